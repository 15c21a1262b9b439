"""Tables of a page: those of the reports, with their titles, headings, units and decimals, and others alike.

Values of the record are texts there: numbers with their decimals, angles, names.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.fortran import parse_edit
from musatpy.model import Grade
from musatpy.page.rendering import Chapter, Fact, Facts, Head, Page, PageTable, Part, Titled
from musatpy.records.tables import Tables
from musatpy.reports.answer import USE
from musatpy.reports.editing import SEXAGESIMAL, named
from musatpy.reports.table import Report, worst_first
from musatpy.reports.values import at
from musatpy.units import dms_from_radians

# Units as a page writes them.
UNITS: Mapping[str, str] = {
    "um": "µm",
    "arc sec": "″",
    "degrees": "°",
    "deg": "°",
    "m2": "m²",
    SEXAGESIMAL: "° ′ ″",
}
_LARGEST = 1e12  # numbers beyond have an exponent: of runs that have lost their way
PageColumn = tuple[str, str, Iterable[Any]]  # heading and edit descriptor as those of a report, and values


def cell_text(edit: str, value: Any) -> str:
    """Return the text of a value by an edit descriptor of the listing; empty for what does not exist.

    A descriptor says the decimals, and here not the width. Angles of `S` are radians. A page has a zero before the
    decimal point, which the listing, as ETL-0306, has not.
    """
    if isinstance(value, list):
        return " ".join(str(part) for part in value)
    if not isinstance(value, int | float) or isinstance(value, bool):
        return "" if value is None else str(value)
    if not math.isfinite(value):
        return ""
    if edit.startswith("S"):
        return angle_text(value, int(edit.partition(".")[2]))
    form = parse_edit(edit)
    if form.letter == "E" or abs(value) >= _LARGEST:
        return f"{value:.{form.decimals or 3}e}"
    return number_text(value, form.decimals if form.letter == "F" else 0)


def number_text(value: float | None, decimals: int) -> str:
    """Return a number with its decimals, zero without sign; empty where there is none."""
    if value is None or not math.isfinite(value):
        return ""
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if not text.strip("-0.") else text


def angle_text(angle: float, decimals: int) -> str:
    """Return an angle (rad) in degrees, minutes and seconds: `-0° 30′ 45.200″`."""
    degrees, minutes, seconds = (float(part) for part in dms_from_radians(angle, decimals))
    zero = not (degrees or minutes or seconds)
    sign = "-" if math.copysign(1.0, degrees) < 0.0 and not zero else ""
    width = decimals + 3 if decimals else 2
    return f"{sign}{abs(degrees):.0f}° {minutes:02.0f}′ {seconds:0{width}.{decimals}f}″"


def significant(value: float | None, digits: int = 6) -> str:
    """Return a number with at most so many digits; empty where there is none."""
    return "" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def size_text(value: float) -> str:
    """Return a number in the text of a sentence: three digits."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:#.3g}".rstrip(".")


def page_table(
    title: str, columns: Iterable[PageColumn], *, ids: int = 1, total: int = 0, note: str = "", folded: bool = False
) -> PageTable:
    """Return a table whose first columns name the rows; columns of nothing are left out.

    Of the `total` of rows those that are given are shown.
    """
    heads, cells = [], []
    for number, (heading, edit, values) in enumerate(columns):
        texts = [_cell(edit, value) for value in values]
        if number < ids or any(texts):
            words, unit = named(heading)
            is_text = edit.startswith("A")
            unit = UNITS.get(unit, unit)
            heads.append(Head(text=words, unit=unit, is_id=number < ids, is_text=is_text or number < ids))
            cells.append(texts)
    rows = list(zip(*cells, strict=True))
    return PageTable(title=title, heads=heads, rows=rows, total=total or len(rows), note=note, folded=folded)


def _cell(edit: str, value: Any) -> str:
    """Return the text of a cell, with one blank between words and units as a page writes them."""
    text = " ".join(cell_text(edit, value).split())
    return UNITS.get(text, text) if edit.startswith("A") else text


@dataclass(frozen=True)
class PageReport:
    """A report on a page: how many of its rows stand there, the worst first, and what is added."""

    report: Report[Any]
    listed: int = 100
    folded: bool = True
    note: str = ""

    @property
    def title(self) -> str:
        """Its title."""
        return self.report.title.removesuffix(": ")

    def of(self, tables: Tables) -> PageTable | None:
        """Return the table of a record; None where the record has no row of it."""
        values = self.report.read(tables, str(at(tables, "options.system") or at(tables, "job.system") or ""))
        count = values.count
        if not count:
            return None
        if self.report.worst:
            values = values.taken(worst_first(self.report.worst(values))[: self.listed])
        elif count > self.listed:
            values = values.taken(np.arange(self.listed))
        columns = sorted(self.report.side_by_side(values), key=lambda column: not column.is_id)
        shown = []
        for column in columns:
            heading = str(column.heading)
            heading = heading if heading.strip() else column.name.replace("_", " ").capitalize()
            printed = column.printed(values)
            shown.append(
                (heading, str(column.edit), printed.tolist() if isinstance(printed, np.ndarray) else printed)
            )
        ids = sum(column.is_id for column in columns)
        return page_table(self.title, shown, ids=ids, total=count, note=self.note, folded=self.folded)


def tables_of(reports: Iterable[PageReport], tables: Tables) -> Iterator[Part]:
    """Yield the tables of which a record has rows."""
    for report in reports:
        table = report.of(tables)
        if table is not None:
            yield table


def chapters_of(contents: Mapping[str, Iterable[Part]]) -> list[Chapter]:
    """Return the chapters by their titles, of which a record has something to show."""
    chapters = [Chapter(title=title, parts=list(parts)) for title, parts in contents.items()]
    return [chapter for chapter in chapters if chapter.parts]


def places_of(chapters: Sequence[Chapter]) -> dict[str, str]:
    """Return the anchors of all that chapters have, by its title."""
    places: dict[str, str] = {}
    for chapter in chapters:
        places[chapter.title] = chapter.anchor
        for piece in chapter.parts:
            if isinstance(piece, Titled) and piece.title:
                places.setdefault(piece.title, piece.anchor)
    return places


def place_of(places: Mapping[str, str], section: str) -> str:
    """Return the anchor of the table whose title begins as a section of the listing does, empty without one."""
    return next((anchor for title, anchor in places.items() if section and title.startswith(section)), "")


def page_of(
    tables: Tables, titles: Sequence[str], what: str, figures: Iterable[Fact], chapters: Sequence[Chapter]
) -> Page:
    """Return the page of a job with these chapters, in which reasons of the verdict find what they are about."""
    verdict, places = tables["verdict"], places_of(chapters)
    first, *others = (" ".join(title.split()) for title in titles)
    return Page(
        title=first,
        lines=[*others, what],
        grade=verdict["grade"],
        use=USE[Grade(verdict["grade"])],
        reasons=[
            Fact(row["grade"], row["text"], link=place_of(places, row["section"])) for row in verdict["reasons"]
        ],
        notes=verdict["notes"],
        figures=Facts(list(figures), large=True),
        chapters=chapters,
    )
