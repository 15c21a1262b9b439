"""Arrays -> what JSON can hold; numbers that do not exist (NaN) are null."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

Json = Any
Rows = list[dict[str, Json]]


def plain(values: NDArray[Any]) -> list[Json]:
    """Return an array as nested lists, numbers that do not exist as None."""
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        kept = values.astype(object)
        kept[~np.isfinite(values)] = None
        return list(kept.tolist())
    return list(values.tolist())


def rounded(values: Any, digits: int | None) -> list[Json]:
    """Return a column as nested lists, its numbers at so many significant digits; None: as they are."""
    if digits is None or (isinstance(values, np.ndarray) and values.dtype.kind != "f"):
        return plain(values) if isinstance(values, np.ndarray) else list(values)
    if isinstance(values, np.ndarray):
        texts = (f"%.{digits}g " * values.size) % tuple(values.ravel().tolist())
        return plain(np.array(texts.split(), dtype=float).reshape(values.shape))
    return [_rounded(value, digits) for value in values]


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
    return [kind(int(value)).name.lower() for value in values]
