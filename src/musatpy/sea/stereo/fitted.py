"""What an estimated water surface gives, of whatever model: the surface, and the covariance of its shape."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.refraction.surface import Surface


class FittedSurface(Protocol):
    """An estimated surface, in axes of the job moved to `origin` (2,) m; it stands still, at one time."""

    @property
    def origin(self) -> FloatArray:
        """(2,) m of the job."""
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
