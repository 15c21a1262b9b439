"""The columns of one table, computed from a solution or read from a record, as a printed table takes them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np

from musatpy.arrays import IntArray

_PART = re.compile(r"\[(\d+)\]|\.?([^.\[\]]+)")
_STEP = re.compile(r"\[(\d+)\]")
_TYPES: Mapping[str, type] = {"integer": np.int64, "number": np.float64, "boolean": np.bool_}
Columns = Mapping[str, Sequence[Any]]


class Values(Mapping[str, Any]):
    """Columns by name, each found when it is first asked for; `position[0]` is a component of one.

    Numbers and flags are arrays (n, ...), NaN for no number; texts are arrays of objects; what is not equally long
    in all rows is a list. Units are those of the record.
    """

    def __init__(
        self, names: Sequence[str], column: Callable[[str], Any], system: str = "", source: Any = None
    ) -> None:
        self.names = names
        self.system = system  # of coordinates of the job
        self.source = source  # what they are computed from; None where they are read
        self.rows: Any = slice(None)  # of the whole table
        self._column = column
        self._known: dict[str, Any] = {}

    def __getitem__(self, path: str) -> Any:
        name = path.partition("[")[0]
        if name not in self.names:
            raise KeyError(name)
        if name not in self._known:
            self._known[name] = self._column(name)
        values = self._known[name]
        for index in map(int, _STEP.findall(path)):
            values = values[:, index] if isinstance(values, np.ndarray) else [row and row[index] for row in values]
        return values

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def count(self) -> int:
        """The number of rows."""
        return len(self[self.names[0]]) if self.names else 0

    def taken(self, rows: IntArray) -> Values:
        """Return some of the rows."""

        def column(name: str) -> Any:
            values = self[name]
            return values[rows] if isinstance(values, np.ndarray) else [values[row] for row in rows.tolist()]

        found = Values(self.names, column, self.system, self.source)
        found.rows = rows if isinstance(self.rows, slice) else self.rows[rows]
        return found


@lru_cache(maxsize=1 << 12)
def keys_of(path: str) -> tuple[str | int, ...]:
    """Return the keys and indices of a path, one after the other."""
    return tuple([int(index) if index else name for index, name in _PART.findall(path)])


def at(value: Any, path: str) -> Any:
    """Return what stands at a path of a record (`position[1]`, `solution.sigma0`), None where there is nothing."""
    for key in keys_of(path):
        if type(key) is int:
            value = value[key] if isinstance(value, list) and key < len(value) else None
        else:
            value = value.get(key) if isinstance(value, dict) else None
    return value


def array_of(kind: str, values: Any) -> Any:
    """Return the values of a column of a kind (see `musatpy.reports.fields`) as `Values` has them."""
    array = values if isinstance(values, np.ndarray) else getattr(values, "array", None)
    if array is not None:
        return array
    sizes, _, base = kind.removesuffix(" or null").rpartition(" ")
    dtype: Any = _TYPES.get(base.removesuffix("?"), object)
    if sizes == "*" or base in ("map", "table"):
        return list(values)
    if dtype is not object and base.endswith("?"):
        dtype = object if base == "boolean?" else np.float64
    if not sizes and dtype is not object:
        return np.array(list(values), dtype=dtype)
    shape = tuple(int(size) for size in sizes.split("x")) if sizes else ()
    blank = None if dtype is object else np.nan if dtype is np.float64 else 0
    out = np.full((len(values), *shape), blank, dtype=dtype)
    for row, value in enumerate(values):
        if value is not None:
            out[row] = value
    return out


def nothing(kind: str, count: int) -> Any:
    """Return a column of a kind without any values, of a record that has not got it."""
    if kind.startswith("*"):
        return [[] for _ in range(count)]
    return array_of(kind if kind.endswith(("?", " or null")) else f"{kind}?", [None] * count)


def in_rows(table: Columns, expand: Sequence[str]) -> Columns:
    """Return columns with a row for each entry of the lists `expand` of each row."""
    if not table or not expand:
        return table
    lengths = [0 if entry is None else len(entry) for entry in table[expand[0]]]
    repeated = list(chain.from_iterable([row] * length for row, length in enumerate(lengths)))
    return {
        name: list(chain.from_iterable(() if entry is None else entry for entry in column))
        if name in expand
        else [column[row] for row in repeated]
        for name, column in table.items()
    }


def unnested(table: Columns, inside: Sequence[Columns], name: str) -> Columns:
    """Return a row for each row of the tables `inside` of the rows, under `name`: with the fields of both."""
    rows = [len(next(iter(inner.values()), ())) for inner in inside]
    repeated = list(chain.from_iterable([row] * count for row, count in enumerate(rows)))
    outer = {field: [column[row] for row in repeated] for field, column in table.items() if field != name}
    fields = dict.fromkeys(chain.from_iterable(inside))
    return outer | {field: list(chain.from_iterable(inner.get(field, ()) for inner in inside)) for field in fields}
