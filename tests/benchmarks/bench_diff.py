"""Two listings of 100,000 lines compared, against reading the same numbers with `float` in the same run.

Run with `pytest -s tests/benchmarks/bench_diff.py`. One core, process time. The peer does the least that any
comparison must: it splits both files into fields and makes numbers of them, without sections, rows, rules.
"""

from __future__ import annotations

import gc
import json
import random
import subprocess
import sys
import time

import pytest

from musatpy.listings import Rules, compare_texts, parse_rules
from musatpy.listings.findings import json_text, junit_text

LINES = 100_000
PAGE = 55
HEAD = """
Residuals Of Plate Measurements: Adjusted Minus Measured{continued}

                             x           y   Resid. x   Resid. y   Sigma x   Sigma y
Photo     Point             mm          mm         um         um        um        um
--------  --------  ----------  ----------  ---------  ---------  --------  --------
"""
TOLERANT = parse_rules("[[rule]]\nname = 'last digits'\nlast_digits = 1\n[[rule]]\nphoto = '17'\nskip = true\n")


def listing(seed: int, *, noise: float = 0.0, inserted: int = -1, headings: bool = True) -> str:
    """Return a listing of residuals; `noise` changes last digits, `inserted` is a row more somewhere."""
    numbers, changes = random.Random(seed), random.Random(seed + 1)
    lines: list[str] = []
    for row in range(LINES):
        if row % PAGE == 0 and headings:
            lines += [f"\fMUSATPY  BENCHMARK{'':80}PAGE {row // PAGE + 1:6d}"]
            lines += HEAD.format(continued=" (continued)" if row else "").split("\n")[:-1]
        x, y = numbers.uniform(-110, 110), numbers.uniform(-110, 110)
        rx, ry = numbers.gauss(0, 5), numbers.gauss(0, 5)
        step = 0.01 if changes.random() < noise else 0.0
        if row == inserted:
            lines.append(f"{9999:<8}  {1:<8}  {x:10.4f}  {y:10.4f}  {rx:9.2f}  {ry:9.2f}  {5:8.2f}  {5:8.2f}")
        ids = f"{row // 60:<8}  {row % 60 + 100:<8}  " if headings else ""
        lines.append(f"{ids}{x:10.4f}  {y:10.4f}  {rx + step:9.2f}  {ry + step:9.2f}  {5:8.2f}  {5:8.2f}")
    return "\n".join(lines) + "\n"


def floats(text: str) -> int:
    """Read every number of a text, as the plainest program would."""
    found = 0
    for line in text.split("\n"):
        for field in line.split():
            try:
                found += float(field) != 0.0
            except ValueError:
                continue
    return found


def shuffled(text: str) -> str:
    """Return a listing with its rows in another order."""
    lines = text.split("\n")
    places = [n for n, line in enumerate(lines) if line[:1].isdigit()]
    rows = [lines[n] for n in places]
    random.Random(1).shuffle(rows)
    for n, row in zip(places, rows, strict=True):
        lines[n] = row
    return "\n".join(lines)


def log(noise: float) -> str:
    """Return lines of words with numbers among them."""
    numbers, words = (
        random.Random(5),
        ["the", "station", "of", "photo", "was", "moved", "by", "about", "metres", "in", "pass", "number"],
    )
    lines = ["LOG OF A RUN", ""]
    for _ in range(LINES):
        row = [numbers.choice(words) for _ in range(8)]
        row.insert(3, f"{numbers.uniform(-100, 100) + noise:.3f}")
        row.insert(6, f"{numbers.uniform(0, 1):.4E}".replace("E", "D"))
        lines.append(" ".join(row))
    return "\n".join(lines)


