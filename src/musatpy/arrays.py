"""The arrays of the program by what they hold, and work on parts of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
TextArray = NDArray[np.str_]
DateArray = NDArray[np.datetime64]
ComplexArray = NDArray[np.complex128]
ByteArray = NDArray[np.uint8]
Result = TypeVar("Result")


@dataclass(frozen=True, kw_only=True, eq=False)
class InRows:
    """Arrays with one row for each of the same things."""

    def __getitem__(self, which: Any) -> Self:
        """Return the rows that a mask, slice or array of rows chooses."""
        return replace(self, **{field.name: getattr(self, field.name)[which] for field in fields(self)})

    def then(self, other: Self) -> Self:
        """Return the rows of both, one after the other."""
        names = [field.name for field in fields(self)]
        return replace(self, **{n: np.concatenate([getattr(self, n), getattr(other, n)]) for n in names})


def rms(values: FloatArray) -> float:
    """Return the root mean square of what is known of values, NaN of nothing."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(known)))) if len(known) else np.nan


def at_rows(values: FloatArray, row: IntArray) -> FloatArray:
    """Return the rows (k,) of values (n, ...), NaN for -1."""
    return np.concatenate([values, np.full((1, *values.shape[1:]), np.nan)])[row]


def rows_of(ids: TextArray, names: TextArray) -> IntArray:
    """Return the rows (k,) of names in ids, -1 of one that is not there."""
    row = {name: number for number, name in enumerate(ids.tolist())}
    first = np.flatnonzero(np.append([True] * bool(len(names)), names[1:] != names[:-1]))  # of equal ones in a row
    numbers_of_rows = np.array([row.get(name, -1) for name in names[first].tolist()], dtype=np.int64)
    return np.repeat(numbers_of_rows, np.diff(np.append(first, len(names))))


def sums(values: ComplexArray, index: IntArray, size: int) -> ComplexArray:
    """Return (size,) the sums of the values at each index."""
    real = np.bincount(index, weights=values.real, minlength=size)
    imaginary = np.bincount(index, weights=values.imag, minlength=size)
    return real + 1j * imaginary


def in_parts(
    work: Callable[[IntArray], Result], rows: IntArray, refusal: type[Exception]
) -> Iterator[tuple[IntArray, Result | None]]:
    """Yield parts of rows (k,) with what `work` makes of them, None for a single row of which it makes nothing.

    Rows of which it raises a `refusal` are divided in halves.
    """
    if not len(rows):
        return
    try:
        result = work(rows)
    except refusal:
        if len(rows) == 1:
            yield rows, None
            return
        for half in np.array_split(rows, 2):
            yield from in_parts(work, half, refusal)
        return
    yield rows, result
