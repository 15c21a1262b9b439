"""The part of the record that says how good the solution is: verdict, water, tests, observations, dependence."""

from __future__ import annotations

import re
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
from musatpy.model.kinds import ANGLES, ENU
from musatpy.model.solution import WAVE_VALUES
from musatpy.reports.fields import Each, Field, Group, Rows, same
from musatpy.reports.values import Values
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import exact_water
from musatpy.statistics.quality import ChiSquare
from musatpy.units import ARC_SECOND, DEGREE

_CONSIDERED_UNITS = {"m": 1.0, "arc sec": ARC_SECOND, "deg": DEGREE, "": 1.0}

_ANGLE = re.compile("tilt of the water.*|wave .* azimuth")  # unknowns by such names are angles
_GRADES = ("DOUBTFUL", "REJECTED", "FAILED")

VERDICT = Group[Statistics, Verdict](
    "verdict",
    "what the run is worth",
    lambda s: s.verdict,
    (
        Field("grade", "string", "that of the worst reason; FAILED has not converged",
              choices=("ACCEPTED", *_GRADES)),
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
        Field("wave", "string", "wave id; of waves without one, their number", lambda w: w.ids, heading="Wave",
              edit="A4", is_id=True),
        Field("period", "number?", "length over speed; null where the wave stands still",
              lambda w: np.where(np.isinf(w.period), np.nan, w.period), "s", heading="Period\ns", edit="F8.3"),
        Field("speed", "number", "of the crests", unit="m/s", heading="Speed\nm/s", edit="F8.3"),
        Field("height", "number", "from trough to crest", lambda w: w.value[:, 0], "m", heading="Height\nm",
              edit="F8.3"),
        Field("length", "number", "from crest to crest", lambda w: w.value[:, 1], "m", heading="Length\nm",
              edit="F9.3"),
        Field("azimuth", "number", "direction it runs to, clockwise from true north (+Y in LOCL jobs)",
              lambda w: w.value[:, 2], "rad", heading="Towards\ndegrees", edit="F9.3"),
        Field("crest", "number", "distance from the origin, in that direction, of a crest at time 0",
              lambda w: w.value[:, 3], "m", heading="Crest\nm", edit="F10.3"),
        Field("crests_open", "number",
              "part of a length (1 sigma) that what was given leaves open of its crests, at the typical distance "
              "of the points from the origin", lambda w: w.open),
    ),
)  # fmt: skip
_OF_WAVE = "m or rad"


def in_units_of_waves(t: Values, name: str) -> FloatArray:
    """Return values of parameters of waves (n,), azimuths in degrees."""
    return np.asarray(t[name] / np.where(t["parameter"] == "azimuth", DEGREE, 1.0))


