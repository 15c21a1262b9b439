"""Bathymetric points without refraction, predicted and with refraction (ETL-0306, Table 6-9); depths and flags."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.arrays import IntArray
from musatpy.model import ControlKind, CoordinateSystem, PointStatus, Refraction
from musatpy.reports.editing import edited, number_text
from musatpy.reports.fields import Field, Rows, flag, identity
from musatpy.reports.pages import Section, wrapped
from musatpy.reports.table import Report
from musatpy.reports.values import Values
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import NOT_GIVEN
from musatpy.statistics.gates import FLAGS as TITLE
from musatpy.statistics.gates import squares_choose

_WIDTH = 18
_GIVES = {kind: kind.name.lower() for kind in ControlKind}
_HEADINGS = ("No Refraction", "Predicted", "Refraction")


BATHYMETRIC = Rows[Statistics, Statistics](
    "bathymetric_points", "one row per submerged point; X, Y, Z are geocentric, or the job's own in LOCL jobs", (
        identity("point", lambda s: s.block.points.ids[s.solution.bathymetric.point]),
        Field("no_refraction", "3 number?",
              "X, Y, Z where straight rays of the adjusted stations meet; null where two rays that are not "
              "parallel do not give it", lambda s: s.bathymetric_xyz[:, 0], _HEADINGS[0], "F14.1", unit="m",
              exact=True),
        Field("predicted", "3 number?", "X, Y, Z below it along the local vertical, at n times its depth",
              lambda s: s.bathymetric_xyz[:, 1], _HEADINGS[1], "F14.1", unit="m", exact=True),
        Field("refraction", "3 number?", "X, Y, Z adjusted", lambda s: s.bathymetric_xyz[:, 2], _HEADINGS[2],
              "F14.1", unit="m", exact=True),
        Field("photos", "integer", "photos whose rays give the point",
              lambda s: s.solution.points.rays[s.solution.bathymetric.point], "Photos", "I6"),
        Field("incidence", "number?", "mean angle of incidence of these rays, in air",
              "solution.bathymetric.incidence", "Incidence\ndegrees", "F9.1"),
        Field("water_level", "number?", "mean height of the water at the point, over the photos that give it",
              "solution.bathymetric.water_level", "Water level\nm", "F11.3"),
        Field("depth_no_refraction", "number?", "where straight rays meet, below the water level",
              "solution.bathymetric.apparent_depth", "Depth, no refr.\nm", "F12.3"),
        Field("depth_predicted", "number?", "n times that; null where there is no index",
              "solution.bathymetric.predicted_depth", "Depth, predicted\nm", "F12.3"),
        Field("depth", "number?", "adjusted, below the water level", "solution.bathymetric.depth",
              "Depth, refraction\nm", "F12.3"),
        Field("depth_sigma", "number?", "of the depth", "solution.bathymetric.depth_sigma", "Sigma\nm", "F9.3"),
        Field("height", "number?", "of the adjusted point: water level minus depth", "solution.bathymetric.height",
              "Height\nm", "F9.3"),
        Field("control", "string?", "kind of control that gives its height; null where none does",
              lambda s: [_GIVES.get(kind) for kind in s.sounding_kinds.tolist()], "Ctrl", "A4",
              choices=("full", "vertical", "check"),
              words={"full": "F", "vertical": "V", "check": "C", None: ""}),
        Field("residual", "number?", "adjusted minus given depth", "sounding_residuals", "Residual\nm", "F8.3"),
    ),
)  # fmt: skip


def _is_refracted(t: Values) -> bool:
    """Tell whether depths are adjusted: in a record they are there to be seen."""
    return t.source is None or not _unrefracted(t.source)


DEPTHS = Report(
    "Depths Of Bathymetric Points",
    BATHYMETRIC,
    (
        "point photos incidence water_level depth_no_refraction depth_predicted",
        *(BATHYMETRIC.column(name, when=_is_refracted) for name in ("depth", "depth_sigma", "height")),
        *(
            BATHYMETRIC.column(name, when=lambda t: t.source is None or (_is_refracted(t) and _are_given(t.source)))
            for name in ("control", "residual")
        ),
    ),
    worst=lambda t: t["depth_sigma"],
)
COORDINATES = Report("Bathymetric Points", BATHYMETRIC, "point no_refraction predicted refraction", layout="xyz")
_POSITIONS = Report(
    COORDINATES.title,
    BATHYMETRIC,
    (
        "point",
        *(
            BATHYMETRIC.column(name, [f"{heading}, {axis}\nm" for axis in "XYZ"], "F14.1")
            for name, heading in zip(("no_refraction", "predicted", "refraction"), _HEADINGS, strict=True)
        ),
    ),
)


def _rows(statistics: Statistics) -> IntArray:
    return statistics.flags.doubted


FLAGS = Rows[Statistics, Statistics](
    "flags_against_heights",
    "one row per point whose height contradicts its flag, the worst first; with the other flag for all too", (
        identity("point", lambda s: s.block.points.ids[s.flags.point[_rows(s)]]),
        flag("bathymetric", "flagged as submerged", "Flag", "B", lambda s: s.flags.flagged[_rows(s)]),
        Field("height", "number", "adjusted", lambda s: s.flags.height[_rows(s)], "Height\nm", "F12.3"),
        Field("water", "number", "lowest over a point that is not flagged, highest over one that is",
              lambda s: s.flags.water[_rows(s)], "Water\nm", "F10.3"),
        Field("sigma", "number", "of the height above the water", lambda s: s.flags.sigma[_rows(s)], "Sigma\nm",
              "F8.3"),
        Field("sigmas", "number", "on the wrong side of the water", lambda s: s.flags.sigmas[_rows(s)],
              "Sigmas\nbeyond", "F8.1"),
        Field("other_height", "number?", "with the other flag; null where it was not to be had",
              lambda s: s.flags.other_height[_rows(s)], "Other flag\nm", "F12.3"),
    ),
)  # fmt: skip
FLAG_TABLE = Report(TITLE, FLAGS)


RECORD, STATED = (FLAGS,), (COORDINATES, DEPTHS, FLAG_TABLE)


def _are_given(statistics: Statistics) -> bool:
    return bool((statistics.sounding_kinds != NOT_GIVEN).any())


def sections(statistics: Statistics) -> list[Section]:
    """Return the comparison of coordinates, the depths, and the points whose flags are in doubt."""
    submerged = len(statistics.solution.bathymetric.point)
    return [*([_comparison(statistics)] if submerged else []), *brief(statistics)]


def brief(statistics: Statistics) -> list[Section]:
    """Return the depths, and the points whose flags are in doubt."""
    if not len(statistics.solution.bathymetric.point):
        return _flags(statistics)
    notes = ["", *wrapped(_notes(statistics), lead="- ")]
    return [DEPTHS.section(statistics, notes, together=True), *_flags(statistics)]


def _notes(statistics: Statistics) -> Iterator[str]:
    """Yield what the columns are, and which depths are not there and why."""
    solution = statistics.solution
    points, ids = solution.bathymetric, statistics.block.points.ids
    yield (
        "Photos: those whose rays give the point. Incidence: mean angle of these rays, in air, from the normal of "
        "the water."
    )
    index = f"; predicted: {solution.water.index:.3f} (the index) times that" if solution.water else ""
    adjusted = "" if _unrefracted(statistics) else "; refraction: adjusted"
    yield f"No refr.: the depth where straight rays of the adjusted stations meet{index}{adjusted}."
    if adjusted and _are_given(statistics):
        yield (
            "Ctrl: a height is given, of full (F) or vertical (V) control or a check point (C). Residual: adjusted "
            "minus given depth."
        )
    blank = np.isnan(points.apparent_depth)
    lost = solution.points.status[points.point] == PointStatus.NOT_DETERMINED
    alone = ids[points.point[blank & ~lost]].tolist()
    if alone:
        yield f"No refr. is blank where straight rays do not meet, or there is only one: {', '.join(alone)}"
    for row in points.point[lost].tolist():
        yield f"{ids[row]} has no depth: {solution.points.reasons.get(row, 'no reason given')}"


def _comparison(statistics: Statistics) -> Section:
    local = statistics.block.options.system is CoordinateSystem.LOCAL
    columns = 2 if _unrefracted(statistics) else 3
    rule = "-" * (16 + columns * _WIDTH)
    names = "".join(f"{heading:>{_WIDTH}}" for heading in _HEADINGS[:columns])
    lines = []
    for (name, mark), coordinates in zip(_names(statistics), statistics.bathymetric_xyz, strict=True):
        for axis, letter in enumerate("XYZ"):
            cells = "".join(f"{cell:>{_WIDTH}}" for cell in edited("F14.1", coordinates[:columns, axis]))
            label = f"{name:<8.8}{mark:<4}" if axis == 1 else " " * 12
            lines.append(f"{label}{letter:>4}{cells}".rstrip())
        lines.append(rule)
    notes = ["", "*  Point not triangulated.", "** Point is a vertical control point."]
    frame = "Local" if local else "Geocentric"
    return Section(
        title=f"Bathymetric Points\nComparison of Computed {frame} Coordinates (M)",
        head=["=" * len(rule), f"{'Point Number':<16}{names}", rule],
        lines=[*lines, *notes],
        values=lambda: _POSITIONS.cells(statistics),
        new_page=True,
    )


def _unrefracted(statistics: Statistics) -> bool:
    """Tell whether the run knew nothing of water: the positions are then those without refraction."""
    return statistics.block.options.refraction is Refraction.NONE


def _names(statistics: Statistics) -> list[tuple[str, str]]:
    """Return the id of each submerged point and its mark of Table 6-9."""
    rows, control = statistics.solution.bathymetric.point, statistics.block.control
    vertical = np.isin(rows, control.point[control.kind == ControlKind.VERTICAL])
    kept_out = statistics.solution.points.status[rows] != PointStatus.TRIANGULATED
    marks = np.where(vertical, "**", np.where(kept_out, "*", ""))
    return list(zip(statistics.block.points.ids[rows].tolist(), marks.tolist(), strict=True))


def _flags(statistics: Statistics) -> list[Section]:
    """Return the points in doubt, and what their flags mean for the fit; nothing where no flag is contradicted."""
    tests, other = statistics.flags, statistics.solution.other_flags
    if not len(tests.doubted):
        return []
    note = (
        f"Of {len(tests.point)} points held against the water of their photos, these lie below all of it without "
        f"the flag B, or stand above it with it, by more than {number_text('F8.1', tests.limit)} sigmas. A point "
        "that is dry and lies below the water (dike, polder, sump) has the flag D."
    )
    if other is not None and squares_choose(statistics.solution):
        own = statistics.solution.sum_of_squares
        squares = [number_text("F12.1", value) for value in (own, other.sum_of_squares)]
        note += f" v'Pv is {squares[0]}, with all of them flagged the other way {squares[1]}."
    return [FLAG_TABLE.section(statistics, note)]
