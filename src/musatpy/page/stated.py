"""Tables of a page from the statements of the reports: their titles, headings, units and decimals, of a record."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from musatpy.listings.recorded import value_of
from musatpy.page.cells import UNITS, cell_text
from musatpy.page.parts import Head, PageTable
from musatpy.reports.fields import Field, Group
from musatpy.reports.headings import named
from musatpy.reports.table import Choice, Column, Report, worst_first
from musatpy.reports.values import at

Tables = Mapping[str, Any]  # a record, whose tables are columns: field -> values
Row = Mapping[str, Any]
LISTED = 100  # rows of a table


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """A statement of the reports on a page: which of its rows stand there, the worst first, and what is added."""

    report: Report[Any]
    listed: int = LISTED
    folded: bool = True
    note: str = ""
    heads: Mapping[str, str] = field(default_factory=dict)  # heading of the listing -> that of the page

    @property
    def title(self) -> str:
        """Its title."""
        return self.report.title.removesuffix(": ")

    def of(self, tables: Tables) -> PageTable | None:
        """Return the table of a record; None where the record has no row of it."""
        if self.report.is_new:
            return self._new(tables)
        table = table_at(tables, self.report)
        count = len(next(iter(table.values()), ()))
        rows = list(_rows(table, range(min(count, self.listed)), self.report))
        if not rows:
            return None
        columns = [column for column in _columns(self.report, system_of(tables)) if self._is_shown(column, rows[0])]
        cells = [self._cells(column, rows) for column in columns]
        kept = [
            n for n, (column, texts) in enumerate(zip(columns, cells, strict=True)) if column.is_id or any(texts)
        ]
        kept.sort(key=lambda n: not columns[n].is_id)
        return PageTable(
            title=self.title,
            anchor=anchor_of(self.title),
            heads=[self._head(columns[n]) for n in kept],
            rows=list(zip(*(cells[n] for n in kept), strict=True)),
            total=len(rows) if self.report.expand else count,
            note=self.note,
            folded=self.folded,
        )

    def _new(self, tables: Tables) -> PageTable | None:
        values = self.report.read(tables, system_of(tables))
        count = values.count
        if not count:
            return None
        if self.report.worst:
            values = values.taken(worst_first(self.report.worst(values))[: self.listed])
        elif count > self.listed:
            values = values.taken(np.arange(self.listed))
        heads, cells = [], []
        for column in self.report.side_by_side(values):
            texts = [_cell(str(column.edit), value) for value in _plain(column.printed(values))]
            if column.is_id or any(texts):
                heads.append(self._head_of(column))
                cells.append(texts)
        order = sorted(range(len(heads)), key=lambda n: not heads[n].is_id)
        return PageTable(
            title=self.title,
            anchor=anchor_of(self.title),
            heads=[heads[n] for n in order],
            rows=list(zip(*(cells[n] for n in order), strict=True)),
            total=count,
            note=self.note,
            folded=self.folded,
        )

    def _head_of(self, column: Field[Any]) -> Head:
        words, unit = named(str(column.heading))
        words = self.heads.get(str(column.heading).split("\n")[0], words)
        is_text = str(column.edit).startswith("A") or column.is_id
        return Head(text=words, unit=UNITS.get(unit, unit), is_id=column.is_id, is_text=is_text)

    def _is_shown(self, column: Column[Any], row: Row) -> bool:
        """Tell whether a record has what a column shows: those of earlier versions have less."""
        return column.origin is not None and column.origin.field.partition("[")[0] in row

    def _head(self, column: Column[Any]) -> Head:
        words, unit = column.named
        words = self.heads.get(_heading(column), words)
        is_text = column.edit.startswith("A") or column.is_id
        return Head(text=words, unit=UNITS.get(unit, unit), is_id=column.is_id, is_text=is_text)

    def _cells(self, column: Column[Any], rows: Sequence[Row]) -> list[str]:
        return [cell_text(column.edit, self._value(column, row)) for row in rows]

    def _value(self, column: Column[Any], row: Row) -> Any:
        """Return the value of a cell in the unit that is printed."""
        origin = column.origin
        assert origin is not None
        value = value_of(origin, row)
        if isinstance(value, float | int) and not isinstance(value, bool):
            return value / column.unit
        if words := self.report.words.get(origin.field):
            return words.get(str(value), value)
        return value


def _cell(edit: str, value: Any) -> str:
    """Return the text of a cell, with one blank between words and units as a page writes them."""
    text = cell_text(edit, value)
    return UNITS.get(" ".join(text.split()), " ".join(text.split())) if edit.startswith("A") else text


def _plain(values: Any) -> list[Any]:
    return values.tolist() if isinstance(values, np.ndarray) else list(values)


def tables_of(shown: Iterable[Shown], tables: Tables) -> Iterator[PageTable]:
    """Yield the tables of which a record has rows."""
    for statement in shown:
        table = statement.of(tables)
        if table is not None:
            yield table


def in_columns(value: Any) -> Any:
    """Return a record, or a part of it, whose tables that are lists of rows are columns too."""
    if isinstance(value, list) and value and isinstance(value[0], Mapping):
        return {name: [in_columns(row.get(name)) for row in value] for name in value[0]}
    if isinstance(value, Mapping):
        return {name: in_columns(entry) for name, entry in value.items()}
    return value


def table_at(tables: Tables, report: Report[Any]) -> Mapping[str, Any]:
    """Return the columns of the table of a statement, an empty one where the record has none of it.

    Of a statement of one object they have one row, of one that expands lists of an object a row for each entry.
    """
    table = at(tables, report.place)
    if not isinstance(table, Mapping) or not table:
        return {}
    if report.table is None and report.expand:
        return {name: table[name] for name in report.expand}
    if isinstance(report.table, Group):
        return {name: [value] for name, value in table.items()}
    return table


def rows_at(table: Mapping[str, Any], numbers: Sequence[int]) -> list[dict[str, Any]]:
    """Return rows of a table of columns."""
    columns = [_taken(column, numbers) for column in table.values()]
    return [dict(zip(table, row, strict=True)) for row in zip(*columns, strict=True)]


def _taken(column: Any, numbers: Sequence[int]) -> Sequence[Any]:
    """Return entries of a column: of an array, of a run whose record was not read, all at once."""
    if getattr(column, "array", None) is not None:
        taken: Sequence[Any] = column[np.array(numbers, dtype=np.int64)]
        return taken
    return [column[number] for number in numbers]


def _rows(table: Mapping[str, Any], numbers: Sequence[int], report: Report[Any]) -> Iterator[Row]:
    """Yield what a statement prints of rows: a line of each, or of each entry of a nested table or of lists."""
    for row in rows_at(table, numbers):
        if report.expand and report.table is not None:
            for n in range(len(row[report.expand[0]])):
                yield {**row, **{name: row[name][n] for name in report.expand}}
        else:
            yield row


def _columns(report: Report[Any], system: str) -> Iterator[Column[Any]]:
    """Yield the columns of a statement in a job of a coordinate system."""
    for part in report.columns:
        if isinstance(part, Choice):
            yield from part.variants[min(len(part.variants) - 1, int(system in part.second_in))]
        else:
            yield part


def system_of(tables: Tables) -> str:
    """Return the coordinate system of the job of a record, of a run or of a compilation."""
    return str(at(tables, "options.system") or at(tables, "job.system") or "")


def _heading(column: Column[Any]) -> str:
    return column.heading.split("\n")[0]


def anchor_of(title: str) -> str:
    """Return the name by which links find a title."""
    return "-".join(re.findall(r"[a-z0-9]+", title.lower()))