PARAMETERS_OF_WAVES = Rows[AdjustedWaves, AdjustedWaves](
    "parameters",
    "one row per parameter of a wave, known or not",
    same,
    (
        Field("wave", "string", "wave id", lambda w: np.repeat(w.ids, len(WAVE_VALUES)), heading="Wave", edit="A4",
              is_id=True),
        Field("parameter", "string", "of the wave", lambda w: WAVE_VALUES * len(w.ids), choices=WAVE_VALUES,
              heading="Parameter", edit="A14", is_id=True,
              words={"height": "height, m", "length": "length, m", "azimuth": "towards, deg", "crest": "crest, m"}),
        Field("given", "number", "of the deck", lambda w: w.prior.ravel(), _OF_WAVE, heading="Given", edit="F10.4",
              shown=lambda t: in_units_of_waves(t, "given")),
        Field("given_sigma", "number?", "of the deck; null where it was known", lambda w: w.prior_sigma.ravel(),
              _OF_WAVE, heading="Sigma", edit="F9.4", shown=lambda t: in_units_of_waves(t, "given_sigma")),
        Field("adjusted", "number", "adjusted", lambda w: w.value.ravel(), _OF_WAVE, heading="Adjusted",
              edit="F10.4", shown=lambda t: in_units_of_waves(t, "adjusted")),
        Field("sigma", "number?", "a posteriori; null where it was known", lambda w: w.sigma.ravel(), _OF_WAVE,
              heading="Sigma", edit="F9.4", shown=lambda t: in_units_of_waves(t, "sigma")),
        Field("kept", "number?",
              "sigma, with the a priori unit weight, over that given: 1 where nothing was learnt",
              lambda w: w.kept.ravel()),
        Field("inflation", "number?", "variance inflation factor; null where it was known",
              lambda w: w.inflation.ravel(), heading="Variance\ninflation", edit="F10.1"),
        Field("verdict", "string", "whether it was determined, and if not, why; empty where it was known",
              lambda w: w.verdicts.ravel(), heading="", edit="A38", words={"": "known"}),
    ),
)  # fmt: skip
WAVE_CORRELATIONS = Rows[AdjustedWaves, AdjustedWaves](
    "correlations",
    "of the unknown parameters with one another, with the other unknowns of the water, and with the station height "
    "most correlated",
    same,
    (
        Field("first", "string", "a parameter of a wave", heading="Unknown", edit="A18", is_id=True),
        Field("second", "string", "the other unknown", heading="With", edit="A26", is_id=True),
        Field("correlation", "number?", "between -1 and 1", heading="Correlation", edit="F9.4"),
    ),
)  # fmt: skip


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
        Field("group", "string", "photo, group or day; empty for all photos", lambda w: w.correction_ids,
              heading="Photo or group", edit="A14", words={"": "all photos"}, is_id=True),
        Field("correction", "number?", "to be added to the given tides; null: not determined", unit="m",
              heading="Correction\nm", edit="F11.4"),
        Field("correction_sigma", "number?", "of the correction", unit="m", heading="Sigma\nm", edit="F9.4"),
    ),
)  # fmt: skip
CONSIDERED = Rows[Statistics, ConsideredWater](
    "considered",
    "water that was known with a sigma and not adjusted; its errors are in all sigmas",
    lambda s: s.solution.considered,
    (
        Field("quantity", "string",
              "the level of a tide group, day or photo; the tilt; the index; a parameter of a wave",
              lambda c: c.names, heading="Quantity", edit="A36", is_id=True),
        Field("sigma", "number", "in the unit beside", considered_sigmas, heading="Sigma", edit="F12.6"),
        Field("unit", "enum", "of the sigma", lambda c: c.units, choices=("m", "arc sec", "deg", ""),
              heading="Unit", edit="A8"),
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
        Field("undetermined", "* string", "unknown water that no observation determines, in words: it has no sigma",
              lambda s: list(_water(s).undetermined)),
        Field("without_error", "* string", "water that was known without a sigma, in words",
              lambda s: exact_water(s.block)),
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
        Field("group", "string", "group of observations", lambda g: g[0], heading="Group", edit="A28", is_id=True),
        Field("redundancy", "number", "sum of the redundancy numbers", lambda g: g[1].redundancy,
              heading="Redundancy", edit="F11.2"),
        Field("factor", "number?", "v'Pv over the redundancy", lambda g: g[1].factor, heading="Variance\nfactor",
              edit="F9.3"),
        Field("low", "number?", "lower limit of the test", lambda g: g[1].low, heading="Lower\nlimit", edit="F8.3"),
        Field("high", "number?", "upper limit", lambda g: g[1].high, heading="Upper\nlimit", edit="F8.3"),
        Field("accepted", "boolean", "the factor agrees with 1", lambda g: g[1].accepted),
    ),
)  # fmt: skip
CHECK_POINTS = Rows[Statistics, Statistics](
    "check_points",
    "one row per check point",
    same,
    (
        Field("point", "string", "point id", lambda s: s.block.points.ids[s.block.control.point[s.check_test.row]],
              heading="Point", edit="A8", is_id=True),
        Field("chi_square", "number", "difference against its covariance", lambda s: s.check_test.squares,
              heading="Chi-square", edit="F10.3"),
        Field("components", "integer", "given components", lambda s: s.check_test.components, heading="Components",
              edit="I5"),
        Field("probability", "number?", "of as much by chance", lambda s: s.check_test.probability,
              heading="Probability", edit="F8.4"),
    ),
)  # fmt: skip


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
        Field("point", "string", "point id", lambda m: m.statistics.block.points.ids[m.rows], heading="Point",
              edit="A8", is_id=True),
        Field("rays", "integer", "plate measurements of the position",
              lambda m: m.statistics.solution.points.rays[m.rows], heading="Rays", edit="I4"),
        Field("shift", "number?",
              "by the largest such error of one image or control component; null: without limit",
              lambda m: m.statistics.hidden.shift[m.rows], "m", heading="Moved by\nm", edit="F11.3",
              shown=lambda t: np.where(t["unlimited"], np.nan, t["shift"])),
        Field("sigmas", "number?", "the same in sigmas of the coordinate that moves most of its own",
              lambda m: m.statistics.hidden.sigmas[m.rows], heading="In its\nsigmas", edit="F11.1",
              shown=lambda t: np.where(np.isinf(t["sigmas"]), np.nan, t["sigmas"])),
        Field("unlimited", "boolean", "nothing checks an observation of the point",
              lambda m: np.isinf(m.statistics.hidden.shift[m.rows]), heading="", edit="A14",
              words={True: "without limit", False: ""}),
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
        Field("photo", "string", "photo id", lambda s: s.block.photos.ids, heading="Photo", edit="A8", is_id=True),
        Field("inflation", "6 number?", "variance inflation factors: east, north, up, X-tilt, Y-tilt, heading",
              lambda s: s.dependence.station_inflation, heading=(*ENU, *ANGLES), edit="F10.1"),
    ),
)  # fmt: skip


