"""Which solutions an orientation can have: what none must be, all exact ones, and that of points among errors.

No water passes through a camera, no point is behind one or on the wrong side of the water; of the exact solutions
of a minimum set no residual chooses one. Among gross errors orientations of small samples of points are held
against all points. Around the one that most of them fit, points go out and come back, each tested against those
that are in, until nothing changes.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, chdtri

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.collinearity import attitude_matrix, nearest_point
from musatpy.geometry.similarity import spread
from musatpy.orientation.twomedia.helmert import Adjusted, HelmertProblem, adjust, misfits, sampled
from musatpy.orientation.twomedia.rays import WATER, ImageRays, Orientation, image_rays
from musatpy.orientation.twomedia.sights import (
    Method,
    Sights,
    WaterPlane,
    conditions_of,
    problem_of,
    redundancy_of,
    without,
)

REASONS = (
    "the water passes through a camera or above it",
    "a ray does not meet the water",
    "a point is behind a camera",
    "a point under water stands above it",
    "a dry point stands below the water",
)
_THROUGH = 1e-3  # of the distance of the points, up to which the water passes through a camera
_ROUNDING = 1e-13  # of normals scaled to unit diagonal
_DOUBT = 5.0  # sigmas of the level, by which a point may stand on the wrong side
_STARTS = 200
_SPREADS = (1.0, 3.0)  # of the starts, in turns: to the roots nearby, and to those farther away
_EXACT = 1e-3  # sigmas of the misclosures that an exact root may leave
_SAME = 1e-6  # rad and heights over the water, up to which two roots are one
CRITICAL = 3.29  # normal deviate from which a point is an outlier, one of as little chance in more dimensions
_BACK = 2.5  # sigmas of a misclosure under which a point comes back, whether the others can check it or not
_CHECKED = 1e-6  # redundancy from which a misclosure says anything
_SAMPLES = 120  # of points
_SAMPLED_FROM = 3  # starts that they are adjusted from
_SPARE = 3  # conditions of a sample beyond the unknowns
_FEWEST = 3  # control points, or others, of a sample
_SUSPECT = 3.3  # robust scales of a misclosure from which a point is out at first


def rejections(problem: HelmertProblem, adjusted: Adjusted) -> BoolArray:
    """Return which of the `REASONS` (s, 5) speak against each of the solutions (s,)."""
    at = adjusted.at
    rays = image_rays(at, problem.photo, adjusted.image, problem.wet, problem.rise)
    images, points = _sighted(problem, adjusted, rays)
    rays, photo, wet, rise = rays[images], problem.photo[images], problem.wet[images], problem.rise[images]
    gap = points - rays.station
    height = rays.station[..., 2] - at.water_at(rays.station[..., :2]) - rise
    through = height <= _THROUGH * np.linalg.norm(gap, axis=-1)
    axis = -attitude_matrix(at.attitude)[..., 2, :][:, photo]
    over = points[..., 2] - at.water_at(points[..., :2]) - rise
    doubt = _DOUBT * _level_sigma(adjusted, points)
    reasons = (
        through & wet,
        ~rays.real & ~through,
        np.sum(gap * axis, axis=-1) <= 0.0,
        (over > doubt) & wet,
        (over < -doubt) & ~wet,
    )
    return np.stack([reason.any(axis=1) for reason in reasons], axis=1)


def _sighted(problem: HelmertProblem, adjusted: Adjusted, rays: ImageRays) -> tuple[IntArray, FloatArray]:
    """Return the images (k,) that take part in conditions, and the points (s, k, 3) that they show."""
    images, points = [], []
    for group in problem.groups:
        if group.control is None:
            place = nearest_point(rays.origin[:, group.images], rays.direction[:, group.images])
        else:
            place = adjusted.control[:, group.control]
        images.append(group.images.ravel())
        points.append(np.repeat(place, group.images.shape[1], axis=1))
    return np.concatenate(images), np.concatenate(points, axis=1)


def _level_sigma(adjusted: Adjusted, points: FloatArray) -> FloatArray:
    """Return the sigmas (s, k) of the level of the water at points (s, k, 3), large where nothing determines it."""
    T = adjusted.directions[:, -WATER:-1]
    diagonal = np.einsum("suu->su", adjusted.normals)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    T = T * scale[:, None]
    N = adjusted.normals * scale[:, None] * scale[..., None] + _ROUNDING * np.eye(scale.shape[-1])
    C = T @ np.linalg.inv(N) @ np.swapaxes(T, -1, -2)
    weights = np.concatenate([points[..., :2], np.ones_like(points[..., :1])], axis=-1)
    return np.sqrt(np.maximum(np.einsum("ski,sij,skj->sk", weights, C, weights), 0.0))


def start_errors(photos: int) -> FloatArray:
    """Return sigmas (6 m + 4,) of starts: 5 degrees, a tenth of the height over the water, slopes of .05."""
    return np.array(([np.radians(5.0)] * 3 + [0.1] * 3) * photos + [0.05, 0.05, 0.1, 0.0])


def exact_roots(problem: HelmertProblem, near: Adjusted) -> Orientation:
    """Return all exact solutions (r,) that random starts lead to, `near` (one solution) the first of them.

    Those that no camera over the water can have taken are left out.
    """
    at = near.at[0]
    scatter = np.random.default_rng(_STARTS).normal(size=(_STARTS, len(problem.unknown)))
    scatter *= np.resize(_SPREADS, _STARTS)[:, None] * at.units * problem.unknown
    trials = adjust(problem, Orientation.of(at.vector + scatter * start_errors(at.photos)))
    exact = trials.converged & (trials.squares < _EXACT**2 * max(int(problem.unknown.sum()), 1))
    exact &= ~rejections(problem, trials).any(axis=1)
    roots = [at.vector]
    for vector in trials.at.vector[exact]:
        if all(np.abs((vector - root) / at.units).max() > _SAME for root in roots):
            roots.append(vector)
    return Orientation.of(np.array(roots))


def outlying(
    sights: Sights, method: Method, plane: WaterPlane, starts: Orientation
) -> tuple[BoolArray, Adjusted] | None:
    """Return the points (p,) that are out and the solution of the others; None where no adjustment converges.

    `starts` are in the order of their fit.
    """
    problem = problem_of(sights, method, plane)
    near = starts[np.arange(_SAMPLES) % min(_SAMPLED_FROM, len(starts.level))]
    solutions = sampled(problem, near, _samples(sights, problem))
    size = misfits(problem, solutions)
    best = int(np.argmin(np.log1p(np.square(size)).sum(axis=1)))
    scale = spread(size[best], 1.0)
    outliers = np.zeros(len(sights.points), dtype=bool)
    outliers[conditioned(problem)[size[best] > _SUSPECT * scale]] = True
    return snooped(sights, method, plane, solutions[best : best + 1], outliers)


def snooped(
    sights: Sights, method: Method, plane: WaterPlane, start: Orientation, suspected: BoolArray | None = None
) -> tuple[BoolArray, Adjusted] | None:
    """Return the same from one orientation `start` (1,) that is near, with points (p,) out that are suspected.

    No point that is in fails its test then, and none that is out is within `_BACK`.
    """
    outliers = np.zeros(len(sights.points), dtype=bool) if suspected is None else suspected
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
