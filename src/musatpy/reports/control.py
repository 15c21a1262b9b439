"""Residuals of control points, and the differences of check points with their statistics."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import ControlKind
from musatpy.reports.analyses import Layout, analysis_section
from musatpy.reports.columns import metric_columns, point_column, vector
from musatpy.reports.echo import CONTROL_KINDS
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table, worst_first
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics, metric_components
from musatpy.statistics.quality import TEST_LIMIT

_NOTE = (
    f"*  A component fails its own test: its residual is beyond {TEST_LIMIT:.2f} of the standard deviations of "
    "that residual. Blank: not given, or nothing else checks it."
)
CHECK_POINTS = Layout("Check Point Analysis", "Point", lambda s: s.check_points)


def sections(statistics: Statistics) -> list[Section]:
    """Return control residuals, check point differences and the check point analysis, as far as there are any."""
    found = []
    block = statistics.block
    if len(_control_rows(statistics)):
        table = Table(
            (
                point_column(lambda s: s.block.control.point[_control_rows(s)]),
                Column("Kind", "A10", _kinds),
                Column("Fixed", "A5", lambda s: np.where(s.block.control.fixed[_control_rows(s)], "X", "")),
                *metric_columns(block, _used_differences, sigma=False),
                *metric_columns(block, lambda s: s.block.control.sigma[_control_rows(s)], sigma=True),
                *vector(tuple(f"Test\n{name}" for name in metric_components(block)), ("F6.1",) * 3, _tests),
                Column("Fails", "A5", lambda s: np.where(_suspicious(s), "*", "")),
            )
        )
        title = "Control Residuals: Adjusted Minus Given, With The Sigmas Given"
        rows = table.lines(statistics)
        lines = [*rows, "", *wrapped([_NOTE])]
        worst = worst_first(np.nan_to_num(np.abs(_tests(statistics)), nan=-1.0).max(axis=1))
        found.append(Section(title=title, head=table.head(), lines=lines, new_page=True, worst=worst.tolist()))
    if len(_check_rows(statistics)):
        table = Table(
            (
                point_column(lambda s: s.block.control.point[_check_rows(s)]),
                *metric_columns(block, lambda s: s.control.difference[_check_rows(s)], sigma=False),
                *metric_columns(block, lambda s: s.control.adjusted_sigma[_check_rows(s)], sigma=True),
            )
        )
        title = "Check Points: Adjusted Minus Given, With The Sigmas Of The Adjusted Position"
        worst = worst_first(statistics.check_test.squares).tolist()
        found.append(Section(title=title, head=table.head(), lines=table.lines(statistics), worst=worst))
        found.append(analysis_section(CHECK_POINTS, statistics))
    return found


def _tests(statistics: Statistics) -> FloatArray:
    return statistics.control_tests[_control_rows(statistics)]


def _suspicious(statistics: Statistics) -> BoolArray:
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(_tests(statistics)) > TEST_LIMIT).any(axis=1))


def _control_rows(statistics: Statistics) -> IntArray:
    return np.flatnonzero(statistics.block.control.kind != ControlKind.CHECK)


def _check_rows(statistics: Statistics) -> IntArray:
    return np.flatnonzero(statistics.block.control.kind == ControlKind.CHECK)


def _kinds(statistics: Statistics) -> list[str]:
    kinds = statistics.block.control.kind[_control_rows(statistics)]
    return [CONTROL_KINDS[ControlKind(kind)] for kind in kinds.tolist()]


def _used_differences(statistics: Statistics) -> FloatArray:
    control = statistics.control
    return np.where(control.used, control.difference, np.nan)[_control_rows(statistics)]
