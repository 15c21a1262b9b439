"""Points that do not fit the orientation of the others: a solution among gross errors, and tests of every point.

Orientations of small samples of points are held against all points. Around the one that most of them fit, points
go out and come back, each tested against those that are in, until nothing changes.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, chdtri

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.similarity import spread
from musatpy.orientation.twomedia.helmert import Adjusted, HelmertProblem, adjust, misfits, sampled
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import (
    Method,
    Sights,
    WaterPlane,
    conditions_of,
    problem_of,
    redundancy_of,
    without,
)

CRITICAL = 3.29  # normal deviate from which a point is an outlier, one of as little chance in more dimensions
_BACK = 2.5  # sigmas of a misclosure under which a point comes back, whether the others can check it or not
_CHECKED = 1e-6  # redundancy from which a misclosure says anything
_SAMPLES = 120  # of points
_NEAR = 3  # starts that they are adjusted from
_SPARE = 3  # conditions of a sample beyond the unknowns
_FEWEST = 3  # control points, or others, of a sample
_SUSPECT = 3.3  # robust scales of a misclosure from which a point is out at first


def outlying(
    sights: Sights, method: Method, plane: WaterPlane, starts: Orientation
) -> tuple[BoolArray, Adjusted] | None:
    """Return the points (p,) that are out and the solution of the others; None where no adjustment converges.

    `starts` are in the order of their fit.
    """
    problem = problem_of(sights, method, plane)
    near = starts[np.arange(_SAMPLES) % min(_NEAR, len(starts.level))]
    solutions = sampled(problem, near, _samples(sights, problem))
    size = misfits(problem, solutions)
    best = int(np.argmin(np.log1p(np.square(size)).sum(axis=1)))
    scale = spread(size[best], 1.0)
    outliers = np.zeros(len(sights.points), dtype=bool)
    outliers[conditioned(problem)[size[best] > _SUSPECT * scale]] = True
    return _tested(sights, method, plane, outliers, solutions[best : best + 1])


def snooped(
    sights: Sights, method: Method, plane: WaterPlane, start: Orientation
) -> tuple[BoolArray, Adjusted] | None:
    """Return the same from one orientation `start` (1,) that is near: few errors draw it little."""
    return _tested(sights, method, plane, np.zeros(len(sights.points), dtype=bool), start)


def conditioned(problem: HelmertProblem) -> IntArray:
    """Return the points of the conditions, in the order of the groups."""
    return np.concatenate([problem.point[group.images[:, 0]] for group in problem.groups])


def _samples(sights: Sights, problem: HelmertProblem) -> FloatArray:
    """Return samples (s, p) of points, of control and of others, with some more conditions than unknowns."""
    point = conditioned(problem)
    share = (int(problem.unknown.sum()) + _SPARE) / conditions_of(problem)
    chance = np.random.default_rng(len(point)).random((_SAMPLES, len(sights.points)))
    samples = np.zeros(chance.shape)
    for members in (point[sights.is_control[point]], point[~sights.is_control[point]]):
        count = min(max(int(np.ceil(share * len(members))), _FEWEST), len(members))
        rank = np.argsort(np.argsort(chance[:, members], axis=1), axis=1)
        samples[:, members] = rank < count
    return samples


def _tested(
    sights: Sights, method: Method, plane: WaterPlane, outliers: BoolArray, start: Orientation
) -> tuple[BoolArray, Adjusted] | None:
    """Return outliers and solution when no point fails its test, and none that is out is within `_BACK`."""
    whole, last = problem_of(sights, method, plane), None
    point, seen = conditioned(whole), set()
    while outliers.tobytes() not in seen:
        seen.add(outliers.tobytes())
        problem = problem_of(without(sights, outliers), method, plane)
        if redundancy_of(problem) < 0:
            break
        adjusted = adjust(problem, start)
        if not adjusted.converged[0]:
            break
        last, start = (outliers, adjusted), adjusted.at
        size = deviations(adjusted)
        worst = int(np.argmax(size))
        outliers = outliers.copy()
        if size[worst] > 1.0:
            outliers[conditioned(problem)[worst]] = True
        else:
            outliers[point[misfits(whole, start)[0] < _BACK]] = False
    return last


def deviations(adjusted: Adjusted) -> FloatArray:
    """Return the test values (k,) of the points of the conditions in one solution, over their critical value.

    The square of a misclosure after the adjustment in its covariance A Q A' - B C B': that of the misclosure in the
    solution of all other points.
    """
    T = adjusted.directions[0]
    C = T @ np.linalg.pinv(adjusted.normals[0], hermitian=True) @ T.T
    values = []
    for part in adjusted.linear:
        weights, axes = np.linalg.eigh(part.weight[0])
        root = np.sqrt(np.maximum(weights, 0.0))[..., None] * np.swapaxes(axes, -1, -2)
        B = root @ part.by_unknown[0]
        taken, axes = np.linalg.eigh(B @ C @ np.swapaxes(B, -1, -2))
        along = np.einsum("kpi,kpq,kq->ki", axes, root, part.misclosure[0])
        checked = taken < 1.0 - _CHECKED
        square = np.sum(np.square(along) / np.where(checked, 1.0 - taken, np.inf), axis=1)
        held = np.count_nonzero(weights > _CHECKED * weights[:, -1:], axis=1)  # less what control leaves open
        freedom = np.maximum(held - np.count_nonzero(~checked, axis=1), 1)
        values.append(np.sqrt(square / chdtri(freedom, chdtrc(1, CRITICAL**2))))
    return np.concatenate(values)
