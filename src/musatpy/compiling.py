"""Which kernels do the work: plain numpy, or loops compiled by numba (the extra `fast`); how these are compiled.

Both give the same numbers to rounding. numba takes longer to load than a small job to compute, so that it does so
for large ones only, whatever was loaded before; `MUSAT_KERNELS` chooses.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
from collections.abc import Callable, Iterable, Mapping
from functools import cache, lru_cache
from hashlib import sha256
from importlib.resources import files
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar, cast

from musatpy.errors import AdjustmentError, Problem

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

VARIABLE = "MUSAT_KERNELS"
NUMPY, NUMBA = "numpy", "numba"
Function = TypeVar("Function", bound=Callable[..., object])


def compiled_kernels(module: str, *, worth: bool) -> ModuleType | None:
    """Return a module of compiled kernels where a job is worth their loading, None where numpy does the work.

    Raises `AdjustmentError` where the variable asks for what there is not.
    """
    asked = os.environ.get(VARIABLE, "")
    if asked not in ("", NUMPY, NUMBA):
        raise AdjustmentError([Problem(message=f"{VARIABLE} is {asked!r}: it is {NUMPY} or {NUMBA}")])
    if asked == NUMPY or (not asked and not worth):
        return None
    kernels = _loaded(module)
    if kernels is None and asked == NUMBA:
        message = f"{VARIABLE} asks for numba, which is not there: pip install 'musatpy[fast]'"
        raise AdjustmentError([Problem(message=message)])
    return kernels


@lru_cache
def _loaded(module: str) -> ModuleType | None:
    """Return compiled kernels, None without numba, or where it can keep them nowhere."""
    if importlib.util.find_spec("numba") is None:
        return None
    try:
        return importlib.import_module(module)
    except RuntimeError:  # neither the folder of the program nor that of the user can be written
        return None


def compiled(function: Function) -> Function:
    """Return a function compiled by numba, kept from run to run; other threads run while it computes.

    Divisions by zero give infinities, as those of numpy do. The order of sums is that of the source.
    """
    import numba  # an extra, which loads when kernels do

    kernel = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    # numba would compile anew for changes of its own file only, and not of those whose pieces are a part of it
    cast(Any, kernel)._cache._cache_file._source_stamp = _stamp()
    return cast(Function, kernel)


def sources() -> list[Traversable]:
    """Return the files that kernels are compiled from."""
    package = files("musatpy")
    kernels = package.joinpath("adjustment", "kernels").iterdir()
    inside = sorted((file for file in kernels if file.name.endswith(".py")), key=lambda file: file.name)
    return [package.joinpath("compiling.py"), package.joinpath("refraction", "compiled_flat.py"), *inside]


@cache
def _stamp() -> bytes:
    """Return what is another one when a source of kernels is."""
    return sha256(b"".join(source.read_bytes() for source in sources())).digest()


def inlined(function: Function) -> Function:
    """Return the same for a piece of kernels, which becomes part of them: arrays cost much to hand on.

    It is compiled once for all constants that it is called with; what does not depend on variables is dropped where
    it has become a part. Pieces make no arrays, so that none that they take needs to be counted: that is an atomic
    addition each time, which takes longer than a ray.
    """
    import numba

    njit = cast(Any, numba.njit)  # whose types leave out `_nrt`, the counting
    piece: Any = njit(nogil=True, error_model="numpy", forceinline=True, _nrt=False)(function)
    template, variable = piece.get_call_template, cast(Any, numba.types.unliteral)

    def of_variables(args: Iterable[Any], kws: Mapping[str, Any]) -> Any:
        return template(tuple(map(variable, args)), {name: variable(kind) for name, kind in kws.items()})

    piece.get_call_template = of_variables
    return cast(Function, piece)
