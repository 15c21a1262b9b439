"""A JSON file as tables: rows with ids, fields with paths, numbers as they are written."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

from musatpy.errors import Problem
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


class Number(str):
    """A number as it is written in a JSON file."""

    __slots__ = ()


@dataclass(eq=False)
class RecordTable:
    """Rows of a record: of a list of objects, or one row of what stands in an object."""

    name: str
    rows: list[dict[str, Any]] = field(default_factory=list)

    @cached_property
    def id_fields(self) -> tuple[str, ...]:
        """The fields that name the rows."""
        names: tuple[str, ...] = ()
        for name in _ID_FIELDS:
            if self.rows and all(name in row for row in self.rows):
                names = (*names, name)
                if len({repr([row[name] for name in names]) for row in self.rows}) == len(self.rows):
                    break
        return names

    @cached_property
    def ids(self) -> list[tuple[str, ...]]:
        """The names of each row, none where there is only one row."""
        return [tuple([text for name in self.id_fields for text in texts_of(row[name])]) for row in self.rows]

    def label(self, n: int) -> str:
        """Return what a row is called: its ids behind the names of their fields, or its number."""
        if self.id_fields:
            return " ".join([f"{name} {' '.join(texts_of(self.rows[n][name]))}" for name in self.id_fields])
        return f"row {n + 1}" if len(self.rows) > 1 else "values"


def tables_of(content: Any) -> dict[str, RecordTable]:
    """Return the tables of a file by their paths, in their order."""
    tables: dict[str, RecordTable] = {}
    for path, rows in _tables(_without_machine(content), ""):
        tables.setdefault(path or TOP, RecordTable(path or TOP)).rows.extend(rows)
    return tables


def _without_machine(content: Any) -> Any:
    """Return what a file says without that which depends on the machine alone: the kernels of a run."""
    program = content.get("program") if isinstance(content, dict) else None
    if not isinstance(program, dict) or "kernels" not in program:
        return content
    return {**content, "program": {name: value for name, value in program.items() if name != "kernels"}}


def read_json(text: str, name: str) -> Any:
    """Return the content of a JSON text, its numbers as they are written; raises `CannotCompareError`."""
    try:
        return json.loads(text, parse_float=Number, parse_int=Number, parse_constant=Number)
    except json.JSONDecodeError as error:
        problem = Problem(file=name, line=error.lineno, message=f"is not JSON: {error.msg}")
        raise CannotCompareError([problem]) from error
    except RecursionError as error:
        raise CannotCompareError([Problem(file=name, message="is nested too deep")]) from error


def _tables(value: Any, path: str) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield rows with the path of their table: objects of a list, and of objects what is no table itself."""
    rows = rows_in(value)
    if rows is not None:
        yield path, rows
        return
    if not isinstance(value, dict):
        yield path, [{"value": value}]
        return
    nested = {key: entry for key, entry in value.items() if isinstance(entry, dict) or _is_list_of_objects(entry)}
    fields = {key: entry for key, entry in value.items() if key not in nested}
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


def _is_list_of_objects(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(entry, dict) for entry in value)


def is_of_columns(value: Any) -> bool:
    """Tell whether an object is a table by its columns: lists of one length, with one that names the rows."""
    if not isinstance(value, dict) or not all(isinstance(column, list) for column in value.values()):
        return False
    entries = [column[0] for column in value.values() if column]
    is_even = len(set(map(len, value.values()))) == 1
    return is_even and not _ID_NAMES.isdisjoint(value) and not any(isinstance(entry, dict) for entry in entries)


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
            value = value[key] if isinstance(value, list) and key < len(value) else None
        else:
            value = value.get(key) if isinstance(value, dict) else None
    return value


def number_of(value: Any) -> float | None:
    """Return the number in a field, None where it has none."""
    if isinstance(value, Number):
        return float(value)
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None
