"""Every table that the listing states of results is on the page, or is left out for a reason."""

from __future__ import annotations

from musatpy.page import compilation_page, run_tables
from musatpy.page.stated import Shown
from musatpy.reports import (
    compilation,
    compilation_bottom,
    compilation_points,
    compilation_profiles,
    echo,
    listing,
    reduction,
    residuals,
    run_comparison,
    stated,
)
from musatpy.reports.table import Report

LEFT_OUT = {
    # input: what was measured and given stands in the deck; cameras and tides are shown
    *(report.title for report in echo.STATED),
    # millions of rows; what of them counts is among the worst observations, by photo, and in pictures
    residuals.RESIDUALS.title,
    # nested twice: parameters of steps of raw plates
    reduction.PARAMETERS.title,
    # columns of the stations in the output system
    stated.MAP.title,
    # the five worst of those that are shown
    "Worst Observations",
}


def shown(module):
    values = [value for value in vars(module).values() if isinstance(value, tuple)]
    return {part.title for value in values for part in value if isinstance(part, Shown)}


def test_tables_of_runs():
    titles = {
        report.title.removesuffix(": ")
        for page in listing.REPORTS
        for report in getattr(page, "STATED", ())
        if isinstance(report, Report)
    }
    assert len(titles) > 35
    assert titles - LEFT_OUT <= shown(run_tables)


def test_tables_of_compilations():
    pages = (compilation, compilation_bottom, compilation_points, compilation_profiles, run_comparison)
    titles = {report.title for page in pages for report in page.STATED if isinstance(report, Report)}
    assert len(titles) > 10
    of_answer = {report.title for report in compilation_points.ANSWER_TABLES}
    assert titles - of_answer <= shown(compilation_page)
