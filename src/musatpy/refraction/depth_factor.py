"""The depth factor: by what an apparent depth of a stereo pair is to be multiplied.

Groeneveld Meijer (1964), Photogrammetric Engineering 30: two vertical photographs taken at one height above level
water. Lengths are in any unit, the same for all; symbols are those of the paper. For a small angle of incidence the
factor is the index n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthDeparture:
    """What one depth factor makes of apparent depths, and another in its place: arrays of one shape."""

    depth: FloatArray  # by the one factor
    other_depth: FloatArray  # by the other
    error: FloatArray  # other_depth - depth
    relative: FloatArray  # error in units of the depth


def pair_factor(
    d1: ArrayLike,
    d2: ArrayLike,
    s: ArrayLike,
    t: ArrayLike,
    apparent_depth: ArrayLike,
    height: ArrayLike,
    index: ArrayLike,
) -> FloatArray:
    """Return F of points at distances d1, d2 from the two nadirs, s and t of them along the base; shapes broadcast.

    `height` h of the cameras above the water, `apparent_depth` h_a. Groeneveld Meijer (13), with b = s + t.
    """
    s, t = np.asarray(s, dtype=float), np.asarray(t, dtype=float)
    n2, d1, d2 = np.square(index), np.asarray(d1, dtype=float), np.asarray(d2, dtype=float)
    fall = np.asarray(height, dtype=float) + apparent_depth
    first, second = (np.sqrt((n2 - 1.0) * np.square(d) + np.square(fall) * n2) for d in (d1, d2))
    # the factor of either ray is (first or second)/fall; s and t weigh their inverses
    return (s + t) / fall / (s / first + t / second)


def departure(factor: ArrayLike, other: ArrayLike, apparent_depth: ArrayLike) -> DepthDeparture:
    """Return how far the depths by the `other` factor are from those by `factor`; shapes broadcast.

    Table 2 is that of the factor of one apparent depth from the factors of others at the same place, Table 3 that
    of the factors of a model from a single value.
    """
    F, G, h_a = (np.asarray(values, dtype=float) for values in (factor, other, apparent_depth))
    F, G, h_a = np.broadcast_arrays(F, G, h_a)
    # relative by the factors, so that it exists at an apparent depth of zero too
    return DepthDeparture(depth=F * h_a, other_depth=G * h_a, error=(G - F) * h_a, relative=(G - F) / F)
