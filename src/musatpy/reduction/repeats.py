"""Repeated readings of the same mark or point on a plate: their means, and a test of their spread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.probability import probability_beyond


@dataclass(frozen=True, kw_only=True, eq=False)
class Means:
    """The means of g targets read m times altogether, in the unit of the readings.

    The spread of a target is the standard deviation of one reading, coordinate by coordinate; pooled over all
    targets it has `freedom` = m - g degrees of freedom in each coordinate. `probability` is that of a chi-square
    variable to exceed the sum of the squared deviations over the stated sigma of one reading.
    """

    ids: TextArray  # (g,) in the order in which they were first read
    xy: FloatArray  # (g, 2)
    count: IntArray  # (g,)
    sigma: FloatArray  # (g, 2) of one reading; NaN where there is but one
    target: IntArray  # (m,) row of ids that each reading belongs to
    deviations: FloatArray  # (m, 2) reading minus mean
    pooled: FloatArray  # (2,) sigma of one reading, NaN where nothing was read twice
    freedom: int
    probability: FloatArray  # (2,) NaN without a stated sigma or without repeated readings
    beyond: BoolArray  # (m,) a deviation, x or y, is beyond the limit

    @property
    def largest(self) -> float:
        """Return the largest deviation of a coordinate from its mean; 0 without readings."""
        return float(np.abs(self.deviations).max(initial=0.0))


def mean_readings(
    ids: TextArray, xy: FloatArray, reading_sigma: float = float("nan"), limit: float = float("inf")
) -> Means:
    """Return the means of readings xy (m, 2) of the targets ids (m,).

    `reading_sigma` is the stated sigma of one reading, against which the spread is tested; `limit` the deviation
    beyond which a reading is reported. Nothing is left out: of two readings that differ neither is the wrong one.
    """
    names, first, target = np.unique(ids, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.argsort(order)
    target, names = rank[target.reshape(-1)], names[order]
    count = np.bincount(target, minlength=len(names))
    mean = _sums(target, xy, len(names)) / count[:, None]
    deviations = xy - mean[target]
    squares = _sums(target, np.square(deviations), len(names))
    freedom = len(xy) - len(names)
    return Means(
        ids=names,
        xy=mean,
        count=count,
        sigma=np.sqrt(squares / np.where(count > 1, count - 1.0, np.nan)[:, None]),
        target=target,
        deviations=deviations,
        pooled=np.sqrt(squares.sum(axis=0) / (freedom or np.nan)),
        freedom=freedom,
        probability=_probability(squares.sum(axis=0), reading_sigma, freedom),
        beyond=np.asarray((np.abs(deviations) > limit).any(axis=1)),
    )


def _sums(target: IntArray, values: FloatArray, size: int) -> FloatArray:
    total = np.zeros((size, 2))
    np.add.at(total, target, values)
    return total


def _probability(squares: FloatArray, sigma: float, freedom: int) -> FloatArray:
    if not freedom or not sigma > 0.0:
        return np.full(2, np.nan)
    return np.array([probability_beyond(float(total) / sigma**2, freedom) for total in squares])
