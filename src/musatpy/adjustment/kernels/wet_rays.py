"""Rays through level water, one after the other: where they enter it, with partials.

The numpy twins are `refraction.flat.air_tangent` and `refraction.flat.incidence`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from musatpy.arrays import FloatArray
from musatpy.compiling import inlined
from musatpy.refraction.compiled_flat import MAX_STEPS, newton_step, slopes

if TYPE_CHECKING:
    from musatpy.adjustment.kernels.points import Water


@inlined
def _air_tangent(H: float, h: float, D: float, n: float) -> float:
    """Return tan(I) of a ray to the water: `refraction.flat.air_tangent`, ETL-0306 (4.10)."""
    t = D / (H + h / n)
    for _ in range(MAX_STEPS):
        step = newton_step(t, H, h, D, n)
        t += step
        if not abs(step) > 4e-16 * abs(t) + 1e-300:
            break
        if not abs(step) > 1e-8 * abs(t):
            t += newton_step(t, H, h, D, n)
            break
    return t


@inlined
def bend(
    row: int, water: Water, gap0: float, gap1: float, gap2: float, v: FloatArray
) -> tuple[float, float, float, float, float]:
    """Set v (3,) from camera to water point of a wet ray; the gap is the vector to the point.

    Returns the horizontal direction e of the ray, the height of the camera above the water and tan(I), of
    `refraction.flat.incidence`.
    """
    up0, up1, up2 = water.normal[row, 0], water.normal[row, 1], water.normal[row, 2]
    h, fall = water.depth[row], -(up0 * gap0 + up1 * gap1 + up2 * gap2)
    e0, e1, e2 = gap0 + up0 * fall, gap1 + up1 * fall, gap2 + up2 * fall
    D = math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
    if D > 0.0:
        e0, e1, e2 = e0 / D, e1 / D, e2 / D
    H = fall - h
    t = _air_tangent(H, h, D, water.refraction)
    v[0], v[1], v[2] = e0 * H * t - up0 * H, e1 * H * t - up1 * H, e2 * H * t - up2 * H
    return e0, e1, e2, H, t


@inlined
def bend_with_partials(
    row: int, water: Water, gap0: float, gap1: float, gap2: float, v: FloatArray, by: FloatArray
) -> None:
    """Set v (3,) as `bend` does, and its partials by (2, 3, 3) camera and ground: `refraction.flat.incidence`."""
    e0, e1, e2, H, t = bend(row, water, gap0, gap1, gap2, v)
    kappa, ratio, Q_H, Q_h, _ = slopes(t, H, water.depth[row], water.refraction)
    for i in range(3):
        e_i, up_i = e0 if i == 0 else e1 if i == 1 else e2, water.normal[row, i]
        for j in range(3):
            e_j, up_j = e0 if j == 0 else e1 if j == 1 else e2, water.normal[row, j]
            K = (kappa - ratio) * e_i * e_j - ratio * up_i * up_j + (ratio if i == j else 0.0)
            by[0, i, j] = -K + (e_i * Q_H - up_i) * up_j
            by[1, i, j] = K - e_i * Q_h * up_j
