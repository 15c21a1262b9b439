"""What a refracting surface that is not level has to say: its height over every place, at every time.

Surfaces stand in local axes, east, north, up (m): z = s(x, y, t), time t in seconds. A family of surfaces is a
module beside this one with a frozen dataclass (or a function that returns one) that has the three members of
`Surface`; `fermat` finds the incidence points and `bending` the refracted rays of any of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Relief:
    """Height (...) m, its gradient (..., 2) and second derivatives (..., 2, 2) 1/m at places (..., 2)."""

    height: FloatArray
    gradient: FloatArray
    hessian: FloatArray


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a surface keeps to everywhere: bounds from which a search knows where it need not look.

    lowest, highest (m): heights; slope: length of the gradient; curvature (1/m) and third (1/m2): the largest
    second and third derivative along any direction; length (m): its shortest wave, infinite for a plane.
    """

    lowest: float
    highest: float
    slope: float
    curvature: float
    third: float
    length: float


class Surface(Protocol):
    """A refracting surface z = s(x, y, t)."""

    @property
    def limits(self) -> Limits:
        """What it keeps to everywhere."""
        ...

    def relief(self, xy: FloatArray, time: ArrayLike = 0.0) -> Relief:
        """Return its shape at places xy (..., 2) m, at times (...) s."""
        ...

    def covers(self, xy: FloatArray, time: ArrayLike = 0.0) -> BoolArray:
        """Tell where (...) it is known."""
        ...


def everywhere(xy: FloatArray) -> BoolArray:
    """Return the answer (...) of a surface without edges to whether it covers places (..., 2)."""
    return np.ones(np.shape(xy)[:-1], dtype=bool)


def unit_direction(azimuth: ArrayLike) -> FloatArray:
    """Return the unit vectors (..., 2) of directions (...) rad, counted from x towards y."""
    angle = np.asarray(azimuth, dtype=float)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
