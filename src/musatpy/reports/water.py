"""The water of a simultaneous adjustment: corrections of the tides, tilt, index, waves, as far as unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import TextArray
from musatpy.model import AdjustedWater, AdjustedWaves
from musatpy.reports import quality_record
from musatpy.reports.editing import edited
from musatpy.reports.origin import Mapped, Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key
from musatpy.reports.text import labelled, wrapped
from musatpy.statistics import Statistics
from musatpy.statistics.exact_water import exact_water
from musatpy.units import ARC_SECOND, DEGREE


def sections(statistics: Statistics) -> list[Section]:
    """Return what was found of the water, nothing where all of it was known."""
    water = statistics.solution.water
    if water is None:
        return []
    found = []
    if len(water.correction):
        found.append(CORRECTIONS.section(statistics))
    lines = _lines(water)
    if lines:
        found.append(Section(title=SURFACE.title, lines=labelled(lines)))
    if water.waves is not None:
        found += _waves(water.waves)
    return [*found, *_not_adjusted(statistics)]


def _not_adjusted(statistics: Statistics) -> list[Section]:
    """Return the water that is known with an error, and that without; nothing in a job without submerged points."""
    sections, solution = [], statistics.solution
    if solution.considered is not None:
        note = (
            "Their errors are not adjusted: they are in the sigmas of stations, points and depths, and the tests "
            f"allow for them. Without what they explain, sigma0 is {_text('F8.3', solution.unit_sigma)}."
        )
        sections.append(CONSIDERED.section(statistics, ["", *wrapped([note])]))
    exact = exact_water(statistics.block)
    if exact:
        note = f"Taken to be without error, as the cards give no sigma: {'; '.join(exact)}."
        sections.append(Section(title="Water: Without Error", lines=wrapped([note])))
    return sections


@dataclass(frozen=True, kw_only=True)
class _Parameter:
    """One parameter of one wave, as it is printed: in metres, or degrees."""

    wave: str
    name: str
    given: float
    given_sigma: float
    adjusted: float
    sigma: float
    inflation: float
    verdict: str


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


def _in_row(name: str, minus: str = "") -> Origin:
    return Origin(field=name, minus=minus, unit_in="Parameter")


PARAMETERS: Report[list[_Parameter]] = Report(
    title="Water: How Well The Waves Are Known",
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
        key("Wave", "A4", "wave", lambda rows: [row.wave for row in rows]),
        key("Parameter", "A14", "parameter", lambda rows: [row.name for row in rows]),
        Column("Given", "F10.4", lambda rows: [row.given for row in rows], _in_row("given")),
        Column("Sigma", "F9.4", lambda rows: [row.given_sigma for row in rows], _in_row("given_sigma")),
        Column("Adjusted", "F10.4", lambda rows: [row.adjusted for row in rows], _in_row("adjusted")),
        Column(
            "Adjusted\n- given",
            "F10.4",
            lambda rows: [row.adjusted - row.given for row in rows],
            _in_row("adjusted", "given"),
        ),
        Column("Sigma", "F9.4", lambda rows: [row.sigma for row in rows], _in_row("sigma")),
        Column("Variance\ninflation", "F10.1", lambda rows: [row.inflation for row in rows], "inflation"),
        Column("", "A38", lambda rows: [row.verdict for row in rows], "verdict"),
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
_PRINTED = (("height, m", 1.0), ("length, m", 1.0), ("towards, deg", DEGREE), ("crest, m", 1.0))
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
        key("Photo or group", "A14", "group", lambda s: _groups(s)),
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
STATED = (CORRECTIONS, SURFACE, CONSIDERED, WAVES, PARAMETERS, CORRELATIONS)


def _waves(waves: AdjustedWaves) -> list[Section]:
    rows = [
        _Parameter(
            wave=str(waves.ids[wave]),
            name=name,
            given=waves.prior[wave, column] / unit,
            given_sigma=waves.prior_sigma[wave, column] / unit,
            adjusted=waves.value[wave, column] / unit,
            sigma=waves.sigma[wave, column] / unit,
            inflation=waves.inflation[wave, column],
            verdict=str(waves.verdicts[wave, column]) or "known",
        )
        for wave in range(len(waves.value))
        for column, (name, unit) in enumerate(_PRINTED)
    ]
    note = (
        "As on the cards, heights are from trough to crest, directions clockwise from true north, and crests count "
        "from the origin of the waves at time 0. A parameter is determined where its sigma is at most half of that "
        "given, and not where it keeps 0.95 of it."
    )
    return [
        WAVES.section(waves),
        PARAMETERS.section(rows, ["", *wrapped([note])]),
        CORRELATIONS.section(waves),
    ]


def _groups(statistics: Statistics) -> TextArray:
    ids = quality_record.CORRECTIONS.column("group", statistics)
    return np.where(ids == "", CORRECTIONS.unnamed, ids)


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
