"""The flat water surface: incidence point from camera and ground point, refracted ray from an image ray.

The surface is a plane across the local vertical `up` of the ground point, `depth` metres above it. Everything is
the closed form of docs/theory.md, the corrected section 4 of ETL-0306, in vectors that need no local frame:
H = camera above water, h = depth, e = horizontal direction from camera to ground point, I and theta the angles
in air and water. Where the depth is not positive the point stands above the water and its ray is straight, unless
the caller says that it is to be taken as wet: then the same formulas, smooth through depth 0, go on above the
water. An adjustment needs that: which rays are wet must not change under its feet.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from musatpy.arrays import FloatArray

_CHUNK = 8192  # rays at a time: the dozen arrays of one Newton step stay in the second-level cache
_MAX_STEPS = 60
# cameras, ground points, verticals (r, 3), depths, indices, and which are wet (r,), one ray after the other
Rays = tuple[NDArray[Any], ...]


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


Traced = TypeVar("Traced", bound=Incidence | RefractedRay)


def water_tangent_ratio(tangent: ArrayLike, index: ArrayLike) -> FloatArray:
    """Return tan(theta)/tan(I) for given tan(I): 1/sqrt(n^2 + (n^2 - 1) tan^2 I), 1/n at the nadir.

    sin(I) = n sin(theta), ETL-0306 section 2. Its inverse is the depth factor of one ray.
    """
    n2 = np.square(index)
    return 1.0 / np.sqrt(n2 + (n2 - 1.0) * np.square(tangent))


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
    ray, last = H > 0.0, False  # others would keep all at it to the last step
    for _ in range(_MAX_STEPS):
        g2 = 1.0 / (n2 + excess * t * t)
        g = g2**0.5
        step = (D - t * (H + h * g)) / (H + h * n2 * g2 * g)
        t = t + step
        # Grazing rays over deep water start far below the root and take more steps than the usual three.
        left, size = np.abs(step), np.abs(t)
        if last or not (ray & (left > 4e-16 * size + 1e-300)).any():
            break
        # the convergence is quadratic: one more step ends at rounding
        last = not (ray & (left > 1e-8 * size)).any()
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
    rays, shape = _rays((camera, ground, up), depth, index, wet)
    r = len(rays[0])
    out = Incidence(
        v=np.empty((r, 3)),
        by_camera=np.empty((r, 3, 3)),
        by_ground=np.empty((r, 3, 3)),
        by_level=np.empty((r, 3)),
        by_index=np.empty((r, 3)),
    )
    for part, some in _chunks(rays):
        _set_incidence(some, out, part)
    return shaped(out, shape)


def shaped(rays: Traced, shape: tuple[int, ...]) -> Traced:
    """Return what is known of r rays, whose arrays have one row each, in the `shape` of these rays."""
    arrays = {field.name: getattr(rays, field.name) for field in fields(rays)}
    return replace(rays, **{name: array.reshape((*shape, *array.shape[1:])) for name, array in arrays.items()})


def water_vector(
    camera: FloatArray,
    ground: FloatArray,
    up: FloatArray,
    depth: ArrayLike,
    index: ArrayLike,
    wet: ArrayLike | None = None,
) -> FloatArray:
    """Return `Incidence.v` (..., 3) alone, of the arguments of `incidence`."""
    rays, shape = _rays((camera, ground, up), depth, index, wet)
    v = np.empty((len(rays[0]), 3))
    for part, some in _chunks(rays):
        gap, _, into, *_ = _entering(some)
        v[part] = np.where(some[-1], into, gap).T
    return v.reshape(*shape, 3)


def _rays(
    vectors: tuple[FloatArray, ...], depth: ArrayLike, index: ArrayLike, wet: ArrayLike | None
) -> tuple[Rays, tuple[int, ...]]:
    """Return the rays one after the other, and the shape that they had."""
    h, n = np.asarray(depth, dtype=float), np.asarray(index, dtype=float)
    values = h, n, h > 0.0 if wet is None else np.asarray(wet, dtype=bool)
    shape = np.broadcast_shapes(*(np.shape(vector)[:-1] for vector in vectors), *(value.shape for value in values))
    rows = [np.broadcast_to(vector, (*shape, 3)).reshape(-1, 3) for vector in vectors]
    return (*rows, *(np.broadcast_to(value, shape).reshape(-1) for value in values)), shape


def _chunks(rays: Rays) -> Iterator[tuple[slice, Rays]]:
    """Yield which rays come next, and these without gaps in memory."""
    for start in range(0, len(rays[0]), _CHUNK):
        part = slice(start, start + _CHUNK)
        yield part, tuple(np.ascontiguousarray(array[part]) for array in rays)


def _entering(rays: Rays) -> tuple[FloatArray, ...]:
    """Return of r rays what leads to the water, vectors (3, r) each component by itself.

    Those to ground points and up, v, horizontal directions e; H, h and tan(I) (r,).
    """
    camera, ground, vertical, depth, n, wet = rays
    gap, up = np.subtract(ground.T, camera.T, order="C"), np.ascontiguousarray(vertical.T)
    fall = -_sum(up * gap)
    e = gap + up * fall
    D = np.sqrt(_sum(e * e))
    e /= np.where(D > 0.0, D, 1.0)  # 0 at the nadir
    h = np.where(wet, depth, 0.0)
    H = fall - h
    t = _newton(H, h, D, n)
    return gap, up, e * (H * t) - up * H, e, H, h, t


def _set_incidence(rays: Rays, out: Incidence, part: slice) -> None:
    """Set a part of the rows of `out`."""
    gap, u, v, e, H, h, t = _entering(rays)
    n, wet = rays[-2:]
    g = water_tangent_ratio(t, n)
    under = t * g
    air2 = 1.0 / (1.0 + t * t)  # cos^2 I
    water2 = 1.0 / (1.0 + under * under)  # cos^2 theta
    cosine = np.sqrt(water2)
    # docs/theory.md, every term multiplied by H h so that neither depth 0 nor the nadir divides by zero
    of_air, of_water = h * air2 * np.sqrt(air2), n * water2 * cosine * H
    spread = of_air + of_water
    kappa = of_water / spread
    Q_H, Q_h = t * of_air / spread, -under * kappa
    ratio = H / (H + h * g)  # Q/D
    out.v[part] = v.T
    out.by_level[part] = (e * (Q_h - Q_H) + u).T
    out.by_index[part] = (e * (under * cosine * H * h / spread)).T
    # K = kappa e e' + ratio (1 - u u' - e e'); at the nadir kappa equals Q/D, and e e' = 0 leaves K as it should be
    along, across = e * (kappa - ratio), u * ratio
    by_H, by_h = e * Q_H - u, e * Q_h
    for i in range(3):
        for j in range(3):
            K = along[i] * e[j] - across[i] * u[j]
            if i == j:
                K += ratio
            out.by_camera[part, i, j] = by_H[i] * u[j] - K
            out.by_ground[part, i, j] = K - by_h[i] * u[j]
    if not wet.all():
        dry = part.start + np.flatnonzero(~wet)
        out.v[dry] = gap[:, ~wet].T
        out.by_camera[dry], out.by_ground[dry] = -np.eye(3), np.eye(3)
        out.by_level[dry] = out.by_index[dry] = 0.0


def _sum(vectors: FloatArray) -> FloatArray:
    """Return the sums (r,) of the components of vectors (3, r)."""
    return np.asarray(vectors[0] + vectors[1] + vectors[2])


def ray_below(
    camera: FloatArray, direction: FloatArray, up: FloatArray, height: ArrayLike, index: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return where image rays enter the water and their unit directions in it, of what `refracted_ray` takes."""
    n = np.asarray(index, dtype=float)
    c = -_dot(up, direction)
    origin = camera + (np.asarray(height, dtype=float) / c)[..., None] * direction
    along = c / n - np.sqrt(1.0 - (1.0 - c * c) / (n * n))
    return origin, np.asarray(direction / n[..., None] + up * along[..., None])


