"""A JSON file as tables, by rows or by columns: rows with ids, fields with paths, numbers as they are written."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any

from musatpy.errors import Problem
from musatpy.image_observations import FIELDS, are_apart, with_images
from musatpy.listings.json_text import Column, Number
from musatpy.listings.lines import CannotCompareError

TOP = "(top)"
# Fields that may name what a row is about: as many of them, in this order, as tell all rows of a table apart.
_ID_FIELDS = (
    "id", "ids", "name", "pass", "number", "photo", "point", "camera", "mark", "group", "photos", "points",
    "unknown", "first", "second", "kind", "of", "component", "wave", "parameter", "quantity", "marks", "cross",
    "model", "root", "sounding",
)  # fmt: skip
_ID_NAMES = frozenset(_ID_FIELDS)
_PART = re.compile(r"\[(\d+)\]|\.?([^.\[\]]+)")
_CONTAINERS = frozenset({list, dict})


class RecordTable:
    """Rows of a record by their ids."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __len__(self) -> int:
        """Return the number of rows."""
        raise NotImplementedError

    @property
    def names(self) -> Collection[str]:
        """The names of the fields that all rows have."""
        raise NotImplementedError

    def entries(self, name: str) -> Sequence[Any]:
        """Return the values of a field, one per row."""
        raise NotImplementedError

    def row(self, n: int, names: Collection[str] | None = None) -> dict[str, Any]:
        """Return a row; with `names` it may have no other fields than these."""
        raise NotImplementedError

    @cached_property
    def id_fields(self) -> tuple[str, ...]:
        """The fields that name the rows."""
        names: tuple[str, ...] = ()
        for name in _ID_FIELDS:
            if name in self.names and len(self):
                names = (*names, name)
                if len(set(map(repr, self._named(names)))) == len(self):
                    break
        return names

    @cached_property
    def ids(self) -> list[tuple[str, ...]]:
        """The names of each row, none where there is only one row."""
        if not self.id_fields:
            return [()] * len(self)
        return [tuple([text for value in row for text in texts_of(value)]) for row in self._named(self.id_fields)]

    def _named(self, names: Sequence[str]) -> Iterator[tuple[Any, ...]]:
        return zip(*[self.entries(name) for name in names], strict=True)

    def label(self, n: int) -> str:
        """Return what a row is called: its ids behind the names of their fields, or its number."""
        if self.id_fields:
            named = ((name, self.entries(name)[n]) for name in self.id_fields)
            return " ".join([f"{name} {' '.join(texts_of(value))}" for name, value in named])
        return f"row {n + 1}" if len(self) > 1 else "values"


class TableOfRows(RecordTable):
    """A list of objects, or one row of what stands in an object."""

    def __init__(self, name: str, rows: list[dict[str, Any]]) -> None:
        super().__init__(name)
        self.rows = rows

    def __len__(self) -> int:
        return len(self.rows)

    @cached_property
    def names(self) -> Collection[str]:
        """The names of the fields that all rows have."""
        return set.intersection(*map(set, self.rows)) if self.rows else ()

    def entries(self, name: str) -> list[Any]:
        """Return the values of a field, one per row."""
        return [row[name] for row in self.rows]

    def row(self, n: int, names: Collection[str] | None = None) -> dict[str, Any]:
        """Return a row."""
        return self.rows[n]


class TableOfColumns(RecordTable):
    """An object of columns, which are decoded when they are asked for."""

    def __init__(self, name: str, columns: Mapping[str, list[Any] | Column]) -> None:
        super().__init__(name)
        self.columns = columns
        self._entries: dict[str, list[Any]] = {}

    def __len__(self) -> int:
        return len(self.entries(next(name for name in _ID_FIELDS if name in self.columns)))

    @property
    def names(self) -> Collection[str]:
        """The names of the columns."""
        return self.columns.keys()

    def entries(self, name: str) -> list[Any]:
        """Return a column. Raises `CannotCompareError` where it is not as long as the others."""
        if name not in self._entries:
            found = list(self.columns[name])
            if self._entries and len(found) != len(next(iter(self._entries.values()))):
                raise CannotCompareError([Problem(message=f"{self.name} has columns of different lengths")])
            self._entries[name] = found
        return self._entries[name]

    def row(self, n: int, names: Collection[str] | None = None) -> dict[str, Any]:
        """Return a row, of columns of these names alone where there are any."""
        chosen = self.columns if names is None else [name for name in names if name in self.columns]
        return {name: self.entries(name)[n] for name in chosen}

    def differing(self, other: TableOfColumns) -> list[int]:
        """Return for each row in which columns another table of the same has other entries: a bit for each."""
        found = [0] * len(self)
        for bit, (name, column) in enumerate(self.columns.items()):
            beside = other.columns[name]
            if column == beside:
                continue
            for n, (a, b) in enumerate(zip(self.entries(name), other.entries(name), strict=True)):
                if a != b:
                    found[n] |= 1 << bit
        return found


def tables_of(content: Any) -> dict[str, RecordTable]:
    """Return the tables of a file by their paths, in their order."""
    tables: dict[str, RecordTable] = {}
    for path, table in _tables(_without_machine(content), ""):
        name = path or TOP
        if name in tables:
            both = (tables[name], _table(name, table))
            tables[name] = TableOfRows(name, [part.row(n) for part in both for n in range(len(part))])
        else:
            tables[name] = _table(name, table)
    return tables


