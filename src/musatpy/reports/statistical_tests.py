"""The statistics of the listing: tests of sigma0 and of groups, the water, the worst observations, dependence."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.model import ObservationKind, PlateSigma
from musatpy.model.kinds import ANGLES, ENU
from musatpy.reports import observation_record, quality_record, result_record
from musatpy.reports.columns import vector
from musatpy.reports.editing import number_text
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Choice, Column, Report, key, worst_first
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import Ellipses
from musatpy.statistics.quality import ALPHA, BETA, FAR, TEST_LIMIT, ChiSquare
from musatpy.units import ARC_SECOND

HIDDEN = "Statistics: Points That Undetected Errors May Move"
LISTED = 20  # observations, at least: all beyond the limit of the test are listed
_LEAST = 1e-300  # probability: zero has no logarithm
_INFLATION, _LENGTHS = 1, 3  # decimals of the tables that are in the order of them
_CORRELATIONS = 40  # listed, the strongest
_ANGLE = "tilt of the water.*|wave .* azimuth"  # unknowns by such names are angles

Rows = Callable[[Statistics], IntArray]
KIND_WORDS = {"kind": {kind.name.lower(): kind.label for kind in ObservationKind}}


def observation_columns(rows: Rows) -> tuple[Column[Statistics], ...]:
    """Return the columns that say which observations stand in the rows, and in which unit."""

    def names(s: Statistics) -> list[str]:
        links = zip(_kinds(s, rows), s.observed.row[rows(s)].reshape(-1, 1), strict=True)
        ids = (kind.owners(s.solution, row)[0] for kind, row in links)
        return [" ".join(f"{name:<8}" for name in of) if len(of) > 1 else "".join(of) for of in ids]

    def components(s: Statistics) -> list[str]:
        numbers = s.observed.component[rows(s)].tolist()
        return [kind.components[component] for kind, component in zip(_kinds(s, rows), numbers, strict=True)]

    return (
        key("Kind", "A8", "kind", lambda s: [kind.label for kind in _kinds(s, rows)]),
        key("Photo, point", "A17", "of", names),
        key("Comp.", "A7", "component", components),
        Column("Unit", "A4", lambda s: [kind.unit for kind in _kinds(s, rows)]),
    )


def in_unit(heading: str, edit: str, shows: str, rows: Rows) -> Column[Statistics]:
    """Return a column of numbers in the units of their rows."""

    def values(s: Statistics) -> FloatArray:
        factors = np.array([kind.factor for kind in _kinds(s, rows)])
        numbers: FloatArray = observation_record.OBSERVATIONS.column(shows, s)[rows(s)] / factors
        return numbers

    return Column(heading, edit, values, Origin(field=shows, unit_in="Unit"))


def _kinds(statistics: Statistics, rows: Rows) -> list[ObservationKind]:
    return [ObservationKind(kind) for kind in statistics.observed.kind[rows(statistics)].tolist()]


COMPONENTS: Report[Statistics] = Report(
    title="Statistics: Sigma0 And Variance Components",
    table=quality_record.COMPONENTS,
    path="tests.variance_components",
    columns=(
        key("Group", "A28", "group"),
        Column("Redundancy", "F11.2", shows="redundancy"),
        Column("Variance\nfactor", "F9.3", shows="factor"),
        Column("Lower\nlimit", "F8.3", shows="low"),
        Column("Upper\nlimit", "F8.3", shows="high"),
        Column("Test", "A8", lambda s: [_verdict(test) for test in s.components.values()]),
    ),
)
OBSERVATIONS: Report[Statistics] = Report(
    title="Statistics: Observations, The Worst First",
    table=observation_record.OBSERVATIONS,
    rows=lambda s: _worst(s),
    words=KIND_WORDS,
    some=True,
    columns=(
        *observation_columns(lambda s: _worst(s)),
        in_unit("Residual", "F10.3", "residual", lambda s: _worst(s)),
        in_unit("Sigma", "F9.3", "sigma", lambda s: _worst(s)),
        Column("Redund.", "F7.3", shows="redundancy"),
        Column("Stand.\nresidual", "F8.2", shows="standardised"),
        Column("Test\nvalue", "F8.2", lambda s: s.test[_worst(s)], "test"),
        Column("", "A1", lambda s: np.where(np.abs(s.test[_worst(s)]) > TEST_LIMIT, "*", "")),
        in_unit("Detectable\nerror", "F10.3", "detectable", lambda s: _worst(s)),
        Column("Effect\nm", "F8.3", shows=Origin(field="effect", norm=True)),
    ),
)
CHECKS: Report[Statistics] = Report(
    title="Statistics: Check Points Against Their Own Covariance",
    table=quality_record.CHECK_POINTS,
    path="tests.check_points",
    rows=lambda s: _checks(s),
    columns=(
        key("Point", "A8", "point"),
        Column("Components", "I5", shows="components"),
        Column("Chi-square", "F10.3", shows="chi_square"),
        Column("Probability", "F8.4", shows="probability"),
    ),
)
HIDDEN_ERRORS: Report[Statistics] = Report(
    title=HIDDEN,
    path="tests.hidden_errors",
    some=True,
    columns=(
        key("Point", "A8", "point", lambda s: s.block.points.ids[_moved(s)]),
        Column("Rays", "I4", lambda s: s.solution.points.rays[_moved(s)], "rays"),
        Column("Moved by\nm", "F11.3", lambda s: _limited(s.hidden.shift)[_moved(s)], "shift"),
        Column("In its\nsigmas", "F11.1", lambda s: _limited(s.hidden.sigmas)[_moved(s)], "sigmas"),
        Column(
            "",
            "A14",
            lambda s: np.where(np.isinf(s.hidden.shift[_moved(s)]), "without limit", ""),
            Origin(field="unlimited", true="without limit"),
        ),
    ),
)
WATER: Report[Statistics] = Report(
    title="Statistics: Global Unknowns",
    table=quality_record.GLOBALS,
    path="dependence.globals",
    rows=lambda s: _globals(s),
    columns=(
        key("Unknown", "A32", "unknown"),
        Column(
            "Sigma\nm, arc sec, 1",
            "F12.6",
            lambda s: _global_sigmas(s)[_globals(s)],
            Origin(field="sigma", angles=_ANGLE),
        ),
        Column("Variance\ninflation", "F12.1", shows="inflation"),
    ),
)
CORRELATIONS: Report[Statistics] = Report(
    title="Statistics: Correlations Of 0.95 And More",
    table=quality_record.CORRELATIONS,
    path="dependence.correlations",
    rows=lambda s: np.arange(len(s.dependence.first))[:_CORRELATIONS],
    some=True,
    columns=(
        key("Unknown", "A32", "first"),
        key("With", "A32", "second"),
        Column("Correlation", "F9.4", shows="correlation"),
    ),
)
STATION_INFLATION: Report[Statistics] = Report(
    title="Statistics: Variance Inflation Of Stations",
    table=quality_record.STATION_INFLATION,
    path="dependence.stations",
    rows=lambda s: _inflated(s),
    columns=(key("Photo", "A8", "photo"), *vector((*ENU, *ANGLES), ("F10.1",) * 6, shows="inflation")),
)


def _ellipses(
    unit: str, of: Callable[[Statistics], Ellipses], listed: int | None, sigmas: str
) -> tuple[Column[Statistics], ...]:
    def rows(values: Callable[[Ellipses], FloatArray]) -> Callable[[Statistics], FloatArray]:
        return lambda s: values(of(s))[_largest(of(s))[:listed]]

    major, minor, bearing = (Origin(field="covariance", ellipse=part) for part in ("major", "minor", "bearing"))
    return (
        Column(f"Major\n{unit}", "F9.3", rows(lambda e: e.major), major),
        Column(f"Minor\n{unit}", "F9.3", rows(lambda e: e.minor), minor),
        Column("Bearing\ndegrees", "F8.1", rows(lambda e: np.degrees(e.bearing)), bearing),
        Column("Sigma Up\nm", "F9.3", rows(lambda e: e.vertical), f"{sigmas}[2]"),
    )


def _ellipse_columns(of: Callable[[Statistics], Ellipses], listed: int | None, sigmas: str) -> Choice[Statistics]:
    return Choice((_ellipses("m", of, listed, sigmas),), lambda s: _ellipses(_plane(s)[1], of, listed, sigmas))


STATION_ELLIPSES: Report[Statistics] = Report(
    title="Statistics: Error Ellipses Of Stations",
    table=result_record.STATIONS,
    rows=lambda s: _largest(s.station_ellipses),
    columns=(
        key("Photo", "A8", "photo"),
        _ellipse_columns(lambda s: s.station_ellipses, None, "position_sigma"),
    ),
)
POINT_ELLIPSES: Report[Statistics] = Report(
    title=f"Statistics: Error Ellipses Of Ground Points, The {LISTED} Largest",
    pattern=r"Statistics: Error Ellipses Of Ground Points, The \d+ Largest",
    table=result_record.POINTS,
    rows=lambda s: _largest(s.point_ellipses)[:LISTED],
    some=True,
    columns=(key("Point", "A8", "point"), _ellipse_columns(lambda s: s.point_ellipses, LISTED, "sigma")),
)
STATED = (
    COMPONENTS,
    OBSERVATIONS,
    HIDDEN_ERRORS,
    STATION_ELLIPSES,
    POINT_ELLIPSES,
    CHECKS,
    WATER,
    CORRELATIONS,
    STATION_INFLATION,
)


def sections(statistics: Statistics) -> list[Section]:
    """Return the statistics of an adjustment; nothing for a solution that carries none."""
    solution = statistics.solution
    if solution.observed is None or solution.dependence is None:
        return []
    sections = [
        COMPONENTS.section(statistics, ["", *_sigma0(statistics)], new_page=True),
        _observations(statistics),
    ]
    checks = len(statistics.check_test.row)
    if checks:
        sections.append(CHECKS.section(statistics, ["", *_check_total(statistics)], worst=range(checks)))
    sections += _hidden(statistics)
    plane, _ = _plane(statistics)
    tables = (
        (WATER, "", len(solution.dependence.names)),
        (CORRELATIONS, "", len(solution.dependence.first)),
        (STATION_INFLATION, "", len(statistics.block.photos.ids)),
        (STATION_ELLIPSES, plane, 1),
        (POINT_ELLIPSES, plane, 1),
    )
    for report, suffix, rows in tables:
        if rows:
            section = report.section(statistics, title=f"{report.title}{suffix}")
            sections.append(replace(section, worst=range(len(section.lines))))
    return sections


def _plane(statistics: Statistics) -> tuple[str, str]:
    """Return what the titles of ellipses say of the plane that they are in, and the unit of their axes."""
    words = statistics.answer_words
    return (", In The Plane Of The System", words.units[0][:14]) if words and words.has_plane else ("", "m")


def _worst(statistics: Statistics) -> IntArray:
    """Return the observations that are listed: the worst, and all that are starred."""
    starred = np.count_nonzero(np.abs(np.nan_to_num(statistics.test)) > TEST_LIMIT)
    return statistics.worst_first[: max(LISTED, int(starred))]


def _moved(statistics: Statistics) -> IntArray:
    """Return the points that are listed: the weakly checked ones, or the worst."""
    hidden = statistics.hidden
    return hidden.worst_first[: max(LISTED, int(hidden.weak.sum()))]


def _limited(values: FloatArray) -> FloatArray:
    return np.where(np.isinf(values), np.nan, values)


def _verdict(test: ChiSquare) -> str:
    if test.accepted:
        return ""
    return "too low" if test.factor < test.low else "TOO HIGH"


def _sigma0(statistics: Statistics) -> list[str]:
    test = statistics.sigma0
    if test is None:
        return ["Sigma0 cannot be tested: there is no redundancy."]
    if statistics.block.options.plate_sigma_is is PlateSigma.GUESS:
        return ["Sigma0 is not tested: the plate sigma is a guess, and estimated by its variance component."]
    factor, low, high = (number_text("F12.4", value) for value in (test.factor, test.low, test.high))
    verdict = "agrees with 1" if test.accepted else f"does not agree with 1: {_verdict(test).lower()}"
    text = f"Sigma0 squared is {factor}, by chance within {low} to {high} in 95 of 100 cases: it {verdict}."
    return wrapped([text])


def _check_total(statistics: Statistics) -> list[str]:
    total = statistics.check_test.total
    if total is None:
        return []
    factor, low, high = (number_text("F12.4", value) for value in (total.factor, total.low, total.high))
    return [
        f"All together: chi-square over components {factor}, limits {low} to {high}. {_verdict(total)}".rstrip()
    ]


def _observations(statistics: Statistics) -> Section:
    weights = ""
    if statistics.block.options.weights != "FULL" and statistics.block.options.program == "IIA":
        weights = " Redundancy numbers are those of full weights."
    limit, risk = number_text("F6.2", TEST_LIMIT), number_text("F6.3", ALPHA)
    note = (
        f"Test values beyond {limit} (risk {risk}) are starred. The smallest detectable error is found with a "
        f"probability of {number_text('F5.2', BETA)}; its effect is on the own position.{weights}"
    )
    return OBSERVATIONS.section(statistics, ["", *wrapped([note])], worst=range(len(_worst(statistics))))


def _hidden(statistics: Statistics) -> list[Section]:
    """Return the points that errors may move while no test finds these: the weakly checked ones, or the worst."""
    hidden = statistics.hidden
    rows = _moved(statistics)
    if not len(rows):
        return []
    note = (
        f"Weakly checked are {int(hidden.weak.sum())} of {len(hidden.worst_first)} points: an undetected error may "
        f"move them by more than {FAR:.0f} sigmas. It is that of one image or control component which its own test "
        f"finds with a probability of {number_text('F5.2', BETA)}; without limit where nothing checks the "
        "observation."
    )
    return [HIDDEN_ERRORS.section(statistics, ["", *wrapped([note])], worst=range(len(rows)))]


def _global_sigmas(statistics: Statistics) -> FloatArray:
    dependence = statistics.dependence
    angles = np.array([bool(re.fullmatch(_ANGLE, name)) for name in dependence.names.tolist()], dtype=bool)
    return np.where(angles, dependence.sigma / ARC_SECOND, dependence.sigma)


def _checks(statistics: Statistics) -> IntArray:
    return worst_first(-np.log10(np.maximum(statistics.check_test.probability, _LEAST)))


def _globals(statistics: Statistics) -> IntArray:
    return worst_first(statistics.dependence.inflation, _INFLATION)


def _inflated(statistics: Statistics) -> IntArray:
    inflation = np.nan_to_num(statistics.dependence.station_inflation, nan=-np.inf).max(axis=1)
    return worst_first(inflation, _INFLATION)


def _largest(ellipses: Ellipses) -> IntArray:
    """Return the rows that have an ellipse, the largest first: by its major axis and the sigma upwards together."""
    size = np.hypot(ellipses.major, ellipses.vertical)
    return worst_first(size, _LENGTHS)[: np.count_nonzero(np.isfinite(size))]
