"""Image rays through any refracting surface: where they enter the water and where they go, with partials.

Okamoto (1982), eq. 22 to 33: the first place where the ray meets the surface, Snell's law about its normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray
from musatpy.refraction.flat import RefractedRay, outer, shaped
from musatpy.refraction.stationary import RayEnds
from musatpy.refraction.surface import Surface

_STEPS = 4000  # a grazing ray between high waves needs the most
_COLUMNS = 9  # of the partials inside: camera, direction, level, slope
_CAMERA, _DIRECTION, _LEVEL, _SLOPE = slice(0, 3), slice(3, 6), 6, slice(7, 9)


@dataclass(frozen=True, kw_only=True, eq=False)
class WaveRay(RefractedRay):
    """A ray refracted by any surface; besides, the direction (..., 3) depends on where the ray meets it.

    By camera (..., 3, 3), by level (..., 3), and both by the slope of the surface there (..., 3, 2).
    """

    direction_by_camera: FloatArray
    direction_by_level: FloatArray
    origin_by_slope: FloatArray
    direction_by_slope: FloatArray


def refracted_ray(
    surface: Surface, camera: FloatArray, direction: FloatArray, index: ArrayLike, time: ArrayLike = 0.0
) -> WaveRay:
    """Return where image rays first meet the water and where they go from there, with partial derivatives.

    camera, direction (unit, downward): (..., 3) east, north, up; index n (...) >= 1; time (...) s. Raises
    `ValueError` for a ray that does not go down, starts under water, or meets the surface where it is not known.
    """
    shape = np.broadcast_shapes(np.shape(camera)[:-1], np.shape(direction)[:-1], np.shape(index), np.shape(time))
    rays = RayEnds.of(camera, direction, index, time)
    C, u, n = rays.camera, rays.ground, rays.index[:, None]
    rho = _first_meeting(surface, C, u, rays.time)
    W = C + rho * u
    if not surface.covers(W[:, :2], rays.time).all():
        raise ValueError("the water surface is not known where a ray meets it")
    relief = surface.relief(W[:, :2], rays.time)
    p = np.concatenate([-relief.gradient, np.ones((len(W), 1))], axis=1)
    secant = np.linalg.norm(p, axis=1)[:, None]
    m = p / secant
    c = -np.sum(m * u, axis=1)[:, None]  # cos i
    cos_theta = np.sqrt(1.0 - (1.0 - c * c) / (n * n))
    r = u / n + m * (c / n - cos_theta)  # Okamoto (1982), eq. 33, the normal pointing up
    dW = _meeting_partials(p, u, rho)
    dm = _normal_partials(p, secant, relief.hessian, dW)
    du = np.zeros((len(W), 3, _COLUMNS))
    du[:, :, _DIRECTION] = np.eye(3)
    dc = -_row(u, dm) - _row(m, du)
    dr = du / n[..., None] + dm * (c / n - cos_theta)[..., None]
    dr += outer(m, dc * (1.0 / n - c / (n * n * cos_theta)))
    by_index = -u / n**2 - m * (c / n**2 + (1.0 - c * c) / (n**3 * cos_theta))

    rays_below = WaveRay(
        origin=W,
        direction=r,
        origin_by_camera=dW[:, :, _CAMERA],
        origin_by_direction=dW[:, :, _DIRECTION],
        origin_by_level=dW[:, :, _LEVEL],
        origin_by_slope=dW[:, :, _SLOPE],
        direction_by_camera=dr[:, :, _CAMERA],
        direction_by_direction=dr[:, :, _DIRECTION],
        direction_by_level=dr[:, :, _LEVEL],
        direction_by_slope=dr[:, :, _SLOPE],
        direction_by_index=by_index,
    )
    return shaped(rays_below, shape)


def _meeting_partials(p: FloatArray, u: FloatArray, rho: FloatArray) -> FloatArray:
    """Return the partials (N, 3, 9) of W = C + rho u: W stays on the surface, p . dW = the rise of the level."""
    straight = np.zeros((len(u), 3, _COLUMNS))  # dC + rho du
    straight[:, :, _CAMERA] = np.eye(3)
    straight[:, :, _DIRECTION] = rho[..., None] * np.eye(3)
    by_rho = -_row(p, straight)
    by_rho[:, _LEVEL] += 1.0
    return straight + outer(u, by_rho / np.sum(p * u, axis=1)[:, None])


def _normal_partials(p: FloatArray, secant: FloatArray, hessian: FloatArray, dW: FloatArray) -> FloatArray:
    """Return the partials (N, 3, 9) of the unit normal p / |p|, which turns as W moves along the surface."""
    dp = np.zeros_like(dW)
    dp[:, :2] = -hessian @ dW[:, :2]
    dp[:, :2, _SLOPE] -= np.eye(2)
    m = p / secant
    return (dp - outer(m, _row(m, dp))) / secant[..., None]


def _first_meeting(surface: Surface, C: FloatArray, u: FloatArray, time: FloatArray) -> FloatArray:
    """Return the distances (N, 1) from cameras C along unit directions u to where they first meet the surface.

    Over the slope g of the surface, a ray nears it by at most |u_z| + g |u_xy| per metre: steps of the height above
    it over that never pass the first meeting. Once a ray is so near, or so steep, that there is no other meeting
    before, Newton's method ends it.
    """
    limits = surface.limits
    fall, run = -u[:, 2], np.linalg.norm(u[:, :2], axis=1)
    if not (fall > limits.slope * 1e-9).all():
        raise ValueError("an image ray does not go down to the water")
    nearing = fall + limits.slope * run
    rho = np.zeros(len(u))
    if not (_above(surface, C, u, time, rho)[0] > 0.0).all():
        raise ValueError("a camera is not above the water")
    if np.isfinite(limits.highest):
        rho = np.maximum(C[:, 2] - limits.highest, 0.0) / fall
    steep = fall > limits.slope * run
    for _ in range(_STEPS):
        height, rate = _above(surface, C, u, time, rho)
        # within this height the surface cannot bend back before the ray is through it
        near = steep | (height * limits.curvature * 4.0 < np.square(np.minimum(rate, 0.0)))
        step = np.where(near & (rate < 0.0), height / np.where(rate < 0.0, -rate, 1.0), height / nearing)
        rho = rho + step
        if (np.abs(step) <= 1e-15 * np.maximum(rho, 1.0) * 4.0).all():
            return rho[:, None]
    raise ValueError("no place was found where an image ray meets the water")


def _above(
    surface: Surface, C: FloatArray, u: FloatArray, time: FloatArray, rho: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the heights (N,) of places on rays above the surface, and how they change along the rays."""
    place = C + rho[:, None] * u
    relief = surface.relief(place[:, :2], time)
    return place[:, 2] - relief.height, u[:, 2] - np.sum(relief.gradient * u[:, :2], axis=1)


def _row(a: FloatArray, matrix: FloatArray) -> FloatArray:
    return np.einsum("ni,nij->nj", a, matrix)
