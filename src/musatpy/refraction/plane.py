"""The still surface: level, or a tilted plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray
from musatpy.refraction.surface import Limits, Relief, everywhere


@dataclass(frozen=True, kw_only=True)
class Plane:
    """z = level + slope . (x, y): `level` m at the origin, `slope` towards x and y; at rest."""

    level: float = 0.0
    slope: tuple[float, float] = (0.0, 0.0)

    @property
    def limits(self) -> Limits:
        """What it keeps to: heights are unbounded where it is tilted."""
        steepness = float(np.hypot(*self.slope))
        low, high = (self.level, self.level) if steepness == 0.0 else (-np.inf, np.inf)
        return Limits(lowest=low, highest=high, slope=steepness, curvature=0.0, third=0.0, length=np.inf)

    def relief(self, xy: FloatArray, time: ArrayLike = 0.0) -> Relief:
        """Return its shape at places xy (..., 2), the same at all times."""
        return Relief(
            height=self.level + xy @ np.array(self.slope),
            gradient=np.broadcast_to(self.slope, xy.shape),
            hessian=np.zeros((*xy.shape, 2)),
        )

    def covers(self, xy: FloatArray, time: ArrayLike = 0.0) -> BoolArray:
        """Tell that it is known everywhere."""
        return everywhere(xy)
