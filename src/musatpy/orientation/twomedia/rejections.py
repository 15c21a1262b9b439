"""What a solution must not be: water through a camera, points behind one or on the wrong side of the water."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.collinearity import attitude_matrix, nearest_point
from musatpy.orientation.twomedia.helmert import Adjusted, Problem
from musatpy.orientation.twomedia.rays import WATER, Rays, image_rays

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


def rejections(problem: Problem, adjusted: Adjusted) -> BoolArray:
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


def _sighted(problem: Problem, adjusted: Adjusted, rays: Rays) -> tuple[IntArray, FloatArray]:
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
