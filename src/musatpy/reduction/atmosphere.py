"""Atmospheric refraction of aerial photographs by a standard atmosphere.

At the camera a ray is steeper from the vertical by K tan(angle) than the straight line to its ground point, so
that a vertical photo shows the point too far out by dr = K (r + r^3/f^2). K, in radians, of a camera at H and
ground at h above sea level:

    ARDC      K = 2410e-6 (H / (H^2 - 6 H + 250) - h^2 / (H (h^2 - 6 h + 250))), H and h in km: the closed
              formula of the textbooks for the ARDC model atmosphere, usually credited to Bertram 1966
    US1976    K = (1/(H - h)) integral from h to H of n(z) dz - n(H) in the U.S. Standard Atmosphere 1976, with
              n - 1 = 2.26e-4 rho (kg/m^3). In hydrostatic balance the integral of rho is the difference of
              pressures over g, so K = 2.26e-4 ((p(h) - p(H)) / (g (H - h)) - rho(H))

Both take the layers for flat, which holds to 60 degrees from the vertical and further than any mapping lens sees.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from enum import StrEnum

from musatpy.arrays import FloatArray
from musatpy.reduction import nadir
from musatpy.reduction.inversion import invert
from musatpy.reduction.nadir import View

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


def constant_partials(model: Model, camera: float, ground: float) -> tuple[float, float]:
    """Return the derivatives of K by the heights of camera and ground, rad/m."""
    if model is Model.ARDC:
        H, h = 1e-3 * camera, 1e-3 * ground
        a, b = H * H - 6 * H + 250, h * h - 6 * h + 250
        by_H = (250 - H * H) / (a * a) + h * h / (H * H * b)
        by_h = -(2 * h * b - h * h * (2 * h - 6)) / (H * b * b)
        return 2410e-9 * by_H, 2410e-9 * by_h
    p, density_h = air(ground)
    p_H, density = air(camera)
    depth = camera - ground
    mean = (p - p_H) / (_GRAVITY * depth)
    by_H = (density - mean) / depth - _density_slope(camera)
    return _GLADSTONE_DALE * by_H, _GLADSTONE_DALE * (mean - density_h) / depth


def air(height: float) -> tuple[float, float]:
    """Return pressure (Pa) and density (kg/m^3) of the U.S. Standard Atmosphere 1976 at a height (m), below 47 km.

    The height is taken for the geopotential one: at 10 km they differ by 16 m.
    """
    _, T, p = _layer(height)
    return p, p / (_GAS * T)


def _layer(height: float) -> tuple[float, float, float]:
    """Return lapse (K/m), temperature (K) and pressure (Pa) at a height."""
    T, p = _SEA_LEVEL
    for (base, lapse), (top, _) in itertools.pairwise(_LAYERS):
        climb = min(height, top) - base
        warm = T + lapse * climb
        p *= (warm / T) ** (-_GRAVITY / (_GAS * lapse)) if lapse else math.exp(-_GRAVITY * climb / (_GAS * T))
        T = warm
        if height <= top:
            break
    return lapse, T, p


def _density_slope(height: float) -> float:
    """Return d rho/dz: rho = p/(R T), dp/dz = -g rho, dT/dz = lapse."""
    lapse, T, p = _layer(height)
    return -p / (_GAS * T * T) * (_GRAVITY / _GAS + lapse)


@dataclass(frozen=True, kw_only=True, eq=False)
class Refraction:
    """The refraction of one photo."""

    view: View
    K: float  # rad

    def apply(self, xy: FloatArray) -> FloatArray:
        """Return images (..., 2) mm freed from refraction: moved towards the nadir."""
        return nadir.bend(self.view, xy, self._b, self._b)

    def inverse(self, xy: FloatArray) -> FloatArray:
        """Return the refracted images (..., 2) of straight ones."""
        return invert(self.apply, self.partials, xy)

    def partials(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (..., 2, 2) of the straight images by the refracted ones xy."""
        return nadir.bend_partials(self.view, xy, self._b, self._b)

    def by_parameters(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (..., 2, 1) of the straight images by K, mm/rad."""
        by_bc = nadir.bend_by_parameters(self.view, xy, self._b, self._b)
        return by_bc.sum(axis=-1, keepdims=True) / (1.0 - self.K) ** 2

    @property
    def _b(self) -> float:
        """Turned by K tan(q) towards n, v becomes (1 - K) v + K n v^2/t; over 1 - K that is b = c = K/(1 - K)."""
        return self.K / (1.0 - self.K)
