"""Residuals of control points, and the differences of check points with their statistics."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.model import ControlKind
from musatpy.reports.analyses import Layout, analysis_section
from musatpy.reports.fields import Field
from musatpy.reports.pages import Section
from musatpy.reports.result_record import CONTROL
from musatpy.reports.table import Report, worst_first
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
    table=CONTROL,
    which=lambda t: np.flatnonzero(t["kind"] != "check"),
    worst=lambda t: np.nan_to_num(np.abs(t["test"]), nan=-1.0).max(axis=1),
    columns=(
        "point",
        "kind",
        "fixed",
        CONTROL.column("difference", shown=lambda t: np.where(t["used"], t["difference"], np.nan)),
        "given_sigma",
        "test",
        Field("fails", heading="Fails", edit="A5", shown=lambda t: np.where(_fails(t["test"]), "*", "")),
    ),
)
DIFFERENCES: Report[Statistics] = Report(
    title="Check Points: Adjusted Minus Given, With The Sigmas Of The Adjusted Position",
    table=CONTROL,
    which=lambda t: np.flatnonzero(t["kind"] == "check"),
    worst=lambda t: np.nan_to_num(np.abs(t["difference"]), nan=-1.0).max(axis=1),
    columns=("point", "difference", "adjusted_sigma"),
)
STATED = (RESIDUALS, DIFFERENCES, CHECK_POINTS.report)


def sections(statistics: Statistics) -> list[Section]:
    """Return control residuals, check point differences and the check point analysis, as far as there are any."""
    is_check = statistics.block.control.kind == ControlKind.CHECK
    sections = []
    if not is_check.all():
        sections.append(RESIDUALS.section(statistics, ["", *wrapped([NOTE])], new_page=True))
    if is_check.any():
        worst = worst_first(statistics.check_test.squares).tolist()
        sections += [DIFFERENCES.section(statistics, worst=worst), analysis_section(CHECK_POINTS, statistics)]
    return sections


def _fails(tests: FloatArray) -> BoolArray:
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(tests) > TEST_LIMIT).any(axis=1))
