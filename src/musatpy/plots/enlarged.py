"""What is drawn larger than it is: ellipses of confidence and arrows, and by how much."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.statistics.analyses import ellipses

CONFIDENCE = 0.95
NORMAL = 1.96  # sigmas of 95 % in one dimension
_STEPS = (1.0, 2.0, 5.0, 10.0)
_MOST = 90.0  # percentile that is drawn no larger than is wanted


def confidence_ellipses(covariance: FloatArray, turn: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return semi-axes (n, 2) m, the longer first, and its angle (n,) rad from x to y, of ellipses of 95 %.

    covariance (n, 3, 3) m2 along east, north, up; `turn` (n,) rad is by what y stands clockwise of north. They are
    standard ellipses times the root of the quantile of chi-square with two degrees of freedom, -2 ln(1 - 0.95).
    NaN where there is no covariance.
    """
    standard = ellipses(covariance)
    factor = np.sqrt(-2.0 * np.log(1.0 - CONFIDENCE))
    return factor * np.column_stack([standard.major, standard.minor]), 0.5 * np.pi - (standard.bearing - turn)


def turned(vectors: FloatArray, turn: FloatArray) -> FloatArray:
    """Return vectors (n, 2) of east and north along axes that stand `turn` (n,) rad clockwise of these."""
    c, s = np.cos(turn), np.sin(turn)
    return np.column_stack([c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]])


def round_length(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that a positive length reaches."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(power * max(step for step in _STEPS if step * power <= length * (1.0 + 1e-9)))


def largest_of_cells(places: FloatArray, sizes: FloatArray, most: int) -> IntArray:
    """Return the rows of places (n, 2), growing, whose sizes (n,) are the largest in the cells of a square grid.

    The grid has about so many cells; where there are no more places than that, all are returned.
    """
    if len(places) <= most:
        return np.arange(len(places))
    low, reach = places.min(axis=0), np.maximum(np.ptp(places, axis=0), 1e-9)
    side = max(float(np.sqrt(reach.prod() / most)), float(reach.max()) / most)
    cell = np.floor((places - low) / side).astype(np.int64)
    order = np.lexsort((-sizes, cell[:, 1], cell[:, 0]))
    first = np.append(True, (np.diff(cell[order], axis=0) != 0).any(axis=1))
    return np.sort(order[first])


def magnification(sizes: FloatArray, shown: float) -> float:
    """Return the round factor by which most sizes (n,) are drawn no larger than `shown`; 0 where there is none.

    Most are nine in ten: a few that are much larger are drawn so, and the others can be seen.
    """
    known = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    if not len(known):
        return 0.0
    return round_length(shown / float(np.percentile(known, _MOST)))
