"""The water of a simultaneous adjustment: corrections of the tides, tilt, index, waves, as far as unknown."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import AdjustedWater, AdjustedWaves, ConsideredWater, WaterPrecision
from musatpy.model.solution import WAVE_VALUES
from musatpy.reports import echo
from musatpy.reports.editing import number_text
from musatpy.reports.fields import Field, FieldGroup, Rows
from musatpy.reports.pages import Section, labelled, wrapped
from musatpy.reports.table import Content, Labels, Report, numbers_at
from musatpy.reports.values import Values, at
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import exact_water
from musatpy.units import ARC_SECOND, DEGREE

_CONSIDERED_UNITS = {"m": 1.0, "arc sec": ARC_SECOND, "deg": DEGREE, "": 1.0}


_WAVES = Rows[AdjustedWaves, AdjustedWaves](
    "waves", "the waves as adjusted", (
        Field("wave", "string", "wave id; of waves without one, their number", "ids", "Wave", "A4", is_id=True),
        Field("period", "number?", "length over speed; null where the wave stands still",
              lambda w: np.where(np.isinf(w.period), np.nan, w.period), "Period\ns", "F8.3"),
        Field("speed", "number", "of the crests", heading="Speed\nm/s", edit="F8.3"),
        echo.WAVES.column("height", values=lambda w: w.value[:, 0]),
        Field("length", "number", "from crest to crest", lambda w: w.value[:, 1], "Length\nm", "F9.3"),
        echo.WAVES.column("azimuth", values=lambda w: w.value[:, 2]),
        echo.WAVES.column("crest", values=lambda w: w.value[:, 3]),
        Field("crests_open", "number",
              "part of a length (1 sigma) that what was given leaves open of its crests, at the typical distance "
              "of the points from the origin", "open"),
    ),
)  # fmt: skip
_OF_WAVE = "m or rad"


def _in_printed_units(t: Values, name: str) -> FloatArray:
    """Return values of parameters of waves (n,), azimuths in degrees."""
    return np.asarray(t[name] / np.where(t["parameter"] == "azimuth", DEGREE, 1.0))


_PARAMETERS = Rows[AdjustedWaves, AdjustedWaves](
    "parameters", "one row per parameter of a wave, known or not", (
        Field("wave", "string", "wave id", lambda w: np.repeat(w.ids, len(WAVE_VALUES)), "Wave", "A4", is_id=True),
        Field("parameter", "string", "of the wave", lambda w: WAVE_VALUES * len(w.ids), "Parameter", "A14",
              choices=WAVE_VALUES, is_id=True,
              words={"height": "height, m", "length": "length, m", "azimuth": "towards, deg", "crest": "crest, m"}),
        Field("given", "number", "of the deck", lambda w: w.prior.ravel(), "Given", "F10.4", unit=_OF_WAVE,
              shown=lambda t: _in_printed_units(t, "given")),
        Field("given_sigma", "number?", "of the deck; null where it was known", lambda w: w.prior_sigma.ravel(),
              "Sigma", "F9.4", unit=_OF_WAVE, shown=lambda t: _in_printed_units(t, "given_sigma")),
        Field("adjusted", "number", "adjusted", lambda w: w.value.ravel(), "Adjusted", "F10.4", unit=_OF_WAVE,
              shown=lambda t: _in_printed_units(t, "adjusted")),
        Field("change", heading="Adjusted\n- given", edit="F10.4",
              shown=lambda t: _in_printed_units(t, "adjusted") - _in_printed_units(t, "given")),
        Field("sigma", "number?", "a posteriori; null where it was known", lambda w: w.sigma.ravel(), "Sigma",
              "F9.4", unit=_OF_WAVE, shown=lambda t: _in_printed_units(t, "sigma")),
        Field("kept", "number?",
              "sigma, with the a priori unit weight, over that given: 1 where nothing was learnt",
              lambda w: w.kept.ravel()),
        Field("inflation", "number?", "variance inflation factor; null where it was known",
              lambda w: w.inflation.ravel(), "Variance\ninflation", "F10.1"),
        Field("verdict", "string", "whether it was determined, and if not, why; empty where it was known",
              lambda w: w.verdicts.ravel(), "", "A38", words={"": "known"}),
    ),
)  # fmt: skip
_CORRELATIONS_OF_WAVES = Rows[AdjustedWaves, AdjustedWaves](
    "correlations",
    "of the unknown parameters with one another, with the other unknowns of the water, and with the station height "
    "most correlated",
    (
        Field("first", "string", "a parameter of a wave", heading="Unknown", edit="A18", is_id=True),
        Field("second", "string", "the other unknown", heading="With", edit="A26", is_id=True),
        Field("correlation", "number?", "between -1 and 1", heading="Correlation", edit="F9.4"),
    ),
)  # fmt: skip


_CORRECTIONS = Rows[Statistics, AdjustedWater](
    "corrections", "corrections of tides", of=attrgetter("solution.water"), fields=(
        Field("group", "string", "photo, group or day; empty for all photos", "correction_ids", "Photo or group",
              "A14", words={"": "all photos"}, is_id=True),
        Field("correction", "number?", "to be added to the given tides; null: not determined",
              heading="Correction\nm", edit="F11.4"),
        Field("correction_sigma", "number?", "of the correction", heading="Sigma\nm", edit="F9.4"),
    ),
)  # fmt: skip
_CONSIDERED = Rows[Statistics, ConsideredWater](
    "considered", "water that was known with a sigma and not adjusted; its errors are in all sigmas",
    of=lambda s: s.solution.considered, fields=(
        Field("quantity", "string",
              "the level of a tide group, day or photo; the tilt; the index; a parameter of a wave", "names",
              "Quantity", "A36", is_id=True),
        Field("sigma", "number", "in the unit beside",
              lambda c: c.sigma / np.array([_CONSIDERED_UNITS[unit] for unit in c.units.tolist()]),
              "Sigma", "F12.6"),
        Field("unit", "enum", "of the sigma", "units", "Unit", "A8", choices=("m", "arc sec", "deg", "")),
    ),
)  # fmt: skip
ADJUSTED_WATER = FieldGroup[Statistics, Statistics](
    "adjusted_water", "the water after the adjustment; null without a water card",
    of=lambda s: None if s.solution.water is None else s, fields=(
        Field("tide", "* number?", "height of the water at each photo", "solution.water.tide", unit="m"),
        _CORRECTIONS,
        Field("tilt", "* number", "slopes towards east and north", "solution.water.tilt", unit="rad"),
        Field("tilt_sigma", "* number?", "null: known, or not determined", "solution.water.tilt_sigma", unit="rad"),
        Field("index", "number", "refractive index", "solution.water.index"),
        Field("index_sigma", "number?", "null: known, or not determined", "solution.water.index_sigma"),
        FieldGroup[Statistics, AdjustedWaves](
            "waves", "waves whose parameters were unknown; null without such",
            of=attrgetter("solution.water.waves"), optional=True,
            fields=(_WAVES, _PARAMETERS, _CORRELATIONS_OF_WAVES),
        ),
        _CONSIDERED,
        Field("undetermined", "* string", "unknown water that no observation determines, in words: it has no sigma",
              lambda s: list(attrgetter("solution.water.undetermined")(s))),
        Field("without_error", "* string", "water that was known without a sigma, in words",
              lambda s: exact_water(s.block)),
    ),
    optional=True,
)  # fmt: skip


WATER_PRECISION = Rows[Statistics, WaterPrecision](
    "water_precision",
    "one row per quantity of the water that is adjusted or considered, but unknown levels of single photos, and "
    "one per parameter of a lens that is adjusted",
    of=lambda s: s.solution.water_precision, fields=(
        Field("quantity", "string", "level, tilt, index, parameter of a wave or of a lens", "names"),
        Field("covariance", "* number?", "a posteriori, with all of them in this order", unit="m, mm, rad"),
        Field("stations", "* number?",
              "a posteriori, with east, north, up, X-tilt, Y-tilt, heading of each station, one after the other",
              lambda w: w.stations.reshape(-1, len(w.names)).T, unit="m, rad"),
        Field("levels", "* number?",
              "a posteriori, with the unknown level of each photo; empty where there are none", "levels.T",
              unit="m", exact=True),
    ),
)  # fmt: skip


def sections(statistics: Statistics) -> list[Section]:
    """Return what was found of the water, nothing where all of it was known."""
    water = statistics.solution.water
    if water is None:
        return []
    lines = labelled(_lines(statistics, water))
    is_open = any(name.startswith("the level") for name in water.undetermined)
    note = "Blank: not determined by the images, if any depend on it." if is_open else ""
    sections = [
        *([CORRECTIONS.section(statistics, note, worst=())] if len(water.correction) else []),
        *([Section(title=SURFACE.title, lines=lines)] if lines else []),
    ]
    if (waves := water.waves) is not None:
        note = (
            "As on the cards, heights are from trough to crest, directions clockwise from true north, and crests "
            "count from the origin of the waves at time 0. A parameter is determined where its sigma is at most "
            "half of that given, and not where it keeps 0.95 of it."
        )
        sections += [WAVES.section(waves), PARAMETERS_OF_WAVES.section(waves, note)]
        sections.append(CORRELATIONS.section(waves, worst=()))
    if (solution := statistics.solution).considered is not None:
        note = (
            "Their errors are not adjusted: they are in the sigmas of stations, points and depths, and the tests "
            f"allow for them. Without what they explain, sigma0 is {number_text('F8.3', solution.unit_sigma)}."
        )
        sections.append(CONSIDERED.section(statistics, note))
    if exact := exact_water(statistics.block):
        note = f"Taken to be without error, as the cards give no sigma: {'; '.join(exact)}."
        sections.append(Section(title="Water: Without Error", lines=wrapped([note])))
    return sections


WAVES = Report("Water: Adjusted Waves", _WAVES, "wave period length speed height azimuth crest")


PARAMETERS_OF_WAVES = Report("Water: How Well The Waves Are Known", _PARAMETERS)
CORRELATIONS = Report(
    "Water: Correlations Of The Waves",
    _CORRELATIONS_OF_WAVES,
    worst=lambda t: np.abs(t["correlation"]),
)
CONSIDERED = Report("Water: Known With An Error", _CONSIDERED)
CORRECTIONS = Report("Water: Corrections Of The Tides", _CORRECTIONS, worst=lambda t: np.abs(t["correction"]))


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


def _lines(statistics: Statistics, water: AdjustedWater) -> dict[str, str]:
    """Return tilt and index of the water, as far as they were unknown."""
    lines, undetermined = {}, " ".join(water.undetermined)
    for label, (value, sigma) in _surface({"adjusted_water": ADJUSTED_WATER.json(statistics)}).items():
        edit, unit = ("F10.6", "") if label == "Refractive index" else ("F12.3", " arc seconds")
        if value is not None and sigma is not None:
            lines[label] = f"{number_text(edit, value)}{unit}, sigma {number_text(edit, sigma)}"
        elif label.split()[0].lower() in undetermined:  # tilt, refractive
            lines[label] = "not determined"
    return lines
