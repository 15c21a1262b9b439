"""Surfaces and contours of a compilation, as tables and as lines in a file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.model import CoordinateSystem
from musatpy.reports.fields import Each, Field
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key
from musatpy.surfaces.contours import bounds
from musatpy.units import DEGREE

if TYPE_CHECKING:
    from musatpy.compilation.bottom import Bottom

Level = tuple[str, float, bool, int, float, float]

SURFACES: Each[list[Bottom], Bottom] = Each(
    "surfaces",
    "one row per model whose bottom was asked for",
    lambda bottoms: bottoms,
    (
        Field("model", "string", "model id", lambda b: b.model.name),
        Field("points", "integer", "of the surface", lambda b: 0 if b.tin is None else len(b.tin.z)),
        Field("merged", "integer", "points in the places of others", lambda b: b.tin.merged if b.tin else 0),
        Field("area", "number?", "in plan", lambda b: b.tin.area if b.tin else np.nan, "m2"),
        Field("least", "number?", "depth below the datum", lambda b: _depth(b, np.min), "m"),
        Field("greatest", "number?", "depth below the datum", lambda b: _depth(b, np.max), "m"),
        Field("dropped", "integer", "pieces of contours that were too short", lambda b: b.lines.dropped),
        Field("reason", "string", "why there is no surface; empty where there is", lambda b: b.surface.reason),
    ),
)
CONTOURS: Each[list[Bottom], Level] = Each(
    "contours",
    "one row per depth of a model",
    lambda bottoms: _levels(bottoms),
    (
        Field("model", "string", "model id", lambda c: c[0]),
        Field("depth", "number", "below the datum", lambda c: c[1], "m"),
        Field("index", "boolean", "drawn thick", lambda c: c[2]),
        Field("lines", "integer", "pieces", lambda c: c[3]),
        Field("length", "number", "in plan", lambda c: c[4], "m"),
        Field("area", "number", "enclosed by closed lines", lambda c: c[5], "m2"),
    ),
)
RECORD = (SURFACES, CONTOURS)


def _depth(bottom: Bottom, of: Any) -> float:
    return np.nan if bottom.tin is None else float(of(bottom.tin.z))


def _levels(bottoms: list[Bottom]) -> list[Level]:
    rows: list[Level] = []
    for bottom in bottoms:
        thick = {line.level for line in bottom.lines.lines if line.index}
        rows += [
            (bottom.model.name, level, level in thick, number, length, area)
            for level, number, length, area in bounds(bottom.lines.lines)
        ]
    return rows


SURFACE_TABLE: Report[Any] = Report(
    title="Surfaces Of The Bottom",
    table=SURFACES,
    columns=(
        key("Model", "A8", "model"),
        Column("Points", "I6", shows="points"),
        Column("Merged", "I6", shows="merged"),
        Column("Area\nm2", "F14.1", shows="area"),
        Column("Least depth\nm", "F11.3", shows="least"),
        Column("Greatest depth\nm", "F14.3", shows="greatest"),
        Column("Dropped", "I7", shows="dropped"),
        Column("Without a surface, because", "A50", shows="reason"),
    ),
)
CONTOUR_TABLE: Report[Any] = Report(
    title="Contours",
    table=CONTOURS,
    columns=(
        key("Model", "A8", "model"),
        key("Depth\nm", "F9.3", "depth"),
        Column("Index", "A5", shows=Origin(field="index", true="index")),
        Column("Lines", "I5", shows="lines"),
        Column("Length\nm", "F12.1", shows="length"),
        Column("Enclosed area\nm2", "F14.1", shows="area"),
    ),
)
STATED = (SURFACE_TABLE, CONTOUR_TABLE)


def sections_of(bottoms: list[Bottom]) -> list[Section]:
    """Return the tables, nothing where no bottom was asked for."""
    if not bottoms:
        return []
    return [SURFACE_TABLE.section(bottoms, new_page=True), CONTOUR_TABLE.section(bottoms)]


def contours_csv(bottoms: list[Bottom], datum: float) -> str:
    """Return the contours as comma-separated values, a vertex a line, in the system of the job (degrees, m)."""
    lines: list[str] = []
    number = 0
    for bottom in bottoms:
        system = bottom.model.stereo.run.block.options.system
        angular = system == CoordinateSystem.GEOGRAPHIC
        if not lines:
            lines.append(f"line,model,depth,index,closed,{'latitude,longitude,height' if angular else 'X,Y,Z'}")
        unit, decimals = (np.array([DEGREE, DEGREE, 1.0]), (10, 10, 4)) if angular else (np.ones(3), (4, 4, 4))
        for line in bottom.lines.lines:
            number += 1
            head = f"{number},{bottom.model.name},{line.level:g},{int(line.index)},{int(line.closed)},"
            for vertex in bottom.surface.coordinates(line.xy, np.full(len(line.xy), datum - line.level)) / unit:
                lines.append(head + ",".join(f"{v:.{d}f}" for v, d in zip(vertex, decimals, strict=True)))
    return "\n".join(lines) + "\n"
