"""Tables of a page from the statements of the reports: their titles, headings, units and decimals, of a record."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.listings.recorded import unit_named, value_of
from musatpy.page.cells import UNITS, cell_text
from musatpy.page.parts import Head, PageTable
from musatpy.reports.fields import Field, Group
from musatpy.reports.headings import PRINTED, named
from musatpy.reports.origin import Mapped
from musatpy.reports.table import Choice, Column, Report, worst_first
from musatpy.reports.values import at

Tables = Mapping[str, Any]  # a record, whose tables are columns: field -> values
Row = Mapping[str, Any]
LISTED = 100  # rows of a table


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """A statement of the reports on a page: which of its rows stand there, the worst first, and what is added."""

    report: Report[Any]
    badness: Callable[[Tables], FloatArray] | None = None  # of the rows of the table; None: as they stand there
    listed: int = LISTED
    folded: bool = True
    note: str = ""
    heads: Mapping[str, str] = field(default_factory=dict)  # heading of the listing -> that of the page
    values: Mapping[str, Callable[[Row], Any]] = field(default_factory=dict)  # of columns that the record has not

    @property
    def title(self) -> str:
        """Its title."""
        return self.report.title.removesuffix(": ")

    def of(self, tables: Tables) -> PageTable | None:
        """Return the table of a record; None where the record has no row of it."""
        if self.report.is_new:
            return self._new(tables)
        table = table_at(tables, self.report)
        numbers = self._numbers(table)
        if not len(numbers):
            return None
        rows = list(_rows(table, self._order(table, numbers), self.report))
        if not rows:
            return None
        columns = [column for column in _columns(self.report, system_of(tables)) if self._is_shown(column, rows[0])]
        cells = _without_rounding(columns, [self._cells(column, rows) for column in columns])
        kept = [
            n for n, (column, texts) in enumerate(zip(columns, cells, strict=True)) if column.is_id or any(texts)
        ]
        kept.sort(key=lambda n: not columns[n].is_id)
        return PageTable(
            title=self.title,
            anchor=anchor_of(self.title),
            heads=[self._head(columns[n]) for n in kept],
            rows=list(zip(*(cells[n] for n in kept), strict=True)),
            total=len(numbers) if not (self.report.nested or self.report.expand) else len(rows),
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

    def _numbers(self, table: Mapping[str, Any]) -> list[int]:
        """Return the rows of the table of the record that the statement prints."""
        count = len(next(iter(table.values()), ()))
        if not count:
            return []
        kept = [True] * count
        for wanted, conditions in ((True, self.report.take), (False, self.report.leave)):
            for name, values in conditions.items():
                kept = [keep and (str(v) in values) is wanted for keep, v in zip(kept, table[name], strict=True)]
        return [n for n, keep in enumerate(kept) if keep]

    def _order(self, table: Mapping[str, Any], numbers: Sequence[int]) -> list[int]:
        badness = np.zeros(0) if self.badness is None else self.badness(table)
        if not len(badness):
            return list(numbers[: self.listed])
        worst = worst_first(badness[numbers])[: self.listed]
        return [numbers[n] for n in worst.tolist()]

    def _is_shown(self, column: Column[Any], row: Row) -> bool:
        """Tell whether a record has what a column shows: those of earlier versions have less."""
        if _heading(column) in self.values:
            return True
        return column.origin is not None and column.origin.field.partition("[")[0] in row

    def _head(self, column: Column[Any]) -> Head:
        words, unit = column.named
        words = self.heads.get(_heading(column), words)
        is_text = column.edit.startswith("A") or column.is_id
        return Head(text=words, unit=UNITS.get(unit, unit), is_id=column.is_id, is_text=is_text)

    def _cells(self, column: Column[Any], rows: Sequence[Row]) -> list[str]:
        own = self.values.get(_heading(column))
        if own is not None:
            return [cell_text(column.edit, UNITS.get(value := own(row), value)) for row in rows]
        return [cell_text(column.edit, self._value(column, row)) for row in rows]

    def _value(self, column: Column[Any], row: Row) -> Any:
        """Return the value of a cell in the unit that is printed."""
        origin = column.origin
        assert origin is not None
        value = value_of(origin, row)
        if isinstance(value, float | int) and not isinstance(value, bool):
            return value / self._unit(column, row)
        if words := self.report.words.get(origin.field):
            return words.get(str(value), value)
        return self.report.unnamed if column.is_id and not value else value

    def _unit(self, column: Column[Any], row: Row) -> float:
        origin = column.origin
        assert origin is not None
        if origin.unit_in:
            unit = self.values[origin.unit_in](row)
            return PRINTED.get(unit_named(str(unit)), 1.0)
        if origin.angles and re.fullmatch(origin.angles, str(next(iter(row.values())))):
            return PRINTED["arc sec"]
        return column.unit


def _cell(edit: str, value: Any) -> str:
    """Return the text of a cell, with one blank between words and units as a page writes them."""
    text = cell_text(edit, value)
    return UNITS.get(" ".join(text.split()), " ".join(text.split())) if edit.startswith("A") else text


def _plain(values: Any) -> list[Any]:
    return values.tolist() if isinstance(values, np.ndarray) else list(values)


def _without_rounding(columns: Sequence[Column[Any]], cells: list[list[str]]) -> list[list[str]]:
    """Return cells, blank those that name whose number it is where the number shows no digit but zeros.

    Which one it is, is then rounding error, and another on each machine.
    """
    places = {_heading(column): n for n, column in enumerate(columns)}
    others = [
        places.get(column.origin.unless) if column.origin and column.origin.unless else None for column in columns
    ]
    return [
        texts
        if n is None
        else [text if re.search("[1-9]", of) else "" for text, of in zip(texts, cells[n], strict=True)]
        for texts, n in zip(cells, others, strict=True)
    ]


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
        if report.nested:
            inner = row[report.nested] or {}
            for entry in rows_at(inner, range(len(next(iter(inner.values()), ())))):
                yield {**row, **entry}
        elif report.expand and report.table is not None:
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


def labels_of(mapped: Mapped, tables: Tables) -> dict[str, list[Any]]:
    """Return the labels of a section with their values in printed units, as far as the record has any."""
    by_label: dict[str, list[Any]] = {}
    for label, origin in mapped.columns.items():
        if label.endswith("*"):
            continue
        unit = PRINTED.get(origin.unit, 1.0)
        if origin.count:
            values = [
                _count(at(tables, origin.field), origin.where),
                *(_count(at(tables, path), "") for path in origin.then),
            ]
        elif origin.sum:
            values = [sum((at(tables, origin.field) or {}).values())]
        else:
            values = [at(tables, path) for path in (origin.field, *origin.then)]
        by_label[label] = [v / unit if isinstance(v, float) else v for v in values if v is not None]
    return {label: values for label, values in by_label.items() if values}


def _count(table: Any, where: str) -> int:
    if not isinstance(table, Mapping):
        return len(table or ())
    column = table.get(where) if where else next(iter(table.values()), ())
    return sum(map(bool, column or ())) if where else len(column or ())
