"""The decorators of compiled kernels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar, cast

import numba
import numpy as np
from llvmlite import ir
from numba.extending import intrinsic

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


def _call(context: Any, routine: Any, arguments: Any) -> Any:
    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        function = ir.FunctionType(ir.VoidType(), [pointer] * len(arguments))
        addresses = [builder.extract_value(values[1], k) for k in range(len(arguments))]
        builder.call(
            builder.inttoptr(values[0], function.as_pointer()),
            [builder.inttoptr(one, pointer) for one in addresses],
        )
        return context.get_dummy_value()

    return numba.types.void(routine, arguments), code


# call(routine, arguments): the C function without a result at an address, with a tuple of addresses
call = cast(Callable[[int, tuple[int, ...]], None], intrinsic(_call))


@inlined
def address(array: Any) -> int:
    """Return where the elements of an array are: it must outlive their use, which is not seen."""
    return int(np.intp(array.ctypes.data))
