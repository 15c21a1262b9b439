"""Displacements of images to or from the nadir: what refraction and the earth's curvature have in common.

The image vector v = (x - xp, y - yp, -f) of a ray that makes the angle q with the vertical is bent in the plane
of the two. With n the unit vector to the nadir, t = n . v and tan^2(q) = v^2/t^2 - 1,

    v' = v + n t (b + c tan^2(q)),        x' = xp - f v'_1 / v'_3

Looking straight down, n = (0, 0, -1), this is x' - xp = (x - xp) / (1 + b + c r^2/f^2).

Atmospheric refraction of aerial photographs by a standard atmosphere.

At the camera a ray is steeper from the vertical by K tan(angle) than the straight line to its ground point, so
that a vertical photo shows the point too far out by dr = K (r + r^3/f^2). K, in radians, of a camera at H and
ground at h above sea level:

    ARDC      K = 2410e-6 (H / (H^2 - 6 H + 250) - h^2 / (H (h^2 - 6 h + 250))), H and h in km: the closed
              formula of the textbooks for the ARDC model atmosphere, usually credited to Bertram 1966
    US1976    K = (1/(H - h)) integral from h to H of n(z) dz - n(H) in the U.S. Standard Atmosphere 1976, with
              n - 1 = 2.26e-4 rho (kg/m^3). In hydrostatic balance the integral of rho is the difference of
              pressures over g, so K = 2.26e-4 ((p(h) - p(H)) / (g (H - h)) - rho(H))

Both take the layers for flat, which holds to 60 degrees from the vertical and further than any mapping lens sees.

Earth curvature, for jobs whose plane coordinates are those of a grid and whose heights count from the curved
earth.

A point at the distance s from the nadir lies s^2/(2 R) below the tangent plane, so that its image falls short of
where a flat ground would put it by dr = H' r^3 / (2 R f^2) on a vertical photo, H' the height above the ground
and R the radius of the earth. Geographic and geocentric jobs have the true shape of the ground, and must not be
corrected.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from musatpy.arrays import FloatArray

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


_GLADSTONE_DALE = 2.26e-4  # m^3/kg, visible light
_GRAVITY = 9.80665  # m/s^2
_GAS = 287.05287  # J/(kg K), dry air
# U.S. Standard Atmosphere 1976: base of each layer (geopotential m), lapse (K/m) above it
_LAYERS = ((0.0, -0.0065), (11000.0, 0.0), (20000.0, 0.001), (32000.0, 0.0028), (47000.0, 0.0))
_SEA_LEVEL = (288.15, 101325.0)  # K, Pa
CEILING = {"ARDC": 30000.0, "US1976": 47000.0}  # m: where they agree, and where the layers end
FLOOR = -500.0  # m


class Model(StrEnum):
    """Which standard atmosphere."""

    ARDC = "ARDC"
    US1976 = "US1976"


def constant(model: Model, camera: float, ground: float) -> float:
    """Return K (rad) of a camera and ground at heights above sea level (m).

    Raises `ValueError` where the camera is not above the ground, or a height is outside the model.
    """
    if not FLOOR <= ground < camera <= CEILING[model]:
        raise ValueError(
            f"refraction by {model} needs {FLOOR:.0f} m <= ground < camera <= {CEILING[model]:.0f} m, "
            f"not {ground:.1f} and {camera:.1f}"
        )
    if model is Model.ARDC:
        H, h = 1e-3 * camera, 1e-3 * ground
        return 2410e-6 * (H / (H * H - 6 * H + 250) - h * h / (H * (h * h - 6 * h + 250)))
    p, _ = air(ground)
    p_camera, density = air(camera)
    return _GLADSTONE_DALE * ((p - p_camera) / (_GRAVITY * (camera - ground)) - density)


def air(height: float) -> tuple[float, float]:
    """Return pressure (Pa) and density (kg/m^3) of the U.S. Standard Atmosphere 1976 at a height (m), below 47 km.

    The height is taken for the geopotential one: at 10 km they differ by 16 m.
    """
    T, p = _SEA_LEVEL
    for (base, lapse), (top, _) in itertools.pairwise(_LAYERS):
        climb = min(height, top) - base
        warm = T + lapse * climb
        p *= (warm / T) ** (-_GRAVITY / (_GAS * lapse)) if lapse else math.exp(-_GRAVITY * climb / (_GAS * T))
        T = warm
        if height <= top:
            break
    return p, p / (_GAS * T)


@dataclass(frozen=True, kw_only=True, eq=False)
class Refraction(Displacement):
    """The refraction of one photo: its images are moved towards the nadir."""

    K: float  # rad

    @property
    def coefficients(self) -> tuple[float, float]:
        """Turned by K tan(q) towards n, v becomes (1 - K) v + K n v^2/t; over 1 - K that is b = c = K/(1 - K)."""
        b = self.K / (1.0 - self.K)
        return b, b


EARTH_RADIUS = 6371000.0  # m, mean radius


@dataclass(frozen=True, kw_only=True, eq=False)
class Curvature(Displacement):
    """The curvature that one photo sees: its images are moved away from the nadir, as of flat ground."""

    height: float  # m, of the camera above the ground
    radius: float = EARTH_RADIUS  # m

    @property
    def coefficients(self) -> tuple[float, float]:
        """The drop over the height, H' tan^2(q)/(2 R), shortens the vertical part of the vector."""
        return 0.0, -self.height / (2.0 * self.radius)
