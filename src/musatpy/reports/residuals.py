"""Residuals of every plate measurement, photo by photo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.reports import brevity, result_record
from musatpy.reports.columns import vector
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key
from musatpy.statistics import LARGE_RESIDUAL, Statistics
from musatpy.units import MICROMETRE


def _refraction(statistics: Statistics, axis: int) -> np.ndarray:
    """Return the refraction (um) of images of submerged points, by the rows of the table."""
    submerged = statistics.block.points.bathymetric[statistics.block.plates.point]
    refraction = np.where(submerged, statistics.solution.plates.correction[:, axis], np.nan)
    return refraction[statistics.plate_order] / MICROMETRE


RESIDUALS: Report[Statistics] = Report(
    title="Residuals Of Plate Measurements: Adjusted Minus Measured",
    table=result_record.PLATES,
    rows=lambda s: s.plate_order,
    columns=(
        key("Photo", "A8", "photo"),
        key("Point", "A8", "point"),
        *vector(("x\nmm", "y\nmm"), ("F10.4", "F10.4"), shows="xy"),
        *vector(("Resid. x\num", "Resid. y\num"), ("F9.2", "F9.2"), shows="residual"),
        *vector(("Sigma x\num", "Sigma y\num"), ("F8.2", "F8.2"), shows="sigma"),
        Column("Refr. x\num", "F9.2", lambda s: _refraction(s, 0), Origin(field="refraction[0]", blank=True)),
        Column("Refr. y\num", "F9.2", lambda s: _refraction(s, 1), Origin(field="refraction[1]", blank=True)),
        Column("Bath", "A4", lambda s: s.block.points.letters[s.block.plates.point[s.plate_order]]),
        Column("Trig", "A4", shows=Origin(field="triangulated", false="N")),
        Column("Large", "A5", lambda s: np.where(s.large_residuals[s.plate_order], "*", "")),
    ),
)
STATED = (RESIDUALS,)
brief = brevity.nothing


def sections(statistics: Statistics) -> list[Section]:
    """Return all residuals, with a blank line between photos."""
    if not len(statistics.block.plates.photo):
        return []
    section = RESIDUALS.section(statistics)
    photos = statistics.block.plates.photo[statistics.plate_order].tolist()
    lines: list[str] = []
    for photo, previous, line in zip(photos, [photos[0], *photos], section.lines, strict=False):
        if photo != previous:
            lines.append("")
        lines.append(line)
    note = f"*  Residual larger than {LARGE_RESIDUAL:.0f} sigmas of its measurement."
    return [replace(section, lines=[*lines, "", note], new_page=True)]
