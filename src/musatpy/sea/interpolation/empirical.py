"""Empirical covariances: the mean product of residuals of pairs of points, by classes of their distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.sea.interpolation.prediction import Observed, Trend


@dataclass(frozen=True, kw_only=True, eq=False)
class Empirical:
    """Classes of distance: mean distance (k,) m, pairs (k,), covariance (k,) m2; the first is that of points alone.

    The first class, at distance 0, is the variance, noise included.
    """

    distance: FloatArray
    pairs: IntArray
    covariance: FloatArray


def residuals(observed: Observed, trend: Trend) -> FloatArray:
    """Return the values (n,) less their trend by plain least squares."""
    rows = observed.trend_rows(trend)
    return observed.value - rows @ np.linalg.lstsq(rows, observed.value, rcond=None)[0]


def empirical(place: FloatArray, residual: FloatArray, *, width: float, classes: int) -> Empirical:
    """Return the covariances of residuals (n,) at places (n, 2), classes `width` m wide; empty ones left out."""
    pairs = np.zeros(classes, dtype=np.int64)
    products, distances = np.zeros(classes), np.zeros(classes)
    for row in range(len(place) - 1):  # a row of pairs at a time: all of them would fill the memory
        lag = place[row + 1 :] - place[row]
        distance = np.hypot(lag[:, 0], lag[:, 1])
        near = distance < width * classes
        index = (distance[near] / width).astype(int)
        pairs += np.bincount(index, minlength=classes)
        distances += np.bincount(index, distance[near], minlength=classes)
        products += np.bincount(index, residual[row] * residual[row + 1 :][near], minlength=classes)
    full = pairs > 0
    return Empirical(
        distance=np.concatenate([[0.0], distances[full] / pairs[full]]),
        pairs=np.concatenate([[len(place)], pairs[full]]),
        covariance=np.concatenate([[np.mean(np.square(residual))], products[full] / pairs[full]]),
    )


def spacing(place: FloatArray) -> float:
    """Return the median distance (m) from a place to the nearest other one; 0 where all are one.

    Points that share a place, measured twice, count once.
    """
    from scipy.spatial import cKDTree  # a plain run does without

    single = np.unique(place, axis=0)
    if len(single) < 2:
        return 0.0
    distance, _ = cKDTree(single).query(single, k=2)
    return float(np.median(np.asarray(distance)[:, 1]))


def extent(place: FloatArray) -> float:
    """Return the diagonal (m) of the rectangle that the points fill."""
    return float(np.hypot(*np.ptp(place, axis=0)))
