"""What of a listing stands in no table: lines of a label and numbers, and sentences, as a record has them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from musatpy.reports.values import at

Content = Mapping[str, Any]  # of a record


@dataclass(frozen=True)
class Labels:
    """Lines of a label and one or more numbers."""

    title: str
    numbers: Callable[
        [Content], Mapping[str, Sequence[float | None]]
    ]  # in printed units; None: the record has none


@dataclass(frozen=True)
class Texts:
    """Sentences, however their lines are broken."""

    title: str
    texts: Callable[[Content], Iterable[str]]
    table: str  # without which a record has none of them


def numbers_at(content: Content, *paths: str, unit: float = 1.0) -> list[float | None]:
    """Return the numbers at some paths of a record, in units of one that is `unit` in units of the record."""
    values = [at(content, path) for path in paths]
    is_number = [isinstance(value, int | float) and not isinstance(value, bool) for value in values]
    return [value / unit if known else None for value, known in zip(values, is_number, strict=True)]


def count_at(content: Content, path: str, flag: str = "") -> int:
    """Return how many rows a table of a record has, or a list entries; with a flag those of which it is true."""
    table = at(content, path)
    if isinstance(table, list) and flag:
        return sum(bool(row.get(flag)) for row in table if isinstance(row, Mapping))
    if isinstance(table, Mapping):
        column = table.get(flag) if flag else next(iter(table.values()), ())
        return sum(map(bool, column or ())) if flag else len(column or ())
    return len(table) if isinstance(table, list) else 0


def sentences_at(content: Content, *paths: str) -> Iterable[str]:
    """Yield the texts of lists of a record, or what `text` is in each row of a table."""
    for path in paths:
        entries = at(content, path)
        if isinstance(entries, Mapping):
            entries = entries.get("text")
        for entry in entries if isinstance(entries, list) else ():
            yield str(entry.get("text", "") if isinstance(entry, Mapping) else entry)
