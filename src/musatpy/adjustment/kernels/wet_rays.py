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
    """Return tan(I) of a ray to the water: `refraction.flat.air_tangent`, ETL-0306 (4.10).

    A step leaves no more than its square: what is below 1e-9 ends at rounding.
    """
    t = D / (H + h / n)
    for _ in range(MAX_STEPS):
        step = newton_step(t, H, h, D, n)
        t += step
        if not abs(step) > 1e-9 * abs(t):
            break
    return t


@inlined
def bend(
    row: int, water: Water, gap0: float, gap1: float, gap2: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """Return v from camera to water point of a wet ray; the gap is the vector to the point.

    Then the horizontal direction e of the ray, the height of the camera above the water and tan(I), of
    `refraction.flat.incidence`.
    """
    up0, up1, up2 = water.normal[row, 0], water.normal[row, 1], water.normal[row, 2]
    h, fall = water.depth[row], -(up0 * gap0 + up1 * gap1 + up2 * gap2)
    e0, e1, e2 = gap0 + up0 * fall, gap1 + up1 * fall, gap2 + up2 * fall
    D = math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
    share = 1.0 / (D if D > 0.0 else 1.0)  # 0 at the nadir
    e0, e1, e2 = e0 * share, e1 * share, e2 * share
    H, t = fall - h, water.tangent[row]
    if math.isnan(t):
        t = water.tangent[row] = _air_tangent(H, h, D, water.refraction)
    Q = H * t
    return e0 * Q - up0 * H, e1 * Q - up1 * H, e2 * Q - up2 * H, e0, e1, e2, H, t


@inlined
def through_water(
    row: int, water: Water, e0: float, e1: float, e2: float, H: float, t: float, B: FloatArray, A: FloatArray,
    by_station: bool,
) -> None:  # fmt: skip
    """Turn partials B (2, 3) of an image by v to those by the point; set those by the camera, the first of A.

    And the last ones of A (2, 7), those by the level of the photo, where that is unknown. The products with the
    matrices K of `refraction.flat.incidence` are taken apart, K b = kappa e e'b + Q/D (1 - e e' - u u') b.
    """
    up0, up1, up2 = water.normal[row, 0], water.normal[row, 1], water.normal[row, 2]
    kappa, ratio, Q_H, Q_h, _ = slopes(t, H, water.depth[row], water.refraction)
    for c in range(2):
        b0, b1, b2 = B[c, 0], B[c, 1], B[c, 2]
        along, rise = b0 * e0 + b1 * e1 + b2 * e2, b0 * up0 + b1 * up1 + b2 * up2
        of_e, of_up = (kappa - ratio) * along, ratio * rise
        k0 = ratio * b0 + of_e * e0 - of_up * up0
        k1 = ratio * b1 + of_e * e1 - of_up * up1
        k2 = ratio * b2 + of_e * e2 - of_up * up2
        by_h, by_H = along * Q_h, along * Q_H - rise
        B[c, 0], B[c, 1], B[c, 2] = k0 - by_h * up0, k1 - by_h * up1, k2 - by_h * up2
        if by_station:
            A[c, 0], A[c, 1], A[c, 2] = by_H * up0 - k0, by_H * up1 - k1, by_H * up2 - k2
            if len(water.rise):  # what rises is the level: both camera and ground sink
                A[c, -1] = (by_h - by_H) * water.rise[row]
