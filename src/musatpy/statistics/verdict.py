"""Solution -> Verdict: the one place that says what a run is worth.

Physical gates reject; statistical tests make doubtful; what failed grossly is rejected. Levels of significance are
named constants, limits that a deck can set are options.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import count_of
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.model import (
    Concern,
    Editing,
    Grade,
    Initial,
    ObservationKind,
    PlateSigma,
    Reason,
    Solution,
    Verdict,
)
from musatpy.model.block import other_focal_length
from musatpy.model.findings import GRADES, a_few, named
from musatpy.model.tables import falling, largest
from musatpy.probability import probability_beyond, quantile, test_limit
from musatpy.statistics import gates
from musatpy.statistics.quality import Quality
from musatpy.units import DEGREE, MICROMETRE, length_unit

GROSS = 5.0  # times the limit of sigma0: no chance puts a single observation so far off
SIGMA0_DOUBT = 0.999  # one-sided: of clean runs one in a thousand is doubtful by it
CHECK_POINT_RISK = 0.001  # that the check points of a clean run fail together
FARTHEST_OF_WATPT = 1.0  # sigmas from RIGOROUS: with more the sigmas printed are not those of the answer
_SAME_SCALE = 0.03  # relative difference of scales that are the same
_LISTED = 3  # observations by name
_OBSERVATIONS = "Statistics: Observations, The Worst First"
COMMON_ERRORS = "Errors Common To All"
_SIGMA0 = "Statistics: Sigma0 And Variance Components"
_STATION_ANALYSIS = "Camera Station Position Analysis"


def verdict(solution: Solution) -> Verdict:
    """Return what a solution is worth: accepted, doubtful, rejected or failed, with the reasons."""
    return verdict_of(Quality(solution))


def verdict_of(statistics: Quality) -> Verdict:
    """Return the verdict on a solution whose statistics exist already."""
    reasons = [
        *convergence(statistics),
        *inertial(statistics),
        *gates.gates(statistics),
        *gates.flags(statistics),
        *gates.straight(statistics),
        *blunders(statistics),
        *sigma0(statistics),
        *observations(statistics),
        *common(statistics),
        *check_points(statistics),
        *given_stations(statistics),
        *given_attitudes(statistics),
        *waves(statistics),
        *departure(statistics),
        *undetermined(statistics),
    ]
    ranked = sorted(reasons, key=lambda reason: -GRADES.index(reason.grade))
    return Verdict(reasons=tuple(ranked), notes=tuple(notes(statistics)))


def convergence(statistics: Quality) -> Iterator[Reason]:
    """Yield why a run has not converged."""
    solution = statistics.solution
    if not solution.converged:
        yield Reason(Grade.FAILED, Concern.CONVERGENCE, f"not converged: {solution.reason}", "Solution Summary")


def blunders(statistics: Quality) -> Iterator[Reason]:
    """Yield that blunders were found and are still in the solution, or that EDIT did not take them out."""
    solution = statistics.solution
    if solution.unedited:
        yield Reason(Grade.REJECTED, Concern.BLUNDERS, f"nothing was edited: {solution.unedited}", "Blunders")
    elif solution.findings and solution.block.options.editing is not Editing.EDIT:
        text = f"{count_of(len(solution.findings), 'blunder')} found and left in the solution"
        yield Reason(Grade.DOUBTFUL, Concern.BLUNDERS, text, "Blunders")


def sigma0(statistics: Quality) -> Iterator[Reason]:
    """Yield that sigma0 cannot be tested, is above its limit, or far above."""
    solution, options = statistics.solution, statistics.block.options
    dof, value = solution.degrees_of_freedom, solution.unit_sigma
    if dof <= 0:
        yield Reason(Grade.DOUBTFUL, Concern.REDUNDANCY, "no redundancy: nothing is checked", _SIGMA0)
        return
    if not np.isfinite(value) or not statistics.tests_sigma0:
        return
    limit = sigma0_doubt(dof)
    if value <= limit:
        return
    gross = value > options.sigma0_limit
    text = f"sigma0 {_number(value)} is above its 99.9 % limit {limit:.2f}"
    if gross:
        text += f" and above {options.sigma0_limit:g}, from which a run is rejected"
    yield Reason(Grade.REJECTED if gross else Grade.DOUBTFUL, Concern.SIGMA0, text, _SIGMA0)


def sigma0_doubt(degrees_of_freedom: int) -> float:
    """Return the limit above which sigma0 is at least doubtful: one-sided, at the level `SIGMA0_DOUBT`."""
    return float(np.sqrt(quantile(SIGMA0_DOUBT, degrees_of_freedom) / degrees_of_freedom))


def observations(statistics: Quality) -> Iterator[Reason]:
    """Yield the observations that fail their test, or fail it grossly; those of control apart."""
    if statistics.solution.observed is None:
        return
    observed, test = statistics.observed, statistics.normal_tests
    limit = test_limit(int(np.isfinite(test).sum()))
    with np.errstate(invalid="ignore"):
        failed = np.abs(test) > limit
    control = observed.kind == ObservationKind.CONTROL
    for rows, concern, text in (
        (failed & ~control, Concern.OBSERVATION, "observations beyond their test"),
        (failed & control, Concern.CONTROL, "control that fits only because other observations bend"),
    ):
        worst = np.flatnonzero(rows)
        worst = worst[falling(np.abs(test[worst]), 1)]  # as they are printed
        if len(worst):
            texts = [_observation(statistics, row, float(test[row])) for row in worst[:_LISTED].tolist()]
            text = f"{text} (limit {limit:.1f}): {a_few(texts, len(worst), '; ')}"
            gross = abs(float(test[worst[0]])) > GROSS * statistics.block.options.sigma0_limit
            yield Reason(Grade.REJECTED if gross else Grade.DOUBTFUL, concern, text, _OBSERVATIONS)


def common(statistics: Quality) -> Iterator[Reason]:
    """Yield the parameters beyond their tests: held ones, an error of which many observations have in common."""
    errors = statistics.common_errors
    if errors is None or not len(errors.beyond):
        return
    texts = []
    for row in errors.beyond[:_LISTED].tolist():
        error = f"{_number(float(errors.estimated[row]))} {errors.held.units[row]}".rstrip()
        texts.append(f"{errors.held.names[row]}, test {abs(errors.test[row]):.1f}, in error by about {error}")
    parameters = a_few(texts, len(errors.beyond), "; or ")
    text = f"an error common to all observations (limit {errors.limit:.1f}): {parameters}"
    yield Reason(Grade.DOUBTFUL, Concern.COMMON, text, COMMON_ERRORS)


def check_points(statistics: Quality) -> Iterator[Reason]:
    """Yield that the check points do not agree with the solution within their own covariance."""
    if statistics.solution.observed is None or not len(statistics.check_test.row):
        return
    check = statistics.check_test
    components = int(check.components.sum())
    squares = float(check.squares[check.components > 0].sum())
    if not components or probability_beyond(squares, components) >= CHECK_POINT_RISK:
        return
    worst = largest(check.squares)
    point = statistics.block.points.ids[statistics.block.control.point[check.row[worst]]]
    text = (
        f"the check points do not agree with the solution: chi-square {_number(squares)} of {components} "
        f"components, the worst is point {point}"
    )
    yield Reason(Grade.DOUBTFUL, Concern.CHECK_POINTS, text, "Statistics: Check Points")


def given_stations(statistics: Quality) -> Iterator[Reason]:
    """Yield the stations far from where the cards put them, and what a unit or another camera would explain.

    Where stations are computed, cards count that most of them agree with: the others may be those of other photos.
    """
    block, options, solution = statistics.block, statistics.block.options, statistics.solution
    height, given = gates.flying_height(statistics), block.photos.position
    computed = options.initial is Initial.COMPUTE
    if computed and solution.cards is not None:
        given = solution.cards
    difference = gates.metric_differences(block, given, solution.stations.position)
    with np.errstate(invalid="ignore"):
        distance = np.linalg.norm(difference, axis=1) / height
        far = np.flatnonzero(distance > options.station_limit)
        near = np.count_nonzero(distance <= options.station_limit)
    if not len(far) or (computed and near <= len(far)):
        return
    worst = far[falling(distance[far], 2)]  # as they are printed
    text = (
        f"{named('photo', block.photos.ids[worst])}: stations up to {distance[worst[0]]:.2f} flying heights away "
        f"from the given positions (limit {options.station_limit:g})"
    )
    yield Reason(Grade.DOUBTFUL, Concern.GIVEN_STATIONS, text, _STATION_ANALYSIS)
    yield from units(statistics)


def given_attitudes(statistics: Quality) -> Iterator[Reason]:
    """Yield the photos turned far from their attitude cards, and that turned plates would explain it.

    The limit is the angle that moves the ground below by the limit of stations.
    """
    block, options = statistics.block, statistics.block.options
    if options.initial is Initial.COMPUTE:
        return
    limit = np.arctan(options.station_limit)
    given = attitude_matrix(block.photos.attitude)
    turn = attitude_matrix(statistics.solution.stations.attitude) @ np.swapaxes(given, 1, 2)
    with np.errstate(invalid="ignore"):
        angle = np.arccos(np.clip(0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0), -1.0, 1.0))
        far = np.flatnonzero(angle > limit)
    if not len(far):
        return
    worst = far[falling(angle[far], 2)]
    text = (
        f"{named('photo', block.photos.ids[worst])}: turned by up to {angle[worst[0]] / DEGREE:.1f} degrees "
        f"from the given attitude (limit {limit / DEGREE:.1f})"
    )
    kappa = np.arctan2(turn[far, 0, 1], turn[far, 0, 0])
    quarters = np.abs(np.rint(kappa / (90.0 * DEGREE)))
    own_axis = turn[far, 2, 2] > np.cos(limit)  # the tilt is as given
    if own_axis.all() and quarters.all() and (np.abs(np.abs(kappa) - quarters * 90.0 * DEGREE) < limit).all():
        turns = " or ".join(f"{90 * quarter:.0f}" for quarter in np.unique(quarters))
        text += f", as if the plates were turned by {turns} degrees: compare kappa with the axes of the plates"
    yield Reason(Grade.DOUBTFUL, Concern.GIVEN_STATIONS, text, "Camera Station Attitude Analysis")


def units(statistics: Quality) -> Iterator[Reason]:
    """Yield feet for metres, or the focal length of another camera, where that explains where the stations are."""
    block, adjusted = statistics.block, statistics.solution.stations.position
    whose, scale = in_feet(gates.rectangular(block, block.photos.position), gates.rectangular(block, adjusted))
    if whose:
        others = {"control": "stations", "stations": "control"}[whose]
        far = f"the adjusted stations are {scale:.3f} times as far apart as the given ones"
        text = f"{far}, as if {whose} were in feet and {others} in metres"
        yield Reason(Grade.DOUBTFUL, Concern.UNIT, text, _STATION_ANALYSIS)
        return
    ground = gates.ground_heights(statistics)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = (gates.elevations(block, adjusted) - ground) / (
            gates.elevations(block, block.photos.position) - ground
        )
    ratios = ratios[np.isfinite(ratios)]
    ratio = float(np.median(ratios)) if len(ratios) else float("nan")
    focal = float(np.median(statistics.block.cameras.focal_length))
    other = other_focal_length(focal, ratio, _SAME_SCALE)
    if other:
        text = (
            f"the stations are {ratio:.3f} times as high above ground as given, as if the focal length "
            f"were {other:g} mm and not {focal:g} mm"
        )
        yield Reason(Grade.DOUBTFUL, Concern.CAMERA, text, _STATION_ANALYSIS)


def waves(statistics: Quality) -> Iterator[Reason]:
    """Yield the unknown waves whose crests may be others: these fit nearly as well, or were not looked for."""
    water = statistics.solution.water
    if water is None or water.waves is None:
        return
    unsure = np.flatnonzero(water.waves.unsure)
    if len(unsure):
        text = f"{named('wave', water.waves.ids[unsure])}: other crests may be the right ones"
        yield Reason(Grade.DOUBTFUL, Concern.WAVES, text, "Warnings")


def departure(statistics: Quality) -> Iterator[Reason]:
    """Yield that a result of WATPT or LEGACY is farther from that of RIGOROUS than its own sigmas allow."""
    away = statistics.solution.departure
    if away is not None and away.sigmas > FARTHEST_OF_WATPT:
        text = f"the result of {statistics.block.options.refraction} is {away}; adjust with refraction RIGOROUS"
        yield Reason(Grade.DOUBTFUL, Concern.REFRACTION, text, "Warnings")


def inertial(statistics: Quality) -> Iterator[Reason]:
    """Yield that inertial attitudes do not fit, and in which convention they would."""
    if text := statistics.solution.misread:
        yield Reason(Grade.REJECTED, Concern.INERTIAL, text, "Inertial Attitudes")


def undetermined(statistics: Quality) -> Iterator[Reason]:
    """Yield the water that images depend on, and the points of the adjustment, that nothing determines."""
    solution = statistics.solution
    water = {} if solution.water is None else solution.water.undetermined
    if names := [name for name, needed in water.items() if needed]:
        text = "the images that depend on it do not determine it: hold it (OP2), or give a sigma"
        text = f"{a_few(names[:_LISTED], len(names))}: {text}"
        yield Reason(Grade.DOUBTFUL, Concern.UNDETERMINED, text, "Water")
    if solution.parameters is not None and (names := list(solution.parameters.undetermined)):
        text = f"{a_few(names[:_LISTED], len(names))}: not determined; hold it, or give a sigma"
        yield Reason(Grade.DOUBTFUL, Concern.UNDETERMINED, text, "Adjusted Parameters")
    if solution.points.lost:
        points = named("point", statistics.block.points.ids[list(solution.points.lost)])
        text = (
            f"{points}: not determined by their rays, so they have no position; they need more rays, or other ones"
        )
        yield Reason(Grade.DOUBTFUL, Concern.UNDETERMINED, text, "Points That Took No Part")


def in_feet(given: FloatArray, adjusted: FloatArray) -> tuple[str, float]:
    """Return whether `control` or `stations` are in feet and all else in metres, empty for neither; and why.

    That is how many times as far from their middle stations adjusted (n, 3) are as those given; NaN of one.
    """
    both = np.isfinite(given).all(axis=1) & np.isfinite(adjusted).all(axis=1)
    if both.sum() < 2:
        return "", float("nan")
    spreads = [float(np.linalg.norm(xyz[both] - xyz[both].mean(axis=0))) for xyz in (given, adjusted)]
    if not min(spreads) > 0.0:
        return "", float("nan")
    scale = spreads[1] / spreads[0]
    times = {"control": scale, "stations": 1.0 / scale}
    return next((one for one, factor in times.items() if length_unit(factor, _SAME_SCALE) == "feet"), ""), scale


def notes(statistics: Quality) -> Iterator[str]:
    """Yield what is worth knowing and casts no doubt."""
    test = statistics.sigma0
    doubtful = any(sigma0(statistics)) or not np.isfinite(statistics.solution.sigma0)
    if test is not None and statistics.tests_sigma0 and not test.accepted and not doubtful:
        low = test.factor < test.low
        side, why = ("below", "larger") if low else ("above", "smaller")
        limit = float(np.sqrt(test.low if low else test.high))
        text = f"sigma0 {_number(statistics.solution.unit_sigma)} is {side} its 95 % limit {limit:.2f}"
        yield f"{text}: the given sigmas may be {why} than the errors"
    water = statistics.solution.water
    if water is not None and (names := [name for name, needed in water.undetermined.items() if not needed]):
        yield f"{a_few(names[:_LISTED], len(names))}: not determined, but no image depends on it"
    if statistics.block.options.plate_sigma_is is PlateSigma.GUESS:
        um = statistics.block.options.plate_sigma / MICROMETRE
        given = um / statistics.solution.plate_factor
        made = f"its variance component makes it {um:.1f} um"
        yield f"the plate sigma is a guess of {given:.1f} um: {made}, with which the job is adjusted and tested"
    yield from gates.flag_notes(statistics)


def _observation(statistics: Quality, row: int, test: float) -> str:
    """Return an observation in words: `plate 21 102 x, test 12.3, in error by about -85.000 um`."""
    observed = statistics.observed
    kind = ObservationKind(int(observed.kind[row]))
    owner = " ".join(kind.owners(statistics.solution, observed.row[row : row + 1])[0])
    error = float(statistics.estimated_error[row]) / kind.factor
    component = kind.components[int(observed.component[row])]
    return f"{kind.label} {owner} {component}, test {abs(test):.1f}, in error by about {_number(error)} {kind.unit}"


def _number(value: float) -> str:
    """Return a number in few digits, that are the same on every machine."""
    return f"{value:.3f}" if 0.01 <= abs(value) < 1000.0 else f"{value:.2e}"
