"""The tables of a record as columns: how all who read records get arrays of them.

A table is a mapping of fields to columns, one entry per row; tables of groups are named with the group
(`dependence.globals`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray

Tables = Mapping[str, Any]


def part(tables: Tables, name: str) -> Mapping[str, Any]:
    """Return a table or group by its name, an empty one where the record has none."""
    value: Any = tables
    for step in name.split("."):
        value = (value or {}).get(step)
    return value or {}


def numbers(table: Mapping[str, Any], field: str, *shape: int) -> FloatArray:
    """Return a column of numbers (n, *shape), NaN for null; (0, *shape) of a field that is not there."""
    values = table.get(field, ())
    array = getattr(values, "array", None)  # of a run whose record was not read
    if array is not None:
        values = array.astype(float).reshape(-1, *shape)
        return np.where(np.isfinite(values), values, np.nan)
    return array_of(values, *shape)


def array_of(values: Iterable[Any], *shape: int) -> FloatArray:
    """Return values of a record (n, *shape) as numbers, NaN for null."""
    nothing = np.full(shape, np.nan).tolist()
    return np.array([nothing if value is None else value for value in values], dtype=float).reshape(-1, *shape)


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


class NamedRows:
    """A table of a record whose rows have names."""

    def __init__(self, key: str, table: Mapping[str, Any]) -> None:
        self.table = table
        self.rows = {name: row for row, name in enumerate(table[key])}

    def common(self, other: NamedRows) -> list[str]:
        """Return the names that another table has too, in the order of this one."""
        return [name for name in self.rows if name in other.rows]

    def array(self, ids: Iterable[str], field: str, *shape: int) -> FloatArray:
        """Return the values of named rows (n, *shape), NaN for null."""
        column = self.table[field]
        return array_of([column[self.rows[name]] for name in ids], *shape)

    def row(self, name: str) -> dict[str, Any] | None:
        """Return a row, None where there is none of the name."""
        number = self.rows.get(name)
        return None if number is None else {field: column[number] for field, column in self.table.items()}

    def why_not(self, name: str) -> str | None:
        """Return why a row has no position; None where it has one."""
        if name not in self.rows:
            return "is not there"
        row = self.rows[name]
        if "position" not in self.table or self.table["position"][row][0] is not None:
            return None
        return f"is not determined: {self.table['reason'][row] or 'no position'}"
