"""Which kernels do the work point after point: plain numpy, or loops compiled by numba (the extra `fast`).

Both give the same numbers to rounding. numba takes longer to load than a small block to adjust, so that it does so
for large blocks only, whatever was loaded before; `MUSAT_KERNELS` chooses.
"""

from __future__ import annotations

import importlib.util
import os
from functools import lru_cache
from types import ModuleType

from musatpy.errors import AdjustmentError, Problem

VARIABLE = "MUSAT_KERNELS"
NUMPY, NUMBA = "numpy", "numba"
LARGE = 200  # photos, from which on numba is worth its loading
_COMPILED = "musatpy.adjustment.kernels.points"


def compiled_points(photos: int) -> ModuleType | None:
    """Return the compiled kernels for a block of so many photos, None where numpy does the work.

    Raises `AdjustmentError` where the variable asks for what there is not.
    """
    asked = os.environ.get(VARIABLE, "")
    if asked not in ("", NUMPY, NUMBA):
        raise AdjustmentError([Problem(message=f"{VARIABLE} is {asked!r}: it is {NUMPY} or {NUMBA}")])
    if asked == NUMPY or (not asked and photos <= LARGE):
        return None
    kernels = _loaded()
    if kernels is None and asked == NUMBA:
        message = f"{VARIABLE} asks for numba, which is not there: pip install 'musatpy[fast]'"
        raise AdjustmentError([Problem(message=message)])
    return kernels


def name_of(photos: int) -> str:
    """Return the name of the kernels for a block of so many photos. Raises as `compiled_points`."""
    return NUMPY if compiled_points(photos) is None else NUMBA


@lru_cache(maxsize=1)
def _loaded() -> ModuleType | None:
    """Return the compiled kernels, None without numba, or where it can keep them nowhere."""
    if importlib.util.find_spec("numba") is None:
        return None
    try:
        return importlib.import_module(_COMPILED)
    except RuntimeError:  # neither the folder of the program nor that of the user can be written
        return None
