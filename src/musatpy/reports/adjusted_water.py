"""The water of a simultaneous adjustment: corrections of the tides, tilt, index, waves, as far as unknown."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import AdjustedWater, AdjustedWaves
from musatpy.model.solution import WAVE_VALUES
from musatpy.reports import quality_record
from musatpy.reports.editing import number_text
from musatpy.reports.origin import Mapped, Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key
from musatpy.reports.text import labelled, wrapped
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import exact_water
from musatpy.units import ARC_SECOND, DEGREE


def sections(statistics: Statistics) -> list[Section]:
    """Return what was found of the water, nothing where all of it was known."""
    water = statistics.solution.water
    if water is None:
        return []
    lines = labelled(_lines(water))
    text = "Blank: not determined by the images, if any depend on it."
    note = ["", text] if any(name.startswith("the level") for name in water.undetermined) else []
    return [
        *([CORRECTIONS.section(statistics, note)] if len(water.correction) else []),
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
    columns=(
        key("Wave", "A4", "wave"),
        Column("Period\ns", "F8.3", lambda waves: waves.period, "period"),
        Column("Length\nm", "F9.3", shows="length"),
        Column("Speed\nm/s", "F8.3", shows="speed"),
        Column("Height\nm", "F8.3", shows="height"),
        Column("Towards\ndegrees", "F9.3", shows="azimuth"),
        Column("Crest\nm", "F10.3", shows="crest"),
    ),
)


def _in_unit(heading: str, edit: str, name: str, minus: str = "") -> Column[AdjustedWaves]:
    """Return a column of numbers in the units of their parameters."""

    def printed(waves: AdjustedWaves, name: str) -> FloatArray:
        units = np.tile([DEGREE if parameter == "azimuth" else 1.0 for parameter in WAVE_VALUES], len(waves.ids))
        numbers: FloatArray = quality_record.PARAMETERS_OF_WAVES.column(name, waves) / units
        return numbers

    def values(waves: AdjustedWaves) -> FloatArray:
        return printed(waves, name) - printed(waves, minus) if minus else printed(waves, name)

    return Column(heading, edit, values, Origin(field=name, minus=minus, unit_in="Parameter"))


PARAMETERS_OF_WAVES: Report[AdjustedWaves] = Report(
    title="Water: How Well The Waves Are Known",
    table=quality_record.PARAMETERS_OF_WAVES,
    path="adjusted_water.waves.parameters",
    words={
        "parameter": {
            "height": "height, m",
            "length": "length, m",
            "azimuth": "towards, deg",
            "crest": "crest, m",
        },
        "verdict": {"": "known"},
    },
    columns=(
        key("Wave", "A4", "wave"),
        key("Parameter", "A14", "parameter"),
        _in_unit("Given", "F10.4", "given"),
        _in_unit("Sigma", "F9.4", "given_sigma"),
        _in_unit("Adjusted", "F10.4", "adjusted"),
        _in_unit("Adjusted\n- given", "F10.4", "adjusted", "given"),
        _in_unit("Sigma", "F9.4", "sigma"),
        Column("Variance\ninflation", "F10.1", shows="inflation"),
        Column("", "A38", shows="verdict"),
    ),
)
CORRELATIONS: Report[AdjustedWaves] = Report(
    title="Water: Correlations Of The Waves",
    table=quality_record.WAVE_CORRELATIONS,
    path="adjusted_water.waves.correlations",
    columns=(
        key("Unknown", "A18", "first"),
        key("With", "A26", "second"),
        Column("Correlation", "F9.4", shows="correlation"),
    ),
)
CONSIDERED: Report[Statistics] = Report(
    title="Water: Known With An Error",
    table=quality_record.CONSIDERED,
    path="adjusted_water.considered",
    columns=(
        key("Quantity", "A36", "quantity"),
        Column("Sigma", "F12.6", shows="sigma"),
        Column("Unit", "A8", shows="unit"),
    ),
)
CORRECTIONS: Report[Statistics] = Report(
    title="Water: Corrections Of The Tides",
    table=quality_record.CORRECTIONS,
    path="adjusted_water.corrections",
    unnamed="all photos",
    columns=(
        key("Photo or group", "A14", "group"),
        Column("Correction\nm", "F11.4", shows="correction"),
        Column("Sigma\nm", "F9.4", shows="correction_sigma"),
    ),
)
SURFACE = Mapped(
    title="Water: Surface And Index",
    layout="labels",
    columns={
        "Tilt towards east": Origin(
            field="adjusted_water.tilt[0]", then=("adjusted_water.tilt_sigma[0]",), unit="arc sec"
        ),
        "Tilt towards north": Origin(
            field="adjusted_water.tilt[1]", then=("adjusted_water.tilt_sigma[1]",), unit="arc sec"
        ),
        "Refractive index": Origin(field="adjusted_water.index", then=("adjusted_water.index_sigma",)),
    },
)
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
        CORRELATIONS.section(waves),
    ]


def _lines(water: AdjustedWater) -> dict[str, str]:
    lines = {}
    for label in SURFACE.columns:
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
