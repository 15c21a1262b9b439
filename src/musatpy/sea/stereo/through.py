"""True points of a simultaneous pair through an estimated surface, with covariance from images and surface.

An image ray goes one way through the surface it meets (`refraction.bending`), whatever number of refraction points
a ground point has. An apparent point lies half-way between rays in air that hardly ever meet under waves. Their
parallax is not in the apparent point; it is that under which the refracted rays meet.

Axes: those of the surface, Z up (m); every array has one row per point.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import BoolArray, FloatArray, IntArray, in_parts
from musatpy.geometry.collinearity import cross, nearest_point
from musatpy.geometry.crs import MapPlan
from musatpy.refraction.apparent import Fault
from musatpy.refraction.bending import WaveRay, refracted_ray
from musatpy.sea.stereo.surface_points import FittedSurface

_MAX_STEPS = 20
_MET = 1e-10  # m: how near refracted rays pass each other that meet
_WIDEST = 20.0  # m: no parallax in air is that of waves
_STEP = 1e-4  # m, or of a slope: of differences whose third order is far below what is printed


@dataclass(frozen=True, kw_only=True, eq=False)
class PairPoints:
    """True points (n, 3) m with their covariance (n, 3, 3) m2, and the part of it that is the surface's.

    by_shape (n, 3, 6): partials by height and slopes of the surface where the left ray meets it, and where the
    right one does; meeting (n, 2, 3): these places; parallax (n,) m in air, by the waves; met (n,): whether the
    refracted rays were made to meet.
    """

    position: FloatArray
    covariance: FloatArray
    surface_covariance: FloatArray
    by_shape: FloatArray
    parallax: FloatArray
    meeting: FloatArray
    met: BoolArray

    @property
    def sigma(self) -> FloatArray:
        """(n, 3) m."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def intersection(origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the points (n, 3) nearest to two rays each (n, 2, 3), and by what these miss each other (n,)."""
    r = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    normal = cross(r[:, 0], r[:, 1])
    parallax = np.sum((origin[:, 1] - origin[:, 0]) * normal, axis=1) / np.linalg.norm(normal, axis=1)
    return nearest_point(origin, r), parallax


def true_points_of_apparent(
    fitted: FittedSurface, cameras: FloatArray, apparent: FloatArray, covariance: FloatArray, index: float
) -> PairPoints:
    """Return the true points of apparent points (n, 3) with covariance (n, 3, 3), intersected in air from a pair.

    cameras (2, 3), or (n, 2, 3) in the axes of each point, and points about the origin of the surface. Raises
    `ValueError` for a ray that does not go down to the water.
    """
    v = np.zeros(len(apparent))
    for _ in range(_MAX_STEPS):
        bent = refracted_ray(fitted.surface, cameras, _rays_through(cameras, apparent, v), index)
        X, parallax = intersection(bent.origin, bent.direction)
        met = np.abs(parallax) <= _MET
        ahead, back = (_rays_through(cameras, apparent, v + step) for step in (_STEP, -_STEP))
        turn = (ahead - back) / (2.0 * _STEP)
        X_v, parallax_v = _moved(bent, *_turned(bent, turn))
        if met.all():
            break
        v = np.clip(v - parallax / parallax_v, -_WIDEST, _WIDEST)
    # v follows from the meeting of the refracted rays: what changes the parallax under water changes v
    by = []
    for axis in np.eye(3):
        ahead, back = (_rays_through(cameras, apparent + step * axis, v) for step in (_STEP, -_STEP))
        by.append(_moved(bent, *_turned(bent, (ahead - back) / (2.0 * _STEP))))
    shapes = zip(_shape_columns(bent, "origin"), _shape_columns(bent, "direction"), strict=True)
    by += [_moved(bent, origin, direction) for origin, direction in shapes]
    partials = np.stack([X_k - X_v * (parallax_k / parallax_v)[:, None] for X_k, parallax_k in by], axis=-1)
    by_apparent, by_shape = partials[..., :3], partials[..., 3:]
    shape = fitted.shape_covariance(bent.origin[..., :2])
    surface = by_shape @ shape @ np.swapaxes(by_shape, 1, 2)
    return PairPoints(
        position=X,
        covariance=by_apparent @ covariance @ np.swapaxes(by_apparent, 1, 2) + surface,
        surface_covariance=surface,
        by_shape=by_shape,
        parallax=v,
        meeting=bent.origin,
        met=met,
    )


