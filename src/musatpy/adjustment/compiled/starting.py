"""Where the straight rays of points come nearest to one another: `geometry.intersection`, by `collinearity.ray`."""

from __future__ import annotations

import math

import numpy as np

from musatpy.adjustment.compiled.compiler import called, compiled, inlined
from musatpy.adjustment.compiled.elimination import room_for
from musatpy.adjustment.compiled.rays import Measured, Stations
from musatpy.arrays import BoolArray, FloatArray, IntArray

_SINGULAR = 1e-14  # smallest pivot: `nearest_point`


@inlined
def _direct(r: int, at: Measured, stations: Stations, u: FloatArray) -> None:
    """Set the unit direction (3,) of ray r."""
    n = at.photo[r]
    x, y = at.xy[r, 0] - stations.principal_point[n, 0], at.xy[r, 1] - stations.principal_point[n, 1]
    f = stations.focal_length[n]
    length = math.sqrt(x * x + y * y + f * f)
    for i in range(3):
        u[i] = (stations.M[n, 0, i] * x + stations.M[n, 1, i] * y - stations.M[n, 2, i] * f) / length


@called
def _are_parallel(m: int, limit: float, u: FloatArray) -> bool:
    """Return whether the widest angle between m rays, rows of u, is below a limit."""
    for i in range(m):
        for j in range(i + 1, m):
            x = u[i, 1] * u[j, 2] - u[i, 2] * u[j, 1]
            y = u[i, 2] * u[j, 0] - u[i, 0] * u[j, 2]
            z = u[i, 0] * u[j, 1] - u[i, 1] * u[j, 0]
            cosine = u[i, 0] * u[j, 0] + u[i, 1] * u[j, 1] + u[i, 2] * u[j, 2]
            if not math.atan2(math.sqrt(x * x + y * y + z * z), cosine) < limit:
                return False
    return True


@compiled
def meet(
    rows: IntArray, at: Measured, stations: Stations, limit: float, ground: FloatArray, parallel: BoolArray
) -> None:
    """Set the ground (k, 3) of points, NaN where it is nowhere, and whether all rays are within a limit, rad."""
    P, u = stations.position, room_for(at.start, rows).B[:, 0]
    for p in rows:
        first, m = at.start[p], at.start[p + 1] - at.start[p]
        n00 = n10 = n11 = n20 = n21 = n22 = t0 = t1 = t2 = 0.0
        for k in range(m):
            _direct(first + k, at, stations, u[k])
            n, x, y, z = at.photo[first + k], u[k, 0], u[k, 1], u[k, 2]
            along = x * P[n, 0] + y * P[n, 1] + z * P[n, 2]
            n00, n11, n22 = n00 + 1.0 - x * x, n11 + 1.0 - y * y, n22 + 1.0 - z * z
            n10, n20, n21 = n10 - y * x, n20 - z * x, n21 - z * y
            t0, t1, t2 = t0 + P[n, 0] - x * along, t1 + P[n, 1] - y * along, t2 + P[n, 2] - z * along
        parallel[p] = _are_parallel(m, limit, u)
        c00, c10, c20 = n11 * n22 - n21 * n21, n20 * n21 - n10 * n22, n10 * n21 - n20 * n11
        c11, c21, c22 = n00 * n22 - n20 * n20, n10 * n20 - n00 * n21, n00 * n11 - n10 * n10
        determinant = n00 * c00 + n10 * c10 + n20 * c20
        # about the smallest eigenvalue, where that is small
        scale = 1.0 / determinant if determinant >= _SINGULAR * (c00 + c11 + c22) else np.nan
        ground[p, 0] = (c00 * t0 + c10 * t1 + c20 * t2) * scale
        ground[p, 1] = (c10 * t0 + c11 * t1 + c21 * t2) * scale
        ground[p, 2] = (c20 * t0 + c21 * t1 + c22 * t2) * scale
