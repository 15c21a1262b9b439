"""The water of a simultaneous adjustment: corrections of the tides, tilt, index, waves, as far as unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import AdjustedWater, AdjustedWaves, ConsideredWater
from musatpy.reports.editing import edited
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table
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
        table = Table(_columns(water))
        found.append(
            Section(title="Water: Corrections Of The Tides", head=table.head(), lines=table.lines(statistics))
        )
    lines = _lines(water)
    if lines:
        found.append(Section(title="Water: Surface And Index", lines=labelled(lines)))
    if water.waves is not None:
        found += _waves(water.waves)
    return [*found, *_not_adjusted(statistics)]


def _not_adjusted(statistics: Statistics) -> list[Section]:
    """Return the water that is known with an error, and that without; nothing in a job without submerged points."""
    sections, solution = [], statistics.solution
    if solution.considered is not None:
        table = Table(_CONSIDERED)
        note = (
            "Their errors are not adjusted: they are in the sigmas of stations, points and depths, and the tests "
            f"allow for them. Without what they explain, sigma0 is {_text('F8.3', solution.unit_sigma)}."
        )
        lines = [*table.lines(solution.considered), "", *wrapped([note])]
        sections.append(Section(title="Water: Known With An Error", head=table.head(), lines=lines))
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


_ADJUSTED: tuple[Column[AdjustedWaves], ...] = (
    Column("Wave", "A4", lambda waves: waves.ids),
    Column("Period\ns", "F8.3", lambda waves: waves.period),
    Column("Length\nm", "F9.3", lambda waves: waves.value[:, 1]),
    Column("Speed\nm/s", "F8.3", lambda waves: waves.speed),
    Column("Height\nm", "F8.3", lambda waves: waves.value[:, 0]),
    Column("Towards\ndegrees", "F9.3", lambda waves: waves.value[:, 2] / DEGREE),
    Column("Crest\nm", "F10.3", lambda waves: waves.value[:, 3]),
)
_PARAMETERS: tuple[Column[list[_Parameter]], ...] = (
    Column("Wave", "A4", lambda rows: [row.wave for row in rows]),
    Column("Parameter", "A14", lambda rows: [row.name for row in rows]),
    Column("Given", "F10.4", lambda rows: [row.given for row in rows]),
    Column("Sigma", "F9.4", lambda rows: [row.given_sigma for row in rows]),
    Column("Adjusted", "F10.4", lambda rows: [row.adjusted for row in rows]),
    Column("Adjusted\n- given", "F10.4", lambda rows: [row.adjusted - row.given for row in rows]),
    Column("Sigma", "F9.4", lambda rows: [row.sigma for row in rows]),
    Column("Variance\ninflation", "F10.1", lambda rows: [row.inflation for row in rows]),
    Column("", "A38", lambda rows: [row.verdict for row in rows]),
)
_PAIRS: tuple[Column[AdjustedWaves], ...] = (
    Column("Unknown", "A18", lambda waves: waves.first),
    Column("With", "A26", lambda waves: waves.second),
    Column("Correlation", "F9.4", lambda waves: waves.correlation),
)
_PRINTED = (("height, m", 1.0), ("length, m", 1.0), ("towards, deg", DEGREE), ("crest, m", 1.0))


_UNITS = {"m": 1.0, "arc sec": ARC_SECOND, "deg": DEGREE, "": 1.0}
_CONSIDERED: tuple[Column[ConsideredWater], ...] = (
    Column("Quantity", "A36", lambda water: water.names),
    Column("Sigma", "F12.6", lambda water: considered_sigmas(water)),
    Column("Unit", "A8", lambda water: water.units),
)


def considered_sigmas(water: ConsideredWater) -> FloatArray:
    """Return the sigmas (c,) of what is known with an error, in the units in which they are read."""
    return water.sigma / np.array([_UNITS[unit] for unit in water.units.tolist()])


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
    found, table, pairs = Table(_ADJUSTED), Table(_PARAMETERS), Table(_PAIRS)
    note = (
        "As on the cards, heights are from trough to crest, directions clockwise from true north, and crests count "
        "from the origin of the waves at time 0. A parameter is determined where its sigma is at most half of that "
        "given, and not where it keeps 0.95 of it."
    )
    return [
        Section(title="Water: Adjusted Waves", head=found.head(), lines=found.lines(waves)),
        Section(
            title="Water: How Well The Waves Are Known",
            head=table.head(),
            lines=[*table.lines(rows), "", *wrapped([note])],
        ),
        Section(title="Water: Correlations Of The Waves", head=pairs.head(), lines=pairs.lines(waves)),
    ]


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