def _turned(bent: WaveRay, turn: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how origins and directions under water (n, 2, 3) change as image rays turn (n, 2, 3)."""
    origin, direction = bent.origin_by_direction, bent.direction_by_direction
    return (origin @ turn[..., None])[..., 0], (direction @ turn[..., None])[..., 0]


def _moved(bent: WaveRay, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how points (n, 3) and parallaxes (n,) under water change with origins and directions (n, 2, 3)."""
    (X, parallax), (X_back, parallax_back) = (
        intersection(bent.origin + step * origin, bent.direction + step * direction) for step in (_STEP, -_STEP)
    )
    return (X - X_back) / (2.0 * _STEP), (parallax - parallax_back) / (2.0 * _STEP)


def _shape_columns(bent: WaveRay, what: str) -> Iterator[FloatArray]:
    """Yield changes (n, 2, 3) of rays by height and slopes where the left one meets the water, then the right."""
    by_slope = getattr(bent, f"{what}_by_slope")
    columns = getattr(bent, f"{what}_by_level"), by_slope[..., 0], by_slope[..., 1]
    for photo in np.eye(2):
        for column in columns:
            yield column * photo[:, None]


def _rays_through(cameras: FloatArray, A: FloatArray, v: FloatArray) -> FloatArray:
    """Return the unit rays (n, 2, 3) past apparent points A (n, 3) by half the parallax v (n,) each way.

    Both pass A along the unit vector e across both: e.g = 0 and e.d = v, g from the middle of the base d to A.
    Thus e = v s / s.s + c e0, where s is d across g, and e0 lies across g and d.
    """
    g, d, v = A - cameras.mean(axis=-2), cameras[..., 1, :] - cameras[..., 0, :], v[:, None]
    s = d - g * (np.sum(g * d, axis=1) / np.sum(g * g, axis=1))[:, None]
    S = np.sum(s * s, axis=1)[:, None]
    m = cross(np.broadcast_to(d, g.shape), g)
    with np.errstate(invalid="ignore"):  # a parallax longer than its base has no ray: NaN, whose reason is told
        c = np.sqrt(1.0 - v * v / S)
    e = v * s / S + c * m / np.linalg.norm(m, axis=1)[:, None]
    w = A[:, None] - cameras + (np.array([-0.5, 0.5]) * v)[..., None] * e[:, None]
    return w / np.linalg.norm(w, axis=-1, keepdims=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenThroughWaves:
    """True points (n, 3) m and their sigmas (n, 3) m, NaN where there is a fault (n,).

    surface_sigma (n,) m: the part of the surface in the sigma of the height; parallax (n,) m in air, by the waves.
    """

    position: FloatArray
    sigma: FloatArray
    surface_sigma: FloatArray
    parallax: FloatArray
    fault: NDArray[np.int8]


def correct(
    fitted: FittedSurface,
    cameras: FloatArray,
    apparent: FloatArray,
    covariance: FloatArray,
    index: float,
    plan: MapPlan | None = None,
) -> SeenThroughWaves:
    """Return the true points of apparent ones (n, 3), intersected in air from the cameras (2, 3) of a pair.

    All in the axes of the job, with their covariance (n, 3, 3); with a `plan` points on its map, each of which is
    corrected in its own vertical, and cameras geocentric. Raises `ValueError` where a camera is not above the
    water, or both are at one place.
    """
    shift, n = np.append(fitted.origin, 0.0), len(apparent)
    if plan is not None:
        cameras = plan.about_points(cameras, apparent)
    C, A = cameras - shift, apparent - shift
    if not (C[..., 2] > fitted.surface.limits.highest).all():
        raise ValueError("a camera is not above the water")
    if not (C[..., 0, :] != C[..., 1, :]).any():
        raise ValueError("both cameras are at one place")
    fault = np.zeros(n, dtype=np.int8)
    fault[A[:, 2] >= fitted.surface.relief(A[:, :2]).height] = Fault.ABOVE_WATER
    fault[A[:, 2] >= C[..., 2].min(axis=-1)] = Fault.CAMERA_BELOW
    position, sigma = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    surface_sigma, parallax = np.full(n, np.nan), np.full(n, np.nan)

    def true_points(rows: IntArray) -> PairPoints:
        pair = C if C.ndim == 2 else C[rows]
        return true_points_of_apparent(fitted, pair, A[rows], covariance[rows], index)

    for wet, true in in_parts(true_points, np.flatnonzero(fault == Fault.NONE), ValueError):
        if true is None:
            fault[wet] = Fault.NO_MEETING
            continue
        covered = fitted.covers(true.meeting[..., :2]).all(axis=1)
        met = np.where(true.met, Fault.NONE, Fault.NO_MEETING)
        fault[wet] = np.where(covered, met, Fault.UNKNOWN_WATER)
        good = fault[wet] == Fault.NONE
        rows = wet[good]
        position[rows] = true.position[good] + shift
        sigma[rows] = true.sigma[good]
        surface_sigma[rows] = np.sqrt(true.surface_covariance[good, 2, 2])
        parallax[rows] = true.parallax[good]
    if plan is not None:
        good = fault == Fault.NONE
        position[good] = plan.settled(position[good], apparent[good])
    return SeenThroughWaves(
        position=position, sigma=sigma, surface_sigma=surface_sigma, parallax=parallax, fault=fault
    )
