"""Weights that gross errors do not draw: Cauchy's, with a scale from the median."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray

_CAUCHY = 2.4  # robust scales at which an error counts for half
TO_SIGMA = 1.4826  # of the median absolute deviation


def spread(size: FloatArray, floor: float) -> float:
    """Return the robust standard deviation of errors of some sizes, `floor` at least."""
    return max(floor, TO_SIGMA * float(np.median(size))) if size.size else floor


def cauchy(error: FloatArray, scale: FloatArray | float, weight: FloatArray | float = 1.0) -> FloatArray:
    """Return weights with Cauchy's factor for errors of a robust scale."""
    return weight / (1.0 + np.square(error / (_CAUCHY * scale)))


def cauchy_cost(error: FloatArray, scale: FloatArray | float) -> FloatArray:
    """Return what errors of a robust scale cost: the sums of these are least where Cauchy's weights lead."""
    return np.log1p(np.square(error / (_CAUCHY * scale)))
