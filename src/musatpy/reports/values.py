"""The columns of one table, computed from a solution or read from a record, and what JSON holds of them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property, lru_cache
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import FloatArray, IntArray
from musatpy.records import tables

Json = Any
_FACTORS = np.array([float(10**power) for power in range(23)])  # all powers of ten that a double holds exactly
_LOWEST = -11  # exponent of the smallest numbers of twelve digits that these bring to whole ones
_POWERS = np.array([float(f"1e{exponent}") for exponent in range(_LOWEST, 16)])


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


def rows(**columns: NDArray[Any] | Sequence[Json]) -> list[dict[str, Json]]:
    """Return a table of columns as one dictionary per row."""
    columned = [plain(column) if isinstance(column, np.ndarray) else column for column in columns.values()]
    return [dict(zip(columns, row, strict=True)) for row in zip(*columned, strict=True)]


def names(kind: type[IntEnum], values: Iterable[int]) -> list[str]:
    """Return the names of the members of an enumeration, in small letters."""
    members = {int(member): member.name.lower() for member in kind}
    return [members[value] for value in np.asarray(values).tolist()]


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
    shape = tuple(int(size) for size in sizes.split("x")) if sizes else ()
    if dtype is np.float64:
        return tables.array_of(values, *shape)
    if not sizes and dtype is not object:
        return np.array(list(values), dtype=dtype)
    out = np.full((len(values), *shape), None if dtype is object else 0, dtype=dtype)
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


@dataclass(frozen=True, eq=False)
class LazyColumn(Sequence[Json]):
    """A column of a table, whose entries are those of the record."""

    of: Callable[[], Any]  # its values, an array or a list
    digits: int | None  # significant ones, as of `rounded`

    @cached_property
    def _values(self) -> Any:
        values = rounded(self.of(), self.digits)
        return values if isinstance(values, np.ndarray) else list(values)

    @property
    def array(self) -> NDArray[Any] | None:
        """The column as an array, whose numbers that do not exist are not finite; None where it is a list."""
        return self._values if isinstance(self._values, np.ndarray) else None

    def __len__(self) -> int:
        return len(self._values)

    def __iter__(self) -> Iterator[Json]:
        return iter(self[:])

    def __getitem__(self, rows: Any) -> Any:
        found = self._values[rows]
        if isinstance(found, np.ndarray):
            return plain(found)
        entry = found.item() if isinstance(found, np.generic) else found
        return None if isinstance(entry, float) and not math.isfinite(entry) else entry
