"""What a record has of a section of the listing: its rows and their values."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from musatpy.listings.json_tables import count_in, number_of, rows_in
from musatpy.listings.sections import columns_of, numbered
from musatpy.reports.origin import Mapped, Origin
from musatpy.reports.table import Report, Table
from musatpy.reports.values import at

_IN_ROWS = {'"': "arc sec", "deg": "degrees"}  # what rows call them


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
    return Mapped(
        title=report.pattern or re.escape(report.title),
        table=report.place,
        ids=ids,
        columns=columns,
        nested=report.nested,
        expand=report.expand,
        take=report.take,
        leave=report.leave,
        words=report.words,
        some=report.some,
        unnamed=report.unnamed,
    )


class Entry(NamedTuple):
    """One row of the record that is printed: its ids as the listing has them, and its fields."""

    ids: tuple[str, ...]
    fields: Mapping[str, Any]


def entries_of(mapped: Mapped, content: Mapping[str, Any]) -> list[Entry]:
    """Return the rows of a section, as far as they are printed."""
    return [
        Entry(tuple([id_text(at(fields, path)) or mapped.unnamed for path in mapped.ids.values()]), fields)
        for outer in rows_of(mapped, content)
        for row in _nested(outer, mapped.nested)
        if mapped.prints(row)
        for fields in _expanded(mapped.worded(row), mapped.expand)
    ]


def rows_of(mapped: Mapped, content: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the rows of the table of a section; a vector is the one row of a table."""
    table = at(content, mapped.table)
    rows = rows_in(table)
    if rows is not None:
        return rows
    return [table] if isinstance(table, dict) else [{"value": table}] if table else []


def _nested(row: Mapping[str, Any], name: str) -> Iterator[Mapping[str, Any]]:
    """Yield the rows of the table in a field of a row, each with the fields of that; without a name the row."""
    entries = rows_in(row.get(name)) if name else [{}]
    for entry in entries or []:
        yield {**row, **entry}


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


def unit_named(text: str) -> str:
    """Return the unit that a row says, by itself or behind a comma, as headings call it."""
    unit = text.rpartition(", ")[2]
    return _IN_ROWS.get(unit, unit)


def value_of(source: Origin, fields: Mapping[str, Any]) -> Any:
    """Return the number, text or flag of the record, in units of the record; None where there is none."""
    recorded = at(fields, source.field)
    number = number_of(recorded)
    if source.is_field and number is not None:
        return number
    if source.count:
        if not source.where:
            return float(count_in(recorded))
        entries = rows_in(recorded) or (recorded if isinstance(recorded, list) else [])
        return float(sum(1 for entry in entries if at(entry, source.where)))
    if source.sum:
        counts = recorded.values() if isinstance(recorded, dict) else ()
        return float(sum(number_of(count) or 0.0 for count in counts))
    if source.norm:
        return math.hypot(*components) if (components := _numbers(recorded)) else None
    if source.ellipse:
        return _ellipse(source.ellipse, recorded)
    if source.where and at(fields, source.where) is False:
        return None
    if source.true or source.false:
        return source.true if recorded is True else source.false
    if number is not None:
        if not source.minus:
            return number
        minus = number_of(at(fields, source.minus))
        return None if minus is None else number - minus
    return source.null if recorded is None else recorded


def _numbers(values: Any) -> list[float]:
    """Return a list of numbers, an empty one where any of them is none."""
    numbers = [number_of(number) for number in values] if isinstance(values, list) else []
    return [] if None in numbers else [number for number in numbers if number is not None]


def _ellipse(part: str, covariance: Any) -> float | None:
    """Return an axis of the ellipse of a covariance of east, north, ..., or the bearing of its longer axis."""
    values = _numbers([at(covariance, place) for place in ("[0][0]", "[0][1]", "[1][1]")])
    if not values:
        return None
    ee, en, nn = values
    mean, half = 0.5 * (ee + nn), math.hypot(0.5 * (nn - ee), en)
    if mean + half < 0.0:
        return None
    if part == "bearing":
        bearing = 0.5 * math.atan2(2.0 * en, nn - ee)
        return bearing + math.pi if bearing < 0.0 else bearing
    return math.sqrt(mean + half) if part == "major" else math.sqrt(max(mean - half, 0.0))
