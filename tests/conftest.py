"""What every test process needs.

One BLAS thread each: the matrices are small, and the processes of a parallel run share the cores. Bytecode is kept,
whatever the user keeps: the many runs of the program as a process of its own would each compile it anew.
Equal decks are read once, and equal blocks adjusted once.
"""

import os
import pickle
import sys
from pathlib import Path

import pytest

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

_known = {}
_patched = False


def once(key, work):
    """Return what the work of a key has returned before: decks and solutions are frozen, and may be shared."""
    if _patched or key is None:
        return work()
    if key not in _known:
        _known[key] = work()
    return _known[key]


def pytest_configure():
    """Have equal decks read and equal blocks adjusted once, before others take the functions by their names."""
    import musatpy.adjustment  # after the threads are set
    from musatpy.adjustment import job
    from musatpy.formats import musat

    adjust, checked_deck = job.adjust, musat.checked_deck

    def adjust_once(block, progress=None, sea=None):
        key = pickle.dumps(block) if progress is None and sea is None else None
        return once(key, lambda: adjust(block, progress, sea))

    def checked_once(source, family=None, *, for_run=True, **more):
        key, path = None, Path(source) if isinstance(source, str | Path) else None
        plain = family in (None, musat.card_family()) and not any(more.values())
        if plain and (isinstance(source, bytes) or (path and path.is_file())):
            key = path, path.read_bytes() if path else source, for_run
        return once(key, lambda: checked_deck(source, family, for_run=for_run, **more))

    job.adjust = musatpy.adjustment.adjust = adjust_once
    musat.checked_deck = checked_once


def pytest_runtest_setup(item):
    """Have tests that put something in the place of a part of the program adjust anew."""
    global _patched
    _patched = "monkeypatch" in item.fixturenames


@pytest.fixture(scope="session")
def run_record(tmp_path_factory):
    """The record of the run of St. Thomas, in a folder of its own: for tests that only read it."""
    from musatpy.runs import run_deck

    deck = Path(__file__).parents[1] / "fixtures" / "st_thomas" / "st_thomas.crd"
    return run_deck(deck, tmp_path_factory.mktemp("st_thomas")).record
