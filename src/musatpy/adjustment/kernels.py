"""The switch between numpy and loops compiled by numba (the extra `fast`), which take the points of large blocks.

Both give the same numbers to rounding. numba takes longer to load than a small job to compute; `MUSAT_KERNELS` says
which it is to be.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Iterable

from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.point_loops import Loops
from musatpy.errors import AdjustmentError, Problem

VARIABLE = "MUSAT_KERNELS"
NUMPY, NUMBA = "numpy", "numba"
LARGE = 500  # photos, from which on numba is worth its loading


def loops_of(network: Network, groups: Iterable[PointGroup]) -> Loops:
    """Return the loops over points of a network, compiled ones for a large one. Raises as `name_of`."""
    if name_of(network.photos) == NUMPY:
        return Loops(network=network, groups=tuple(groups))
    from musatpy.adjustment.compiled.loops import CompiledLoops  # numba takes its time

    return CompiledLoops.of(network, groups)


def name_of(photos: int) -> str:
    """Return the name of the kernels for a block of so many photos.

    Raises `AdjustmentError` where the variable asks for what there is not.
    """
    asked = os.environ.get(VARIABLE, "")
    if asked not in ("", NUMPY, NUMBA):
        raise AdjustmentError([Problem(message=f"{VARIABLE} is {asked!r}: it is {NUMPY} or {NUMBA}")])
    if asked == NUMBA and not is_there():
        message = f"{VARIABLE} asks for numba, which is not there: pip install 'musatpy[fast]'"
        raise AdjustmentError([Problem(message=message)])
    return asked or (NUMBA if photos > LARGE and is_there() else NUMPY)


def is_there() -> bool:
    """Return whether numba is installed."""
    return importlib.util.find_spec("numba") is not None