def images_in_columns(content: Any) -> Any:
    """Return a record whose tables of images and observations are columns, where it has the latter in both."""
    plates: Any = content.get("plates") if isinstance(content, dict) else None
    if not _is_list_of_objects(plates) or FIELDS[0] not in plates[0]:
        return content
    tables = {name: content.get(name) for name in ("plates", "observations")}
    columns = {
        name: {key: [row.get(key) for row in table] for key in table[0]}
        for name, table in tables.items()
        if _is_list_of_objects(table)
    }
    return {**content, **columns}


def in_one_table(content: Any) -> Any:
    """Return a record with all observations in one table; one that is not as its schema says stays as it is."""
    if not are_apart(content := images_in_columns(content)):
        return content
    try:
        return with_images(content, lambda value: Number(f"{value:.12g}"))
    except (LookupError, TypeError, ValueError, ZeroDivisionError):
        return content


def _table(name: str, value: Any) -> RecordTable:
    return TableOfRows(name, value) if isinstance(value, list) else TableOfColumns(name, value)


def _without_machine(content: Any) -> Any:
    """Return what a file says without that which depends on the machine alone: the kernels of a run."""
    program = content.get("program") if isinstance(content, dict) else None
    if not isinstance(program, dict) or "kernels" not in program:
        return content
    return {**content, "program": {name: value for name, value in program.items() if name != "kernels"}}


def _tables(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield tables with their paths: lists of objects, objects of columns, of others what is no table itself."""
    if _is_list_of_objects(value) or is_of_columns(value):
        yield path, value
        return
    if not isinstance(value, dict):
        yield path, [{"value": value}]
        return
    nested = {key: entry for key, entry in value.items() if isinstance(entry, dict) or _is_list_of_objects(entry)}
    fields = {
        key: list(entry) if isinstance(entry, Column) else entry
        for key, entry in value.items()
        if key not in nested
    }
    if fields or not value:
        yield path, [fields]
    for key, entry in nested.items():
        yield from _tables(entry, f"{path}.{key}" if path else key)


def rows_in(value: Any) -> list[dict[str, Any]] | None:
    """Return the rows of a table, which is a list of objects, or an object of columns; None of what is neither."""
    if _is_list_of_objects(value):
        return list(value)
    if not is_of_columns(value):
        return None
    return [dict(zip(value, row, strict=True)) for row in zip(*value.values(), strict=True)]


def count_in(value: Any) -> int:
    """Return how many rows a table has, or entries a list; none of anything else."""
    if is_of_columns(value):
        return len(TableOfColumns("", value))
    return len(value) if isinstance(value, list | Column) else 0


def _is_list_of_objects(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(entry, dict) for entry in value)


def is_of_columns(value: Any) -> bool:
    """Tell whether an object is a table by its columns: lists of one length, with one that names the rows."""
    if not isinstance(value, dict) or not all(isinstance(column, list | Column) for column in value.values()):
        return False
    decoded = [column for column in value.values() if isinstance(column, list)]
    is_even = len(set(map(len, decoded))) <= 1 and bool(value)
    has_objects = any(isinstance(column[0], dict) for column in decoded if column)
    return is_even and not has_objects and not _ID_NAMES.isdisjoint(value)


def texts_of(value: Any) -> list[str]:
    """Return the texts of a list, or that of a value."""
    return [str(entry) for entry in value] if isinstance(value, list) else [str(value)]


def leaves(value: Any, path: str = "") -> list[tuple[str, Any]]:
    """Return the path and the value of every field of a row: `position[1]`, `a.b`; of an empty list that itself."""
    fields: list[tuple[str, Any]] = []
    waiting = [(path, value)]  # the next one last; however deep a record is nested
    while waiting:
        path, value = waiting.pop()
        if isinstance(value, dict):
            inside = [(f"{path}.{key}" if path else key, entry) for key, entry in value.items()]
        elif isinstance(value, list) and value:
            inside = [(f"{path}[{n}]", entry) for n, entry in enumerate(value)]
        else:
            fields.append((path, value))
            continue
        if _CONTAINERS.isdisjoint([type(entry) for _, entry in inside]):
            fields += inside
        else:
            waiting += reversed(inside)
    return fields


@lru_cache(maxsize=1 << 12)
def keys_of(path: str) -> tuple[str | int, ...]:
    """Return the keys and indices of a path, one after the other."""
    return tuple([int(index) if index else name for index, name in _PART.findall(path)])


def at(value: Any, path: str) -> Any:
    """Return what stands at a path of a record (`position[1]`, `solution.sigma0`), None where there is nothing.

    The last names of a path may hold points and blanks of their own (`solution.unknowns.station parameters`).
    """
    for key in keys_of(path):
        if type(key) is int:
            value = value[key] if isinstance(value, list | Column) and key < len(value) else None
        else:
            value = value.get(key) if isinstance(value, dict) else None
    return value


def number_of(value: Any) -> float | None:
    """Return the number in a field, None where it has none."""
    if isinstance(value, Number):
        return float(value)
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None
