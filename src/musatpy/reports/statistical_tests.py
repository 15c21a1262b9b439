"""The statistics of the listing: tests of sigma0 and of groups, the water, the worst observations, dependence."""

from __future__ import annotations

import math
import re
from functools import partial
from operator import attrgetter

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.model import Dependence, PlateSigma
from musatpy.model.kinds import ANGLES, ENU
from musatpy.reports import positions, residuals
from musatpy.reports.editing import number_text
from musatpy.reports.fields import Each, Field, FieldGroup, Rows, identity, within
from musatpy.reports.pages import Section
from musatpy.reports.table import Report, is_fine, worst_first
from musatpy.reports.values import Values
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import Ellipses, ellipses
from musatpy.statistics.quality import ALPHA, BETA, FAR, TEST_LIMIT, ChiSquare
from musatpy.units import ARC_SECOND

HIDDEN = "Statistics: Points That Undetected Errors May Move"
LISTED = 20  # observations, at least: all beyond the limit of the test are listed
_LEAST = 1e-300  # probability: zero has no logarithm
_INFLATION, _LENGTHS = 1, 3  # decimals of the tables that are in the order of them
_LISTED_CORRELATIONS = 40  # listed, the strongest


FACTOR: tuple[Field[ChiSquare], ...] = (
    Field("redundancy", "number", "degrees of freedom", heading="Redundancy", edit="F11.2"),
    Field("factor", "number?", "weighted squares over the redundancy", heading="Variance\nfactor", edit="F9.3"),
    Field("low", "number?", "lower limit", heading="Lower\nlimit", edit="F8.3"),
    Field("high", "number?", "upper limit", heading="Upper\nlimit", edit="F8.3"),
    Field("accepted", "boolean", "the factor lies within the limits"),
)
FACTOR_DEFINITION = FieldGroup[ChiSquare, ChiSquare](
    "factor", "a variance factor with its two-sided test at 95 %", FACTOR, optional=True
)
_COMPONENTS = Each[Statistics, tuple[str, ChiSquare]](
    "variance_components", "variance components", of=lambda s: list(s.components.items()), fields=(
        Field("group", "string", "group of observations", lambda g: g[0], "Group", "A28", is_id=True),
        *within(lambda g: g[1], FACTOR),
        Field("verdict", heading="Test", edit="A8",
              shown=lambda t: list(map(outside, t["factor"], t["low"], t["accepted"]))),
    ),
)  # fmt: skip
_CHECK_POINTS = Rows[Statistics, Statistics](
    "check_points", "one row per check point", (
        identity("point", lambda s: s.block.points.ids[s.block.control.point[s.check_test.row]]),
        Field("chi_square", "number", "difference against its covariance", "check_test.squares", "Chi-square",
              "F10.3"),
        Field("components", "integer", "given components", "check_test.components", "Components", "I5"),
        Field("probability", "number?", "of as much by chance", "check_test.probability", "Probability", "F8.4"),
    ),
)  # fmt: skip


def _moved(statistics: Statistics) -> IntArray:
    """Return the points that an error may move which its test does not find."""
    return np.flatnonzero(~np.isnan(statistics.hidden.shift))