def refracted_ray(
    camera: FloatArray, direction: FloatArray, up: FloatArray, height: ArrayLike, index: ArrayLike
) -> RefractedRay:
    """Return where image rays enter the water and where they go from there, with partial derivatives.

    camera, direction (unit, downward), up: (..., 3); `height` (...) of the camera above the water, m.
    ETL-0306 (3.13) and (3.17): only the direction of (3.17) matters, here it is a unit vector.
    """
    origin, below = ray_below(camera, direction, up, height, index)
    H, n = np.asarray(height, dtype=float)[..., None], np.asarray(index, dtype=float)[..., None]
    u, c = direction, -_dot(up, direction)[..., None]  # cos I
    cos_theta = np.sqrt(1.0 - (1.0 - c * c) / (n * n))
    along = u + up * c  # horizontal part of the ray in air
    one = np.eye(3)
    return RefractedRay(
        origin=origin,
        direction=below,
        origin_by_camera=one + outer(u / c, up),
        origin_by_direction=(H / c)[..., None] * (one + outer(u / c, up)),
        direction_by_direction=one / n[..., None] - (1.0 / n - c / (n * n * cos_theta))[..., None] * outer(up, up),
        origin_by_level=-u / c,
        direction_by_index=-along / (n * n) - up * (1.0 - c * c) / (n**3 * cos_theta),
    )


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.einsum("...i,...i->...", a, b)


def outer(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the products (..., i, j) of vectors (..., i) and (..., j)."""
    return a[..., :, None] * b[..., None, :]
