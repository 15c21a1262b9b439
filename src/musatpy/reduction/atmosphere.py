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

from musatpy.reduction.nadir import Displacement

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
