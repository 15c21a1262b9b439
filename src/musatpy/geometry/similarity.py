"""Spatial similarity in closed form, y = scale R x + shift; weights by which gross errors do not draw it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.collinearity import skew, turn

_SAMPLES = 300  # of three points: one in 1e9 finds no clean one among 40 % of gross errors
_STEPS = 10
_CAUCHY = 2.4  # robust scales at which an error counts for half
TO_SIGMA = 1.4826  # of the median absolute deviation


@dataclass(frozen=True, kw_only=True)
class Similarity:
    """y = scale R x + shift."""

    scale: float
    rotation: FloatArray  # (3, 3)
    shift: FloatArray  # (3,)

    def apply(self, x: FloatArray) -> FloatArray:
        """Return the images (..., 3) of points x (..., 3)."""
        return self.scale * (x @ self.rotation.T) + self.shift

    def turn(self, M: FloatArray) -> FloatArray:
        """Return the rotations (..., 3, 3) from the new axes of those M (..., 3, 3) from the old ones."""
        return M @ self.rotation.T

    def inverse(self) -> Similarity:
        """Return the similarity that undoes this one."""
        scale, rotation = 1.0 / self.scale, self.rotation.T
        return Similarity(scale=scale, rotation=rotation, shift=-scale * rotation @ self.shift)

    def after(self, first: Similarity) -> Similarity:
        """Return the similarity that applies `first` and then this one."""
        return Similarity(
            scale=self.scale * first.scale, rotation=self.rotation @ first.rotation, shift=self.apply(first.shift)
        )


def small(change: FloatArray) -> Similarity:
    """Return the similarity of a small change (7,): of the scale's logarithm, a turn (rad) and a shift."""
    return Similarity(scale=float(np.exp(change[0])), rotation=turn(change[1:4]), shift=change[4:])


def by_change(x: FloatArray) -> FloatArray:
    """Return the partials (..., 3, 7) of places x (..., 3) by such a change."""
    shift = np.broadcast_to(np.eye(3), (*x.shape, 3))
    return np.concatenate([x[..., None], -skew(x), shift], axis=-1)


def fit(x: FloatArray, y: FloatArray, weight: FloatArray) -> Similarity:
    """Return the similarity with the least weighted sum of squares of y - (scale R x + shift).

    x, y: (k, 3), weight (k,). Umeyama, IEEE PAMI 13 (1991) 376, eqs. 40-43. Points on a line leave the turn about
    it free: whichever comes out.
    """
    scale, rotation, shift = _umeyama(x[None], y[None], weight[None])
    return Similarity(scale=float(scale[0]), rotation=rotation[0], shift=shift[0])


def fit_robust(
    x: FloatArray, y: FloatArray, weight: FloatArray, floor: float, starts: Sequence[Similarity] = ()
) -> tuple[Similarity, FloatArray]:
    """Return a similarity that gross errors of up to 40 % of k points do not draw, and the robust weights (k,).

    The start is the one of `starts`, or of samples of three points in a fixed random sequence, that fits the
    better half of the points best; least squares with Cauchy's weights follow. `floor` (units of y) is the least
    error that counts as one.
    """
    count, candidates = len(x), [fit(x, y, weight), *starts]
    scale, rotation, shift = (
        np.stack([getattr(each, name) for each in candidates]) for name in ("scale", "rotation", "shift")
    )
    if count > 3:
        rng = np.random.default_rng(count)
        sample = np.argsort(rng.random((_SAMPLES, count)), axis=1)[:, :3]
        pairs = zip((scale, rotation, shift), _umeyama(x[sample], y[sample], weight[sample]), strict=True)
        scale, rotation, shift = (np.concatenate(pair) for pair in pairs)
    placed = scale[:, None, None] * (x[None] @ np.swapaxes(rotation, 1, 2)) + shift[:, None]
    error = np.sort(np.linalg.norm(y - placed, axis=2) * np.sqrt(weight), axis=1)
    half = error[:, min((count + 3) // 2, count - 1)]  # the error of a sample's own three points says nothing
    best = int(np.where(np.isfinite(half), half, np.inf).argmin())
    start = Similarity(scale=float(scale[best]), rotation=rotation[best], shift=shift[best])
    robust = np.ones(count)
    for _ in range(_STEPS):
        error = np.linalg.norm(y - start.apply(x), axis=1) * np.sqrt(weight)
        robust = cauchy(error, spread(error, floor))
        start = fit(x, y, weight * robust)
    return start, robust


def _umeyama(x: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return scale (s,), rotation (s, 3, 3) and shift (s, 3) of s problems of k points, x, y: (s, k, 3)."""
    share = (weight / weight.sum(axis=1, keepdims=True))[..., None]
    mean_x, mean_y = (share * x).sum(axis=1), (share * y).sum(axis=1)
    dx, dy = x - mean_x[:, None], y - mean_y[:, None]
    U, D, Vt = np.linalg.svd(np.swapaxes(share * dy, 1, 2) @ dx)
    sign = np.ones_like(D)
    sign[:, 2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    rotation = (U * sign[:, None, :]) @ Vt
    spread = (share * np.square(dx)).sum(axis=(1, 2))
    scale = (D * sign).sum(axis=1) / np.maximum(spread, np.finfo(float).tiny)
    return scale, rotation, mean_y - scale[:, None] * np.einsum("sij,sj->si", rotation, mean_x)


def spread(size: FloatArray, floor: float) -> float:
    """Return the robust standard deviation of errors of some sizes, `floor` at least."""
    return max(floor, TO_SIGMA * float(np.median(size))) if size.size else floor


def cauchy(error: FloatArray, scale: FloatArray | float, weight: FloatArray | float = 1.0) -> FloatArray:
    """Return weights with Cauchy's factor for errors of a robust scale."""
    return weight / (1.0 + np.square(error / (_CAUCHY * scale)))


def cauchy_cost(error: FloatArray, scale: FloatArray | float) -> FloatArray:
    """Return what errors of a robust scale cost: the sums of these are least where Cauchy's weights lead."""
    return np.log1p(np.square(error / (_CAUCHY * scale)))
