"""Residuals of every plate measurement, photo by photo."""

from __future__ import annotations

import numpy as np

from musatpy.reports.columns import photo_column, point_column, vector
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table
from musatpy.statistics import LARGE_RESIDUAL, Statistics
from musatpy.units import MICROMETRE

RESIDUALS: tuple[Column[Statistics], ...] = (
    photo_column(lambda s: s.block.plates.photo[s.plate_order]),
    point_column(lambda s: s.block.plates.point[s.plate_order]),
    *vector(("x\nmm", "y\nmm"), ("F10.4", "F10.4"), lambda s: s.block.plates.xy[s.plate_order]),
    *vector(
        ("Resid. x\num", "Resid. y\num"),
        ("F9.2", "F9.2"),
        lambda s: s.solution.plates.residual[s.plate_order],
        unit=MICROMETRE,
    ),
    *vector(
        ("Sigma x\num", "Sigma y\num"), ("F8.2", "F8.2"), lambda s: s.plate_sigmas[s.plate_order], unit=MICROMETRE
    ),
    *vector(
        ("Refr. x\num", "Refr. y\num"),
        ("F9.2", "F9.2"),
        lambda s: np.where(s.submerged_plates[:, None], s.solution.plates.correction, np.nan)[s.plate_order],
        unit=MICROMETRE,
    ),
    Column("Bath", "A4", lambda s: np.where(s.submerged_plates[s.plate_order], "B", "")),
    Column("Trig", "A4", lambda s: np.where(s.solution.plates.triangulated[s.plate_order], "", "N")),
    Column("Large", "A5", lambda s: np.where(s.large_residuals[s.plate_order], "*", "")),
)


def sections(statistics: Statistics) -> list[Section]:
    """Return all residuals, with a blank line between photos."""
    if not len(statistics.block.plates.photo):
        return []
    table = Table(RESIDUALS)
    photos = statistics.block.plates.photo[statistics.plate_order].tolist()
    lines: list[str] = []
    for photo, previous, line in zip(photos, [photos[0], *photos], table.lines(statistics), strict=False):
        if photo != previous:
            lines.append("")
        lines.append(line)
    note = f"*  Residual larger than {LARGE_RESIDUAL:.0f} sigmas of its measurement."
    title = "Residuals Of Plate Measurements: Adjusted Minus Measured"
    return [Section(title=title, head=table.head(), lines=[*lines, "", note], new_page=True)]
