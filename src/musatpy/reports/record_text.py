"""The record as JSON text: tables by columns, rows one on a line, some at a time.

A table is neither turned into dictionaries nor held as text: of a large block that takes gigabytes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import chain, repeat
from typing import Any

import numpy as np

from musatpy.reports.encoding import Json, plain
from musatpy.reports.fields import Node, Rows

_ROWS = 5000  # at a time

# One encoder for all: json.dumps would make another for every row.
encoded = json.JSONEncoder(allow_nan=False).encode


def record_texts(nodes: Sequence[Node[Any]], source: Any) -> Iterator[str]:
    """Yield the text of a record of these fields and tables, piece by piece."""
    yield "{"
    for number, node in enumerate(nodes):
        yield f"{',' if number else ''}\n  {encoded(node.name)}: "
        if isinstance(node, Rows):
            yield from _table(node, source)
        else:
            yield laid_out(node.json(source), "\n  ")
    yield "\n}\n"


def laid_out(value: Json, margin: str) -> str:
    """Spread tables, and what contains them, over lines that begin with `margin`."""
    inner = margin + "  "
    if _is_table(value):
        return "[" + ",".join(inner + encoded(row) for row in value) + margin + "]"
    if isinstance(value, dict) and any(_is_table(entry) or isinstance(entry, dict) for entry in value.values()):
        entries = (f"{inner}{encoded(key)}: {laid_out(entry, inner)}" for key, entry in value.items())
        return "{" + ",".join(entries) + margin + "}"
    return encoded(value)


def _is_table(value: Json) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], dict)


def _table(node: Rows[Any, Any], source: Any) -> Iterator[str]:
    """Yield the text of a table, as `laid_out` has it of its rows."""
    item = node.of(source)
    columns = [] if item is None else [field.of(item) for field in node.fields]
    count = len(columns[0]) if columns else 0
    if not count:
        yield "[]"
        return
    names = [encoded(field.name).replace("%", "%%") for field in node.fields]
    for start in range(0, count, _ROWS):
        rows = slice(start, min(start + _ROWS, count))
        templates, parts = zip(*(_column(values[rows]) for values in columns), strict=True)
        row = "\n    {" + ", ".join(f"{name}: {text}" for name, text in zip(names, templates, strict=True)) + "}"
        values = tuple(chain.from_iterable(zip(*chain.from_iterable(parts), strict=True)))
        yield ("," if start else "[") + ",".join(repeat(row, rows.stop - start)) % values
    yield "\n  ]"


def _column(values: Any) -> tuple[str, list[list[Any]]]:
    """Return the template of a value of a column, and the lists of what goes into its places, one per row."""
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiu":
        entries = plain(values) if isinstance(values, np.ndarray) else values
        return "%s", [_texts(entries)]
    flat = values.reshape(len(values), -1)
    template = _nested("%r", values.shape[1:])
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        template, texts = _nested("%s", values.shape[1:]), plain(flat.T)
        return template, [["null" if value is None else repr(value) for value in column] for column in texts]
    return template, flat.T.tolist()


def _nested(place: str, shape: tuple[int, ...]) -> str:
    for size in reversed(shape):
        place = f"[{', '.join([place] * size)}]"
    return place


def _texts(entries: Sequence[Json]) -> list[str]:
    """Return values as JSON; ids and kinds, which a column repeats, are encoded once."""
    kinds = set(map(type, entries))
    if kinds == {str}:
        return [_quoted(entry) for entry in entries]
    if kinds == {list} and set(map(type, chain.from_iterable(entries))) == {str}:
        return [f"[{', '.join(map(_quoted, entry))}]" for entry in entries]
    return [encoded(entry) for entry in entries]


@lru_cache(maxsize=1 << 16)
def _quoted(text: str) -> str:
    return encoded(text)
