"""Straight rays of points, one point after the other: where they come nearest to one another, or reach a level.

The numpy twins are `geometry.collinearity.ray`, `geometry.intersection.nearest_point` and `widest_angle`, and those
of `adjustment.ground` for the level.
"""

from __future__ import annotations

import math

import numpy as np

from musatpy.adjustment.kernels.points import Measured, Stations
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.compiling import compiled, inlined

_SINGULAR = 1e-14  # smallest pivot: `nearest_point`


@compiled
def directions(rows: IntArray, at: Measured, stations: Stations, u: FloatArray) -> None:
    """Set the unit directions (r, 3) of the rays of points."""
    for p in rows:
        for r in range(at.start[p], at.start[p + 1]):
            n = at.photo[r]
            x, y = at.xy[r, 0] - stations.principal_point[n, 0], at.xy[r, 1] - stations.principal_point[n, 1]
            f = stations.focal_length[n]
            length = math.sqrt(x * x + y * y + f * f)
            for i in range(3):
                along = stations.M[n, 0, i] * x + stations.M[n, 1, i] * y - stations.M[n, 2, i] * f
                u[r, i] = along / length


@compiled
def reach(
    rows: IntArray, at: Measured, stations: Stations, up: FloatArray, above: FloatArray, flattest: float,
    u: FloatArray, X: FloatArray,
) -> None:  # fmt: skip
    """Set where the rays (r, 3) of points, in directions u, reach a level, as flat as it is at their stations.

    Stations are `above` (n,) it, where `up` (n, 3) is; directions that fall by less than `flattest` are bent down.
    """
    for p in rows:
        for r in range(at.start[p], at.start[p + 1]):
            n = at.photo[r]
            e, d, h = up[n]
            fall = -(e * u[r, 0] + d * u[r, 1] + h * u[r, 2])
            if fall < flattest:
                x, y, z = u[r, 0] + e * fall, u[r, 1] + d * fall, u[r, 2] + h * fall
                scale = math.sqrt(1.0 - flattest * flattest) / max(math.sqrt(x * x + y * y + z * z), 1e-9)
                u[r, 0], u[r, 1] = scale * x - flattest * e, scale * y - flattest * d
                u[r, 2] = scale * z - flattest * h
                fall = flattest
            for i in range(3):
                X[r, i] = stations.position[n, i] + u[r, i] * (above[n] / fall)


@compiled
def middles(rows: IntArray, at: Measured, X: FloatArray, ground: FloatArray) -> None:
    """Set the ground of points, rows of (g, 3), to the means of what their rays have at X (r, 3)."""
    for p in rows:
        first, last = at.start[p], at.start[p + 1]
        for i in range(3):
            total = 0.0
            for r in range(first, last):
                total += X[r, i]
            ground[at.point[p], i] = total / (last - first)


@inlined
def _are_parallel(first: int, last: int, limit: float, u: FloatArray) -> bool:
    """Return whether the widest angle between some rays is below a limit."""
    for i in range(first, last):
        for j in range(i + 1, last):
            x = u[i, 1] * u[j, 2] - u[i, 2] * u[j, 1]
            y = u[i, 2] * u[j, 0] - u[i, 0] * u[j, 2]
            z = u[i, 0] * u[j, 1] - u[i, 1] * u[j, 0]
            cosine = u[i, 0] * u[j, 0] + u[i, 1] * u[j, 1] + u[i, 2] * u[j, 2]
            if not math.atan2(math.sqrt(x * x + y * y + z * z), cosine) < limit:
                return False
    return True


@compiled
def nearest(
    rows: IntArray, at: Measured, stations: Stations, limit: float, u: FloatArray, ground: FloatArray,
    parallel: BoolArray,
) -> None:  # fmt: skip
    """Set the ground of points, rows of (g, 3), where their rays come nearest, NaN where these are parallel.

    `parallel` (k,): no two of the rays have an angle of the limit, rad.
    """
    P = stations.position
    for p in rows:
        g, first, last = at.point[p], at.start[p], at.start[p + 1]
        parallel[p] = _are_parallel(first, last, limit, u)
        n00 = n10 = n11 = n20 = n21 = n22 = t0 = t1 = t2 = 0.0
        for r in range(first, last):
            n, x, y, z = at.photo[r], u[r, 0], u[r, 1], u[r, 2]
            along = x * P[n, 0] + y * P[n, 1] + z * P[n, 2]
            n00, n11, n22 = n00 + 1.0 - x * x, n11 + 1.0 - y * y, n22 + 1.0 - z * z
            n10, n20, n21 = n10 - y * x, n20 - z * x, n21 - z * y
            t0, t1, t2 = t0 + P[n, 0] - x * along, t1 + P[n, 1] - y * along, t2 + P[n, 2] - z * along
        c00, c10, c20 = n11 * n22 - n21 * n21, n20 * n21 - n10 * n22, n10 * n21 - n20 * n11
        c11, c21, c22 = n00 * n22 - n20 * n20, n10 * n20 - n00 * n21, n00 * n11 - n10 * n10
        determinant = n00 * c00 + n10 * c10 + n20 * c20
        # about the smallest eigenvalue, where that is small
        scale = 1.0 / determinant if determinant >= _SINGULAR * (c00 + c11 + c22) else np.nan
        ground[g, 0] = (c00 * t0 + c10 * t1 + c20 * t2) * scale
        ground[g, 1] = (c10 * t0 + c11 * t1 + c21 * t2) * scale
        ground[g, 2] = (c20 * t0 + c21 * t1 + c22 * t2) * scale
