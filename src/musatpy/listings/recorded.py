"""What a record has of the echo in a listing: its rows and their values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from musatpy.listings.records import number_of, rows_in
from musatpy.listings.sections import columns_of, numbered
from musatpy.reports.origin import Origin
from musatpy.reports.table import Report, Table
from musatpy.reports.values import at


class Mapped(NamedTuple):
    """Where the record has what a table of the echo shows."""

    report: Report[Any]
    ids: Mapping[str, str]  # heading -> field
    columns: Mapping[str, Origin]  # heading -> what is shown


def mapped_of(report: Report[Any]) -> Mapped:
    """Return where the record has what a report shows."""
    ids: dict[str, str] = {}
    columns: dict[str, Origin] = {}
    for layout in report.layouts():
        names = numbered([column.name for column in columns_of(Table(layout).head())])
        for name, column in zip(names, layout, strict=True):
            if column.origin and column.is_id:
                ids[name] = column.origin.field
            elif column.origin:
                columns[name] = column.origin
    return Mapped(report, ids, columns)


class Entry(NamedTuple):
    """One row of the record that is printed: its ids as the listing has them, and its fields."""

    ids: tuple[str, ...]
    fields: Mapping[str, Any]


def entries_of(mapped: Mapped, content: Mapping[str, Any]) -> list[Entry]:
    """Return the rows of a section."""
    return [
        Entry(tuple([id_text(at(fields, path)) for path in mapped.ids.values()]), fields)
        for row in rows_of(mapped.report, content)
        for fields in _expanded(_worded(mapped.report, row), mapped.report.expand)
    ]


def rows_of(report: Report[Any], content: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the rows of the table of a section; a vector is the one row of a table."""
    table = at(content, report.place)
    rows = rows_in(table)
    if rows is not None:
        return rows
    return [table] if isinstance(table, dict) else [{"value": table}] if table else []


def _worded(report: Report[Any], row: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a row with the words that are printed for what some of its fields say."""
    said = {name: str(row.get(name)) for name in report.words}
    return {**row, **{name: report.words[name].get(text, text) for name, text in said.items()}}


def _expanded(row: Mapping[str, Any], lists: Sequence[str]) -> Iterator[Mapping[str, Any]]:
    """Yield a row for each entry of the lists of a row; the row itself without lists."""
    if not lists:
        yield row
        return
    entries = row.get(lists[0])
    for n in range(len(entries) if isinstance(entries, list) else 0):
        yield {**row, **{name: at(row, f"{name}[{n}]") for name in lists}}


def id_text(value: Any) -> str:
    """Return what names a row as it is printed: of several names one behind the other."""
    return "" if value is None else " ".join(map(str, value)) if isinstance(value, list) else str(value)


def value_of(source: Origin, fields: Mapping[str, Any]) -> Any:
    """Return the number, text or flag of the record, in units of the record; None where there is none."""
    recorded = at(fields, source.field)
    if source.true or source.false:
        return source.true if recorded is True else source.false
    number = number_of(recorded)
    return recorded if number is None else number
