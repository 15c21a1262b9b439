"""The listing of a job: every report, on pages for a 132-column printer."""

from __future__ import annotations

import datetime

from musatpy.model import Solution
from musatpy.reports import (
    analyses,
    bathymetric,
    blunders,
    conditions,
    control,
    echo,
    iterations,
    plate_rms,
    plates,
    points,
    reliability,
    residuals,
    sea,
    stations,
    summary,
    titles,
    water,
)
from musatpy.reports.pages import PAGE_WIDTH, paginate, print_pages
from musatpy.statistics import Statistics

REPORTS = (
    titles,
    echo,
    sea,
    plates,
    iterations,
    summary,
    blunders,
    analyses,
    plate_rms,
    bathymetric,
    water,
    reliability,
    stations,
    points,
    control,
    conditions,
    residuals,
)


def listing(solution: Solution, *, carriage_control: bool = False, date: datetime.date | None = None) -> str:
    """Return the listing of a solution, converged or not.

    Pages have 60 lines of 132 columns, `carriage_control` puts ASA characters before them. The text depends on
    nothing but the arguments; a `date` is printed only where one is given.
    """
    return listing_of(Statistics(solution), carriage_control=carriage_control, date=date)


def listing_of(statistics: Statistics, *, carriage_control: bool = False, date: datetime.date | None = None) -> str:
    """Return `listing` of a solution whose statistics exist already."""
    block = statistics.block
    title = block.titles[0] if block.titles else ""
    day = date.isoformat() if date else ""
    left = f"MUSATPY  MUSAT-{block.options.program}  {title:<68.68}"

    def header(page: int) -> str:
        return f"{left}{f'{day}  PAGE {page:6d}':>{PAGE_WIDTH - len(left)}}"

    sections = [section for report in REPORTS for section in report.sections(statistics)]
    return print_pages(paginate(sections), header, carriage_control=carriage_control)
