"""The tables of a record as columns: how pictures get arrays of them.

A table is a mapping of fields to columns, one entry per row; tables of groups are named with the group
(`dependence.globals`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray

Tables = Mapping[str, Any]


class NothingToShowError(Exception):
    """Why a record has nothing of what a picture shows."""


def part(tables: Tables, name: str) -> Mapping[str, Any]:
    """Return a table or group by its name, an empty one where the record has none."""
    value: Any = tables
    for step in name.split("."):
        value = (value or {}).get(step)
    return value or {}


def numbers(table: Mapping[str, Any], field: str, *shape: int) -> FloatArray:
    """Return a column of numbers (n, *shape), NaN for null; (0, *shape) of a field that is not there.

    Raises `NothingToShowError` where they are no numbers, or not so many.
    """
    values = table.get(field, ())
    array = getattr(values, "array", None)  # of a run whose record was not read
    if array is not None:
        values = array.astype(float).reshape(-1, *shape)
        return np.where(np.isfinite(values), values, np.nan)
    nothing = np.full(shape, np.nan).tolist()
    try:
        return np.array([nothing if row is None else row for row in values], dtype=float).reshape(-1, *shape)
    except (TypeError, ValueError) as error:
        raise NothingToShowError(f"the field {field} of the record has other things than numbers") from error


def texts(table: Mapping[str, Any], field: str) -> TextArray:
    """Return a column of texts (n,), empty ones for null."""
    values = table.get(field, ())
    array = getattr(values, "array", None)
    if array is not None and array.dtype.kind == "U":
        return np.asarray(array)
    return np.array(["" if value is None else value for value in values], dtype=np.str_)


def flags(table: Mapping[str, Any], field: str, *shape: int) -> BoolArray:
    """Return a column of what is so or not (n, *shape)."""
    values = table.get(field, ())
    array = getattr(values, "array", None)
    return np.array(values if array is None else array, dtype=bool).reshape(-1, *shape)


def at_rows(values: FloatArray, row: IntArray) -> FloatArray:
    """Return the rows (k,) of values (n, ...), NaN for -1."""
    return np.concatenate([values, np.full((1, *values.shape[1:]), np.nan)])[row]


def rows_of(ids: TextArray, names: TextArray) -> IntArray:
    """Return the rows (k,) of names in ids, -1 of one that is not there."""
    row = {name: number for number, name in enumerate(ids.tolist())}
    first = np.flatnonzero(np.append([True] * bool(len(names)), names[1:] != names[:-1]))  # of equal ones in a row
    numbers_of_rows = np.array([row.get(name, -1) for name in names[first].tolist()], dtype=np.int64)
    return np.repeat(numbers_of_rows, np.diff(np.append(first, len(names))))
