"""Snell's law at one surface: angle in air I, angle in water theta, n = index of water relative to air."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray


def water_tangent_ratio(tangent: ArrayLike, index: ArrayLike) -> FloatArray:
    """Return tan(theta)/tan(I) for given tan(I): 1/sqrt(n^2 + (n^2 - 1) tan^2 I), 1/n at the nadir.

    sin(I) = n sin(theta), ETL-0306 section 2. Its inverse is the depth factor of one ray.
    """
    n2 = np.square(index)
    return 1.0 / np.sqrt(n2 + (n2 - 1.0) * np.square(tangent))
