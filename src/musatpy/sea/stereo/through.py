"""True points of a simultaneous pair through an estimated surface, with covariance from images and surface.

An image ray goes one way through the surface it meets (`refraction.bending`), whatever number of refraction points
a ground point has. Two kinds of input: image rays, whose refracted rays are intersected as near as they come to
each other; and apparent points, half-way between rays in air that hardly ever meet under waves. Their parallax is
not in the apparent point; it is that under which the refracted rays meet.

Axes: those of the surface, Z up (m); every array has one row per point.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.collinearity import cross
from musatpy.geometry.crs import Plan
from musatpy.refraction import bending
from musatpy.refraction.bending import WaveRay
from musatpy.refraction.surface import Limits, Relief, Surface
from musatpy.sea.stereo.surface_points import FittedSurface, SurfacePoints

_SHAPE = 3  # height and two slopes of the surface at one place
_MAX_STEPS = 20
_MET = 1e-10  # m: how near refracted rays pass each other that meet
_WIDEST = 20.0  # m: no parallax in air is that of waves


@dataclass(frozen=True, kw_only=True, eq=False)
class Intersection:
    """Points (n, 3) m under water, and what moves them.

    by_ray (n, 3, 2, 3): by the directions of both image rays; by_shape (n, 3, 6): by height and slopes of the
    surface where the left ray meets it, and where the right one does; meeting (n, 2, 3): these places; parallax
    (n,) m: by which the refracted rays miss each other, signed.
    """

    position: FloatArray
    by_ray: FloatArray
    by_shape: FloatArray
    meeting: FloatArray
    parallax: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class TruePoint:
    """True points (n, 3) m with their covariance (n, 3, 3) m2, and the part of it that is the surface's.

    by_given (n, 3, m): partials by what they were computed from: both rays (6), or the apparent point (3). parallax
    (n,) m: of image rays that under water, of apparent points that in air which the waves make.
    """

    position: FloatArray
    covariance: FloatArray
    surface_covariance: FloatArray
    by_given: FloatArray
    by_shape: FloatArray
    parallax: FloatArray
    meeting: FloatArray  # (n, 2, 3) m, where both rays meet the water
    met: BoolArray  # (n,) whether the refracted rays of an apparent point were made to meet

    @property
    def sigma(self) -> FloatArray:
        """(n, 3) m."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def intersect_rays(surface: Surface, cameras: FloatArray, direction: FloatArray, index: float) -> Intersection:
    """Return where the refracted rays of unit image rays (n, 2, 3) from two cameras (2, 3) come nearest.

    The point has the least sum of squared distances from both. Raises `ValueError` for a ray that does not go down
    to the water, or meets it where it is not known.
    """
    bent = bending.refracted_ray(surface, cameras, direction, index)
    P, r = bent.origin, bent.direction
    across = np.eye(3) - r[..., :, None] * r[..., None, :]
    inverse = np.linalg.inv(across.sum(axis=1))
    X = np.einsum("nij,nkjl,nkl->ni", inverse, across, P)
    q = P - X[:, None, :]
    rq = np.sum(r * q, axis=-1)
    by_origin = inverse[:, None] @ across  # (n, 2, 3, 3)
    by_refracted = -inverse[:, None] @ (rq[..., None, None] * np.eye(3) + r[..., :, None] * q[..., None, :])
    by_ray = by_origin @ bent.origin_by_direction + by_refracted @ bent.direction_by_direction
    by_shape = by_origin @ _shape_of_origin(bent) + by_refracted @ _shape_of_direction(bent)
    normal = cross(r[:, 0], r[:, 1])
    return Intersection(
        position=X,
        by_ray=np.swapaxes(by_ray, 1, 2),
        by_shape=np.swapaxes(by_shape, 1, 2).reshape(len(X), 3, 2 * _SHAPE),
        meeting=P,
        parallax=np.sum((P[:, 1] - P[:, 0]) * normal, axis=1) / np.linalg.norm(normal, axis=1),
    )


def _shape_of_origin(bent: WaveRay) -> FloatArray:
    return np.concatenate([bent.origin_by_level[..., None], bent.origin_by_slope], axis=-1)


