"""Plate cards per second, against pandas and fortranformat in the same run.

Run with `pytest -s tests/benchmarks/bench_cards.py`. All on one core, best of several runs; also that every field
is what `float()` makes of it, and how much memory it takes.
"""

from __future__ import annotations

import subprocess
import sys
import time
import tracemalloc

import numpy as np
import pytest

from musatpy.formats.cards.deck import read_cards, write_cards
from musatpy.formats.cards.spec import card_formats_folder, load_family

pandas = pytest.importorskip("pandas")
fortranformat = pytest.importorskip("fortranformat")

CARDS = 500_000
SLOW_CARDS = 5_000  # of fortranformat, which is scaled up
FORTRAN_FORMAT = "(A3, 1X, A8, 1X, A8, F12.7, F12.7, 1X, F7.5, F7.5, 1X, A1, A1)"


@pytest.fixture(scope="module")
def family():
    return load_family(card_formats_folder() / "musat")


@pytest.fixture(scope="module")
def columns():
    """Plate measurements of a large block: every sigma given, a third of the points bathymetric."""
    rng = np.random.default_rng(306)
    return {
        "photo": np.repeat(np.arange(CARDS // 100), 100).astype("U8"),
        "point": rng.integers(0, 10**8, CARDS).astype("U8"),
        "x": rng.uniform(-115, 115, CARDS).round(6),
        "y": rng.uniform(-115, 115, CARDS).round(6),
        "sigma_x": rng.uniform(0.002, 0.05, CARDS).round(5),
        "sigma_y": rng.uniform(0.002, 0.05, CARDS).round(5),
        "bathymetric": np.where(rng.random(CARDS) < 1 / 3, "B", ""),
        "not_triangulated": np.where(rng.random(CARDS) < 0.1, "N", ""),
    }


@pytest.fixture(scope="module")
def path(family, columns, tmp_path_factory):
    path = tmp_path_factory.mktemp("cards") / "large.crd"
    path.write_bytes(write_cards([(family.cards["PLT"], columns)]))
    return path


def best_rate(cards: int, action, repeats: int) -> float:
    """Cards per second of the fastest of several runs, in the time of this process."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return cards / min(times)


def read_with_pandas(path, family):
    """Read the same columns with pandas, texts as texts."""
    fields = family.cards["PLT"].fields
    return pandas.read_fwf(
        path,
        colspecs=[(field.first - 1, field.last) for field in fields],
        names=[field.name for field in fields],
        header=None,
        dtype={field.name: float if field.edit.is_number else str for field in fields},
    )


def test_plate_cards_per_second(path, family):
    lines = path.read_text(encoding="ascii").splitlines()[:SLOW_CARDS]
    reader = fortranformat.FortranRecordReader(FORTRAN_FORMAT)
    ours = best_rate(CARDS, lambda: read_cards(path, family), 7)
    pandas_rate = best_rate(CARDS, lambda: read_with_pandas(path, family), 2)
    fortran_rate = best_rate(SLOW_CARDS, lambda: [reader.read(line) for line in lines], 2)
    print(f"\nread_cards {ours:,.0f} cards/s")
    print(f"pandas.read_fwf {pandas_rate:,.0f} cards/s: read_cards is {ours / pandas_rate:.1f} times as fast")
    print(f"fortranformat {fortran_rate:,.0f} cards/s: read_cards is {ours / fortran_rate:.1f} times as fast")
    assert ours >= 3 * pandas_rate
    assert ours >= 10 * fortran_rate


@pytest.mark.parametrize("form", ["bare", "other point", "exponents"])
def test_other_forms_of_cards(path, family, form):
    # Not of the fast form; printed for the record, with the rate of pandas as the bound.
    changed = {
        "bare": lambda line: line[:72].rstrip(),
        "other point": lambda line: line[:44] + " " + line[45:],
        "exponents": lambda line: line[:40] + "E+00 " + line[45:],
    }[form]
    lines = [changed(line) for line in path.read_text(encoding="ascii").splitlines()]
    data = "\n".join(lines).encode("ascii")
    rate = best_rate(CARDS, lambda: read_cards(data, family), 3)
    sample = path.with_name("sample.crd")
    sample.write_bytes("\n".join(lines[: CARDS // 10]).encode("ascii"))
    pandas_rate = best_rate(CARDS // 10, lambda: read_with_pandas(sample, family), 2)
    print(f"\n{form}: {rate:,.0f} cards/s; pandas.read_fwf {pandas_rate:,.0f}")
    assert rate > pandas_rate


def test_every_field_is_what_float_makes_of_it(path, family):
    table = read_cards(path, family).tables["PLT"]
    lines = path.read_text(encoding="ascii").splitlines()
    for field in family.cards["PLT"].fields:
        texts = [line[field.first - 1 : field.last] for line in lines]
        column = table[field.name]
        if field.edit.is_number:
            expected = np.array([float(text) for text in texts])
            assert np.array_equal(column.view(np.int64), expected.view(np.int64))
        else:
            assert column.tolist() == [text.strip() for text in texts]


def test_plate_cards_written_per_second(path, family, columns):
    rate = best_rate(CARDS, lambda: write_cards([(family.cards["PLT"], columns)]), 3)
    print(f"\nwrite_cards {rate:,.0f} cards/s")
    assert rate >= 200_000


MEASURE_RESIDENT = """
import sys
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.cards.spec import card_formats_folder, load_family
def high_water():
    return next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM"))
family = load_family(card_formats_folder() / "musat")
before = high_water()
deck = read_cards(sys.argv[1], family)
print(high_water() - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads the high-water mark of /proc")
def test_memory(path, family):
    size = path.stat().st_size
    tracemalloc.start()
    deck = read_cards(path, family)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    command = [sys.executable, "-c", MEASURE_RESIDENT, str(path)]
    resident = 1024 * int(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    print(f"\n{len(deck.lines['PLT']):,} cards, {size / 1e6:.1f} MB")
    print(f"{peak / size:.2f} times the file allocated, {resident / size:.2f} times resident")
    assert peak <= 4 * size
    assert resident <= 4 * size