_HIDDEN_ERRORS = Rows[Statistics, Statistics](
    "hidden_errors", "one row per point that an error may move which its test does not find", (
        identity("point", lambda s: s.block.points.ids[_moved(s)]),
        Field("rays", "integer", "plate measurements of the position", lambda s: s.solution.points.rays[_moved(s)],
              "Rays", "I4"),
        Field("shift", "number?",
              "by the largest such error of one image or control component; null: without limit",
              lambda s: s.hidden.shift[_moved(s)], "Moved by\nm", "F11.3",
              shown=lambda t: np.where(t["unlimited"], np.nan, t["shift"])),
        Field("sigmas", "number?", "the same in sigmas of the coordinate that moves most of its own",
              lambda s: s.hidden.sigmas[_moved(s)], "In its\nsigmas", "F11.1",
              shown=lambda t: np.where(np.isinf(t["sigmas"]), np.nan, t["sigmas"])),
        Field("unlimited", "boolean", "nothing checks an observation of the point",
              lambda s: np.isinf(s.hidden.shift[_moved(s)]), "", "A14", words={True: "without limit", False: ""}),
        Field("weak", "boolean", "they are more than five", lambda s: s.hidden.weak[_moved(s)]),
    ),
)  # fmt: skip
TESTS = FieldGroup[Statistics, Statistics](
    "tests",
    "tests of the solution",
    of=lambda s: None if s.solution.observed is None else s,
    fields=(
        FieldGroup[Statistics, ChiSquare]("sigma0", "", of=lambda s: s.sigma0, fields=FACTOR, shared="factor"),
        _COMPONENTS,
        _CHECK_POINTS,
        FieldGroup[Statistics, ChiSquare](
            "check_points_total", "", of=lambda s: s.check_test.total, fields=FACTOR, shared="factor"
        ),
        _HIDDEN_ERRORS,
    ),
    optional=True,
)
_STATION_INFLATION = Rows[Statistics, Statistics](
    "stations", "one row per photo", (
        identity("photo", "block.photos.ids"),
        Field("inflation", "6 number?", "variance inflation factors: east, north, up, X-tilt, Y-tilt, heading",
              "dependence.station_inflation", (*ENU, *ANGLES), "F10.1"),
    ),
)  # fmt: skip


_ANGLE = re.compile("tilt of the water.*|wave .* azimuth")  # unknowns by such names are angles


def _global_sigmas(t: Values) -> FloatArray:
    """Return the sigmas (n,) of levels, water and points, those of angles in arc seconds."""
    is_angle = [bool(_ANGLE.fullmatch(name)) for name in t["unknown"]]
    return np.asarray(t["sigma"] / np.where(is_angle, ARC_SECOND, 1.0))


_GLOBALS = Rows[Statistics, Dependence](
    "globals", "levels, water, and points with distances or height differences",
    of=attrgetter("dependence"), fields=(
        Field("unknown", "string", "name", "names", "Unknown", "A32", is_id=True),
        Field("sigma", "number?", "a posteriori; null: nothing observes it", heading="Sigma\nm, arc sec, 1",
              edit="F12.6", shown=_global_sigmas),
        Field("inflation", "number?", "variance inflation factor", heading="Variance\ninflation", edit="F12.1"),
    ),
)  # fmt: skip
_CORRELATIONS = Rows[Statistics, Dependence](
    "correlations", "correlations of 0.95 and more, the strongest first", of=attrgetter("dependence"), fields=(
        Field("first", "string", "unknown", heading="Unknown", edit="A32", is_id=True),
        Field("second", "string", "unknown", heading="With", edit="A32", is_id=True),
        Field("correlation", "number", "coefficient", heading="Correlation", edit="F9.4"),
    ),
)  # fmt: skip
DEPENDENCE = FieldGroup[Statistics, Statistics](
    "dependence",
    "how the unknowns depend on one another",
    of=lambda s: None if s.solution.dependence is None else s,
    fields=(_STATION_INFLATION, _GLOBALS, _CORRELATIONS),
    optional=True,
)


def _listed(t: Values) -> IntArray:
    """Return the observations that are listed: the worst, and all that are starred."""
    starred = np.count_nonzero(np.abs(np.nan_to_num(t.source.test)) > TEST_LIMIT)
    rows: IntArray = t.source.worst_first[: max(LISTED, int(starred))]
    return rows


def _tests(t: Values) -> FloatArray:
    """Return the test values (n,), which a record has where they are finite."""
    return np.asarray(t["test"] if t.source is None else t.source.test[t.rows])


