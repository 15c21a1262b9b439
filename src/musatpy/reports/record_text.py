"""The record as JSON text: tables column after column, one on a line, some rows at a time.

A table is held neither as lists nor as text: of a large block that takes gigabytes. With orjson (the extra `fast`)
numbers are the same, their exponents may be written in another way.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from musatpy.json_files import quick_json
from musatpy.reports.encoding import Json, plain, rounded
from musatpy.reports.fields import Group, Node, Rows

_ROWS = 20_000  # at a time
_MANY = 500  # entries of a column, from which on a package is worth its loading

# One encoder for all: json.dumps would make another for every row.
encoded = json.JSONEncoder(allow_nan=False).encode
_compact = json.JSONEncoder(allow_nan=False, separators=(",", ":")).encode


def record_texts(nodes: Sequence[Node[Any]], source: Any) -> Iterator[str]:
    """Yield the text of a record of these fields and tables, piece by piece."""
    yield from _object(nodes, source, "\n")
    yield "\n"


def _object(nodes: Sequence[Node[Any]], source: Any, margin: str) -> Iterator[str]:
    inner = margin + "  "
    for number, node in enumerate(nodes):
        yield f"{',' if number else '{'}{inner}{encoded(node.name)}: "
        if isinstance(node, Rows):
            yield from _table(node, source, inner)
        elif isinstance(node, Group) and any(isinstance(field, Rows | Group) for field in node.fields):
            item = node.of(source)
            yield from ["null"] if item is None else _object(node.fields, item, inner)
        else:
            yield laid_out(node.json(source), inner)
    yield margin + "}"


def laid_out(value: Json, margin: str) -> str:
    """Spread tables, and what contains them, over lines that begin with `margin`."""
    inner = margin + "  "
    if _is_list_of_objects(value):
        return "[" + ",".join(inner + encoded(row) for row in value) + margin + "]"
    if isinstance(value, dict) and value and all(isinstance(entry, list) for entry in value.values()):
        columns = (f"{inner}{encoded(name)}: {_compact(column)}" for name, column in value.items())
        return "{" + ",".join(columns) + margin + "}"
    if isinstance(value, dict) and any(
        isinstance(entry, dict) or _is_list_of_objects(entry) for entry in value.values()
    ):
        entries = (f"{inner}{encoded(key)}: {laid_out(entry, inner)}" for key, entry in value.items())
        return "{" + ",".join(entries) + margin + "}"
    return encoded(value)


def _is_list_of_objects(value: Json) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], dict)


def _table(node: Rows[Any, Any], source: Any, margin: str) -> Iterator[str]:
    """Yield the text of a table."""
    for number, (field, values) in enumerate(node.columns(source)):
        yield f"{',' if number else '{'}{margin}  {encoded(field.name)}: ["
        for start in range(0, len(values), _ROWS):
            yield ("," if start else "") + _entries(values[start : start + _ROWS], field.digits)
        yield "]"
    yield margin + "}"


def _entries(values: Any, digits: int | None) -> str:
    """Return the entries of a part of a column, with commas between them."""
    entries = rounded(values, digits)
    is_array = isinstance(entries, np.ndarray)
    if (orjson := quick_json() if len(entries) > _MANY else None) is not None:
        plain_types = not is_array or entries.dtype.kind in "fiub"
        whole = (np.ascontiguousarray(entries) if is_array else list(entries)) if plain_types else entries.tolist()
        return str(orjson.dumps(whole, option=orjson.OPT_SERIALIZE_NUMPY), "utf-8")[1:-1]
    if not is_array or entries.dtype.kind != "f":
        return _compact(plain(entries) if is_array else list(entries))[1:-1]
    entry = "%r"
    for size in reversed(entries.shape[1:]):
        entry = f"[{','.join([entry] * size)}]"
    known = np.where(np.isfinite(entries), entries, np.nan).ravel().tolist()
    return (",".join([entry] * len(entries)) % tuple(known)).replace("nan", "null")
