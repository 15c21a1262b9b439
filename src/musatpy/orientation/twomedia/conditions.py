"""What the rays of a point must fulfil: Okamoto and Mori (1974), (13), (18)', (23), (28), (29), (31) to (33), (46).

Every condition takes the r rays of each of k points in s orientations, control points (s, k, 3) and the
orientations, and gives q misclosures a point with their partial derivatives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry.collinearity import coplanarity, scale_restraint
from musatpy.orientation.twomedia.rays import COLUMNS, INDEX, SLOPE, STATION, ImageRays, Orientation


@dataclass(frozen=True, kw_only=True, eq=False)
class Misclosure:
    """Misclosures (s, k, q), partials by the rays (s, k, q, r, 12) and by the control point (s, k, q, 3)."""

    value: FloatArray
    by_rays: FloatArray
    by_control: FloatArray


Condition = Callable[[ImageRays, FloatArray, Orientation], Misclosure]


@dataclass(frozen=True, kw_only=True, eq=False)
class ConditionGroup:
    """k points on the same r photos (r,) with the same condition: their images (k, r) and control points (k,).

    `control` is None for points that are not known.
    """

    condition: Condition
    photos: tuple[int, ...]
    images: IntArray
    control: IntArray | None = None


def refracted(rays: ImageRays, control: FloatArray, at: Orientation) -> Misclosure:
    """Return how far each ray passes the control point at its height: dX and dY of (13), 2 r a point."""
    s, k, r = rays.real.shape
    direction, gap = rays.direction, rays.origin - control[:, :, None]
    run = direction[..., :2] / direction[..., 2:]
    value = gap[..., :2] - gap[..., 2:] * run
    by_origin = np.concatenate([np.broadcast_to(np.eye(2), (*run.shape, 2)), -run[..., None]], axis=-1)
    by_direction = by_origin * -(gap[..., 2:] / direction[..., 2:])[..., None]
    by_columns = np.concatenate([by_origin, by_direction], axis=-1) @ rays.partials
    by_rays = np.zeros((s, k, r, 2, r, COLUMNS))
    for ray in range(r):
        by_rays[:, :, ray, :, ray] = by_columns[:, :, ray]
    return Misclosure(
        value=value.reshape(s, k, 2 * r),
        by_rays=by_rays.reshape(s, k, 2 * r, r, COLUMNS),
        by_control=-by_origin.reshape(s, k, 2 * r, 3),
    )


def fermat(rays: ImageRays, control: FloatArray, at: Orientation) -> Misclosure:
    """Return Fermat's condition at the water point W of one wet ray a point: (18)'.

    beta (W - C).t - alpha n (G - W).t for both tangents t of the plane, with the ways alpha from station C to W and
    beta from W to control G.
    """
    only = rays[:, 0]
    tangent = np.concatenate([np.broadcast_to(np.eye(2), (len(at.level), 2, 2)), at.slope[:, :, None]], axis=-1)
    n = at.index[:, None, None]
    air, water = only.origin - only.station, control - only.origin
    alpha, beta = (np.sqrt(np.sum(np.square(way), axis=-1))[..., None] for way in (air, water))
    air_along, water_along = (np.einsum("sti,ski->skt", tangent, way) for way in (air, water))
    by_air = beta[..., None] * tangent[:, None] - (n * water_along)[..., None] * (air / alpha)[..., None, :]
    by_water = air_along[..., None] * (water / beta)[..., None, :] - (alpha * n)[..., None] * tangent[:, None]
    by_rays = (by_air - by_water) @ only.partials[..., :3, :]
    by_rays[..., STATION] -= by_air
    by_rays[..., INDEX] -= alpha * water_along
    by_rays[..., SLOPE] += (beta * air[..., 2:] - alpha * n * water[..., 2:])[..., None] * np.eye(2)
    value = beta * air_along - alpha * n * water_along
    return Misclosure(value=value, by_rays=by_rays[..., None, :], by_control=by_water)


def intersection(rays: ImageRays, control: FloatArray, at: Orientation) -> Misclosure:
    """Return the volume by which two rays a point miss each other: (23), (28), (29)."""
    return _of_rays(*coplanarity(rays.origin, rays.direction), rays)


def triple(rays: ImageRays, control: FloatArray, at: Orientation) -> Misclosure:
    """Return the conditions of three rays a point: two coplanarities, and the scale of (46) in the dot form.

    The nine equations (31) to (33) and (46) of such a point have rank 3.
    """
    pairs = [slice(0, 2), slice(1, 3)]
    parts = [intersection(rays[:, pair], control, at) for pair in pairs]
    scale = _of_rays(*scale_restraint(rays.origin, rays.direction), rays)
    by_rays = np.concatenate([np.zeros_like(scale.by_rays)] * 2 + [scale.by_rays], axis=-3)
    for row, (pair, part) in enumerate(zip(pairs, parts, strict=True)):
        by_rays[..., row, pair, :] = part.by_rays[..., 0, :, :]
    value = np.concatenate([*(part.value for part in parts), scale.value], axis=-1)
    return Misclosure(value=value, by_rays=by_rays, by_control=np.zeros((*value.shape, 3)))


def _of_rays(value: FloatArray, by_ray: FloatArray, rays: ImageRays) -> Misclosure:
    """Return a condition of one number (s, k), of its partials (s, k, r, 6) by origin and direction of the rays."""
    by_columns = np.einsum("...i,...ij->...j", by_ray, rays.partials)
    return Misclosure(
        value=value[..., None], by_rays=by_columns[..., None, :, :], by_control=np.zeros((*value.shape, 1, 3))
    )