COMPONENTS = Report("Statistics: Sigma0 And Variance Components", _COMPONENTS)
OBSERVATIONS = Report(
    "Statistics: Observations, The Worst First",
    residuals.OBSERVATIONS,
    (
        "kind of component",
        residuals.UNIT,
        "residual sigma redundancy standardised",
        residuals.OBSERVATIONS.column("test", shown=_tests),
        Field("beyond", edit="A1", shown=lambda t: np.where(np.abs(_tests(t)) > TEST_LIMIT, "*", "")),
        "detectable effect",
    ),
    which=_listed,
    worst=lambda t: np.abs(t["test"]),
    some=True,
)
CHECKS = Report(
    "Statistics: Check Points Against Their Own Covariance",
    _CHECK_POINTS,
    "point components chi_square probability",
    which=lambda t: worst_first(-np.log10(np.maximum(t["probability"], _LEAST))),
    worst=lambda t: -t["probability"],
)
HIDDEN_ERRORS = Report(
    HIDDEN,
    _HIDDEN_ERRORS,
    which=lambda t: np.searchsorted(
        _moved(t.source), t.source.hidden.worst_first[: max(LISTED, int(t.source.hidden.weak.sum()))]
    ),
    worst=lambda t: np.where(np.isnan(t["sigmas"]), np.inf, t["sigmas"]),
    some=True,
)
WATER = Report(
    "Statistics: Global Unknowns",
    _GLOBALS,
    which=lambda t: worst_first(t["inflation"], _INFLATION),
    worst=lambda t: t["inflation"],
)
CORRELATIONS = Report(
    "Statistics: Correlations Of 0.95 And More",
    _CORRELATIONS,
    which=lambda t: np.arange(t.count)[:_LISTED_CORRELATIONS],
    worst=lambda t: np.abs(t["correlation"]),
    some=True,
)
STATION_INFLATION = Report(
    "Statistics: Variance Inflation Of Stations",
    _STATION_INFLATION,
    which=lambda t: worst_first(_most_inflated(t), _INFLATION),
    worst=lambda t: _most_inflated(t),
)


def _ellipses(kind: str, unit: str = "m") -> Report[Statistics]:
    """Return the table of ellipses of stations or points, across the vertical or in the plane of the answer."""

    def of(t: Values) -> Ellipses:
        found: Ellipses = ellipses(t["covariance"]) if t.source is None else getattr(t.source, f"{kind}_ellipses")
        return found

    def part(name: str, t: Values) -> FloatArray:
        values: FloatArray = getattr(of(t), name)
        return values if t.source is None else values[t.rows]

    def largest(t: Values) -> IntArray:
        """Return the rows that have one, the largest first: by its major axis and the sigma upwards together."""
        size = np.hypot(of(t).major, of(t).vertical)
        rows = worst_first(size, 2 * _LENGTHS if is_fine(size) else _LENGTHS)[: np.count_nonzero(np.isfinite(size))]
        return rows if is_station else rows[:LISTED]

    axes = (
        Field[Statistics](name, heading=f"{name}\n{unit}", edit=edit, shown=partial(part, name.lower()))
        for name, unit, edit in (("Major", unit, "F9.3"), ("Minor", unit, "F9.3"), ("Bearing", "degrees", "F8.1"))
    )
    is_station = kind == "station"
    name, sigma = ("photo", "position_sigma") if is_station else ("point", "sigma")
    whose = "Stations" if is_station else f"Ground Points, The {LISTED} Largest"
    return Report(
        f"Statistics: Error Ellipses Of {whose}",
        positions.STATIONS if is_station else positions.POINTS,
        (name, *axes, Field(f"{sigma}[2]", heading="Sigma Up\nm", edit="F9.3")),
        pattern="" if is_station else r"Statistics: Error Ellipses Of Ground Points, The \d+ Largest",
        which=largest,
        worst=lambda t: np.linalg.norm(t[sigma], axis=1),
        some=not is_station,
    )


STATION_ELLIPSES, POINT_ELLIPSES = _ellipses("station"), _ellipses("point")
STATED = (
    *(COMPONENTS, OBSERVATIONS, HIDDEN_ERRORS, STATION_ELLIPSES, POINT_ELLIPSES),
    *(CHECKS, WATER, CORRELATIONS, STATION_INFLATION),
)


