"""Surface points that do not fit: data snooping of heights above an estimated surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.similarity import spread
from musatpy.sea.stereo.fitted import FittedSurface, height_sigma
from musatpy.sea.stereo.surface_points import SurfacePoints

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
class Snooped:
    """Which points (n,) are kept; of the others the residual (n,) m, and over its sigma (n,), when they went."""

    kept: BoolArray
    residual: FloatArray
    ratio: FloatArray

    @classmethod
    def everyone(cls, count: int) -> Snooped:
        """Return that all points are kept."""
        return cls(kept=np.ones(count, dtype=bool), residual=np.zeros(count), ratio=np.zeros(count))

    def without(self, bad: BoolArray, residual: FloatArray, ratio: FloatArray) -> Snooped:
        """Return the points without some more."""
        return Snooped(
            kept=self.kept & ~bad,
            residual=np.where(bad, residual, self.residual),
            ratio=np.where(bad, ratio, self.ratio),
        )


Fit = Callable[[BoolArray], FittedSurface]


def snoop(points: SurfacePoints, fit: Fit, judged: Snooped, critical: float = CRITICAL) -> Snooped:
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


def _rejecting(points: SurfacePoints, fit: Fit, judged: Snooped, critical: float) -> Snooped:
    for _ in range(_ROUNDS):
        misfit = misfits(points, fit(judged.kept), judged.kept)
        ratio = np.abs(misfit.standardised) / scale_of(misfit, judged.kept)
        bad = judged.kept & (ratio > critical)
        if not bad.any():
            break
        judged = judged.without(bad & (ratio >= _TOGETHER * ratio[bad].max()), misfit.residual, ratio)
    return judged
