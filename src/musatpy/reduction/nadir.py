"""Displacements of images to or from the nadir: what refraction and the earth's curvature have in common.

The image vector v = (x - xp, y - yp, -f) of a ray that makes the angle q with the vertical is bent in the plane
of the two. With n the unit vector to the nadir, t = n . v and tan^2(q) = v^2/t^2 - 1,

    v' = v + n t (b + c tan^2(q)),        x' = xp - f v'_1 / v'_3

Looking straight down, n = (0, 0, -1), this is x' - xp = (x - xp) / (1 + b + c r^2/f^2).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.reduction.inversion import TOLERANCE

_TURNS = 60
DOWN = np.array([0.0, 0.0, -1.0])  # the nadir of a vertical photo, in its own system
DOWN.flags.writeable = False
_ONE = np.eye(3)


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """How a photo looks at the ground."""

    focal_length: float  # mm
    principal_point: FloatArray  # (2,) mm, of autocollimation
    nadir: FloatArray  # (3,), unit vector to it in the photo's system: M (0, 0, -1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Displacement(ABC):
    """What moves the images of a photo to or from the nadir, by two coefficients."""

    view: View

    @property
    @abstractmethod
    def coefficients(self) -> tuple[float, float]:
        """b and c."""

    def apply(self, xy: FloatArray) -> FloatArray:
        """Return the displaced images (..., 2) mm of images xy (..., 2)."""
        bent = self._bent(*self._vector(xy))
        return self.view.principal_point - self.view.focal_length * bent[..., :2] / bent[..., 2:]

    def inverse(self, xy: FloatArray) -> FloatArray:
        """Return the images (..., 2) of displaced ones, NaN where there is none.

        With w = (x' - xp, y' - yp, -f) the image vector is v = l w - n s, l = 1 - n_3 s / f, and of s, which is
        small, s = t (b + c tan^2(q)): what it is off by shrinks at each turn by about its share in f.
        """
        b, c = self.coefficients
        n, f = self.view.nadir, self.view.focal_length
        w, along, square = self._vector(xy)
        down = n[..., 2:] / f
        s = np.zeros_like(along)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for _ in range(_TURNS):
                scale = 1.0 - down * s
                t, squared = scale * along - s, scale * (scale * square - 2.0 * s * along) + s * s
                new = b * t + c * (squared / t - t)
                change, s = abs(new - s), new
                if not (change > TOLERANCE).any():
                    break
            v = (1.0 - down * s) * w - n * s
        return np.where(change <= TOLERANCE, self.view.principal_point + v[..., :2], np.nan)

    def partials(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (..., 2, 2) of the displaced images by the images xy."""
        b, c = self.coefficients
        v, t, square = self._vector(xy)
        n = self.view.nadir
        by_v = (b - c) * n + c * (2.0 * v / t - square * n / t**2)
        by_v = (_ONE + n[..., :, None] * by_v[..., None, :])[..., :2]
        bent = self._bent(v, t, square)
        third = bent[..., 2, None, None]
        ratio = bent[..., :2, None] / third
        return -self.view.focal_length / third * (by_v[..., :2, :] - ratio * by_v[..., 2:, :])

    def _vector(self, xy: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return v (..., 3), and t and v^2 (..., 1)."""
        v = np.empty((*xy.shape[:-1], 3), dtype=xy.dtype)
        v[..., :2], v[..., 2] = xy - self.view.principal_point, -self.view.focal_length
        return v, _product(v, self.view.nadir), _product(v, v)

    def _bent(self, v: FloatArray, t: FloatArray, square: FloatArray) -> FloatArray:
        b, c = self.coefficients
        return v + self.view.nadir * (b * t + c * (square / t - t))


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the products (..., 1) of vectors (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", a, b)[..., None])
