"""The trochoidal wave of Gerstner (1802), exact in deep water: the path of a point inside a rolling circle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray
from musatpy.refraction.surface import Limits, Relief, everywhere, unit_direction

_STEPS = 60


@dataclass(frozen=True, kw_only=True)
class Trochoid:
    """x = q - r sin(k q), z = level + k r^2 / 2 + r cos(k q) along the direction it runs to, k = 2 pi / length.

    amplitude r (m), half the height; length (m); azimuth (rad) from x towards y; speed (m/s); crest (m): distance
    from the origin of a crest at time 0; level (m): mean over a length, which lies k r^2 / 2 below the middle of
    crest and trough. Raises `ValueError` unless 0 <= k r < 1: from 1 on the crests are cusps.
    """

    amplitude: float
    length: float
    azimuth: float
    speed: float = 0.0
    crest: float = 0.0
    level: float = 0.0

    def __post_init__(self) -> None:
        if not (self.length > 0.0 and 0.0 <= self._steepness < 1.0):
            raise ValueError("the amplitude of a trochoidal wave lies from 0 to its length over 2 pi")

    @property
    def _number(self) -> float:
        return float(2.0 * np.pi / self.length)

    @property
    def _steepness(self) -> float:
        return self._number * self.amplitude

    @cached_property
    def limits(self) -> Limits:
        """What it keeps to: steepest at cos(k q) = k r, most curved at the crest, third derivative beside it."""
        e, middle = self._steepness, self.level + self._number * self.amplitude**2 / 2.0
        return Limits(
            lowest=middle - self.amplitude,
            highest=middle + self.amplitude,
            slope=e / float(np.sqrt(1.0 - e * e)),
            curvature=e * self._number / (1.0 - e) ** 2,
            third=_largest_third(e) * self._number**2,
            # a crest is as sharp as that of a sinusoidal wave shorter by 1 - k r
            length=self.length * (1.0 - e),
        )

    def relief(self, xy: FloatArray, time: ArrayLike = 0.0) -> Relief:
        """Return its shape at places xy (..., 2) m, at times (...) s."""
        direction, k, e = unit_direction(self.azimuth), self._number, self._steepness
        theta = _parameter(k * (xy @ direction - self.speed * np.asarray(time) - self.crest), e)
        sine, cosine = np.sin(theta), np.cos(theta)
        stretch = 1.0 - e * cosine
        slope = -e * sine / stretch
        bend = -e * k * (cosine - e) / stretch**3
        return Relief(
            height=self.level + k * self.amplitude**2 / 2.0 + self.amplitude * cosine,
            gradient=slope[..., None] * direction,
            hessian=bend[..., None, None] * np.outer(direction, direction),
        )

    def covers(self, xy: FloatArray, time: ArrayLike = 0.0) -> BoolArray:
        """Tell that it is known everywhere."""
        return everywhere(xy)


def _parameter(angle: FloatArray, e: float) -> FloatArray:
    """Return theta of theta - e sin(theta) = angle (...): Kepler's equation, whose safe start is -+ pi."""
    turn = np.round(angle / (2.0 * np.pi)) * 2.0 * np.pi
    wanted = angle - turn
    theta = np.where(wanted < 0.0, -np.pi, np.pi) if e > 0.8 else wanted + e * np.sin(wanted)
    for _ in range(_STEPS):
        step = (wanted - theta + e * np.sin(theta)) / (1.0 - e * np.cos(theta))
        theta = theta + step
        if np.all(np.abs(step) <= 4e-16 * np.pi):
            break
    return turn + theta


def _largest_third(e: float) -> float:
    """Return the largest third derivative of a trochoid of k = 1 and radius e < 1.

    It is e sin(theta) (1 + 2 e c - 3 e^2) / (1 - e c)^5 with c = cos(theta), whose derivative vanishes where a
    cubic polynomial in c does.
    """
    if e == 0.0:
        return 0.0
    c = np.roots([6.0 * e**2, 8.0 * e - 12.0 * e**3, 1.0 - 11.0 * e**2, 15.0 * e**3 - 7.0 * e])
    c = np.clip(c.real, -1.0, 1.0)  # what is no root is a value that the function takes too: it does no harm
    third = e * np.sqrt(1.0 - c * c) * (1.0 + 2.0 * e * c - 3.0 * e * e) / (1.0 - e * c) ** 5
    return float(np.abs(third).max()) * (1.0 + 1e-9)  # rounding of the roots
