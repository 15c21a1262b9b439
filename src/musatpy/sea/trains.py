"""What the cards of waves leave to linear theory."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import Waves
from musatpy.sea.theory import LinearWave, linear_wave, period_of


def wave_trains(waves: Waves) -> LinearWave:
    """Return period, depth, number and height of the waves (k,): as given, the rest by linear theory.

    Where the period alone is given, theory has the length, where the length alone, the period; speed is length over
    period. What cannot be found is NaN.
    """
    depth = np.where(np.isnan(waves.depth), np.inf, waves.depth)
    T, L, c = waves.period, waves.length, waves.speed
    L = _first(L, T * c)
    alone = np.isnan(L) & (T > 0.0) & (depth > 0.0)
    number = 2.0 * np.pi / L
    number[alone] = linear_wave(T[alone], depth[alone]).number
    with np.errstate(invalid="ignore"):  # a length that cannot be
        period = _first(T, L / c, period_of(number, depth))
    return LinearWave(period=period, depth=depth, number=number, height=waves.height)


def _first(*values: FloatArray) -> FloatArray:
    """Return the first of several values (k,) that is known."""
    found = values[0]
    for other in values[1:]:
        found = np.where(np.isnan(found), other, found)
    return np.asarray(found)
