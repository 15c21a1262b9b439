"""The decorators of compiled kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Return a function compiled by numba, kept from run to run; other threads run while it computes.

    Divisions by zero give infinities, as those of numpy do. The order of sums is that of the source.
    """
    return cast(Function, numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def inlined(function: Function) -> Function:
    """Return the same for a piece of kernels, which becomes part of them: arrays cost much to hand on."""
    return cast(Function, numba.njit(nogil=True, error_model="numpy", forceinline=True)(function))
