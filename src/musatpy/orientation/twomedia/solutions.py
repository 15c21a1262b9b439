"""Which solutions an orientation can have: what none must be, and all exact ones of a minimum set of points.

No water passes through a camera, no point is behind one or on the wrong side of the water; of the exact
solutions of a minimum set no residual chooses one.
"""

from __future__ import annotations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.collinearity import attitude_matrix, nearest_point
from musatpy.orientation.twomedia.helmert import Adjusted, HelmertProblem, adjust
from musatpy.orientation.twomedia.rays import WATER, ImageRays, Orientation, image_rays

REASONS = (
    "the water passes through a camera or above it",
    "a ray does not come down on the water",
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
