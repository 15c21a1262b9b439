"""Bathymetric points without refraction, predicted and with refraction (ETL-0306, Table 6-9); their depths."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.arrays import BoolArray
from musatpy.model import ControlKind, CoordinateSystem, PointStatus, Refraction
from musatpy.reports import result_record
from musatpy.reports.editing import edited
from musatpy.reports.origin import Mapped, Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Choice, Column, Report, key, worst_first
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import NOT_GIVEN

_WIDTH = 18
_HEADINGS = ("No Refraction", "Predicted", "Refraction")

_ADJUSTED: tuple[Column[Statistics], ...] = (
    Column("Depth, refraction\nm", "F12.3", shows="depth"),
    Column("Sigma\nm", "F9.3", shows="depth_sigma"),
    Column("Height\nm", "F9.3", shows="height"),
)
_GIVEN: tuple[Column[Statistics], ...] = (
    Column("Ctrl", "A4", shows="control"),
    Column("Residual\nm", "F8.3", shows="residual"),
)
DEPTHS: Report[Statistics] = Report(
    title="Depths Of Bathymetric Points",
    table=result_record.BATHYMETRIC,
    words={"control": {"full": "F", "vertical": "V", "check": "C", "None": ""}},
    columns=(
        key("Point", "A8", "point"),
        Column("Photos", "I6", shows="photos"),
        Column("Incidence\ndegrees", "F9.1", shows="incidence"),
        Column("Water level\nm", "F11.3", shows="water_level"),
        Column("Depth, no refr.\nm", "F12.3", shows="depth_no_refraction"),
        Column("Depth, predicted\nm", "F12.3", shows="depth_predicted"),
        Choice((_ADJUSTED,), lambda s: () if _unrefracted(s) else _ADJUSTED),
        # soundings used as control: none where no submerged point has a given height
        Choice((_GIVEN,), lambda s: () if _unrefracted(s) or not _are_given(s) else _GIVEN),
    ),
)
COORDINATES = Mapped(
    title="Bathymetric Points",
    layout="xyz",
    table="bathymetric_points",
    columns={
        heading: Origin(field=name)
        for heading, name in zip(_HEADINGS, ("no_refraction", "predicted", "refraction"), strict=True)
    },
)
_POSITIONS: Report[Statistics] = Report(
    title=COORDINATES.title,
    table=result_record.BATHYMETRIC,
    columns=(
        key("Point", "A8", "point"),
        *(
            Column(f"{heading}, {axis}\nm", "F14.1", shows=f"{origin.field}[{number}]")
            for heading, origin in COORDINATES.columns.items()
            for number, axis in enumerate("XYZ")
        ),
    ),
)
STATED = (COORDINATES, DEPTHS)


def _are_given(statistics: Statistics) -> bool:
    return bool((statistics.sounding_kinds != NOT_GIVEN).any())


def sections(statistics: Statistics) -> list[Section]:
    """Return the comparison of coordinates and the depths; nothing in a job without submerged points."""
    if not len(statistics.solution.bathymetric.point):
        return []
    return [_comparison(statistics), *brief(statistics)]


def brief(statistics: Statistics) -> list[Section]:
    """Return the depths; nothing in a job without submerged points."""
    points = statistics.solution.bathymetric
    if not len(points.point):
        return []
    notes = ["", *wrapped(_notes(statistics), lead="- ")]
    return [DEPTHS.section(statistics, notes, together=True, worst=worst_first(points.depth_sigma).tolist())]


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
    rows = statistics.solution.bathymetric.point
    vertical = _vertical_control(statistics)[rows]
    kept_out = statistics.solution.points.status[rows] != PointStatus.TRIANGULATED
    marks = np.where(vertical, "**", np.where(kept_out, "*", ""))
    return list(zip(statistics.block.points.ids[rows].tolist(), marks.tolist(), strict=True))


def _vertical_control(statistics: Statistics) -> BoolArray:
    """Return (p,) True where a point is a vertical control point."""
    control = statistics.block.control
    vertical = np.zeros(len(statistics.block.points.ids), dtype=bool)
    vertical[control.point[control.kind == ControlKind.VERTICAL]] = True
    return vertical
