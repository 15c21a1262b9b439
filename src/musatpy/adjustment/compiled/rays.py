"""Single rays in registers: straight ones to a point with its image, and those through level water, with partials.

The numpy twins are `geometry.collinearity` and `refraction.flat`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from musatpy.adjustment.compiled.compiler import inlined
from musatpy.arrays import FloatArray, IntArray

_MAX_STEPS = 60


class Stations(NamedTuple):
    """n photos where they are."""

    position: FloatArray  # (n, 3) working
    M: FloatArray  # (n, 3, 3) working axes to photo
    axes: FloatArray  # (n, 3, 3) east, north, up, along which positions are corrected
    turn: FloatArray  # (n, 2) cosine and sine of kappa
    focal_length: FloatArray  # (n,) mm
    principal_point: FloatArray  # (n, 2) mm


class Measured(NamedTuple):
    """k points one after the other, and their r images: those of point p are `start[p]` to `start[p + 1]`."""

    point: IntArray  # (k,) rows of the ground
    start: IntArray  # (k + 1,)
    photo: IntArray  # (r,)
    xy: FloatArray  # (r, 2) mm
    root: FloatArray  # (r, 2) 1/mm, of the weights
    ground: FloatArray  # (k, 3) working, of the points: those of one photo stand together


class Water(NamedTuple):
    """Level water over the w rays that it refracts."""

    row: IntArray  # (r,) of the ray among those, -1 where it is dry
    normal: FloatArray  # (w, 3)
    depth: FloatArray  # (w,) m, of the points
    tangent: FloatArray  # (w,) of the angle in air, NaN until it is asked for: it stays as camera and point do
    rise: FloatArray  # (w,) m of depth by one of the level of the photo
    refraction: float  # index of the water
    unknowns: tuple[int, ...]  # as many as a station has: loops are compiled for their number


@inlined
def image_off(r: int, at: Measured, stations: Stations, v0: float, v1: float, v2: float) -> tuple[float, float]:
    """Return the residuals of image r in mm, of a vector v from its camera: `geometry.collinearity.image`."""
    n, M = at.photo[r], stations.M
    x = M[n, 0, 0] * v0 + M[n, 0, 1] * v1 + M[n, 0, 2] * v2
    y = M[n, 1, 0] * v0 + M[n, 1, 1] * v1 + M[n, 1, 2] * v2
    scale = -stations.focal_length[n] / (M[n, 2, 0] * v0 + M[n, 2, 1] * v1 + M[n, 2, 2] * v2)
    return (
        scale * x + stations.principal_point[n, 0] - at.xy[r, 0],
        scale * y + stations.principal_point[n, 1] - at.xy[r, 1],
    )


@inlined
def to_point(r: int, p: int, at: Measured, stations: Stations) -> tuple[float, float, float, bool]:
    """Return the vector from the camera of image r to point p, and whether that sees it."""
    n, X, P, M = at.photo[r], at.ground, stations.position, stations.M
    v0, v1, v2 = X[p, 0] - P[n, 0], X[p, 1] - P[n, 1], X[p, 2] - P[n, 2]
    return v0, v1, v2, M[n, 2, 0] * v0 + M[n, 2, 1] * v1 + M[n, 2, 2] * v2 < 0.0


@inlined
def _newton_step(t: float, H: float, h: float, D: float, n: float) -> float:
    """Return a step of tan(I) to the ray that reaches the point: `flat.air_tangent`, ETL-0306 (4.10).

    Multiplied by the root that it has, which leaves one division.
    """
    n2 = n * n
    square = n2 + (n2 - 1.0) * t * t
    root = math.sqrt(square)
    return square * (root * (D - t * H) - t * h) / (H * square * root + h * n2)


@inlined
def _slopes(t: float, H: float, h: float, n: float) -> tuple[float, float, float, float]:
    """Return kappa, Q/D and the partials of Q by H and h, docs/theory.md: those of `flat.incidence`.

    Its fractions by 1/cos^3(I), with the root n cos(theta)/cos(I): one square root in place of three.
    """
    n2, square = n * n, n * n + (n * n - 1.0) * t * t
    root = math.sqrt(square)
    of_air, of_water = h * n2, H * square * root
    share = 1.0 / (of_air + of_water)
    kappa = of_water * share
    return (
        kappa,
        H * root / (H * root + h),
        t * of_air * share,
        -t * kappa / root,
    )


@inlined
def _air_tangent(H: float, h: float, D: float, n: float) -> float:
    """Return tan(I) of a ray to the water: `refraction.flat.air_tangent`, ETL-0306 (4.10).

    A step leaves no more than its square: what is below 1e-9 ends at rounding.
    """
    t = D / (H + h / n)
    for _ in range(_MAX_STEPS):
        step = _newton_step(t, H, h, D, n)
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
    kappa, ratio, Q_H, Q_h = _slopes(t, H, water.depth[row], water.refraction)
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
            if len(water.unknowns) > 6:  # what rises is the level: both camera and ground sink
                A[c, -1] = (by_h - by_H) * water.rise[row]
