"""The flat water surface: incidence point from camera and ground point, refracted ray from an image ray.

The surface is a plane across the local vertical `up` of the ground point, `depth` metres above it. Everything is
the closed form of docs/theory.md, the corrected section 4 of ETL-0306, in vectors that need no local frame:
H = camera above water, h = depth, e = horizontal direction from camera to ground point, I and theta the angles
in air and water. Where the depth is not positive the point stands above the water and its ray is straight, unless
the caller says that it is to be taken as wet: then the same formulas, smooth through depth 0, go on above the
water. An adjustment needs that: which rays are wet must not change under its feet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray
from musatpy.refraction.snell import water_tangent_ratio

_CHUNK = 8192  # rays at a time: the dozen arrays of one Newton step stay in the second-level cache
_MAX_STEPS = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class Incidence:
    """v = W - C from camera to incidence point, (..., 3), and its partial derivatives.

    By camera and by ground point (..., 3, 3); by water level and by refractive index (..., 3).
    For a point above the water v = G - C.
    """

    v: FloatArray
    by_camera: FloatArray
    by_ground: FloatArray
    by_level: FloatArray
    by_index: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class RefractedRay:
    """Water point W and unit direction r under water, (..., 3), and their partial derivatives (..., 3, 3).

    By camera (of W; r does not depend on it) and by the direction in air; by water level and index (..., 3).
    """

    origin: FloatArray
    direction: FloatArray
    origin_by_camera: FloatArray
    origin_by_direction: FloatArray
    direction_by_direction: FloatArray
    origin_by_level: FloatArray
    direction_by_index: FloatArray


def air_tangent(height: ArrayLike, depth: ArrayLike, distance: ArrayLike, index: ArrayLike) -> FloatArray:
    """Return tan(I) of the rays that reach ground points through the surface, vectorised in chunks.

    `height` H > 0 of the camera above the water, `depth` h of the point below it, horizontal `distance` D >= 0, all
    in metres and of shapes that broadcast, `index` n >= 1. A small negative depth continues the formula upwards.
    Newton on H t + h tan(theta(t)) = D, ETL-0306 (4.10) in terms of t = tan(I). The left side is increasing and
    concave, and the paraxial start D/(H + h/n) lies below the root: the steps rise towards it and cannot overshoot.
    Where H is not positive, or no number, there is no ray: what is returned means nothing.
    """
    H, h, D, n = np.broadcast_arrays(
        np.asarray(height, float), np.asarray(depth, float), np.asarray(distance, float), np.asarray(index, float)
    )
    tangent = np.empty(H.shape)
    flat = tangent.reshape(-1)
    H, h, D, n = H.reshape(-1), h.reshape(-1), D.reshape(-1), n.reshape(-1)
    for start in range(0, flat.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        flat[part] = _newton(H[part], h[part], D[part], n[part])
    return tangent


def _newton(H: FloatArray, h: FloatArray, D: FloatArray, n: FloatArray) -> FloatArray:
    t = D / (H + h / n)
    n2 = n * n
    excess = n2 - 1.0
    ray = H > 0.0  # others would keep all at it to the last step
    for _ in range(_MAX_STEPS):
        g2 = 1.0 / (n2 + excess * t * t)
        g = np.sqrt(g2)
        step = (D - t * (H + h * g)) / (H + h * n2 * g2 * g)
        t = t + step
        # Grazing rays over deep water start far below the root and take more steps than the usual three.
        left, size = np.abs(step), np.abs(t)
        if not (ray & (left > 4e-16 * size + 1e-300)).any():
            break
        if not (ray & (left > 1e-8 * size)).any():
            g = water_tangent_ratio(t, n)  # the convergence is quadratic: one more step ends at rounding
            t = t + (D - t * (H + h * g)) / (H + h * n2 * g**3)
            break
    return t


def incidence(
    camera: FloatArray,
    ground: FloatArray,
    up: FloatArray,
    depth: ArrayLike,
    index: ArrayLike,
    wet: ArrayLike | None = None,
) -> Incidence:
    """Return the incidence point of the rays from ground points to cameras, with partial derivatives.

    camera, ground, up: (..., 3); depth (...): water level minus height of the ground point, m; index n; wet (...):
    which rays are refracted, those with a positive depth unless given.
    The partial by the ground point includes the depth that changes with it; `up` is held.
    """
    depth, n = np.asarray(depth, dtype=float), np.asarray(index, dtype=float)
    gap = ground - camera
    fall = -_dot(up, gap)
    horizontal = gap + up * fall[..., None]
    D = np.linalg.norm(horizontal, axis=-1)
    e = horizontal / np.where(D > 0.0, D, 1.0)[..., None]  # 0 at the nadir
    wet = depth > 0.0 if wet is None else np.broadcast_to(wet, depth.shape)
    h = np.where(wet, depth, 0.0)
    H = fall - h
    t = air_tangent(H, h, D, n)
    g = water_tangent_ratio(t, n)
    air3 = (1.0 + t * t) ** -1.5  # cos^3 I
    water2 = 1.0 / (1.0 + np.square(t * g))  # cos^2 theta
    water3 = water2 * np.sqrt(water2)
    # docs/theory.md, every term multiplied by H h so that neither depth 0 nor the nadir divides by zero
    spread = h * air3 + n * water3 * H
    kappa = n * water3 * H / spread
    Q_H = t * air3 * h / spread
    Q_h = -n * t * g * water3 * H / spread
    Q_n = t * g * np.sqrt(water2) * H * h / spread
    ratio = H / (H + h * g)  # Q/D
    ee, uu = _outer(e, e), _outer(up, up)
    K = kappa[..., None, None] * ee + ratio[..., None, None] * (np.eye(3) - uu - ee)
    # at the nadir kappa equals Q/D, and ee = 0 leaves K = ratio (I - uu) as it should be
    by_camera = -K + _outer(e * Q_H[..., None] - up, up)
    by_ground = K - _outer(e * Q_h[..., None], up)
    dry = ~wet[..., None]
    dry_matrix = dry[..., None]
    v = e * (H * t)[..., None] - up * H[..., None]
    return Incidence(
        v=np.where(dry, gap, v),
        by_camera=np.where(dry_matrix, -np.eye(3), by_camera),
        by_ground=np.where(dry_matrix, np.eye(3), by_ground),
        by_level=np.where(dry, 0.0, e * (Q_h - Q_H)[..., None] + up),
        by_index=np.where(dry, 0.0, e * Q_n[..., None]),
    )


def refracted_ray(
    camera: FloatArray, direction: FloatArray, up: FloatArray, height: ArrayLike, index: ArrayLike
) -> RefractedRay:
    """Return where image rays enter the water and where they go from there, with partial derivatives.

    camera, direction (unit, downward), up: (..., 3); `height` (...) of the camera above the water, m.
    ETL-0306 (3.13) and (3.17): only the direction of (3.17) matters, here it is a unit vector.
    """
    H, n = np.asarray(height, dtype=float)[..., None], np.asarray(index, dtype=float)[..., None]
    u = direction
    c = -_dot(up, u)[..., None]  # cos I
    k = H / c
    cos_theta = np.sqrt(1.0 - (1.0 - c * c) / (n * n))
    r = u / n + up * (c / n - cos_theta)
    uu = _outer(up, up)
    along = u + up * c  # horizontal part of the ray in air
    one = np.eye(3)
    return RefractedRay(
        origin=camera + k * u,
        direction=r,
        origin_by_camera=one + _outer(u / c, up),
        origin_by_direction=k[..., None] * (one + _outer(u / c, up)),
        direction_by_direction=one / n[..., None] - (1.0 / n - c / (n * n * cos_theta))[..., None] * uu,
        origin_by_level=-u / c,
        direction_by_index=-along / (n * n) - up * (1.0 - c * c) / (n**3 * cos_theta),
    )


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.einsum("...i,...i->...", a, b)


def _outer(a: FloatArray, b: FloatArray) -> FloatArray:
    return a[..., :, None] * b[..., None, :]