def record(noise: float) -> str:
    """Return a record with as many plate measurements as `listing` has rows, every number a little different."""
    numbers = random.Random(3)
    rows = [
        {
            "photo": str(n // 60),
            "point": str(100 + n % 60),
            "xy": [numbers.uniform(-110, 110), numbers.uniform(-110, 110)],
            "residual": [numbers.gauss(0, 0.005) + noise, numbers.gauss(0, 0.005) + noise],
            "sigma": [0.005, 0.005],
        }
        for n in range(LINES)
    ]
    return json.dumps({"plates": rows})


def printed(text: str, noise_um: float) -> str:
    """Return the listing of a record."""
    lines = HEAD.format(continued="").split("\n")[:-1]
    for row in json.loads(text)["plates"]:
        (x, y), (rx, ry) = row["xy"], row["residual"]
        ids = f"{row['photo']:<8}  {row['point']:<8}  "
        residuals = f"{rx * 1e3 + noise_um:9.2f}  {ry * 1e3 + noise_um:9.2f}"
        lines.append(f"{ids}{x:10.4f}  {y:10.4f}  {residuals}  {5:8.2f}  {5:8.2f}")
    return "\n".join(lines)


FIFTY = "".join(
    f"[[rule]]\nsection = 'Resid'\ncolumn = '^Resid. {'xy'[n % 2]}'\npoint = '{100 + n}'\nlast_digits = {n}\n"
    f"[[rule]]\nrow = '^{n} .*{n}$'\nphoto = ['{n}', '{n + 1000}']\nat = [{n + 1}, {n + 30}]\nabsolute = {n + 1}\n"
    for n in range(25)
)
IN_SIGMAS = "[[rule]]\nsigmas = 1\n[[rule]]\npoint = '117'\nabsolute = 1e-8\n"
ANY_ORDER = "[[rule]]\norder = 'any'\n[[rule]]\nlast_digits = 1\n"


@pytest.mark.parametrize(
    ("case", "a", "b", "rules", "names"),
    [
        ("50 rules", listing, lambda: listing(306, noise=1.0), FIFTY, ("a", "b")),
        ("another order", listing, lambda: shuffled(listing(306, noise=1.0)), ANY_ORDER, ("a", "b")),
        ("words and numbers", lambda: log(0.0), lambda: log(0.01), "", ("a", "b")),
        ("records", lambda: record(0.0), lambda: record(1e-9), "", ("a.json", "b.json")),
        ("records, by rules", lambda: record(0.0), lambda: record(1e-9), IN_SIGMAS, ("a.json", "b.json")),
        ("listing and record", lambda: printed(record(0.0), 0.01), lambda: record(0.0), "", ("a", "b.json")),
    ],
)
def test_other_shapes_of_100_000_rows(case, a, b, rules, names):
    gc.disable()  # as the program does
    texts = (a(306) if a is listing else a()), b()
    start = time.process_time()
    floats(texts[0].replace(",", " ")), floats(texts[1].replace(",", " "))
    plain = time.process_time() - start
    start = time.process_time()
    found = compare_texts(*texts, parse_rules(rules), names)
    ours = time.process_time() - start
    start = time.process_time()
    size = len(json_text(found)) + len(junit_text(found))
    written = time.process_time() - start
    print(
        f"\n{case}: {ours:.2f} s, {ours / plain:.1f} times float(); {size / 1e6:.0f} MB written in {written:.2f} s"
    )
    # measured: 2 to 9 times
    assert ours + written < 20 * plain


@pytest.mark.parametrize(
    ("case", "noise", "inserted", "headings", "rules"),
    [
        ("equal", 0.0, -1, True, Rules()),
        ("equal, rules that match late", 0.0, -1, True, parse_rules("[[rule]]\nrow = 'NOTHING'\nabsolute = 1\n")),
        ("one row more", 0.0, 40_000, True, Rules()),
        ("every row differs, by rules", 1.0, 40_000, True, TOLERANT),
        ("every row differs", 1.0, 40_000, True, Rules()),
        ("no headings, no ids, every second row differs", 0.5, 40_000, False, Rules()),
    ],
)
def test_listings_of_100_000_lines(case, noise, inserted, headings, rules):
    gc.disable()  # as the program does
    a = listing(306, headings=headings)
    b = listing(306, noise=noise, inserted=inserted, headings=headings)
    start = time.process_time()
    floats(a), floats(b)
    plain = time.process_time() - start
    start = time.process_time()
    found = compare_texts(a, b, rules)
    ours = time.process_time() - start
    print(f"\n{case}: {ours:.2f} s, {ours / plain:.1f} times float() of all fields ({plain:.2f} s)")
    print(f"{found.counts}")
    # measured: 2 to 3 times where files are the same or nearly so, 6 to 10 where every row differs
    assert ours < 20 * plain


MEASURED = """
import gc, json, resource, sys, time
from pathlib import Path
from musatpy.listings import compare_files
gc.disable()
start = time.process_time()
if sys.argv[1] == "json":
    contents = [json.loads(Path(name).read_bytes()) for name in sys.argv[2:]]
else:
    compare_files(*sys.argv[2:4], *sys.argv[4:])
print(time.process_time() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""


def test_records_of_1000_photos(tmp_path):
    """Compare two records of a block, beside what `json` alone takes to read both."""
    from benchmarks.large_blocks import make_block
    from musatpy import adjust
    from musatpy.reports.record import texts_of
    from musatpy.statistics import Statistics

    names = [str(tmp_path / name) for name in ("a.json", "b.json", "rules.toml")]
    for name, block in zip(names[:2], (make_block(1000), make_block(1000)), strict=True):
        with open(name, "w", encoding="utf-8") as file:
            file.writelines(texts_of(Statistics(adjust(block))))
    (tmp_path / "rules.toml").write_text("[[rule]]\nrelative = 1e-6\nabsolute = 1e-9\n", encoding="utf-8")
    size = (tmp_path / "a.json").stat().st_size

    def measured(*arguments):
        done = subprocess.run(
            [sys.executable, "-c", MEASURED, *arguments], check=True, capture_output=True, text=True
        )
        return [float(number) for number in done.stdout.split()]

    plain, memory = measured("json", *names[:2])
    print(f"\n{size / 1e6:.1f} MB each; json.loads of both: {plain:.2f} s, {memory / size:.1f} times the file")
    for case, files in (("the same", names[:2]), ("the same, by rules", names)):
        ours, memory = measured("diff", *files)
        print(f"{case}: {ours:.2f} s, {ours / plain:.2f} of it; {memory / size:.1f} times the file")
        assert ours < 3 * plain  # measured: see docs/performance.md
