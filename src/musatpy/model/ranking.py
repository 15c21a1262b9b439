"""Rows by falling numbers as they are printed: rounding errors, which differ by kernels, order nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray, IntArray

_DIGITS = 6  # significant ones, where a number is not printed


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
