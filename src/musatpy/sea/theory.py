"""Linear (Airy) theory of waves in water of constant depth: from period and depth to length, speed and height.

A wave keeps its period while it runs into shallow water; length and speed follow the dispersion relation
w^2 = g k tanh kh, its height the flow of energy (shoaling; no refraction in plan, no friction). Tables 1 to 3 of
Okamoto (1982) are this theory with g = 9.8 m/s2. The formulas are those of any textbook, such as Dean and
Dalrymple, Water Wave Mechanics for Engineers and Scientists (1991), chapters 3 and 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray
from musatpy.refraction.surface import Surface
from musatpy.refraction.waves import Trochoid, sinusoidal, stokes

GRAVITY = 9.80665  # m/s2, standard
DEPTH_BREAKING = 0.78  # height over depth of the highest solitary wave, McCowan (1894)
STEEPNESS_BREAKING = 0.142  # height over length of the steepest wave in deep water, Michell (1893), Miche (1944)
_STEPS = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearWave:
    """A wave of given period (s) in water of given depth (m, infinite in deep water), arrays of one shape (...).

    number k (...) rad/m; height (...) m from trough to crest, NaN where none was given.
    """

    period: FloatArray
    depth: FloatArray
    number: FloatArray
    height: FloatArray

    @property
    def length(self) -> FloatArray:
        """Length (...) m."""
        return 2.0 * np.pi / self.number

    @property
    def speed(self) -> FloatArray:
        """Phase speed (...) m/s: that of the crests."""
        return self.length / self.period

    @property
    def group_speed(self) -> FloatArray:
        """Speed (...) m/s of groups, and of the energy: c/2 (1 + 2kh / sinh 2kh)."""
        return self.speed * _group_ratio(self.number * self.depth)

    @property
    def ursell(self) -> FloatArray:
        """Ursell number (...) H L^2 / h^3: far above some 26, a shallow wave is no longer nearly sinusoidal."""
        return self.height * np.square(self.length) / self.depth**3

    @property
    def breaking_height(self) -> FloatArray:
        """Height (...) m that the wave cannot exceed: the lesser of 0.142 L tanh kh and 0.78 of the depth."""
        steep = STEEPNESS_BREAKING * self.length * np.tanh(self.number * self.depth)
        return np.minimum(steep, DEPTH_BREAKING * self.depth)

    @property
    def breaks(self) -> BoolArray:
        """Whether the wave (...) is too high to stand."""
        return self.height > self.breaking_height

    def orbits(self, elevation: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the horizontal and vertical semi-axes (...) m of the paths of water at an elevation (...) m.

        The elevation counts from the mean level, 0 to -depth. In deep water the paths are circles that shrink with
        exp(k z), in shallow water flat ellipses of the same width down to the bottom. The largest speeds along the
        axes are 2 pi / period times these. Raises `ValueError` outside the water.
        """
        z = np.asarray(elevation, dtype=float)
        if not ((z <= 0.0) & (z >= -self.depth)).all():
            raise ValueError("the elevation of an orbit lies between the bottom and the mean level")
        k, kh = self.number, self.number * self.depth
        # cosh k(z+h) / sinh kh and sinh k(z+h) / sinh kh, without overflow
        scale = self.height / 2.0 * np.exp(k * z) / -np.expm1(-2.0 * kh)
        echo = np.exp(-2.0 * k * (z + self.depth))
        return scale * (1.0 + echo), scale * (1.0 - echo)

    @property
    def bottom_speed(self) -> FloatArray:
        """Largest speed (...) m/s of the water to and fro at the bottom."""
        return self.orbits(-self.depth)[0] * 2.0 * np.pi / self.period


def linear_wave(
    period: ArrayLike,
    depth: ArrayLike,
    *,
    height: ArrayLike = np.nan,
    deep_height: ArrayLike | None = None,
    gravity: float = GRAVITY,
) -> LinearWave:
    """Return waves of periods (...) s in water of depths (...) m, of shapes that broadcast.

    Their height (m) is that there, or follows from the `deep_height` in deep water by shoaling. Raises `ValueError`
    unless period and depth are positive.
    """
    given = height if deep_height is None else deep_height
    T, h, H = np.broadcast_arrays(*(np.asarray(values, dtype=float) for values in (period, depth, given)))
    if not ((T > 0.0) & (h > 0.0)).all():
        raise ValueError("period and depth of a wave are positive")
    k = _number(T, h, gravity)
    return LinearWave(period=T, depth=h, number=k, height=H if deep_height is None else H * shoaling(k * h))


def period_of(number: ArrayLike, depth: ArrayLike, gravity: float = GRAVITY) -> FloatArray:
    """Return the period (...) s of waves of given numbers k (...) rad/m in water of depths (...) m."""
    k = np.asarray(number, dtype=float)
    return 2.0 * np.pi / np.sqrt(gravity * k * np.tanh(k * np.asarray(depth, dtype=float)))


def shoaling(kh: ArrayLike) -> FloatArray:
    """Return the height (...) of a wave over that in deep water: energy flows at the group speed, and is kept."""
    kh = np.asarray(kh, dtype=float)
    return 1.0 / np.sqrt(2.0 * np.tanh(kh) * _group_ratio(kh))


def _group_ratio(kh: FloatArray) -> FloatArray:
    """Return group over phase speed, 1/2 in deep water and 1 in shallow."""
    twice = np.minimum(2.0 * kh, 700.0)  # beyond, and in deep water, x / sinh x is nothing
    # x / sinh x, without overflow
    return 0.5 * (1.0 + 2.0 * twice * np.exp(-twice) / -np.expm1(-2.0 * twice))


def _number(T: FloatArray, h: FloatArray, gravity: float) -> FloatArray:
    """Return k of x tanh x = y, x = kh, y = w^2 h / g, by Newton's method from both limits."""
    deep = np.square(2.0 * np.pi / T) / gravity
    infinite = np.isinf(h)
    h = np.where(infinite, 1.0, h)
    y = deep * h
    # sqrt(y) in shallow, y in deep water; the root lies above both, by less than half
    x = np.maximum(np.sqrt(y), y)
    for _ in range(_STEPS):
        t = np.tanh(x)
        step = (y - x * t) / (t + x * (1.0 - t * t))
        x = x + step
        if np.all(np.abs(step) <= 4e-16 * x):
            break
    return np.where(infinite, deep, x / h)


class Shape(StrEnum):
    """Shapes of a wave."""

    SINUSOIDAL = "sinusoidal"
    STOKES = "stokes"
    TROCHOIDAL = "trochoidal"


def wave_surface(
    shape: Shape, *, amplitude: float, length: float, azimuth: float, speed: float, crest: float, depth: float
) -> Surface:
    """Return a wave about level 0; the arguments are those of `sinusoidal`, and the mean depth (m) of the water.

    Raises `ValueError` where it is too high for the theory of its shape.
    """
    if shape is Shape.STOKES:
        return stokes(amplitude=amplitude, length=length, azimuth=azimuth, speed=speed, crest=crest, depth=depth)
    if shape is Shape.TROCHOIDAL:
        return Trochoid(amplitude=amplitude, length=length, azimuth=azimuth, speed=speed, crest=crest)
    return sinusoidal(amplitude=amplitude, length=length, azimuth=azimuth, speed=speed, crest=crest)
