"""Residuals of control points, and the differences of check points with their statistics."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import ControlKind
from musatpy.reports import result_record
from musatpy.reports.analyses import Layout, analysis_section
from musatpy.reports.columns import metric_columns
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key, worst_first
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics
from musatpy.statistics.quality import TEST_LIMIT

NOTE = (
    f"*  A component fails its own test: its residual is beyond {TEST_LIMIT:.2f} of the standard deviations of "
    "that residual. Blank: not given, or nothing else checks it."
)
CHECK_POINTS = Layout("Check Point Analysis", "Point", lambda s: s.check_points, "check_point")
RESIDUALS: Report[Statistics] = Report(
    title="Control Residuals: Adjusted Minus Given, With The Sigmas Given",
    table=result_record.CONTROL,
    rows=lambda s: _control_rows(s),
    leave={"kind": ("check",)},
    columns=(
        key("Point", "A8", "point"),
        key("Kind", "A10", "kind"),
        Column("Fixed", "A5", shows=Origin(field="fixed", true="X")),
        metric_columns(Origin(field="difference", where="used")),
        metric_columns("given_sigma", "Sigma "),
        metric_columns("test", "Test\n", edit="F6.1", unit=""),
        Column("Fails", "A5", lambda s: np.where(_suspicious(s), "*", "")),
    ),
)
DIFFERENCES: Report[Statistics] = Report(
    title="Check Points: Adjusted Minus Given, With The Sigmas Of The Adjusted Position",
    table=result_record.CONTROL,
    rows=lambda s: _check_rows(s),
    take={"kind": ("check",)},
    columns=(
        key("Point", "A8", "point"),
        metric_columns("difference"),
        metric_columns("adjusted_sigma", "Sigma "),
    ),
)
STATED = (RESIDUALS, DIFFERENCES, CHECK_POINTS.mapped)


def sections(statistics: Statistics) -> list[Section]:
    """Return control residuals, check point differences and the check point analysis, as far as there are any."""
    sections = []
    if len(_control_rows(statistics)):
        worst = worst_first(np.nan_to_num(np.abs(_tests(statistics)), nan=-1.0).max(axis=1)).tolist()
        sections.append(RESIDUALS.section(statistics, ["", *wrapped([NOTE])], new_page=True, worst=worst))
    if len(_check_rows(statistics)):
        worst = worst_first(statistics.check_test.squares).tolist()
        sections += [DIFFERENCES.section(statistics, worst=worst), analysis_section(CHECK_POINTS, statistics)]
    return sections


def _tests(statistics: Statistics) -> FloatArray:
    return statistics.control_tests[_control_rows(statistics)]


def _suspicious(statistics: Statistics) -> BoolArray:
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(_tests(statistics)) > TEST_LIMIT).any(axis=1))


def _control_rows(statistics: Statistics) -> IntArray:
    return np.flatnonzero(statistics.block.control.kind != ControlKind.CHECK)


def _check_rows(statistics: Statistics) -> IntArray:
    return np.flatnonzero(statistics.block.control.kind == ControlKind.CHECK)
