"""Work on points of which waves may refuse some: done in parts, so that only these are lost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from musatpy.arrays import IntArray
from musatpy.errors import AdjustmentError

Result = TypeVar("Result")


def in_parts(work: Callable[[IntArray], Result], rows: IntArray) -> Iterator[tuple[IntArray, Result | None]]:
    """Yield parts of rows (k,) with what `work` makes of them, None for a single row of which it makes nothing.

    Rows of which it raises `AdjustmentError` are divided in halves.
    """
    if not len(rows):
        return
    try:
        result = work(rows)
    except AdjustmentError:
        if len(rows) == 1:
            yield rows, None
            return
        for half in np.array_split(rows, 2):
            yield from in_parts(work, half)
        return
    yield rows, result
