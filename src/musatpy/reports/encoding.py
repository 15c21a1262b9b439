"""Arrays -> what JSON can hold; numbers that do not exist (NaN) are null."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import FloatArray

Json = Any
_FACTORS = np.array([float(10**power) for power in range(23)])  # all powers of ten that a double holds exactly
_LOWEST = -11  # exponent of the smallest numbers of twelve digits that these bring to whole ones
_POWERS = np.array([float(f"1e{exponent}") for exponent in range(_LOWEST, 16)])
Rows = list[dict[str, Json]]


def plain(values: NDArray[Any]) -> list[Json]:
    """Return an array as nested lists, numbers that do not exist as None."""
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        kept = values.astype(object)
        kept[~np.isfinite(values)] = None
        return list(kept.tolist())
    return list(values.tolist())


def rounded(values: Any, digits: int | None) -> Any:
    """Return a column, an array or lists, with its numbers at so many significant digits; None: as they are."""
    if digits is None:
        return values
    if isinstance(values, np.ndarray):
        return _to_digits(values, digits) if values.dtype.kind == "f" else values
    return [_rounded(value, digits) for value in values]


def _to_digits(values: FloatArray, digits: int) -> FloatArray:
    """Return the doubles that are nearest to numbers of so many significant digits.

    Those of usual size by a power of ten that a double holds exactly, so that the quotient is rounded but once; a
    number within a unit of the sixteenth digit of a tie may go either way.
    """
    size = np.abs(values)
    usual = (size >= _POWERS[0]) & (size < 10.0**digits)
    numbers = np.where(usual, values, 1.0)
    first = np.searchsorted(_POWERS, np.abs(numbers), side="right") - 1 + _LOWEST  # exponents of the first digits
    factor = _FACTORS[digits - 1 - first]
    found = np.where(usual, np.rint(numbers * factor) / factor, values)
    for place in zip(*np.nonzero(~usual & np.isfinite(values) & (values != 0.0)), strict=True):
        found[place] = float(f"{values[place]:.{digits}g}")
    return found


def _rounded(value: Json, digits: int) -> Json:
    if isinstance(value, list):
        return [_rounded(entry, digits) for entry in value]
    return float(f"{value:.{digits}g}") if isinstance(value, float) else value


def number(value: float) -> float | None:
    """Return a number, None where it does not exist."""
    return float(value) if math.isfinite(value) else None


def rows(**columns: NDArray[Any] | Sequence[Json]) -> Rows:
    """Return a table of columns as one dictionary per row."""
    columned = [plain(column) if isinstance(column, np.ndarray) else column for column in columns.values()]
    return [dict(zip(columns, row, strict=True)) for row in zip(*columned, strict=True)]


def names(kind: type[IntEnum], values: Iterable[int]) -> list[str]:
    """Return the names of the members of an enumeration, in small letters."""
    members = {int(member): member.name.lower() for member in kind}
    return [members[value] for value in np.asarray(values).tolist()]
