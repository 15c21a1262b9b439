"""A JSON file as tables: rows with names, fields with paths."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from musatpy.errors import Problem
from musatpy.listings.lines import CannotCompareError

TOP = "(top)"
# Fields that may name what a row is about: as many of them, in this order, as tell all rows of a table apart.
_ID_FIELDS = (
    "id", "ids", "name", "pass", "number", "photo", "point", "camera", "mark", "group", "photos", "points",
    "unknown", "first", "second", "kind", "of", "component", "wave", "parameter", "quantity", "marks", "cross",
    "model", "root", "sounding",
)  # fmt: skip
Row = Mapping[str, Any]


def read_json(text: str, name: str) -> Any:
    """Return the content of a JSON text; raises `CannotCompareError`."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise CannotCompareError([Problem(file=name, message="is nested too deep")]) from error
    except ValueError as error:  # a number of more digits than Python reads has no line
        line = getattr(error, "lineno", 0)
        message = f"is not JSON: {getattr(error, 'msg', error)}"
        raise CannotCompareError([Problem(file=name, line=line, message=message)]) from error


class NamedRows(NamedTuple):
    """The rows of a table, and the fields that name them."""

    rows: Sequence[Row]
    id_fields: tuple[str, ...]

    def ids(self) -> list[tuple[str, ...]]:
        """Return the names of each row, none where nothing tells the rows apart."""
        return [tuple([text for name in self.id_fields for text in texts_of(row[name])]) for row in self.rows]

    def label(self, n: int) -> str:
        """Return what a row is called: its names behind those of their fields, or its number."""
        named = [f"{name} {' '.join(texts_of(self.rows[n][name]))}" for name in self.id_fields]
        return " ".join(named) or (f"row {n + 1}" if len(self.rows) > 1 else "values")


def tables_of(content: Any) -> dict[str, NamedRows]:
    """Return the tables of a file by their paths, in their order; but not what depends on the machine alone."""
    tables: dict[str, list[Row]] = {}
    for path, rows in _tables(content, ""):
        tables.setdefault(path or TOP, []).extend(rows)
    return {path: NamedRows(rows, _id_fields(rows)) for path, rows in tables.items()}


def _tables(value: Any, path: str) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield tables with their paths: lists of objects, objects of columns, of others what is no table itself."""
    rows = rows_in(value)
    if rows is not None:
        yield path, rows
    elif not isinstance(value, dict):
        yield path, [{"value": value}]
    else:
        nested = {
            key: entry for key, entry in value.items() if isinstance(entry, dict) or _is_list_of_objects(entry)
        }
        fields = {
            key: entry
            for key, entry in value.items()
            if key not in nested and (path, key) != ("program", "kernels")
        }
        if fields or not value:
            yield path, [fields]
        for key, entry in nested.items():
            yield from _tables(entry, f"{path}.{key}" if path else key)


def _id_fields(rows: Sequence[Row]) -> tuple[str, ...]:
    """Return the fields that tell the rows of a table apart, as far as any do."""
    names: tuple[str, ...] = ()
    everywhere = set.intersection(*map(set, rows)) if rows else ()
    for name in _ID_FIELDS:
        if name in everywhere:
            names = (*names, name)
            if len({repr([row[name] for name in names]) for row in rows}) == len(rows):
                break
    return names


def rows_in(value: Any) -> list[dict[str, Any]] | None:
    """Return the rows of a table, which is a list of objects, or an object of columns; None of what is neither."""
    if _is_list_of_objects(value):
        return list(value)
    if not _is_of_columns(value):
        return None
    return [dict(zip(value, row, strict=True)) for row in zip(*value.values(), strict=True)]


def count_in(value: Any) -> int:
    """Return how many rows a table has, or entries a list; none of anything else."""
    entries = next(iter(value.values())) if _is_of_columns(value) else value
    return len(entries) if isinstance(entries, list) else 0


def _is_list_of_objects(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(entry, dict) for entry in value)


def _is_of_columns(value: Any) -> bool:
    """Tell whether an object is a table by its columns: lists of one length, with one that names the rows."""
    if not isinstance(value, dict) or not all(isinstance(column, list) for column in value.values()):
        return False
    has_objects = any(isinstance(column[0], dict) for column in value.values() if column)
    return len(set(map(len, value.values()))) == 1 and not has_objects and not value.keys().isdisjoint(_ID_FIELDS)


def texts_of(value: Any) -> list[str]:
    """Return the texts of a list, or that of a value."""
    return [str(entry) for entry in value] if isinstance(value, list) else [str(value)]


def leaves(row: Row) -> dict[str, Any]:
    """Return every field of a row by its path: `position[1]`, `a.b`; an empty list or object is one itself."""
    fields: dict[str, Any] = {}
    waiting = list(row.items())[::-1]  # the next one last; however deep a record is nested
    while waiting:
        path, value = waiting.pop()
        if isinstance(value, dict) and value:
            inside = [(f"{path}.{key}", entry) for key, entry in value.items()]
        elif isinstance(value, list) and value:
            inside = [(f"{path}[{n}]", entry) for n, entry in enumerate(value)]
        else:
            fields[path] = value
            continue
        waiting += reversed(inside)
    return fields


def number_of(value: Any) -> float | None:
    """Return the number in a field, None where it has none."""
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None
