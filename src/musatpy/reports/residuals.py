"""Residuals of every plate measurement, photo by photo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.reports import brevity
from musatpy.reports.fields import Field
from musatpy.reports.pages import Section
from musatpy.reports.result_record import PLATES
from musatpy.reports.table import Report
from musatpy.reports.values import Values
from musatpy.reports.wording import of_job
from musatpy.statistics import LARGE_RESIDUAL, Statistics


def _refraction(t: Values) -> FloatArray:
    """Return the refraction (n, 2) of images of submerged points, NaN of others: a listing leaves them blank."""
    if t.source is None:
        return np.asarray(t["refraction"])
    block = t.source.block
    return np.where(block.points.bathymetric[block.plates.point][t.rows, None], t["refraction"], np.nan)


RESIDUALS: Report[Statistics] = Report(
    title="Residuals Of Plate Measurements: Adjusted Minus Measured",
    table=PLATES,
    which=lambda t: t.source.plate_order if t.source else np.arange(t.count),
    columns=(
        *("photo", "point", "xy", "residual", "sigma"),
        PLATES.column("refraction", shown=_refraction),
        of_job("Bath", "A4", lambda s: s.block.points.letters[s.block.plates.point[s.plate_order]]),
        "triangulated",
        Field("large", heading="Large", edit="A5", shown=lambda t: np.where(_large(t), "*", "")),
    ),
)


def _large(t: Values) -> BoolArray:
    return np.asarray((np.abs(t["residual"]) > LARGE_RESIDUAL * t["sigma"]).any(axis=1))


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
