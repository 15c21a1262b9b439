"""What every test process needs.

One BLAS thread each: the matrices are small, and the processes of a parallel run share the cores. Bytecode is kept,
whatever the user keeps: the many runs of the program as a process of its own would each compile it anew.
Equal blocks are adjusted once.
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

_adjusted = {}
_patched = False


def pytest_configure():
    """Have equal blocks adjusted once: a solution is frozen, and may be shared."""
    import musatpy.adjustment  # after the threads are set
    from musatpy.adjustment import job

    adjust = job.adjust

    def adjust_once(block, progress=None, sea=None):
        if progress is not None or sea is not None or _patched:
            return adjust(block, progress, sea)
        key = pickle.dumps(block)
        if key not in _adjusted:
            _adjusted[key] = adjust(block)
        return _adjusted[key]

    job.adjust = musatpy.adjustment.adjust = adjust_once


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
