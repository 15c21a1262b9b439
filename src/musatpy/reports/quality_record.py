"""The part of the record that says how good the solution is: verdict, water, tests, observations, dependence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.model import (
    AdjustedWater,
    AdjustedWaves,
    Cause,
    ConsideredWater,
    Dependence,
    Finding,
    Verdict,
)
from musatpy.model.findings import Reason
from musatpy.model.solution import WAVE_VALUES
from musatpy.reports.fields import Each, Field, Group, Rows, same
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import exact_water
from musatpy.statistics.quality import ChiSquare
from musatpy.units import ARC_SECOND, DEGREE

_CONSIDERED_UNITS = {"m": 1.0, "arc sec": ARC_SECOND, "deg": DEGREE, "": 1.0}

_GRADES = ("DOUBTFUL", "REJECTED", "FAILED")

VERDICT = Group[Statistics, Verdict](
    "verdict",
    "what the run is worth",
    lambda s: s.verdict,
    (
        Field(
            "grade", "string", "that of the worst reason; FAILED has not converged", choices=("ACCEPTED", *_GRADES),
        ),
        Each[Verdict, Reason](
            "reasons",
            "one row per reason against the answer, the worst first",
            lambda v: v.reasons,
            (
                Field("grade", "string", "that the reason alone would give", choices=_GRADES),
                Field("concern", "string", "what it is about: convergence, sigma0, control, ..."),
                Field("text", "string", "the reason"),
                Field("section", "string", "how the title of the section of the listing begins where it shows"),
            ),
        ),
        Field("notes", "* string", "worth knowing, and no doubt"),
    ),
)  # fmt: skip

WAVES = Rows[AdjustedWaves, AdjustedWaves](
    "waves",
    "the waves as adjusted",
    same,
    (
        Field("wave", "string", "wave id; of waves without one, their number", lambda w: w.ids),
        Field(
            "period", "number?", "length over speed; null where the wave stands still",
            lambda w: np.where(np.isinf(w.period), np.nan, w.period), "s",
        ),
        Field("speed", "number", "of the crests", unit="m/s"),
        Field("height", "number", "from trough to crest", lambda w: w.value[:, 0], "m"),
        Field("length", "number", "from crest to crest", lambda w: w.value[:, 1], "m"),
        Field(
            "azimuth", "number", "direction it runs to, clockwise from true north (+Y in LOCL jobs)",
            lambda w: w.value[:, 2], "rad",
        ),
        Field(
            "crest", "number", "distance from the origin, in that direction, of a crest at time 0",
            lambda w: w.value[:, 3], "m",
        ),
        Field(
            "crests_open", "number",
            "part of a length (1 sigma) that what was given leaves open of its crests, at the typical distance of "
            "the points from the origin",
            lambda w: w.open,
        ),
    ),
)  # fmt: skip
_OF_WAVE = "m or rad"
PARAMETERS_OF_WAVES = Rows[AdjustedWaves, AdjustedWaves](
    "parameters",
    "one row per parameter of a wave, known or not",
    same,
    (
        Field("wave", "string", "wave id", lambda w: np.repeat(w.ids, len(WAVE_VALUES))),
        Field("parameter", "string", "of the wave", lambda w: WAVE_VALUES * len(w.ids), choices=WAVE_VALUES),
        Field("given", "number", "of the deck", lambda w: w.prior.ravel(), _OF_WAVE),
        Field(
            "given_sigma", "number?", "of the deck; null where it was known", lambda w: w.prior_sigma.ravel(),
            _OF_WAVE,
        ),
        Field("adjusted", "number", "adjusted", lambda w: w.value.ravel(), _OF_WAVE),
        Field("sigma", "number?", "a posteriori; null where it was known", lambda w: w.sigma.ravel(), _OF_WAVE),
        Field(
            "kept", "number?", "sigma, with the a priori unit weight, over that given: 1 where nothing was learnt",
            lambda w: w.kept.ravel(),
        ),
        Field(
            "inflation", "number?", "variance inflation factor; null where it was known",
            lambda w: w.inflation.ravel(),
        ),
        Field(
            "verdict", "string", "whether it was determined, and if not, why; empty where it was known",
            lambda w: w.verdicts.ravel(),
        ),
    ),
)  # fmt: skip
WAVE_CORRELATIONS = Rows[AdjustedWaves, AdjustedWaves](
    "correlations",
    "of the unknown parameters with one another, with the other unknowns of the water, and with the station height "
    "most correlated",
    same,
    (
        Field("first", "string", "a parameter of a wave"),
        Field("second", "string", "the other unknown"),
        Field("correlation", "number?", "between -1 and 1"),
    ),
)


def considered_sigmas(water: ConsideredWater) -> FloatArray:
    """Return the sigmas (c,) of what is known with an error, in the units in which they are read."""
    return water.sigma / np.array([_CONSIDERED_UNITS[unit] for unit in water.units.tolist()])


def _water(statistics: Statistics) -> AdjustedWater:
    water = statistics.solution.water
    if water is None:
        raise ValueError("a job without water")
    return water


CORRECTIONS = Rows[Statistics, AdjustedWater](
    "corrections",
    "corrections of tides",
    _water,
    (
        Field("group", "string", "photo, group or day; empty for all photos", lambda w: w.correction_ids),
        Field("correction", "number?", "to be added to the given tides; null: not determined", unit="m"),
        Field("correction_sigma", "number?", "of the correction", unit="m"),
    ),
)
CONSIDERED = Rows[Statistics, ConsideredWater](
    "considered",
    "water that was known with a sigma and not adjusted; its errors are in all sigmas",
    lambda s: s.solution.considered,
    (
        Field(
            "quantity", "string",
            "the level of a tide group, day or photo; the tilt; the index; a parameter of a wave",
            lambda c: c.names,
        ),
        Field("sigma", "number", "in the unit beside", considered_sigmas),
        Field("unit", "enum", "of the sigma", lambda c: c.units, choices=("m", "arc sec", "deg", "")),
    ),
)  # fmt: skip
ADJUSTED_WATER = Group[Statistics, Statistics](
    "adjusted_water",
    "the water after the adjustment; null without a water card",
    lambda s: None if s.solution.water is None else s,
    (
        Field("tide", "* number?", "height of the water at each photo", lambda s: _water(s).tide, "m"),
        CORRECTIONS,
        Field("tilt", "* number", "slopes towards east and north", lambda s: _water(s).tilt, "rad"),
        Field("tilt_sigma", "* number?", "null: known, or not determined", lambda s: _water(s).tilt_sigma, "rad"),
        Field("index", "number", "refractive index", lambda s: _water(s).index),
        Field("index_sigma", "number?", "null: known, or not determined", lambda s: _water(s).index_sigma),
        Group[Statistics, AdjustedWaves](
            "waves",
            "waves whose parameters were unknown; null without such",
            lambda s: _water(s).waves,
            (WAVES, PARAMETERS_OF_WAVES, WAVE_CORRELATIONS),
            optional=True,
        ),
        CONSIDERED,
        Field(
            "undetermined", "* string", "unknown water that no observation determines, in words: it has no sigma",
            lambda s: list(_water(s).undetermined),
        ),
        Field(
            "without_error", "* string", "water that was known without a sigma, in words",
            lambda s: exact_water(s.block),
        ),
    ),
    optional=True,
)  # fmt: skip

FACTOR: tuple[Field[ChiSquare], ...] = (
    Field("redundancy", "number", "degrees of freedom"),
    Field("factor", "number?", "weighted squares over the redundancy"),
    Field("low", "number?", "lower limit"),
    Field("high", "number?", "upper limit"),
    Field("accepted", "boolean", "the factor lies within the limits"),
)
FACTOR_DEFINITION = Group[ChiSquare, ChiSquare](
    "factor", "a variance factor with its two-sided test at 95 %", same, FACTOR, optional=True
)
COMPONENTS = Each[Statistics, tuple[str, ChiSquare]](
    "variance_components",
    "variance components",
    lambda s: list(s.components.items()),
    (
        Field("group", "string", "group of observations", lambda g: g[0]),
        Field("redundancy", "number", "sum of the redundancy numbers", lambda g: g[1].redundancy),
        Field("factor", "number?", "v'Pv over the redundancy", lambda g: g[1].factor),
        Field("low", "number?", "lower limit of the test", lambda g: g[1].low),
        Field("high", "number?", "upper limit", lambda g: g[1].high),
        Field("accepted", "boolean", "the factor agrees with 1", lambda g: g[1].accepted),
    ),
)
CHECK_POINTS = Rows[Statistics, Statistics](
    "check_points",
    "one row per check point",
    same,
    (
        Field("point", "string", "point id", lambda s: s.block.points.ids[s.block.control.point[s.check_test.row]]),
        Field("chi_square", "number", "difference against its covariance", lambda s: s.check_test.squares),
        Field("components", "integer", "given components", lambda s: s.check_test.components),
        Field("probability", "number?", "of as much by chance", lambda s: s.check_test.probability),
    ),
)


@dataclass(frozen=True, eq=False)
class _Moved:
    """The points that an error may move which its test does not find."""

    statistics: Statistics
    rows: IntArray


def _moved(statistics: Statistics) -> _Moved:
    return _Moved(statistics, np.flatnonzero(~np.isnan(statistics.hidden.shift)))


HIDDEN_ERRORS = Rows[Statistics, _Moved](
    "hidden_errors",
    "one row per point that an error may move which its test does not find",
    _moved,
    (
        Field("point", "string", "point id", lambda m: m.statistics.block.points.ids[m.rows]),
        Field(
            "rays", "integer", "plate measurements of the position",
            lambda m: m.statistics.solution.points.rays[m.rows],
        ),
        Field(
            "shift", "number?", "by the largest such error of one image or control component; null: without limit",
            lambda m: m.statistics.hidden.shift[m.rows], "m",
        ),
        Field(
            "sigmas", "number?", "the same in sigmas of the coordinate that moves most of its own",
            lambda m: m.statistics.hidden.sigmas[m.rows],
        ),
        Field(
            "unlimited", "boolean", "nothing checks an observation of the point",
            lambda m: np.isinf(m.statistics.hidden.shift[m.rows]),
        ),
        Field("weak", "boolean", "they are more than five", lambda m: m.statistics.hidden.weak[m.rows]),
    ),
)  # fmt: skip
TESTS = Group[Statistics, Statistics](
    "tests",
    "tests of the solution",
    lambda s: None if s.solution.observed is None else s,
    (
        Group[Statistics, ChiSquare]("sigma0", "", lambda s: s.sigma0, FACTOR, shared="factor"),
        COMPONENTS,
        CHECK_POINTS,
        Group[Statistics, ChiSquare](
            "check_points_total", "", lambda s: s.check_test.total, FACTOR, shared="factor"
        ),
        HIDDEN_ERRORS,
    ),
    optional=True,
)

STATION_INFLATION = Rows[Statistics, Statistics](
    "stations",
    "one row per photo",
    same,
    (
        Field("photo", "string", "photo id", lambda s: s.block.photos.ids),
        Field(
            "inflation", "6 number?", "variance inflation factors: east, north, up, X-tilt, Y-tilt, heading",
            lambda s: s.dependence.station_inflation,
        ),
    ),
)  # fmt: skip


def _dependence(statistics: Statistics) -> Dependence:
    return statistics.dependence


GLOBALS = Rows[Statistics, Dependence](
    "globals",
    "levels, water, and points with distances or height differences",
    _dependence,
    (
        Field("unknown", "string", "name", lambda d: d.names),
        Field("sigma", "number?", "a posteriori; null: nothing observes it"),
        Field("inflation", "number?", "variance inflation factor"),
    ),
)
CORRELATIONS = Rows[Statistics, Dependence](
    "correlations",
    "correlations of 0.95 and more, the strongest first",
    _dependence,
    (
        Field("first", "string", "unknown"),
        Field("second", "string", "unknown"),
        Field("correlation", "number", "coefficient"),
    ),
)
DEPENDENCE = Group[Statistics, Statistics](
    "dependence",
    "how the unknowns depend on one another",
    lambda s: None if s.solution.dependence is None else s,
    (STATION_INFLATION, GLOBALS, CORRELATIONS),
    optional=True,
)

FINDINGS = Each[Statistics, Finding](
    "findings",
    "one row per finding of the search for blunders",
    lambda s: s.solution.findings,
    (
        Field("blunder", "string", "what is wrong"),
        Field("photo", "string?", "photo id; of tides also a group, a day, or all", lambda f: f.photo or None),
        Field("point", "string?", "point id, as in the deck", lambda f: f.point or None),
        Field("test", "number?", "test value, null where nothing checks"),
        Field("size", "* number?", "estimated: given minus what all else says, by component"),
        Field("unit", "string", "of the size", lambda f: f.kind.unit),
        Field("action", "string", "what was done, or with LIST would be"),
        Field("note", "string", "explanation"),
    ),
)
CAUSES = Each[Statistics, Cause](
    "causes",
    "ranked causes of what does not fit: of a search that was asked for, and of runs that failed or are doubtful",
    lambda s: s.solution.causes,
    (
        Field("group", "integer", "causes of one group explain the same misfit"),
        Field(
            "rank", "integer",
            "in the group; causes of one rank explain it equally well, the cheaper to check first",
        ),
        Field("cause", "string", "what may be wrong", lambda c: c.kind),
        Field("cards", "* string", "mnemonics of the cards to read again"),
        Field("photos", "* string", "photo ids"),
        Field("points", "* string", "point ids"),
        Field("component", "string", "of the card; empty: none of its own"),
        Field("size", "* number?", "estimated: given minus true, by component"),
        Field("sigma", "* number?", "of the size"),
        Field("unit", "string", "of size and sigma"),
        Field("parameters", "integer", "that the cause takes"),
        Field("drop", "number?", "of the weighted sum of squares; null where the block fits only under it"),
        Field("test", "number?", "root of the drop for each parameter, in sigma0"),
        Field("advice", "string", "what to check"),
    ),
)  # fmt: skip