def _shape_of_direction(bent: WaveRay) -> FloatArray:
    return np.concatenate([bent.direction_by_level[..., None], bent.direction_by_slope], axis=-1)


def _parallax_partials(
    surface: Surface, cameras: FloatArray, u: FloatArray, index: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (n,) c = (P2 - P1).(r1 x r2), by the image rays (n, 2, 3) and by the shapes (n, 6)."""
    bent = bending.refracted_ray(surface, cameras, u, index)
    P, r = bent.origin, bent.direction
    gap, normal = P[:, 1] - P[:, 0], cross(r[:, 0], r[:, 1])
    by_origin = np.stack([-normal, normal], axis=1)
    by_refracted = np.stack([cross(r[:, 1], gap), cross(gap, r[:, 0])], axis=1)

    def through(origin: FloatArray, refracted: FloatArray) -> FloatArray:
        first = np.einsum("nki,nkij->nkj", by_origin, origin)
        return first + np.einsum("nki,nkij->nkj", by_refracted, refracted)

    by_ray = through(bent.origin_by_direction, bent.direction_by_direction)
    by_shape = through(_shape_of_origin(bent), _shape_of_direction(bent))
    return np.sum(gap * normal, axis=1), by_ray, by_shape.reshape(len(by_shape), -1)


def true_points_of_rays(
    fitted: FittedSurface, cameras: FloatArray, direction: FloatArray, index: float, sigma: float
) -> TruePoint:
    """Return the true points of image rays (n, 2, 3), sigma (rad) that of an image across its ray, both ways.

    cameras (2, 3) about the origin of the surface. Raises `ValueError`.
    """
    intersection = intersect_rays(fitted.surface, cameras, direction, index)
    across = np.eye(3) - direction[..., :, None] * direction[..., None, :]
    by_ray = intersection.by_ray
    images = sigma**2 * np.einsum("nikj,nkjl,nmkl->nim", by_ray, across, by_ray)
    by_given, met = by_ray.reshape(len(by_ray), 3, 6), np.ones(len(by_ray), dtype=bool)
    return _with_covariance(
        fitted, intersection, images, by_given, intersection.by_shape, intersection.parallax, met
    )


def true_points_of_apparent(
    fitted: FittedSurface, cameras: FloatArray, apparent: FloatArray, covariance: FloatArray, index: float
) -> TruePoint:
    """Return the true points of apparent points (n, 3) with covariance (n, 3, 3), intersected in air from a pair.

    cameras (2, 3), or (n, 2, 3) in the axes of each point, and points about the origin of the surface. Raises
    `ValueError`.
    """
    v, intersection, met = _met(fitted.surface, cameras, apparent, index)
    u, by_apparent, by_v = _rays_through(cameras, apparent, v)
    _, c_ray, c_shape = _parallax_partials(fitted.surface, cameras, u, index)
    # v follows from the meeting of the refracted rays, c = 0
    c_v = np.einsum("nkj,nkj->n", c_ray, by_v)[:, None]
    v_apparent = -np.einsum("nkj,nkji->ni", c_ray, by_apparent) / c_v
    v_shape = -c_shape / c_v
    X_v = np.einsum("nikj,nkj->ni", intersection.by_ray, by_v)
    by_given = (
        np.einsum("nikj,nkjl->nil", intersection.by_ray, by_apparent) + X_v[:, :, None] * v_apparent[:, None, :]
    )
    by_shape = intersection.by_shape + X_v[:, :, None] * v_shape[:, None, :]
    images = by_given @ covariance @ np.swapaxes(by_given, 1, 2)
    return _with_covariance(fitted, intersection, images, by_given, by_shape, v, met)


def _met(
    surface: Surface, cameras: FloatArray, A: FloatArray, index: float
) -> tuple[FloatArray, Intersection, BoolArray]:
    """Return the parallaxes (n,) m in air under which refracted rays meet, where, and whether they do (n,)."""
    v = np.zeros(len(A))
    for _ in range(_MAX_STEPS):
        u, _, by_v = _rays_through(cameras, A, v)
        intersection = intersect_rays(surface, cameras, u, index)
        met = np.abs(intersection.parallax) <= _MET
        if met.all():
            break
        c, c_ray, _ = _parallax_partials(surface, cameras, u, index)
        v = np.clip(v - c / np.einsum("nkj,nkj->n", c_ray, by_v), -_WIDEST, _WIDEST)
    return v, intersection, met


def _rays_through(cameras: FloatArray, A: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the unit rays (n, 2, 3) past apparent points A (n, 3) by half the parallax v (n,) each way.

    Their derivatives by A (n, 2, 3, 3) and by v (n, 2, 3).
    """
    e, e_A, e_v = _common_perpendicular(
        A - cameras.mean(axis=-2), cameras[..., 1, :] - cameras[..., 0, :], v[:, None]
    )
    half = np.array([-0.5, 0.5])
    w = A[:, None, :] - cameras + (half * v[:, None])[..., None] * e[:, None, :]
    distance = np.linalg.norm(w, axis=-1)[..., None]
    u = w / distance
    turn = (np.eye(3) - u[..., :, None] * u[..., None, :]) / distance[..., None]
    by_A = turn @ (np.eye(3) + (half * v[:, None])[..., None, None] * e_A[:, None])
    along = half[:, None] * (e + v[:, None] * e_v)[:, None, :]
    return u, by_A, np.einsum("nkij,nkj->nki", turn, along)


def _common_perpendicular(g: FloatArray, d: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the unit vector e (n, 3) across both rays of a point, by g (n, 3, 3) and by v (n, 3).

    g (n, 3): from the middle of the base d (..., 3) to the apparent point, v (n, 1) the parallax. Across both rays
    means e.g = 0 and e.d = v: e = v s / s.s + c e0, where s is d across g, and e0 lies across g and d.
    """
    gd, gg = np.sum(g * d, axis=1), np.sum(g * g, axis=1)
    s = d - g * (gd / gg)[:, None]
    S = np.sum(s * s, axis=1)[:, None]
    one = np.eye(3)
    s_g = -(
        (gd / gg)[:, None, None] * one
        + g[:, :, None] * (d / gg[:, None] - 2.0 * g * (gd / gg**2)[:, None])[:, None, :]
    )
    ss_g = np.einsum("ni,nij->nj", s, s_g)
    m = cross(d, g)
    size = np.linalg.norm(m, axis=1)[:, None]
    e0 = m / size
    m_g = np.cross(d[..., None, :], -one)  # column j is d across the axis j
    e0_g = (one - e0[:, :, None] * e0[:, None, :]) / size[..., None] @ m_g
    with np.errstate(invalid="ignore"):  # a parallax longer than its base has no ray: NaN, whose reason is told
        c = np.sqrt(1.0 - v * v / S)
    e = v * s / S + c * e0
    e_g = (v / S)[..., None] * (s_g - 2.0 * s[:, :, None] * (ss_g / S)[:, None, :]) + c[..., None] * e0_g
    e_g += e0[:, :, None] * (v * v / (S * S * c) * ss_g)[:, None, :]
    return e, e_g, s / S - v / (S * c) * e0


def _with_covariance(
    fitted: FittedSurface,
    intersection: Intersection,
    images: FloatArray,
    by_given: FloatArray,
    by_shape: FloatArray,
    parallax: FloatArray,
    met: BoolArray,
) -> TruePoint:
    shape = fitted.shape_covariance(intersection.meeting[..., :2])
    surface = by_shape @ shape @ np.swapaxes(by_shape, 1, 2)
    return TruePoint(
        position=intersection.position,
        covariance=images + surface,
        surface_covariance=surface,
        by_given=by_given,
        by_shape=by_shape,
        parallax=parallax,
        meeting=intersection.meeting,
        met=met,
    )


class Fault(IntEnum):
    """Why a point has no true position."""

    NONE = 0
    ABOVE_WATER = 1
    UNKNOWN_WATER = 2
    NO_MEETING = 3
    CAMERA_BELOW = 4


REASONS = {
    Fault.NONE: "",
    Fault.ABOVE_WATER: "not below the water",
    Fault.UNKNOWN_WATER: "the surface is not known where its rays meet the water",
    Fault.NO_MEETING: "no parallax makes its rays meet under water",
    Fault.CAMERA_BELOW: "not below both cameras",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrected:
    """True points (n, 3) m and their covariance (n, 3, 3) m2, NaN where there is a fault (n,).

    surface_sigma (n,) m: the part of the surface in the sigma of the height; parallax (n,) m in air, by the waves.
    """

    position: FloatArray
    covariance: FloatArray
    surface_sigma: FloatArray
    parallax: FloatArray
    fault: NDArray[np.int8]

    @property
    def sigma(self) -> FloatArray:
        """(n, 3) m."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


@dataclass(frozen=True, kw_only=True, eq=False)
class Endless(Surface):
    """An estimated surface that answers everywhere: whether it `covers` a place is asked afterwards."""

    fitted: FittedSurface

    @property
    def origin(self) -> FloatArray:
        return self.fitted.origin

    @property
    def surface(self) -> Surface:
        return self

    @property
    def limits(self) -> Limits:
        return self.fitted.surface.limits

    def relief(self, xy: FloatArray, time: ArrayLike = 0.0) -> Relief:
        return self.fitted.surface.relief(xy, time)

    def shape_covariance(self, xy: FloatArray) -> FloatArray:
        return self.fitted.shape_covariance(xy)


def correct(
    fitted: FittedSurface, cameras: FloatArray, apparent: SurfacePoints, index: float, plan: Plan | None = None
) -> Corrected:
    """Return the true points of apparent ones, intersected in air from the cameras (2, 3) of its pair.

    All in the axes of the job; with a `plan` points on its map, each of which is corrected in its own vertical, and
    cameras geocentric. Raises `ValueError` where a camera is not above the water, or both are at one place.
    """
    shift = np.append(fitted.origin, 0.0)
    if plan is not None:
        cameras = plan.about_points(cameras, apparent.position)
    C, A = cameras - shift, apparent.position - shift
    if not (C[..., 2] > fitted.surface.limits.highest).all():
        raise ValueError("a camera is not above the water")
    if not (C[..., 0, :] != C[..., 1, :]).any():
        raise ValueError("both cameras are at one place")
    n = len(A)
    fault = np.zeros(n, dtype=np.int8)
    fault[A[:, 2] >= fitted.surface.relief(A[:, :2]).height] = Fault.ABOVE_WATER
    fault[A[:, 2] >= C[..., 2].min(axis=-1)] = Fault.CAMERA_BELOW
    position, covariance = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    surface_sigma, parallax = np.full(n, np.nan), np.full(n, np.nan)
    below = np.flatnonzero(fault == Fault.NONE)
    for wet, true in _true_points(Endless(fitted=fitted), C, A, apparent.covariance, index, below):
        if true is None:
            fault[wet] = Fault.NO_MEETING
            continue
        known = fitted.covers(true.meeting[..., :2]).all(axis=1)
        fault[wet] = np.where(known, np.where(true.met, Fault.NONE, Fault.NO_MEETING), Fault.UNKNOWN_WATER)
        good = fault[wet] == Fault.NONE
        rows = wet[good]
        position[rows] = true.position[good] + shift
        covariance[rows] = true.covariance[good]
        surface_sigma[rows] = np.sqrt(true.surface_covariance[good, 2, 2])
        parallax[rows] = true.parallax[good]
    if plan is not None:
        good = fault == Fault.NONE
        position[good] = plan.settled(position[good], apparent.position[good])
    return Corrected(
        position=position, covariance=covariance, surface_sigma=surface_sigma, parallax=parallax, fault=fault
    )


def _true_points(
    fitted: FittedSurface, cameras: FloatArray, A: FloatArray, covariance: FloatArray, index: float, rows: IntArray
) -> Iterator[tuple[IntArray, TruePoint | None]]:
    """Yield rows with their true points, None for those whose rays cannot be followed: halves of what fails."""
    if not rows.size:
        return
    try:
        pair = cameras if cameras.ndim == 2 else cameras[rows]
        yield rows, true_points_of_apparent(fitted, pair, A[rows], covariance[rows], index)
    except ValueError:
        if len(rows) == 1:
            yield rows, None
            return
        for half in np.array_split(rows, 2):
            yield from _true_points(fitted, cameras, A, covariance, index, half)
