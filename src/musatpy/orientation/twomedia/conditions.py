"""What the rays of a point must fulfil: Okamoto and Mori (1974), (13), (18)', (23), (28), (29), (31) to (33), (46).

A condition gives its misclosures g (..., k, q) of k points and their partials by the columns of its r rays, (..., k, q,
r, 12), and by the control point, (..., k, q, 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.coplanarity import coplanarity, scale_restraint
from musatpy.orientation.twomedia.rays import COLUMNS, INDEX, SLOPE, STATION, Orientation, Rays


@dataclass(frozen=True, kw_only=True, eq=False)
class Misclosure:
    """Misclosures (..., k, q), partials by the rays (..., k, q, r, 12) and by the control point (..., k, q, 3)."""

    value: FloatArray
    by_rays: FloatArray
    by_control: FloatArray


def single_ray(rays: Rays, control: FloatArray) -> Misclosure:
    """Return how far a ray passes control (..., k, 3) at its height: (13), dX and dY. Rays (..., k)."""
    r, fall = rays.direction, (rays.origin - control)[..., 2]
    run = r[..., :2] / r[..., 2:]
    value = (rays.origin - control)[..., :2] - fall[..., None] * run
    by_origin = np.concatenate([np.broadcast_to(np.eye(2), (*run.shape, 2)), -run[..., None]], axis=-1)
    by_direction = -(fall / r[..., 2])[..., None, None] * by_origin
    by_ray = np.concatenate([by_origin, by_direction], axis=-1)
    return Misclosure(value=value, by_rays=(by_ray @ rays.partials)[..., None, :], by_control=-by_origin)


def single_fermat(rays: Rays, control: FloatArray, at: Orientation) -> Misclosure:
    """Return Fermat's condition at the water point of a ray to control (..., k, 3), wet rays only: (18)'.

    beta (W - C).t - alpha n (G - W).t for both tangents t of the plane, with alpha and beta the ways in air and in
    water.
    """
    W, C, G = rays.origin, rays.station, control
    tangent = np.zeros((*at.slope.shape[:-1], 1, 2, 3))
    tangent[..., 0, 0] = tangent[..., 1, 1] = 1.0
    tangent[..., 0, :, 2] = at.slope
    n = at.index[..., None, None]
    a, b = W - C, G - W
    alpha, beta = (np.sqrt(np.sum(np.square(v), axis=-1))[..., None] for v in (a, b))
    at_air, at_water = (np.einsum("...ti,...i->...t", tangent, v) for v in (a, b))
    value = beta * at_air - alpha * n * at_water
    # by a and b: of W they are +1 and -1
    by_a = beta[..., None] * tangent - (n * at_water)[..., None] * (a / alpha)[..., None, :]
    by_b = at_air[..., None] * (b / beta)[..., None, :] - (alpha * n)[..., None] * tangent
    by_rays = (by_a - by_b) @ rays.partials[..., :3, :]
    by_rays[..., STATION] -= by_a
    by_rays[..., INDEX] -= alpha * at_water
    slope = beta * a[..., 2:] - alpha * n * b[..., 2:]
    by_rays[..., SLOPE] += slope[..., None] * np.eye(2)
    return Misclosure(value=value, by_rays=by_rays[..., None, :], by_control=by_b)


def intersection(rays: Rays) -> Misclosure:
    """Return by how much two rays (..., k, 2) miss to lie in one plane: (23), (28), (29), a volume."""
    value, by_rays = coplanarity(rays.origin, rays.direction)
    return _of_rays(value, by_rays, rays)


def common_scale(rays: Rays) -> Misclosure:
    """Return the difference of the ways along the middle of three rays (..., k, 3) in two models: (46), dot form."""
    value, by_rays = scale_restraint(rays.origin, rays.direction)
    return _of_rays(value, by_rays, rays)


def triple(rays: Rays) -> Misclosure:
    """Return the conditions of points on three photos (..., k, 3): two coplanarities and one scale.

    The nine equations (31) to (33) and (46) of such a point have rank 3.
    """
    parts = [intersection(_some(rays, [0, 1])), intersection(_some(rays, [1, 2])), common_scale(rays)]
    shape = parts[2].by_rays.shape
    by_rays = np.zeros((*shape[:-3], 3, 3, COLUMNS))
    for row, (part, columns) in enumerate(zip(parts, ([0, 1], [1, 2], [0, 1, 2]), strict=True)):
        by_rays[..., row, columns, :] = part.by_rays[..., 0, :, :]
    value = np.concatenate([part.value for part in parts], axis=-1)
    return Misclosure(value=value, by_rays=by_rays, by_control=np.zeros((*value.shape, 3)))


def _of_rays(value: FloatArray, by_ray: FloatArray, rays: Rays) -> Misclosure:
    """Return a condition of one number, of its partials (..., r, 6) by origin and direction of the rays."""
    by_columns = np.einsum("...i,...ij->...j", by_ray, rays.partials)
    return Misclosure(
        value=value[..., None], by_rays=by_columns[..., None, :, :], by_control=np.zeros((*value.shape, 1, 3))
    )


def _some(rays: Rays, which: list[int]) -> Rays:
    """Return some of the rays of each point."""
    return Rays(
        origin=rays.origin[..., which, :],
        direction=rays.direction[..., which, :],
        partials=rays.partials[..., which, :, :],
        station=rays.station[..., which, :],
        real=rays.real[..., which],
    )
