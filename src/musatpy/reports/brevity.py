"""The brief listing: statistics and tables of results, and of these no more than so many pages hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from musatpy.reports import (
    analyses,
    bathymetric,
    blunders,
    conditions,
    control,
    iterations,
    plate_rms,
    points,
    reliability,
    sea,
    stations,
    summary,
    titles,
    water,
)
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

REPORTS: tuple[Callable[[Statistics], list[Section]], ...] = (
    titles.sections,
    lambda statistics: [Section(title="Brief Listing", lines=wrapped([_NOTE]))],
    sea.sections,
    iterations.sections,
    summary.sections,
    blunders.sections,
    analyses.sections,
    plate_rms.by_photo,
    bathymetric.depths,
    water.sections,
    reliability.sections,
    stations.sections,
    points.sections,
    control.sections,
    conditions.sections,
)


def sections(statistics: Statistics) -> list[Section]:
    """Return the sections of the brief listing."""
    whole = [section for report in REPORTS for section in report(statistics)]
    found = whole
    for limits in _STEPS:
        if len(paginate(found)) <= MOST_PAGES - _FRONT_PAGES:
            break
        found = [_cut(section, limits[_kind(section.title)]) for section in whole]
    return found


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
