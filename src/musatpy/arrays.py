"""The arrays of the program by what they hold; rows in order of numbers.

Rows by falling numbers are by numbers as they are printed: rounding errors, which differ by kernels, order nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
TextArray = NDArray[np.str_]
DateArray = NDArray[np.datetime64]
ComplexArray = NDArray[np.complex128]
ByteArray = NDArray[np.uint8]
WordArray = NDArray[np.uint64]

_DIGITS = 6  # significant ones, where a number is not printed


def order_of(numbers: IntArray) -> IntArray:
    """Return the order (k,) of whole numbers (k,), equal ones as they stand.

    They are sorted as one number with their rows, which is several times as fast as a stable `argsort`.
    """
    bits = len(numbers).bit_length()
    if len(numbers) and max(int(numbers.max()), -int(numbers.min())) >> (63 - bits):
        return np.argsort(numbers, kind="stable")  # there is no room for the rows
    key = (numbers << bits) | np.arange(len(numbers))
    key.sort()
    return key & ((1 << bits) - 1)


def finite_rows(rows: FloatArray) -> BoolArray:
    """Return which rows (n,) of three components (n, 3) are finite: their sum is, in a tenth of the time."""
    return np.isfinite(rows[:, 0] + rows[:, 1] + rows[:, 2])


def falling(size: ArrayLike, decimals: int | None = None) -> IntArray:
    """Return the rows (n,) by falling size (n,), equal ones in their own order, those without one (NaN) last.

    Equal are sizes that print alike in so many `decimals`; without these, in six significant digits.
    """
    given = np.nan_to_num(np.asarray(size, dtype=float), nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    with np.errstate(over="ignore"):  # of runs that have lost their way
        rounded = _significant(given) if decimals is None else np.round(given, decimals)
    return np.lexsort((np.arange(len(given)), -rounded))


def largest(size: ArrayLike) -> int:
    """Return the row of the largest size (n,), the first of equal ones in six significant digits."""
    return int(falling(size)[0])


def _significant(size: FloatArray) -> FloatArray:
    """Return sizes rounded to six significant digits."""
    finite = np.isfinite(size) & (size != 0.0)
    place = np.floor(np.log10(np.abs(size), where=finite, out=np.zeros_like(size))) - (_DIGITS - 1)
    unit = 10.0**place
    return np.where(finite, np.round(size / unit) * unit, size)
