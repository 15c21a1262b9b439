"""The water of a simultaneous adjustment: corrections of the tides, tilt and index, as far as they were unknown."""

from __future__ import annotations

import numpy as np

from musatpy.model import AdjustedWater
from musatpy.reports.editing import edited
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table
from musatpy.reports.text import labelled
from musatpy.statistics import Statistics
from musatpy.units import ARC_SECOND


def sections(statistics: Statistics) -> list[Section]:
    """Return what was found of the water, nothing where all of it was known."""
    water = statistics.solution.water
    if water is None:
        return []
    found = []
    if len(water.correction):
        table = Table(_columns(water))
        found.append(
            Section(title="Water: Corrections Of The Tides", head=table.head(), lines=table.lines(statistics))
        )
    lines = _lines(water)
    if lines:
        found.append(Section(title="Water: Surface And Index", lines=labelled(lines)))
    return found


def _columns(water: AdjustedWater) -> tuple[Column[Statistics], ...]:
    return (
        Column(
            "Photo or group",
            "A14",
            lambda s: np.where(water.correction_ids == "", "all photos", water.correction_ids),
        ),
        Column("Correction\nm", "F11.4", lambda s: water.correction),
        Column("Sigma\nm", "F9.4", lambda s: water.correction_sigma),
    )


def _lines(water: AdjustedWater) -> dict[str, str]:
    lines = {}
    if np.isfinite(water.tilt_sigma).all():
        for name, value, sigma in zip(("east", "north"), water.tilt, water.tilt_sigma, strict=True):
            text = f"{_text('F12.3', value / ARC_SECOND)} arc seconds, sigma {_text('F12.3', sigma / ARC_SECOND)}"
            lines[f"Tilt towards {name}"] = text
    if np.isfinite(water.index_sigma):
        lines["Refractive index"] = f"{_text('F10.6', water.index)}, sigma {_text('F10.6', water.index_sigma)}"
    return lines


def _text(descriptor: str, value: float) -> str:
    return edited(descriptor, [value])[0].strip()
