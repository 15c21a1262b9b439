"""Surfaces on top of one another: their heights are added."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray
from musatpy.refraction.harmonic import Harmonic
from musatpy.refraction.surface import Limits, Relief, Surface


@dataclass(frozen=True, kw_only=True, eq=False)
class Superposed:
    """The sum of surfaces of any families; at least one."""

    surfaces: tuple[Surface, ...]

    @cached_property
    def limits(self) -> Limits:
        """What the sum keeps to: all of them at their worst together."""
        each = [surface.limits for surface in self.surfaces]
        return Limits(
            lowest=sum(limits.lowest for limits in each),
            highest=sum(limits.highest for limits in each),
            slope=sum(limits.slope for limits in each),
            curvature=sum(limits.curvature for limits in each),
            third=sum(limits.third for limits in each),
            length=min(limits.length for limits in each),
        )

    def relief(self, xy: FloatArray, time: ArrayLike = 0.0) -> Relief:
        """Return its shape at places xy (..., 2) m, at times (...) s."""
        each = [surface.relief(xy, time) for surface in self.surfaces]
        return Relief(
            height=np.asarray(sum(relief.height for relief in each)),
            gradient=np.asarray(sum(relief.gradient for relief in each)),
            hessian=np.asarray(sum(relief.hessian for relief in each)),
        )

    def covers(self, xy: FloatArray, time: ArrayLike = 0.0) -> BoolArray:
        """Tell where (...) all of them are known."""
        return np.all([surface.covers(xy, time) for surface in self.surfaces], axis=0)


def superposed(*surfaces: Surface) -> Surface:
    """Return the sum of surfaces; that of harmonic ones is one harmonic surface with all their components."""
    harmonic = [surface for surface in surfaces if isinstance(surface, Harmonic)]
    if len(harmonic) < len(surfaces):
        return Superposed(surfaces=surfaces)
    return Harmonic(
        level=sum(wave.level for wave in harmonic),
        amplitude=np.concatenate([wave.amplitude for wave in harmonic]),
        vector=np.concatenate([wave.vector for wave in harmonic]),
        frequency=np.concatenate([wave.frequency for wave in harmonic]),
        phase=np.concatenate([wave.phase for wave in harmonic]),
    )
