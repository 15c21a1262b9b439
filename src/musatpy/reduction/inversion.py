"""The inverse of a small displacement in the plate, by Newton's method."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from musatpy.arrays import FloatArray

Displacement = Callable[[FloatArray], FloatArray]

TOLERANCE = 1e-11  # mm: well below the 1e-9 mm that an inverse is good for
_STEPS = 30


def invert(function: Displacement, partials: Displacement, target: FloatArray) -> FloatArray:
    """Return xy (..., 2) with function(xy) = target (..., 2), mm, to 1e-9 mm or better.

    `function` moves points (..., 2) by little, `partials` are its derivatives (..., 2, 2). Points at which the
    iteration does not settle, or settles where the plane is folded over (no plate has such distortion), are NaN.
    """
    xy = np.array(target, dtype=float)
    settled = np.zeros(xy.shape[:-1], dtype=bool)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for _ in range(_STEPS):
            miss = function(xy) - target
            step = solve(partials(xy), miss)
            xy = np.where(settled[..., None], xy, xy - step)
            settled |= np.abs(step).max(axis=-1) < TOLERANCE
            if settled.all():
                break
        J = partials(xy)
        settled &= (np.linalg.det(J) > 0.0) & (np.trace(J, axis1=-2, axis2=-1) > 0.0)
    return np.where(settled[..., None], xy, np.nan)


def solve(J: FloatArray, b: FloatArray) -> FloatArray:
    """Return J^-1 b for 2 by 2 matrices J (..., 2, 2) and vectors b (..., 2); not finite where J is singular."""
    return np.einsum("...ij,...j->...i", inverse(J), b)


def inverse(J: FloatArray) -> FloatArray:
    """Return the inverses of 2 by 2 matrices (..., 2, 2); not finite where there is none."""
    a, b, c, d = J[..., 0, 0], J[..., 0, 1], J[..., 1, 0], J[..., 1, 1]
    adjoint = np.empty_like(J)
    adjoint[..., 0, 0], adjoint[..., 0, 1], adjoint[..., 1, 0], adjoint[..., 1, 1] = d, -b, -c, a
    return adjoint / (a * d - b * c)[..., None, None]
