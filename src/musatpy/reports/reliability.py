"""The statistics of the listing: tests of sigma0 and of groups, the water, the worst observations, dependence."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.model import ObservationKind, PlateSigma
from musatpy.reports.columns import point_column, vector
from musatpy.reports.editing import edited
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table, worst_first
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics
from musatpy.statistics.hidden import FAR
from musatpy.statistics.kinds import ANGLES, ENU, KINDS, Kind
from musatpy.statistics.quality import ALPHA, BETA, TEST_LIMIT, ChiSquare, Ellipses
from musatpy.units import ARC_SECOND

HIDDEN = "Statistics: Points That Undetected Errors May Move"
LISTED = 20  # observations, at least: all beyond the limit of the test are listed
_LEAST = 1e-300  # probability: zero has no logarithm
_CORRELATIONS = 40  # listed, the strongest

COMPONENTS: tuple[Column[Statistics], ...] = (
    Column("Group", "A28", lambda s: s.quality.components),
    Column("Redundancy", "F11.2", lambda s: [one.redundancy for one in _components(s)]),
    Column("Variance\nfactor", "F9.3", lambda s: [one.factor for one in _components(s)]),
    Column("Lower\nlimit", "F8.3", lambda s: [one.low for one in _components(s)]),
    Column("Upper\nlimit", "F8.3", lambda s: [one.high for one in _components(s)]),
    Column("Test", "A8", lambda s: [_verdict(one) for one in _components(s)]),
)
CHECKS: tuple[Column[Statistics], ...] = (
    point_column(lambda s: s.block.control.point[s.check_test.row[_checks(s)]]),
    Column("Components", "I5", lambda s: s.check_test.components[_checks(s)]),
    Column("Chi-square", "F10.3", lambda s: s.check_test.squares[_checks(s)]),
    Column("Probability", "F8.4", lambda s: s.check_test.probability[_checks(s)]),
)
WATER: tuple[Column[Statistics], ...] = (
    Column("Unknown", "A32", lambda s: s.quality.dependence.names[_globals(s)]),
    Column("Sigma\nm, arc sec, 1", "F12.6", lambda s: _global_sigmas(s)[_globals(s)]),
    Column("Variance\ninflation", "F12.1", lambda s: s.quality.dependence.inflation[_globals(s)]),
)
CORRELATIONS: tuple[Column[Statistics], ...] = (
    Column("Unknown", "A32", lambda s: s.quality.dependence.first[:_CORRELATIONS]),
    Column("With", "A32", lambda s: s.quality.dependence.second[:_CORRELATIONS]),
    Column("Correlation", "F9.4", lambda s: s.quality.dependence.correlation[:_CORRELATIONS]),
)
STATION_INFLATION: tuple[Column[Statistics], ...] = (
    Column("Photo", "A8", lambda s: s.block.photos.ids[_inflated(s)]),
    *vector((*ENU, *ANGLES), ("F10.1",) * 6, lambda s: s.quality.dependence.station_inflation[_inflated(s)]),
)


def sections(statistics: Statistics) -> list[Section]:
    """Return the statistics of an adjustment; nothing for a solution that carries none."""
    solution = statistics.solution
    if solution.observed is None or solution.dependence is None:
        return []
    found = [
        Section(title="Statistics: Sigma0 And Variance Components", head=Table(COMPONENTS).head(),
                lines=[*Table(COMPONENTS).lines(statistics), "", *_sigma0(statistics)], new_page=True),
        _observations(statistics),
    ]  # fmt: skip
    if len(statistics.check_test.row):
        lines = [*Table(CHECKS).lines(statistics), "", *_check_total(statistics)]
        title = "Statistics: Check Points Against Their Own Covariance"
        worst = range(len(lines) - len(_check_total(statistics)) - 1)
        found.append(Section(title=title, head=Table(CHECKS).head(), lines=lines, worst=worst))
    found += _hidden(statistics)
    words = statistics.answer_words
    plane, unit = (", In The Plane Of The System", words.units[0][:14]) if words and words.has_plane else ("", "m")
    tables = (
        ("Statistics: Global Unknowns", WATER, len(solution.dependence.names)),
        ("Statistics: Correlations Of 0.95 And More", CORRELATIONS, len(solution.dependence.first)),
        ("Statistics: Variance Inflation Of Stations", STATION_INFLATION, len(statistics.block.photos.ids)),
        (f"Statistics: Error Ellipses Of Stations{plane}", _station_ellipses(unit), 1),
        (f"Statistics: Error Ellipses Of Ground Points, The {LISTED} Largest{plane}", _point_ellipses(unit), 1),
    )
    for title, columns, rows in tables:
        if rows:
            lines = Table(columns).lines(statistics)
            found.append(Section(title=title, head=Table(columns).head(), lines=lines, worst=range(len(lines))))
    return found


def _station_ellipses(unit: str) -> tuple[Column[Statistics], ...]:
    photo: Column[Statistics] = Column("Photo", "A8", lambda s: s.block.photos.ids[_largest(s.station_ellipses)])
    return (photo, *_ellipse_columns(unit, lambda s: s.station_ellipses, None))


def _point_ellipses(unit: str) -> tuple[Column[Statistics], ...]:
    return (
        point_column(lambda s: _largest(s.point_ellipses)[:LISTED]),
        *_ellipse_columns(unit, lambda s: s.point_ellipses, LISTED),
    )


def _ellipse_columns(
    unit: str, of: Callable[[Statistics], Ellipses], listed: int | None
) -> tuple[Column[Statistics], ...]:
    def rows(values: Callable[[Ellipses], FloatArray]) -> Callable[[Statistics], FloatArray]:
        return lambda s: values(of(s))[_largest(of(s))[:listed]]

    return (
        Column(f"Major\n{unit}", "F9.3", rows(lambda e: e.major)),
        Column(f"Minor\n{unit}", "F9.3", rows(lambda e: e.minor)),
        Column("Bearing\ndegrees", "F8.1", rows(lambda e: np.degrees(e.bearing))),
        Column("Sigma Up\nm", "F9.3", rows(lambda e: e.vertical)),
    )


def _components(statistics: Statistics) -> list[ChiSquare]:
    return list(statistics.quality.components.values())


def _verdict(one: ChiSquare) -> str:
    if one.accepted:
        return ""
    return "too low" if one.factor < one.low else "TOO HIGH"


def _sigma0(statistics: Statistics) -> list[str]:
    test = statistics.quality.sigma0
    if test is None:
        return ["Sigma0 cannot be tested: there is no redundancy."]
    if statistics.block.options.plate_sigma_is is PlateSigma.GUESS:
        return ["Sigma0 is not tested: the plate sigma is a guess, and estimated by it."]
    factor, low, high = (_text("F12.4", value) for value in (test.factor, test.low, test.high))
    verdict = "agrees with 1" if test.accepted else f"does not agree with 1: {_verdict(test).lower()}"
    text = f"Sigma0 squared is {factor}, by chance within {low} to {high} in 95 of 100 cases: it {verdict}."
    return wrapped([text])


def _check_total(statistics: Statistics) -> list[str]:
    total = statistics.check_test.total
    if total is None:
        return []
    factor, low, high = (_text("F12.4", value) for value in (total.factor, total.low, total.high))
    return [
        f"All together: chi-square over components {factor}, limits {low} to {high}. {_verdict(total)}".rstrip()
    ]


def _observations(statistics: Statistics) -> Section:
    quality = statistics.quality
    shown = max(LISTED, int(np.count_nonzero(np.abs(np.nan_to_num(quality.test)) > TEST_LIMIT)))
    rows = quality.worst_first[:shown]
    table = Table(_columns(rows))
    weights = ""
    if statistics.block.options.weights != "FULL" and statistics.block.options.program == "IIA":
        weights = " Redundancy numbers are those of full weights."
    note = (
        f"Test values beyond {_text('F6.2', TEST_LIMIT)} (risk {_text('F6.3', ALPHA)}) are starred. The smallest "
        f"detectable error is found with a probability of {_text('F5.2', BETA)}; its effect is on the own position."
        f"{weights}"
    )
    return Section(
        title="Statistics: Observations, The Worst First",
        head=table.head(),
        lines=[*table.lines(statistics), "", *wrapped([note])],
        worst=range(len(rows)),
    )


def _hidden(statistics: Statistics) -> list[Section]:
    """Return the points that errors may move while no test finds these: the weakly checked ones, or the worst."""
    hidden = statistics.hidden
    rows = hidden.worst_first[: max(LISTED, int(hidden.weak.sum()))]
    if not len(rows):
        return []
    shift, sigmas = (np.where(np.isinf(values), np.nan, values)[rows] for values in (hidden.shift, hidden.sigmas))
    table: Table[Statistics] = Table(
        (
            point_column(lambda s: rows),
            Column("Rays", "I4", lambda s: s.solution.points.rays[rows]),
            Column("Moved by\nm", "F11.3", lambda s: shift),
            Column("In its\nsigmas", "F11.1", lambda s: sigmas),
            Column("", "A14", lambda s: np.where(np.isinf(hidden.shift[rows]), "without limit", "")),
        )
    )
    note = (
        f"Weakly checked are {int(hidden.weak.sum())} of {len(hidden.worst_first)} points: an undetected error may "
        f"move them by more than {FAR:.0f} sigmas. It is that of one image or control component which its own test "
        f"finds with a probability of {_text('F5.2', BETA)}; without limit where nothing checks the observation."
    )
    return [
        Section(
            title=HIDDEN,
            head=table.head(),
            lines=[*table.lines(statistics), "", *wrapped([note])],
            worst=range(len(rows)),
        )
    ]


def _columns(rows: IntArray) -> tuple[Column[Statistics], ...]:
    def kinds(s: Statistics) -> list[Kind]:
        return [KINDS[ObservationKind(kind)] for kind in s.quality.observed.kind[rows].tolist()]

    def scaled(values: Callable[[Statistics], FloatArray]) -> Callable[[Statistics], Iterable[float]]:
        return lambda s: values(s)[rows] / np.array([kind.factor for kind in kinds(s)])

    def names(s: Statistics) -> list[str]:
        links = s.quality.observed.row[rows].tolist()
        return [kind.owner(s, row) for kind, row in zip(kinds(s), links, strict=True)]

    def components(s: Statistics) -> list[str]:
        found = s.quality.observed.component[rows].tolist()
        return [kind.components[component] for kind, component in zip(kinds(s), found, strict=True)]

    return (
        Column("Kind", "A8", lambda s: [kind.name for kind in kinds(s)]),
        Column("Photo, point", "A17", names),
        Column("Comp.", "A7", components),
        Column("Unit", "A4", lambda s: [kind.unit for kind in kinds(s)]),
        Column("Residual", "F10.3", scaled(lambda s: s.quality.observed.residual)),
        Column("Sigma", "F9.3", scaled(lambda s: s.quality.observed.sigma)),
        Column("Redund.", "F7.3", lambda s: s.quality.observed.redundancy[rows]),
        Column("Stand.\nresidual", "F8.2", lambda s: s.quality.standardised[rows]),
        Column("Test\nvalue", "F8.2", lambda s: s.quality.test[rows]),
        Column("", "A1", lambda s: np.where(np.abs(s.quality.test[rows]) > TEST_LIMIT, "*", "")),
        Column("Detectable\nerror", "F10.3", scaled(lambda s: s.quality.detectable)),
        Column("Effect\nm", "F8.3", lambda s: np.linalg.norm(s.quality.effect[rows], axis=1)),
    )


def _global_sigmas(statistics: Statistics) -> FloatArray:
    dependence = statistics.quality.dependence
    angles = np.array([_is_angle(name) for name in dependence.names.tolist()], dtype=bool)
    return np.where(angles, dependence.sigma / ARC_SECOND, dependence.sigma)


def _is_angle(name: str) -> bool:
    """Return whether an unknown by that name is an angle: a tilt, or the azimuth of a wave."""
    return name.startswith("tilt of the water") or (name.startswith("wave ") and name.endswith(" azimuth"))


def _checks(statistics: Statistics) -> IntArray:
    return worst_first(-np.log10(np.maximum(statistics.check_test.probability, _LEAST)))


def _globals(statistics: Statistics) -> IntArray:
    return worst_first(statistics.quality.dependence.inflation)


def _inflated(statistics: Statistics) -> IntArray:
    return worst_first(np.nan_to_num(statistics.quality.dependence.station_inflation, nan=-np.inf).max(axis=1))


def _largest(ellipses: Ellipses) -> IntArray:
    """Return the rows that have an ellipse, the largest first: by its major axis and the sigma upwards together."""
    size = np.hypot(ellipses.major, ellipses.vertical)
    return worst_first(size)[: np.count_nonzero(np.isfinite(size))]


def _text(descriptor: str, value: float) -> str:
    return edited(descriptor, [value])[0].strip()
