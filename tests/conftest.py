"""What every test process needs.

One BLAS thread each: the matrices are small, and the processes of a parallel run share the cores. Bytecode is kept,
whatever the user keeps: the many runs of the program as a process of its own would each compile it anew.
Equal blocks are adjusted once.
"""

import os
import pickle
import sys

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

import pytest  # noqa: E402  # after the threads are set

import musatpy.adjustment  # noqa: E402
from musatpy.adjustment import programs  # noqa: E402

_adjust, _solutions = programs.adjust, {}
_patched = False


@pytest.fixture(autouse=True)
def _as_it_is(request):
    """Have tests that put something in the place of a part of the program adjust anew."""
    global _patched
    _patched = "monkeypatch" in request.fixturenames


def _adjusted_once(block, progress=None, sea=None):
    """Adjust a block that was not adjusted before, or is watched; a solution is frozen, and may be shared."""
    if progress is not None or sea is not None or _patched:
        return _adjust(block, progress, sea)
    key = pickle.dumps(block)
    if key not in _solutions:
        _solutions[key] = _adjust(block)
    return _solutions[key]


programs.adjust = musatpy.adjustment.adjust = _adjusted_once
