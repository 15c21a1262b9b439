"""Points on the water of a simultaneous pair, what a surface through them gives, and those that do not fit it.

Okamoto (1982), Discussion, method (1). Rectangular axes, Z up, metres.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.similarity import spread
from musatpy.refraction.surface import Surface


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePoints:
    """n points: ids, position (n, 3) m, covariance (n, 3, 3) m2. Raises `ValueError` where they do not fit."""

    ids: tuple[str, ...]
    position: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        n = len(self.ids)
        if self.position.shape != (n, 3) or self.covariance.shape != (n, 3, 3):
            raise ValueError("surface points have one id, position and covariance each")
        if not (np.isfinite(self.position).all() and np.isfinite(self.covariance).all()):
            raise ValueError("a surface point is not finite")
        if n and not (np.linalg.eigvalsh(self.covariance)[:, 0] > 0.0).all():
            raise ValueError("the covariance of a surface point is not positive")

    def some(self, kept: BoolArray) -> SurfacePoints:
        """Return the points of a mask (n,)."""
        ids = tuple(name for name, keep in zip(self.ids, kept.tolist(), strict=True) if keep)
        return SurfacePoints(ids=ids, position=self.position[kept], covariance=self.covariance[kept])

    def height_variance(self, gradient: FloatArray) -> FloatArray:
        """Return (n,) m2 the variances of heights above a surface of gradients (n, 2): its slope tells on them."""
        normal = np.column_stack([-gradient, np.ones(len(gradient))])
        return np.einsum("ni,nij,nj->n", normal, self.covariance, normal)


def intersection_covariance(cameras: FloatArray, points: FloatArray, sigma: float) -> FloatArray:
    """Return the covariance (n, 3, 3) m2 of points (n, 3) intersected in air from cameras (k, 3).

    sigma (rad): of an image across its ray, both ways: that of a plate coordinate over the focal length, for rays
    near the camera axis. Each ray fixes the point across itself with the weight 1 / (sigma distance)^2.
    """
    gap = points[:, None, :] - cameras
    distance = np.linalg.norm(gap, axis=-1)
    u = gap / distance[..., None]
    across = np.eye(3) - u[..., :, None] * u[..., None, :]
    normal = np.sum(across / np.square(sigma * distance)[..., None, None], axis=1)
    return np.linalg.inv(normal)


class FittedSurface(Protocol):
    """An estimated surface, in axes of the job moved to `origin` (2,) m; it stands still, at one time."""

    @property
    def origin(self) -> FloatArray:
        """(2,) m of the job."""
        ...

    @property
    def level(self) -> float:
        """Mean height, m."""
        ...

    @property
    def surface(self) -> Surface:
        """The surface, about the origin."""
        ...

    def covers(self, xy: FloatArray) -> BoolArray:
        """Tell at which places (..., 2) m about the origin its points say what it is like."""
        ...

    def shape_covariance(self, xy: FloatArray) -> FloatArray:
        """Return (n, 3k, 3k) the joint covariance at k places each, xy (n, k, 2) m about the origin.

        Of every place: height (m), and gradient along x and y.
        """
        ...


def height_sigma(fitted: FittedSurface, xy: FloatArray) -> FloatArray:
    """Return the sigma (...) m of the height at places (..., 2) m about the origin."""
    covariance = fitted.shape_covariance(xy.reshape(-1, 1, 2))
    return np.sqrt(covariance[:, 0, 0]).reshape(xy.shape[:-1])


CRITICAL = 3.29  # of a standard normal deviate: a good point is rejected once in a thousand
_ROUNDS = 50
_TOGETHER = 0.8  # of the largest: rejected with it; the neighbours of a gross error stay, and are judged again
_LEAST_REDUNDANCY = 1e-6  # of a point that the surface follows wherever it lies: no residual can tell


@dataclass(frozen=True, kw_only=True, eq=False)
class Misfits:
    """Of n points above a surface: residual (n,) m, its sigma (n,) m, and redundancy (n,), 0 to 1.

    A point that is kept out of the surface has the residual of a check point, its sigma that of point and surface.
    """

    residual: FloatArray
    sigma: FloatArray
    redundancy: FloatArray

    @property
    def standardised(self) -> FloatArray:
        """(n,) residual over sigma."""
        return self.residual / self.sigma


def misfits(points: SurfacePoints, fitted: FittedSurface, kept: BoolArray) -> Misfits:
    """Return how the points stand above a surface that `kept` (n,) were used for."""
    xy = points.position[:, :2] - fitted.origin
    relief = fitted.surface.relief(xy)
    variance = points.height_variance(relief.gradient)
    known = np.square(height_sigma(fitted, xy))
    redundancy = np.where(kept, np.maximum(1.0 - known / variance, _LEAST_REDUNDANCY), 1.0)
    return Misfits(
        residual=points.position[:, 2] - relief.height,
        sigma=np.sqrt(np.where(kept, variance * redundancy, variance + known)),
        redundancy=redundancy,
    )


def scale_of(misfit: Misfits, kept: BoolArray) -> float:
    """Return how many times their sigmas residuals are, by the median; not less than one."""
    return spread(np.abs(misfit.standardised[kept]), 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class KeptPoints:
    """Which points (n,) are kept; of the others the residual (n,) m, and over its sigma (n,), when they went."""

    kept: BoolArray
    residual: FloatArray
    ratio: FloatArray

    @classmethod
    def everyone(cls, count: int) -> KeptPoints:
        """Return that all points are kept."""
        return cls(kept=np.ones(count, dtype=bool), residual=np.zeros(count), ratio=np.zeros(count))


Fit = Callable[[BoolArray], FittedSurface]


def snoop(points: SurfacePoints, fit: Fit, judged: KeptPoints, critical: float = CRITICAL) -> KeptPoints:
    """Return which points are kept of those that are: the worst one goes, the surface is estimated anew, and so on.

    Residuals are judged by their sigmas times `scale_of`, lest a model that is too simple for the sea throws out
    points for its own faults. In the end a point that fits the surface without it comes back, and is judged again.
    """
    judged = _rejecting(points, fit, judged, critical)
    if judged.kept.all():
        return judged
    misfit = misfits(points, fit(judged.kept), judged.kept)
    back = ~judged.kept & (np.abs(misfit.standardised) <= critical * scale_of(misfit, judged.kept))
    return _rejecting(points, fit, replace(judged, kept=judged.kept | back), critical) if back.any() else judged


def _rejecting(points: SurfacePoints, fit: Fit, judged: KeptPoints, critical: float) -> KeptPoints:
    for _ in range(_ROUNDS):
        misfit = misfits(points, fit(judged.kept), judged.kept)
        ratio = np.abs(misfit.standardised) / scale_of(misfit, judged.kept)
        bad = judged.kept & (ratio > critical)
        if not bad.any():
            break
        bad &= ratio >= _TOGETHER * ratio[bad].max()
        judged = KeptPoints(
            kept=judged.kept & ~bad,
            residual=np.where(bad, misfit.residual, judged.residual),
            ratio=np.where(bad, ratio, judged.ratio),
        )
    return judged
