"""Printed tables: a column is data (heading, edit descriptor, extractor), a table a tuple of columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.reports.editing import edited, field_width

Source = TypeVar("Source")


@dataclass(frozen=True, eq=False)
class Column(Generic[Source]):
    """One column: `values` takes its values out of the source of the table, one per row."""

    heading: str  # one or two lines, parted by a line feed
    edit: str  # edit descriptor (see `musatpy.reports.editing`)
    values: Callable[[Source], Iterable[Any]]

    @cached_property
    def width(self) -> int:
        """Columns of print: as many as the descriptor or the longer heading line needs."""
        return max(field_width(self.edit), *(len(line) for line in self.heading.split("\n")))


@dataclass(frozen=True, eq=False)
class Table(Generic[Source]):
    """Columns side by side, two blanks apart."""

    columns: tuple[Column[Source], ...]

    def head(self) -> tuple[str, ...]:
        """Return the heading lines, and a rule below them; text headings stand left, those of numbers right."""
        height = max(len(column.heading.split("\n")) for column in self.columns)
        rows: list[list[str]] = [[] for _ in range(height)]
        for column in self.columns:
            lines = column.heading.split("\n")
            for row, line in zip(rows, [""] * (height - len(lines)) + lines, strict=True):
                left = column.edit.startswith("A")
                row.append(line.ljust(column.width) if left else line.rjust(column.width))
        rule = "  ".join("-" * column.width for column in self.columns)
        return (*(_join(row) for row in rows), rule)

    def lines(self, source: Source) -> list[str]:
        """Return one printed line per row of `source`."""
        texts = [self._texts(column, source) for column in self.columns]
        return [_join(row) for row in zip(*texts, strict=True)]

    @staticmethod
    def _texts(column: Column[Source], source: Source) -> list[str]:
        texts = edited(column.edit, column.values(source))
        if field_width(column.edit) == column.width:
            return texts
        if column.edit.startswith("A"):
            return [text.ljust(column.width) for text in texts]
        return [text.rjust(column.width) for text in texts]


def _join(cells: Iterable[str]) -> str:
    return "  ".join(cells).rstrip()


def worst_first(badness: FloatArray, *, lines: int = 1) -> IntArray:
    """Return the rows (n * lines,) by falling badness (n,), where there is none last; rounding errors do not order.

    Each row may have several `lines`.
    """
    badness = np.nan_to_num(badness, nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    with np.errstate(over="ignore"):  # of runs that have lost their way
        order = np.lexsort((np.arange(len(badness)), -np.round(badness, 6)))
    return (order[:, None] * lines + np.arange(lines)).reshape(-1)
