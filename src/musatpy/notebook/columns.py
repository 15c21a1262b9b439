"""The tables of a record as columns of arrays, by the statements that the record is made of."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import TextArray
from musatpy.reports import record
from musatpy.reports.fields import Each, Field, Group, Node, Rows
from musatpy.statistics import Statistics

_JOB = "record"  # of what stands in no table
_TYPES = {"integer": np.int64, "number": np.float64, "boolean": np.bool_}


@dataclass(frozen=True, kw_only=True, eq=False)
class TableColumn:
    """One field: its values (n, ...) or, of fields that are not equally long in all rows, a list of n lists."""

    name: str
    values: NDArray[Any] | list[Any]
    unit: str
    text: str


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordTable:
    """A table of a record, or an object of it: one row, that has no number."""

    name: str  # as in the record, with points between the names: `plate_statistics.frames`
    columns: tuple[TableColumn, ...]
    is_object: bool

    @property
    def count(self) -> int:
        """The number of rows."""
        return len(self.columns[0].values)

    @property
    def ids(self) -> TextArray | None:
        """What the rows are about, where the first column says it of each; None for others, and for none."""
        first = self.columns[0].values
        if self.is_object or not isinstance(first, np.ndarray) or first.dtype.kind not in "UO" or first.ndim > 1:
            return None
        names: TextArray = first.astype(np.str_)
        return names if len(names) and len(np.unique(names)) == len(names) else None


def tables_of(statistics: Statistics) -> Iterator[RecordTable]:
    """Yield the tables of the record of a solution, those without rows too."""
    yield from _of_object(record.document(as_read=True).whole, "", statistics)


def _of_object(nodes: Iterable[Node[Any]], path: str, item: Any) -> Iterator[RecordTable]:
    """Yield what stands in an object: its fields as a table of one row, if it has any, and its tables."""
    nodes = list(nodes)
    plain = [node for node in nodes if isinstance(node, Field)]
    if plain:
        columns = chain.from_iterable(_columns(field, [] if item is None else [field.of(item)]) for field in plain)
        yield RecordTable(name=path or _JOB, columns=tuple(columns), is_object=True)
    for node in nodes:
        name = f"{path}.{node.name}" if path else node.name
        if isinstance(node, Group):
            yield from _of_object(node.fields, name, None if item is None else node.of(item))
        elif isinstance(node, Rows):
            values = ((field, []) for field in node.recorded) if item is None else node.columns(item)
            columns = chain.from_iterable(_columns(*entry) for entry in values)
            yield RecordTable(name=name, columns=tuple(columns), is_object=False)
        elif isinstance(node, Each):
            yield from _of_each(node, name, [] if item is None else list(node.of(item)))


def _of_each(node: Each[Any, Any], name: str, items: list[Any]) -> Iterator[RecordTable]:
    """Yield a table with a row for each of some things, and the tables that each of these has.

    In front of the columns of the latter stands what the thing is called: its first field.
    """
    plain = [field for field in node.fields if isinstance(field, Field) and field.kind]
    columns = chain.from_iterable(_columns(field, [field.of(item) for item in items]) for field in plain)
    yield RecordTable(name=name, columns=tuple(columns), is_object=False)
    for inner in node.fields:
        if not isinstance(inner, Rows | Each):
            continue
        parts = [list(_of_object([inner], name, item)) for item in [*items, None]]  # None: where there are no items
        for same in zip(*parts, strict=True):
            owners = [
                plain[0].of(item) for item, table in zip(items, same, strict=False) for _ in range(table.count)
            ]
            owner = _columns(plain[0], owners)
            yield RecordTable(
                name=same[0].name,
                columns=(*owner, *(_joined(several) for several in zip(*(t.columns for t in same), strict=True))),
                is_object=False,
            )


def _joined(parts: tuple[TableColumn, ...]) -> TableColumn:
    first = parts[0]
    if isinstance(first.values, list):
        values: Any = list(chain.from_iterable(part.values for part in parts))
    else:
        values = np.concatenate([part.values for part in parts])
    return TableColumn(name=first.name, values=values, unit=first.unit, text=first.text)


def _columns(field: Field[Any], values: Any) -> Iterator[TableColumn]:
    """Yield the column of a field; of numbers by names one for each name."""
    if field.kind == "map":
        for name in dict.fromkeys(chain.from_iterable(values)):
            counts = np.array([row.get(name, 0) for row in values], dtype=np.int64)
            yield TableColumn(name=f"{field.name}[{name}]", values=counts, unit=field.unit, text=field.text)
        return
    yield TableColumn(name=field.name, values=_values(field.kind, values), unit=field.unit, text=field.text)


def _values(kind: str, values: Any) -> NDArray[Any] | list[Any]:
    """Return the values of a kind of field as an array, NaN for no number, or as lists of any length."""
    sizes, _, base = kind.removesuffix(" or null").rpartition(" ")
    dtype: Any = _TYPES.get(base.removesuffix("?"), object)
    if sizes == "*":
        return [list(value) for value in values]
    shape = tuple(int(size) for size in sizes.split("x")) if sizes else ()
    if isinstance(values, np.ndarray) and dtype is not object:
        return values.astype(dtype).reshape(len(values), *shape)
    if dtype is np.float64:
        nothing = np.full(shape, np.nan).tolist()
        values = [nothing if value is None else value for value in values]
    out = np.empty((len(values), *shape), dtype=dtype)
    for row, value in enumerate(values):
        out[row] = value
    return out
