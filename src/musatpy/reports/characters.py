"""Columns of print as characters: an array (n, width) of code points, whole columns at once.

What it cannot edit as exactly as `fortran.write_number` does is not marked as done, and is left to that: what does
not fit, and what is so near to a tie that the product with a power of ten does not tell which way it is rounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import BoolArray, FloatArray, TextArray

Characters = NDArray[np.uint32]  # (n, width)

_BLANK, _MINUS, _POINT, _ZERO = map(ord, " -.0")
_EXACT = 1e15  # whole numbers below it are exact, and so are their halves
_SPACING = 2.0**-52


def blank(rows: int, width: int) -> Characters:
    """Return a column of blanks."""
    return np.full((width, rows), _BLANK, dtype=np.uint32).T  # filled character by character


def of_texts(texts: Sequence[str] | TextArray, width: int) -> Characters:
    """Return texts (n,), each cut or filled with blanks behind it."""
    table: Any = np.array(texts, dtype=f"U{width}").reshape(-1, 1).view(np.uint32)
    return np.where(table == 0, np.uint32(_BLANK), table)


def strings(table: Characters) -> list[str]:
    """Return the rows of characters as texts."""
    whole: Any = np.ascontiguousarray(table).view(f"U{table.shape[1]}")
    return list(whole.ravel().tolist())


def fixed(values: FloatArray, width: int, decimals: int) -> tuple[Characters, BoolArray]:
    """Return numbers (n,) with decimals, none of them wider than leaves a blank, and which (n,) are done.

    There is no zero before the point, no sign of what rounds to zero, and nothing but blanks of NaN.
    """
    room = width - decimals
    limit = 10.0 ** (room - 2) - 1.0 if decimals and room > 3 else 0.0
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.abs(values)
        scaled = size * 10.0**decimals
        nearest = np.rint(scaled)
        done = (size < limit) & (scaled < _EXACT) & (np.abs(np.abs(scaled - nearest) - 0.5) > _SPACING * scaled)
    table, number = blank(len(values), width), _whole(nearest, done)
    left = _digits(table, number, width, decimals)
    point = width - decimals - 1
    table[:, point] = _POINT
    _signed(table, left, (values < 0.0) & (number > 0), point, least=0)
    nothing = np.isnan(values)
    table[nothing] = _BLANK
    return table, done | nothing


def whole_numbers(values: NDArray[Any], negative: BoolArray, width: int) -> tuple[Characters, BoolArray]:
    """Return whole numbers (n,), none wider than leaves a blank, with signs where told, and which (n,) are done."""
    with np.errstate(invalid="ignore"):
        size = np.abs(values)
        done = size < min(10.0 ** (width - 1), _EXACT) if width > 1 else np.zeros(len(values), dtype=bool)
    table = blank(len(values), width)
    _signed(table, _whole(size, done), negative & done, width, least=1)
    return table, done


def _whole(size: NDArray[Any], done: BoolArray) -> NDArray[Any]:
    """Return whole numbers, zero where they are not done; short ones are divided in half the time."""
    number = np.where(done, size, 0).astype(np.int64)
    return number.astype(np.uint32) if number.max(initial=0) < 2**32 else number


def _digits(table: Characters, number: NDArray[Any], end: int, count: int) -> NDArray[Any]:
    """Write the last `count` digits of numbers before the column `end`; return what is left of the numbers."""
    for column in range(end - 1, end - 1 - count, -1):
        left = number // 10
        table[:, column] = number - 10 * left + _ZERO
        number = left
    return number


def _signed(table: Characters, number: NDArray[Any], negative: BoolArray, end: int, *, least: int) -> None:
    """Write whole numbers before the column `end`, of `least` digits, and the signs before them."""
    first = np.full(len(number), end)
    for column in range(end - 1, -1, -1):
        shown = number > 0 if column < end - least else np.ones(len(number), dtype=bool)
        if not shown.any():
            break
        left = number // 10
        table[:, column] = np.where(shown, number - 10 * left + _ZERO, _BLANK)
        first -= shown
        number = left
    rows = np.flatnonzero(negative)
    table[rows, first[rows] - 1] = _MINUS
