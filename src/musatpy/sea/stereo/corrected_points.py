"""Apparent points of a pair corrected through its surface, each with its sigmas or the reason why it is not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry.crs import Plan
from musatpy.refraction.surface import Limits, Relief, Surface
from musatpy.sea.stereo.fitted import FittedSurface
from musatpy.sea.stereo.surface_points import SurfacePoints
from musatpy.sea.stereo.through import TruePoint, true_points_of_apparent


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
