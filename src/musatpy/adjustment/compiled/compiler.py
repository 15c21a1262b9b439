"""How loops are compiled by numba, and kept from run to run."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Return a compiled function, kept from run to run; other threads run while it computes.

    Divisions by zero give infinities, as those of numpy do. The order of sums is that of the source.
    """
    kernel = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    # numba would compile anew for changes of its own file only, and not of those whose pieces are a part of it
    cast(Any, kernel)._cache._cache_file._source_stamp = _stamp()
    return cast(Function, kernel)


def piece(function: Function) -> Function:
    """Return the same for a piece that becomes part of others.

    Pieces make no arrays, so that none that they take needs to be counted: that is an atomic addition each time,
    which takes longer than a ray.
    """
    njit = cast(Any, numba.njit)  # whose types leave out `_nrt`, the counting
    return cast(Function, njit(nogil=True, error_model="numpy", forceinline=True, _nrt=False)(function))


def is_kept(kernel: Callable[..., object]) -> bool:
    """Return whether a function that was compiled in a run before is as its source is now."""
    return bool(cast(Any, kernel)._cache._cache_file._load_index())


@cache
def _stamp() -> bytes:
    """Return what is another one when a source of this folder is."""
    return sha256(b"".join(source.read_bytes() for source in sorted(Path(__file__).parent.glob("*.py")))).digest()
