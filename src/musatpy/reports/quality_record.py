"""The part of the JSON record that says how good the solution is: water, tests, observations, dependence."""

from __future__ import annotations

import numpy as np

from musatpy.model import AdjustedWaves, ConsideredWater, ObservationKind, Solution
from musatpy.model.adjusted_waves import PARAMETERS
from musatpy.reports.blunders import UNITS
from musatpy.reports.encoding import Json, Rows, names, number, plain, rows
from musatpy.reports.water import considered_sigmas
from musatpy.statistics import Statistics
from musatpy.statistics.exact_water import exact_water
from musatpy.statistics.kinds import KINDS
from musatpy.statistics.quality import ChiSquare


def adjusted_water(statistics: Statistics) -> dict[str, Json] | None:
    """Return the water after the adjustment, None in a job without."""
    water = statistics.solution.water
    if water is None:
        return None
    return {
        "tide": plain(water.tide),
        "corrections": rows(
            group=water.correction_ids, correction=water.correction, correction_sigma=water.correction_sigma
        ),
        "tilt": plain(water.tilt),
        "tilt_sigma": plain(water.tilt_sigma),
        "index": water.index,
        "index_sigma": number(water.index_sigma),
        "waves": None if water.waves is None else _waves(water.waves),
        "considered": _considered(statistics.solution.considered),
        "without_error": list(exact_water(statistics.block)),
    }


def _considered(water: ConsideredWater | None) -> Rows:
    if water is None:
        return []
    return rows(quantity=water.names, sigma=considered_sigmas(water), unit=water.units)


def _waves(waves: AdjustedWaves) -> dict[str, Json]:
    return {
        "waves": rows(
            wave=waves.ids,
            period=np.where(np.isinf(waves.period), np.nan, waves.period),
            speed=waves.speed,
            **{name: waves.value[:, column] for column, name in enumerate(PARAMETERS)},
            crests_open=waves.open,
        ),
        "parameters": rows(
            wave=np.repeat(waves.ids, len(PARAMETERS)),
            parameter=PARAMETERS * len(waves.ids),
            given=waves.prior.ravel(),
            given_sigma=waves.prior_sigma.ravel(),
            adjusted=waves.value.ravel(),
            sigma=waves.sigma.ravel(),
            kept=waves.kept.ravel(),
            inflation=waves.inflation.ravel(),
            verdict=waves.verdicts.ravel(),
        ),
        "correlations": rows(first=waves.first, second=waves.second, correlation=waves.correlation),
    }


def verdict(statistics: Statistics) -> dict[str, Json]:
    """Return what the run is worth, and why."""
    found = statistics.verdict
    return {
        "grade": found.grade.value,
        "reasons": [
            {
                "grade": reason.grade.value,
                "concern": reason.concern.value,
                "text": reason.text,
                "section": reason.section,
            }
            for reason in found.reasons
        ],
        "notes": list(found.notes),
    }


def tests(statistics: Statistics) -> dict[str, Json] | None:
    """Return the tests of sigma0, of groups of observations and of check points."""
    if statistics.solution.observed is None:
        return None
    check, quality = statistics.check_test, statistics.quality
    points = statistics.block.points.ids[statistics.block.control.point[check.row]]
    groups = [{"group": name} | _factor(one) for name, one in quality.components.items()]
    return {
        "sigma0": None if quality.sigma0 is None else _factor(quality.sigma0),
        "variance_components": groups,
        "check_points": rows(
            point=points, chi_square=check.squares, components=check.components, probability=check.probability
        ),
        "check_points_total": None if check.total is None else _factor(check.total),
        "hidden_errors": _hidden_errors(statistics),
    }


def _hidden_errors(statistics: Statistics) -> Rows:
    hidden = statistics.hidden
    chosen = np.flatnonzero(~np.isnan(hidden.shift))
    return rows(
        point=statistics.block.points.ids[chosen],
        rays=statistics.solution.points.rays[chosen],
        shift=hidden.shift[chosen],
        sigmas=hidden.sigmas[chosen],
        unlimited=np.isinf(hidden.shift[chosen]),
        weak=hidden.weak[chosen],
    )


def _factor(one: ChiSquare) -> dict[str, Json]:
    return {
        "redundancy": one.redundancy,
        "factor": number(one.factor),
        "low": number(one.low),
        "high": number(one.high),
        "accepted": one.accepted,
    }


def observations(statistics: Statistics) -> Rows:
    """Return every observation with its tests."""
    if statistics.solution.observed is None:
        return []
    quality, observed = statistics.quality, statistics.quality.observed
    kinds = [KINDS[ObservationKind(kind)] for kind in observed.kind.tolist()]
    owners = [kind.owner(statistics, row).split() for kind, row in zip(kinds, observed.row.tolist(), strict=True)]
    component = [kind.components[number] for kind, number in zip(kinds, observed.component.tolist(), strict=True)]
    return rows(
        kind=names(ObservationKind, observed.kind.tolist()),
        of=owners,
        component=component,
        residual=observed.residual,
        sigma=observed.sigma,
        redundancy=observed.redundancy,
        standardised=quality.standardised,
        test=np.where(np.isfinite(quality.test), quality.test, np.nan),
        normal_test=statistics.normal_tests,
        estimated_error=quality.estimated_error,
        detectable=quality.detectable,
        effect=quality.effect,
    )


def dependence(statistics: Statistics) -> dict[str, Json] | None:
    """Return variance inflation and correlations of the unknowns."""
    found = statistics.solution.dependence
    if found is None:
        return None
    return {
        "stations": rows(photo=statistics.block.photos.ids, inflation=found.station_inflation),
        "globals": rows(unknown=found.names, sigma=found.sigma, inflation=found.inflation),
        "correlations": rows(first=found.first, second=found.second, correlation=found.correlation),
    }


def findings(solution: Solution) -> Rows:
    """Return what the search for blunders found."""
    return [
        {
            "blunder": one.blunder.value,
            "photo": one.photo or None,
            "point": one.point or None,
            "test": number(one.test),
            "size": [number(value) for value in one.size],
            "unit": UNITS[one.blunder],
            "action": one.action.value,
            "note": one.note,
        }
        for one in solution.findings
    ]


def causes(solution: Solution) -> Rows:
    """Return the ranked causes of what does not fit."""
    return [
        {
            "group": one.group,
            "rank": one.rank,
            "cause": one.kind.value,
            "cards": list(one.cards),
            "photos": list(one.photos),
            "points": list(one.points),
            "component": one.component,
            "size": [number(value) for value in one.size],
            "sigma": [number(value) for value in one.sigma],
            "unit": one.unit,
            "parameters": one.parameters,
            "drop": number(one.drop),
            "test": number(one.test),
            "advice": one.advice,
        }
        for one in solution.causes
    ]
