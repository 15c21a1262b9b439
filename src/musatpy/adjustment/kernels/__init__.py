"""The compiled kernels of an adjustment, point after point, and the blocks that are worth their loading."""

from __future__ import annotations

from types import ModuleType

from musatpy.compiling import NUMBA, NUMPY, VARIABLE, compiled_kernels

__all__ = ["LARGE", "NUMBA", "NUMPY", "VARIABLE", "compiled_points", "name_of"]

LARGE = 200  # photos, from which on numba is worth its loading
_COMPILED = "musatpy.adjustment.kernels.points"


def compiled_points(photos: int) -> ModuleType | None:
    """Return the compiled kernels for a block of so many photos, None where numpy does the work.

    Raises as `compiling.compiled_kernels`.
    """
    return compiled_kernels(_COMPILED, worth=photos > LARGE)


def name_of(photos: int) -> str:
    """Return the name of the kernels for a block of so many photos. Raises as `compiled_points`."""
    return NUMPY if compiled_points(photos) is None else NUMBA
