"""Incidence points on any refracting surface, by Fermat's principle, with their partial derivatives.

The optical path L = |W - C| + n |G - W| from a camera C to a ground point G over a place W = (x, y, s(x, y)) of the
surface is stationary at every refraction point: Okamoto (1982), eq. 9, 10 and 13. A wavy surface can have several.
THE PRINCIPAL ONE is that of the least optical path, whatever the start of the iteration: on a surface that calms
down it goes over into the only one.

Two bounds make that safe and quick. Snell's law and the limits of the surface keep all refraction points of a ray
within a circle about the ground point (`reach`); where L is convex over that circle, there is one and Newton's
method cannot miss it (`is_single`). Only the other rays are searched (`search`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.refraction import flat
from musatpy.refraction.all_refraction_points import search
from musatpy.refraction.stationary import RayEnds, path, stationary
from musatpy.refraction.surface import Surface

_PART = 16384  # rays at a time: what they need on the way would fill the memory for a million


@dataclass(frozen=True, kw_only=True, eq=False)
class WaveIncidence(flat.Incidence):
    """An incidence on any surface; the level raises all of the surface, `by_slope` (..., 3, 2) tilts it there.

    Whatever else moves the surface acts through the height and the gradient that it changes at the incidence point:
    the partials by a wave parameter p are by_level ds/dp + by_slope dgrad s/dp.

    number (...): of refraction points, 0 for a point above the water; complete (...): whether these are all, as far
    as their indices tell (see `search`).
    """

    by_slope: FloatArray
    number: IntArray
    complete: BoolArray


def incidence(
    surface: Surface, camera: FloatArray, ground: FloatArray, index: ArrayLike, time: ArrayLike = 0.0
) -> WaveIncidence:
    """Return the principal incidence points of the rays from ground points to cameras, with partial derivatives.

    camera, ground: (..., 3) east, north, up; index n (...) >= 1; time (...) s of the exposures. A point above the
    water keeps its straight ray. Raises `ValueError` where a camera is not above the highest wave, and where the
    surface is not known at an incidence point.
    """
    rays = RayEnds.of(camera, ground, index, time)
    _check_cameras(surface, rays)
    wet = surface.relief(rays.ground[:, :2], rays.time).height > rays.ground[:, 2]
    count, straight = len(wet), np.eye(3)
    out = WaveIncidence(
        v=rays.ground - rays.camera,
        by_camera=np.tile(-straight, (count, 1, 1)),
        by_ground=np.tile(straight, (count, 1, 1)),
        by_level=np.zeros((count, 3)),
        by_index=np.zeros((count, 3)),
        by_slope=np.zeros((count, 3, 2)),
        number=np.zeros(count, dtype=np.int64),
        complete=np.ones(count, dtype=bool),
    )
    partials = out.v, out.by_camera, out.by_ground, out.by_level, out.by_index, out.by_slope
    rows = np.flatnonzero(wet)
    for part in np.split(rows, range(_PART, len(rows), _PART)):
        under = rays[part]
        xy, out.number[part], out.complete[part] = _principal(surface, under)
        _check_covered(surface, under, xy)
        for array, values in zip(partials, _partials(surface, under, xy), strict=True):
            array[part] = values
    shape = np.broadcast_shapes(np.shape(camera)[:-1], np.shape(ground)[:-1], np.shape(index), np.shape(time))
    return flat.shaped(out, shape)


def is_single(surface: Surface, rays: RayEnds) -> BoolArray:
    """Tell for which rays (N,) the optical path is convex wherever a refraction point may be: they have one.

    A sufficient condition: the water leg bends L by at least n cos^2(beta + gamma)/r, the surface by at most
    |n cos beta - cos I| times its curvature; beta, gamma, r, I the worst angles and distance within reach.
    """
    limits = surface.limits
    if limits.curvature == 0.0:
        return np.ones(len(rays.index), dtype=bool)
    reach = rays.reach(surface)
    steepest = np.arctan2(reach.radius, reach.shallowest)
    angle = steepest + np.arctan(limits.slope)
    water = rays.index * np.square(np.cos(angle)) / np.hypot(reach.deepest, reach.radius)
    pull = np.maximum(rays.index - np.cos(reach.air_angle), 1.0 - rays.index * np.cos(steepest))
    bend = pull * limits.curvature
    return (angle < np.pi / 2.0) & (water > bend)


def _principal(surface: Surface, rays: RayEnds) -> tuple[FloatArray, IntArray, BoolArray]:
    """Return the principal places (N, 2), the number of refraction points and whether these are all (N,)."""
    number, complete = np.ones(len(rays.index), dtype=np.int64), np.ones(len(rays.index), dtype=bool)
    xy, quick = np.empty((len(rays.index), 2)), is_single(surface, rays)
    if quick.any():
        single = rays[quick]
        xy[quick], quick[quick] = stationary(surface, single, _flat_start(surface, single))
    open_ = np.flatnonzero(~quick)
    if len(open_):
        points = search(surface, rays[open_])
        number[open_], complete[open_] = np.bincount(points.ray, minlength=len(open_)), points.complete
        xy[open_] = points.xy[np.searchsorted(points.ray, np.arange(len(open_)))]
    return xy, number, complete


def _flat_start(surface: Surface, rays: RayEnds) -> FloatArray:
    """Return where the rays (N,) would enter level water of the height above their ground points."""
    gap = rays.ground - rays.camera
    depth = surface.relief(rays.ground[:, :2], rays.time).height - rays.ground[:, 2]
    D = np.linalg.norm(gap[:, :2], axis=1)
    H = -gap[:, 2] - depth
    Q = H * flat.air_tangent(H, depth, D, rays.index)
    return rays.camera[:, :2] + gap[:, :2] * np.divide(Q, D, out=np.ones_like(D), where=D > 0.0)[:, None]


def _partials(surface: Surface, rays: RayEnds, xy: FloatArray) -> tuple[FloatArray, ...]:
    """Return v = W - C and its partials by camera, ground, level, index and slope, by implicit differentiation."""
    at = path(surface, rays, xy)
    T, a, b, n = at.tangents, at.air, at.water, rays.index[:, None, None]
    one = np.eye(3)
    across_air = (one - a[:, :, None] * a[:, None, :]) / at.air_length[:, None, None]
    across_water = n * (one - b[:, :, None] * b[:, None, :]) / at.water_length[:, None, None]
    Tt = np.swapaxes(T, 1, 2)
    bend = (a - n[:, 0] * b)[:, 2, None, None]
    # of the two conditions T'(a - n b) = 0: by camera, ground, level, index, slope
    change = np.concatenate(
        [-Tt @ across_air, -Tt @ across_water, Tt @ (across_air + across_water)[:, :, 2:], -Tt @ b[:, :, None],
         bend * np.eye(2)], axis=2,
    )  # fmt: skip
    move = T @ -np.linalg.solve(at.hessian, change)
    by_camera, by_ground, by_level, by_index, by_slope = np.split(move, [3, 6, 7, 8], axis=2)
    v = np.concatenate([xy, at.height[:, None]], axis=1) - rays.camera
    return v, by_camera - one, by_ground, by_level[:, :, 0] + one[2], by_index[:, :, 0], by_slope


def _check_cameras(surface: Surface, rays: RayEnds) -> None:
    top = surface.limits.highest
    if np.isinf(top):
        above = surface.relief(rays.camera[:, :2], rays.time).height < rays.camera[:, 2]
    else:
        above = rays.camera[:, 2] > top
    if not above.all():
        raise ValueError("a camera is not above the water")


def _check_covered(surface: Surface, rays: RayEnds, xy: FloatArray) -> None:
    outside = ~surface.covers(xy, rays.time)
    if outside.any():
        x, y = xy[np.argmax(outside)]
        raise ValueError(f"the water surface is not known where a ray meets it: at {x:.1f}, {y:.1f} m")