def sections(statistics: Statistics) -> list[Section]:
    """Return the statistics of an adjustment; nothing for a solution that carries none."""
    solution = statistics.solution
    if solution.observed is None or solution.dependence is None:
        return []
    tables = (
        (OBSERVATIONS, _observations(statistics)),
        (CHECKS, _check_total(statistics)),
        (HIDDEN_ERRORS, _hidden(statistics)),
        *((report, "") for report in (WATER, CORRELATIONS, STATION_INFLATION)),
    )
    sections = [COMPONENTS.section(statistics, _sigma0(statistics), new_page=True)]
    sections += [section for report, note in tables if (section := _ranked(report, statistics, note)).worst]
    plane, unit, words = "", "m", statistics.answer_words
    if words and words.has_plane:  # that ellipses are in
        plane, unit = ", In The Plane Of The System", words.statement.system.units[0][:14]
    return [*sections, *(_ranked(_ellipses(kind, unit), statistics, title=plane) for kind in ("station", "point"))]


def _ranked(report: Report[Statistics], statistics: Statistics, note: str = "", title: str = "") -> Section:
    """Return a table whose rows stand in their order, the worst first; its title ends with that."""
    values = report.values(statistics)
    return report.section(values, note, title=f"{report.title}{title}", worst=range(values.count))


def outside(factor: float, low: float, accepted: bool) -> str:
    """Return on which side of its limits a variance factor is, empty where these accept it, or there is none."""
    return "" if accepted or math.isnan(factor) else "too low" if factor < low else "TOO HIGH"


def _sigma0(statistics: Statistics) -> str:
    test = statistics.sigma0
    if test is None:
        return "Sigma0 cannot be tested: there is no redundancy."
    if statistics.block.options.plate_sigma_is is PlateSigma.GUESS:
        return "Sigma0 is not tested: the plate sigma is a guess, and estimated by its variance component."
    factor, low, high = (number_text("F12.4", value) for value in (test.factor, test.low, test.high))
    verdict = outside(test.factor, test.low, test.accepted).lower()
    verdict = f"does not agree with 1: {verdict}" if verdict else "agrees with 1"
    return f"Sigma0 squared is {factor}, by chance within {low} to {high} in 95 of 100 cases: it {verdict}."


def _check_total(statistics: Statistics) -> str:
    total = statistics.check_test.total
    if total is None:
        return ""
    factor, low, high = (number_text("F12.4", value) for value in (total.factor, total.low, total.high))
    verdict = outside(total.factor, total.low, total.accepted)
    return f"All together: chi-square over components {factor}, limits {low} to {high}. {verdict}".rstrip()


def _observations(statistics: Statistics) -> str:
    weights, options = "", statistics.block.options
    if options.weights != "FULL" and options.program == "IIA":
        weights = " Redundancy numbers are those of full weights."
    if statistics.block.control.correlated.any():
        weights += residuals.CORRELATED + (
            " Its residual and sigma are those for known other two components; its redundancy numbers do not add "
            "up to the degrees of freedom."
        )
    limit, risk = number_text("F6.2", TEST_LIMIT), number_text("F6.3", ALPHA)
    return (
        f"Test values beyond {limit} (risk {risk}) are starred. The smallest detectable error is found with a "
        f"probability of {number_text('F5.2', BETA)}; its effect is on the own position.{weights}"
    )


def _hidden(statistics: Statistics) -> str:
    """Return what is said of points that errors may move while no test finds these: the weakly checked ones."""
    hidden = statistics.hidden
    return (
        f"Weakly checked are {int(hidden.weak.sum())} of {len(hidden.worst_first)} points: an undetected error may "
        f"move them by more than {FAR:.0f} sigmas. It is that of one image or control component which its own test "
        f"finds with a probability of {number_text('F5.2', BETA)}; without limit where nothing checks the "
        "observation."
    )


def _most_inflated(t: Values) -> FloatArray:
    return np.asarray(np.nan_to_num(t["inflation"], nan=-np.inf).max(axis=1, initial=-np.inf))
