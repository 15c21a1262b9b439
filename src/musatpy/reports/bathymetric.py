"""Bathymetric points without refraction, predicted and with refraction (ETL-0306, Table 6-9); their depths."""

from __future__ import annotations

import numpy as np

from musatpy.model import ControlKind, CoordinateSystem, PointStatus, Refraction
from musatpy.model.arrays import BoolArray
from musatpy.reports.columns import point_column
from musatpy.reports.editing import edited
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table, worst_first
from musatpy.statistics import Statistics

_WIDTH = 18
_HEADINGS = ("No Refraction", "Predicted", "Refraction")

DEPTHS: tuple[Column[Statistics], ...] = (
    point_column(lambda s: s.solution.bathymetric.point),
    Column("Water level\nm", "F11.3", lambda s: s.solution.bathymetric.water_level),
    Column("Depth, no refr.\nm", "F12.3", lambda s: s.solution.bathymetric.apparent_depth),
    Column("Depth, predicted\nm", "F12.3", lambda s: s.solution.bathymetric.predicted_depth),
    Column("Depth, refraction\nm", "F12.3", lambda s: s.solution.bathymetric.depth),
    Column("Sigma\nm", "F9.3", lambda s: s.solution.bathymetric.depth_sigma),
)


def sections(statistics: Statistics) -> list[Section]:
    """Return the comparison of coordinates and the depths; nothing in a job without submerged points."""
    if not len(statistics.solution.bathymetric.point):
        return []
    return [_comparison(statistics), *depths(statistics)]


def depths(statistics: Statistics) -> list[Section]:
    """Return the depths; nothing in a job without submerged points."""
    points = statistics.solution.bathymetric
    if not len(points.point):
        return []
    table = Table(DEPTHS[:4] if _unrefracted(statistics) else DEPTHS)
    return [
        Section(
            title="Depths Of Bathymetric Points",
            head=table.head(),
            lines=table.lines(statistics),
            worst=worst_first(points.depth_sigma).tolist(),
        )
    ]


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
    found = np.zeros(len(statistics.block.points.ids), dtype=bool)
    found[control.point[control.kind == ControlKind.VERTICAL]] = True
    return found