def _dependence(statistics: Statistics) -> Dependence:
    return statistics.dependence


def _global_sigmas(t: Values) -> FloatArray:
    """Return the sigmas (n,) of levels, water and points, those of angles in arc seconds."""
    is_angle = [bool(_ANGLE.fullmatch(name)) for name in t["unknown"]]
    return np.asarray(t["sigma"] / np.where(is_angle, ARC_SECOND, 1.0))


GLOBALS = Rows[Statistics, Dependence](
    "globals",
    "levels, water, and points with distances or height differences",
    _dependence,
    (
        Field("unknown", "string", "name", lambda d: d.names, heading="Unknown", edit="A32", is_id=True),
        Field("sigma", "number?", "a posteriori; null: nothing observes it", heading="Sigma\nm, arc sec, 1",
              edit="F12.6", shown=_global_sigmas),
        Field("inflation", "number?", "variance inflation factor", heading="Variance\ninflation", edit="F12.1"),
    ),
)  # fmt: skip
CORRELATIONS = Rows[Statistics, Dependence](
    "correlations",
    "correlations of 0.95 and more, the strongest first",
    _dependence,
    (
        Field("first", "string", "unknown", heading="Unknown", edit="A32", is_id=True),
        Field("second", "string", "unknown", heading="With", edit="A32", is_id=True),
        Field("correlation", "number", "coefficient", heading="Correlation", edit="F9.4"),
    ),
)  # fmt: skip
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
        Field("blunder", "string", "what is wrong", heading="Blunder", edit="A21", is_id=True),
        Field("photo", "string?", "photo id; of tides also a group, a day, or all", lambda f: f.photo or None,
              heading="Photo", edit="A17", is_id=True),
        Field("point", "string?", "point id, as in the deck", lambda f: f.point or None, heading="Point",
              edit="A17", is_id=True),
        Field("test", "number?", "test value, null where nothing checks", heading="Test", edit="F9.1"),
        Field("size", "* number?", "estimated: given minus what all else says, by component"),
        Field("unit", "string", "of the size", lambda f: f.kind.unit),
        Field("action", "string", "what was done, or with LIST would be", heading="Action", edit="A11"),
        Field("note", "string", "explanation", heading="Note", edit="A80"),
    ),
)  # fmt: skip
CAUSES = Each[Statistics, Cause](
    "causes",
    "ranked causes of what does not fit: of a search that was asked for, and of runs that failed or are doubtful",
    lambda s: s.solution.causes,
    (
        Field("group", "integer", "causes of one group explain the same misfit", heading="Group", edit="I5"),
        Field("rank", "integer",
              "in the group; causes of one rank explain it equally well, the cheaper to check first",
              heading="Rank", edit="I4"),
        Field("cause", "string", "what may be wrong", lambda c: c.kind, heading="Cause", edit="A27"),
        Field("cards", "* string", "mnemonics of the cards to read again"),
        Field("photos", "* string", "photo ids"),
        Field("points", "* string", "point ids"),
        Field("component", "string", "of the card; empty: none of its own"),
        Field("size", "* number?", "estimated: given minus true, by component"),
        Field("sigma", "* number?", "of the size"),
        Field("unit", "string", "of size and sigma", heading="Unit", edit="A7"),
        Field("parameters", "integer", "that the cause takes"),
        Field("drop", "number?", "of the weighted sum of squares; null where the block fits only under it"),
        Field("test", "number?", "root of the drop for each parameter, in sigma0", heading="Test", edit="F9.1"),
        Field("advice", "string", "what to check"),
    ),
)  # fmt: skip
