"""Routines of C that compiled kernels call by their addresses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numba
import numpy as np
from llvmlite import ir
from numba.extending import intrinsic

from musatpy.compiling import inlined


def _call(context: Any, routine: Any, arguments: Any) -> Any:
    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        function = ir.FunctionType(ir.VoidType(), [pointer] * len(arguments))
        addresses = [builder.extract_value(values[1], k) for k in range(len(arguments))]
        builder.call(
            builder.inttoptr(values[0], function.as_pointer()),
            [builder.inttoptr(value, pointer) for value in addresses],
        )
        return context.get_dummy_value()

    return numba.types.void(routine, arguments), code


# call(routine, arguments): the C function without a result at an address, with a tuple of addresses
call = cast(Callable[[int, tuple[int, ...]], None], intrinsic(_call))


@inlined
def address(array: Any) -> int:
    """Return where the elements of an array are: it must outlive their use, which is not seen."""
    return int(np.intp(array.ctypes.data))
