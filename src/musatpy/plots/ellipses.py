"""Ellipses of confidence of plane positions, arrows and scale bars: what is drawn larger than it is."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray

CONFIDENCE = 0.95
_STEPS = (1.0, 2.0, 5.0, 10.0)


def ellipses(covariance: FloatArray, confidence: float = CONFIDENCE) -> tuple[FloatArray, FloatArray]:
    """Return semi-axes (n, 2) of covariances (n, 2, 2), the larger first, and its angle (n,) rad from x to y.

    The true place lies in the ellipse with the probability `confidence`: axes are the roots of the eigenvalues times
    the quantile of chi-square of two degrees of freedom, -2 ln(1 - confidence). NaN where there is no covariance.
    """
    known = np.isfinite(covariance).all(axis=(1, 2))
    axes, angle = np.full((len(covariance), 2), np.nan), np.full(len(covariance), np.nan)
    values, vectors = np.linalg.eigh(covariance[known])
    axes[known] = np.sqrt(-2.0 * np.log(1.0 - confidence) * np.maximum(values[:, ::-1], 0.0))
    angle[known] = np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])
    return axes, angle


def turned(vectors: FloatArray, angle: FloatArray) -> FloatArray:
    """Return vectors (n, 2) of east and north along axes that stand `angle` (n,) rad clockwise of these."""
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]])


def round_length(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that a positive length reaches."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(power * max(step for step in _STEPS if step * power <= length * (1.0 + 1e-9)))


def magnification(sizes: FloatArray, shown: float) -> float:
    """Return the round factor by which most sizes (n,) are drawn no larger than `shown`; 0 where there is none.

    Most are nine in ten: a few that are much larger are drawn so, and the others can be seen.
    """
    known = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    if not len(known):
        return 0.0
    return round_length(shown / float(np.percentile(known, 90.0)))
