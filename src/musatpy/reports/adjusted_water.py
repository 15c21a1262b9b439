"""The water of a simultaneous adjustment: corrections of the tides, tilt, index, waves, as far as unknown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from musatpy.model import AdjustedWater, AdjustedWaves
from musatpy.reports import quality_record
from musatpy.reports.editing import number_text
from musatpy.reports.fields import Field
from musatpy.reports.labels import Content, Labels, numbers_at
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.reports.text import labelled, wrapped
from musatpy.reports.values import at
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import exact_water
from musatpy.units import ARC_SECOND


def sections(statistics: Statistics) -> list[Section]:
    """Return what was found of the water, nothing where all of it was known."""
    water = statistics.solution.water
    if water is None:
        return []
    lines = labelled(_lines(water))
    text = "Blank: not determined by the images, if any depend on it."
    note = ["", text] if any(name.startswith("the level") for name in water.undetermined) else []
    return [
        *([CORRECTIONS.section(statistics, note, worst=())] if len(water.correction) else []),
        *([Section(title=SURFACE.title, lines=lines)] if lines else []),
        *([] if water.waves is None else _waves(water.waves)),
        *_not_adjusted(statistics),
    ]


def _not_adjusted(statistics: Statistics) -> list[Section]:
    """Return the water that is known with an error, and that without; nothing in a job without submerged points."""
    sections, solution = [], statistics.solution
    if solution.considered is not None:
        note = (
            "Their errors are not adjusted: they are in the sigmas of stations, points and depths, and the tests "
            f"allow for them. Without what they explain, sigma0 is {number_text('F8.3', solution.unit_sigma)}."
        )
        sections.append(CONSIDERED.section(statistics, ["", *wrapped([note])]))
    exact = exact_water(statistics.block)
    if exact:
        note = f"Taken to be without error, as the cards give no sigma: {'; '.join(exact)}."
        sections.append(Section(title="Water: Without Error", lines=wrapped([note])))
    return sections


WAVES: Report[AdjustedWaves] = Report(
    title="Water: Adjusted Waves",
    table=quality_record.WAVES,
    path="adjusted_water.waves.waves",
    columns=("wave", "period", "length", "speed", "height", "azimuth", "crest"),
)


PARAMETERS_OF_WAVES: Report[AdjustedWaves] = Report(
    title="Water: How Well The Waves Are Known",
    table=quality_record.PARAMETERS_OF_WAVES,
    path="adjusted_water.waves.parameters",
    columns=(
        "wave",
        "parameter",
        "given",
        "given_sigma",
        "adjusted",
        Field(
            "change",
            heading="Adjusted\n- given",
            edit="F10.4",
            shown=lambda t: (
                quality_record.in_units_of_waves(t, "adjusted") - quality_record.in_units_of_waves(t, "given")
            ),
        ),
        "sigma",
        "inflation",
        "verdict",
    ),
)
CORRELATIONS: Report[AdjustedWaves] = Report(
    title="Water: Correlations Of The Waves",
    table=quality_record.WAVE_CORRELATIONS,
    path="adjusted_water.waves.correlations",
    worst=lambda t: np.abs(t["correlation"]),
    columns=("first", "second", "correlation"),
)
CONSIDERED: Report[Statistics] = Report(
    title="Water: Known With An Error",
    table=quality_record.CONSIDERED,
    path="adjusted_water.considered",
    columns=("quantity", "sigma", "unit"),
)
CORRECTIONS: Report[Statistics] = Report(
    title="Water: Corrections Of The Tides",
    table=quality_record.CORRECTIONS,
    path="adjusted_water.corrections",
    worst=lambda t: np.abs(t["correction"]),
    columns=("group", "correction", "correction_sigma"),
)


def _surface(content: Content) -> dict[str, Sequence[float | None]]:
    """Return tilt (arc seconds) and index of the water with their sigmas, as a record has them."""
    tilt, sigma = (at(content, f"adjusted_water.{name}") or (None, None) for name in ("tilt", "tilt_sigma"))
    labels: dict[str, Sequence[float | None]] = {
        f"Tilt towards {name}": [None if part is None else part / ARC_SECOND for part in parts]
        for name, *parts in zip(("east", "north"), tilt, sigma, strict=True)
    }
    labels["Refractive index"] = numbers_at(content, "adjusted_water.index", "adjusted_water.index_sigma")
    return labels


SURFACE = Labels("Water: Surface And Index", _surface)
STATED = (CORRECTIONS, SURFACE, CONSIDERED, WAVES, PARAMETERS_OF_WAVES, CORRELATIONS)


def _waves(waves: AdjustedWaves) -> list[Section]:
    note = (
        "As on the cards, heights are from trough to crest, directions clockwise from true north, and crests count "
        "from the origin of the waves at time 0. A parameter is determined where its sigma is at most half of that "
        "given, and not where it keeps 0.95 of it."
    )
    return [
        WAVES.section(waves),
        PARAMETERS_OF_WAVES.section(waves, ["", *wrapped([note])]),
        CORRELATIONS.section(waves, worst=()),
    ]


def _lines(water: AdjustedWater) -> dict[str, str]:
    lines = {}
    for label in ("Tilt towards east", "Tilt towards north", "Refractive index"):
        if label.split()[0].lower() in " ".join(water.undetermined):  # tilt, refractive
            lines[label] = "not determined"
    if np.isfinite(water.tilt_sigma).all():
        for name, value, sigma in zip(("east", "north"), water.tilt, water.tilt_sigma, strict=True):
            numbers = [number_text("F12.3", angle / ARC_SECOND) for angle in (value, sigma)]
            lines[f"Tilt towards {name}"] = f"{numbers[0]} arc seconds, sigma {numbers[1]}"
    if np.isfinite(water.index_sigma):
        lines["Refractive index"] = (
            f"{number_text('F10.6', water.index)}, sigma {number_text('F10.6', water.index_sigma)}"
        )
    return lines
