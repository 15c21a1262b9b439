"""The decorators of compiled kernels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Return a function compiled by numba, kept from run to run; other threads run while it computes.

    Divisions by zero give infinities, as those of numpy do. The order of sums is that of the source.
    """
    return cast(Function, numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def inlined(function: Function) -> Function:
    """Return the same for a piece of kernels, which becomes part of them: arrays cost much to hand on.

    It is compiled once for all constants that it is called with; what does not depend on variables is dropped where
    it has become a part. Pieces make no arrays, so that none that they take needs to be counted: that is an atomic
    addition each time, which takes longer than a ray.
    """
    njit = cast(Any, numba.njit)  # whose types leave out `_nrt`, the counting
    piece: Any = njit(nogil=True, error_model="numpy", forceinline=True, _nrt=False)(function)
    template, variable = piece.get_call_template, cast(Any, numba.types.unliteral)

    def of_variables(args: Iterable[Any], kws: Mapping[str, Any]) -> Any:
        return template(tuple(map(variable, args)), {name: variable(kind) for name, kind in kws.items()})

    piece.get_call_template = of_variables
    return cast(Function, piece)
