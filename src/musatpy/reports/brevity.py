"""The brief listing: statistics and tables of results, and of these no more than so many pages hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import ModuleType

from musatpy.reports.pages import Section, paginate
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics

MOST_PAGES = 40  # of the listing, those of the answer and the index included
_FRONT_PAGES = 2
_ALL = 10**9
# Rows of tables that have to be cut: first those of statistics, then those of points, stations last.
_STEPS = (
    *((40, _ALL, rows) for rows in (_ALL, 400, 300, 200, 150, 100)),
    *((20, rows, rows) for rows in (300, 200, 100, 70, 50, 35, 20)),
)
_STATISTICS, _STATIONS = ("Statistics: ", "Plate Residuals By Photo"), "Adjusted Exposure Stations"
_NOTE = (
    "Without the echo of the input, the residuals of plate measurements, and the coordinates of bathymetric points "
    f"beside their depths; tables are cut to their worst rows where there would be more than {MOST_PAGES} pages. "
    "The record has everything."
)


def note(statistics: Statistics) -> list[Section]:
    """Return what a brief listing has not: it stands in place of the echo of the input."""
    return [Section(title="Brief Listing", lines=wrapped([_NOTE]))]


def nothing(statistics: Statistics) -> list[Section]:
    """Return what a brief listing has of a page that it leaves out."""
    return []


def uncut(statistics: Statistics, pages: Sequence[ModuleType]) -> list[Section]:
    """Return the sections of a brief listing with all of their rows: `brief` of pages that have it, else all."""
    return [section for page in pages for section in getattr(page, "brief", page.sections)(statistics)]


def sections(statistics: Statistics, pages: Sequence[ModuleType]) -> list[Section]:
    """Return the sections of the brief listing."""
    whole = shortened = uncut(statistics, pages)
    for limits in _STEPS:
        if len(paginate(shortened)) <= MOST_PAGES - _FRONT_PAGES:
            break
        shortened = [_cut(section, limits[_kind(section.title)]) for section in whole]
    return shortened


def _kind(title: str) -> int:
    """Return which of the limits of a step a table has."""
    return 0 if title.startswith(_STATISTICS) else 1 if title.startswith(_STATIONS) else 2


def _cut(section: Section, rows: int) -> Section:
    """Return a table with no more than so many of its rows, the worst, in the order that they had."""
    count = len(section.worst)
    if count <= rows:
        return section
    left_out = set(section.worst[rows:])
    lines = [line for number, line in enumerate(section.lines) if number not in left_out]
    return replace(section, lines=[*lines, "", f"Only the worst {rows} of {count} rows are listed here."], worst=())
