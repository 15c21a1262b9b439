"""Control and check points with their statistics; equal elevations, air bases, distances, height differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from musatpy.arrays import TextArray
from musatpy.model import ControlKind, ObservationKind
from musatpy.model.tables import POSITION_UNIT
from musatpy.reports.analyses import CHECK_POINTS, analysis_section
from musatpy.reports.editing import along_axes
from musatpy.reports.fields import ENU, Field, Rows, flag, identity, unrecorded
from musatpy.reports.pages import Section
from musatpy.reports.residuals import CORRELATED
from musatpy.reports.table import Report, filled, worst_first
from musatpy.reports.values import names, plain
from musatpy.statistics import Statistics
from musatpy.statistics.quality import TEST_LIMIT

Table = Rows[Statistics, Statistics]
CONTROL = Table(
    "control", "one row per control card", (
        identity("point", lambda s: s.block.points.ids[s.block.control.point]),
        Field("kind", "string", "components that are known", lambda s: names(ControlKind, s.block.control.kind),
              "Kind", "A10", choices=("full", "horizontal", "vertical", "check"), is_id=True),
        flag("fixed", "held without error", "Fixed", "X", "block.control.fixed"),
        Field("given_position", "3 number?", "of the deck, null where blank", "block.control.position",
              unit=POSITION_UNIT),
        Field("given_sigma", "3 number?", f"of the deck, {ENU}", "block.control.sigma", along_axes("Sigma ")),
        Field("given_correlation", "3 number?", "of the deck: east and north, east and up, north and up",
              "block.control.correlation", seldom=True),
        Field("difference", "3 number?", f"adjusted minus given, {ENU}", "control_difference", along_axes()),
        Field("used", "3 boolean", "the component took part in the adjustment", "block.control.known"),
        Field("adjusted_sigma", "3 number?", f"of the adjusted position, {ENU}",
              lambda s: s.point_sigmas[s.block.control.point], along_axes("Sigma ")),
        Field("test", "3 number?", f"test values of the components, {ENU}, as `normal_test` of the observations",
              "control_tests", along_axes("Test\n", edit="F6.1", unit="")),
    ),
)  # fmt: skip


NOTE = (
    f"*  A component fails its own test: its residual is beyond {TEST_LIMIT:.2f} of the standard deviations of "
    "that residual. Blank: not given, or nothing else checks it."
)
FAILS = unrecorded(
    "Fails", "A5", lambda t: np.where((np.abs(np.nan_to_num(t["test"])) > TEST_LIMIT).any(axis=1), "*", "")
)
RESIDUALS = Report(
    "Control Residuals: Adjusted Minus Given, With The Sigmas Given",
    CONTROL,
    (
        "point kind fixed",
        CONTROL.column("difference", shown=lambda t: np.where(t["used"], t["difference"], np.nan)),
        "given_sigma test",
        FAILS,
    ),
    which=lambda t: np.flatnonzero(t["kind"] != "check"),
    worst=lambda t: np.nan_to_num(np.abs(t["test"]), nan=-1.0).max(axis=1),
)
DIFFERENCES = Report(
    "Check Points: Adjusted Minus Given, With The Sigmas Of The Adjusted Position",
    CONTROL,
    "point difference adjusted_sigma",
    which=lambda t: np.flatnonzero(t["kind"] == "check"),
    worst=lambda t: np.nan_to_num(np.abs(t["difference"]), nan=-1.0).max(axis=1),
)


def _by_group(of: Callable[[Statistics], Any]) -> Callable[[Statistics], list[list[Any]]]:
    """Return what takes the values of the points of each group of equal elevations."""

    def values(statistics: Statistics) -> list[list[Any]]:
        groups, every = statistics.block.equal_elevations, of(statistics)
        return [plain(every[groups.group == group]) for group in range(len(groups.ids))]

    return values


EQUAL_ELEVATIONS = Table(
    "equal_elevations", "one row per group", (
        identity("group", "block.equal_elevations.ids"),
        Field("given_sigma", "number", "of a point about the level", "block.equal_elevations.sigma",
              "Sigma given\nm", "F9.4"),
        Field("level", "number?", "adjusted", "solution.levels", "Level\nm", "F11.4"),
        Field("level_sigma", "number?", "a posteriori", "solution.level_sigmas", "Sigma\nm", "F9.4"),
        Field("points", "* string", "point ids",
              _by_group(lambda s: s.block.points.ids[s.block.equal_elevations.point]), "Point", "A8", is_id=True),
        Field("difference", "* number?", "adjusted elevation of each point minus the level",
              _by_group(lambda s: s.level_differences), "Point minus level\nm", "F11.4"),
    ),
)  # fmt: skip
_K = ObservationKind


def _between(name: str, text: str, ends: str, what: str, kind: ObservationKind) -> Table:
    """Return what was measured between two photos or points: `what` of the table of the deck, and as adjusted."""
    end = ends.removesuffix("s")

    def ids(statistics: Statistics) -> TextArray:
        block = statistics.block
        return getattr(block, ends).ids[getattr(getattr(block, name), end)]

    return Table(
        name, text, (
            Field(ends, "2 string", f"{end} ids", ids, (end.capitalize(),) * 2, "A8", is_id=True),
            Field(f"given_{what}", "number", "of the deck", lambda s: getattr(getattr(s.block, name), what),
                  "Given\nm", "F13.4"),
            Field("given_sigma", "number", "of the deck", lambda s: getattr(s.block, name).sigma, "Sigma given\nm",
                  "F9.4"),
            Field(what, "number?", "adjusted", lambda s: s.solution.measured[kind], "Adjusted\nm", "F13.4"),
        ),
    )  # fmt: skip


AIR_BASES = _between("air_bases", "one row per air base", "photos", "length", _K.AIR_BASE)
DISTANCES = _between("distances", "one row per measured distance", "points", "length", _K.DISTANCE)
HEIGHT_DIFFERENCES = _between(
    "height_differences", "one row per measured height difference, second point minus first", "points",
    "difference", _K.HEIGHT_DIFFERENCE,
)  # fmt: skip


_COUNT = unrecorded("Points", "I6", lambda t: [len(points) for points in t["points"]])


def _adjusted(title: str, table: Table) -> Report[Statistics]:
    """Return what was measured between two photos or points, beside what is adjusted."""
    ends, given, _, what = (field.name for field in table.fields)
    change = unrecorded("Adjusted minus given\nm", "F10.4", lambda t: t[what] - t[given])
    return Report(title, table, (ends, given, what, change, "given_sigma"))


CONSTRAINTS: tuple[Report[Statistics], ...] = (
    Report("Equal Elevation Levels", EQUAL_ELEVATIONS, ("group", _COUNT, "level level_sigma")),
    Report(
        "Equal Elevation Points",
        EQUAL_ELEVATIONS,
        "group points difference given_sigma",
        expand=("points", "difference"),
    ),
    _adjusted("Air Bases", AIR_BASES),
    _adjusted("Distances", DISTANCES),
    _adjusted("Height Differences", HEIGHT_DIFFERENCES),
)
STATED = (RESIDUALS, DIFFERENCES, CHECK_POINTS, *CONSTRAINTS)


def sections(statistics: Statistics) -> list[Section]:
    """Return control and check points, the analysis of these, and constraints, as far as there are any."""
    is_check = statistics.block.control.kind == ControlKind.CHECK
    sections = []
    if not is_check.all():
        note = NOTE + CORRELATED if statistics.block.control.correlated.any() else NOTE
        sections.append(RESIDUALS.section(statistics, note, new_page=True))
    if is_check.any():
        worst = worst_first(statistics.check_test.squares).tolist()
        sections += [DIFFERENCES.section(statistics, worst=worst), analysis_section(CHECK_POINTS, statistics)]
    return sections + filled(CONSTRAINTS, statistics)
