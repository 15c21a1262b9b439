"""Tables of a page from the statements of the reports: their titles, headings, units and decimals, of a record."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from musatpy.page.cells import UNITS, cell_text
from musatpy.page.parts import Head, PageTable
from musatpy.reports.fields import Field
from musatpy.reports.headings import named
from musatpy.reports.table import Report, worst_first
from musatpy.reports.values import at

Tables = Mapping[str, Any]  # a record, whose tables are columns: field -> values
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
                heads.append(self._head(column))
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

    def _head(self, column: Field[Any]) -> Head:
        words, unit = named(str(column.heading))
        words = self.heads.get(str(column.heading).split("\n")[0], words)
        is_text = str(column.edit).startswith("A") or column.is_id
        return Head(text=words, unit=UNITS.get(unit, unit), is_id=column.is_id, is_text=is_text)


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


def system_of(tables: Tables) -> str:
    """Return the coordinate system of the job of a record, of a run or of a compilation."""
    return str(at(tables, "options.system") or at(tables, "job.system") or "")


def anchor_of(title: str) -> str:
    """Return the name by which links find a title."""
    return "-".join(re.findall(r"[a-z0-9]+", title.lower()))
