"""The lag of a mark behind a surface, by profiles side by side that were read to and fro.

A mark that is driven along a profile comes late: what is read at a station is the surface some way back. Between
lines that are read in opposite directions that leaves a difference that grows with the slope; the mean of the two
neighbours of a line takes off what the surface does across the lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.surfaces.profiles import Profile

_MIDDLE = np.array([-0.5, 1.0, -0.5])  # of a line and its neighbours, what is left of the surface


@dataclass(frozen=True, kw_only=True)
class Lag:
    """How far (m) the mark was behind, with its sigma as if errors were independent from post to post."""

    length: float
    sigma: float
    posts: int


def lag_of(lines: Sequence[Profile], direction: IntArray, step: float) -> Lag | None:
    """Return the lag of lines (l) side by side, direction (l,) 1 to their ends and -1 back, by posts a step apart.

    None for fewer than three lines, and where they share no slope.
    """
    if len(lines) < 3:
        return None
    ends = [line.station[~line.spike][[0, -1]] for line in lines]
    first, last = max(end[0] for end in ends), min(end[1] for end in ends)
    if last - first < 2.0 * step:
        return None
    posts = np.arange(first, last + 1e-9 * step, step)
    value = np.stack([line.at(posts) for line in lines])
    # of line i a part -d_i L z' is the lag: m = v_i - (v_i-1 + v_i+1) / 2 = -2 d_i L z'
    m = _across(value)
    slope = np.gradient(_across(value, np.array([0.25, 0.5, 0.25])), step, axis=1)
    design = -2.0 * direction[1:-1, None] * slope
    squares = float(np.sum(np.square(design)))
    if not squares > 0.0:
        return None
    length = float(np.sum(design * m)) / squares
    left = m - length * design
    variance = float(np.sum(np.square(left))) / (np.sum(np.square(_MIDDLE)) * max(left.size - 1, 1))
    share = np.zeros_like(value)  # of each reading in the lag
    for place, weight in enumerate(_MIDDLE):
        share[place : place + len(design)] += weight * design / squares
    return Lag(length=length, sigma=float(np.sqrt(variance * np.sum(np.square(share)))), posts=m.size)


def _across(value: FloatArray, weights: FloatArray = _MIDDLE) -> FloatArray:
    """Return weighted sums (l - 2, s) of each line and its neighbours."""
    return np.asarray(weights[0] * value[:-2] + weights[1] * value[1:-1] + weights[2] * value[2:])
