"""Rays through level water compiled: the pieces of one ray, and many rays with all partials.

The numpy twin is `refraction.flat`.
"""

from __future__ import annotations

import math

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compiling import compiled, inlined
from musatpy.refraction.flat import Rays

MAX_STEPS = 60
CHUNK = 32768  # rays of a call: copies of them stay in the cache
_BLOCK = 256  # rays at a time: what is known of them stays in the first-level cache


@inlined
def newton_step(t: float, H: float, h: float, D: float, n: float) -> float:
    """Return a step of tan(I) to the ray that reaches the point: `flat.air_tangent`, ETL-0306 (4.10).

    Multiplied by the root that it has, which leaves one division.
    """
    n2 = n * n
    square = n2 + (n2 - 1.0) * t * t
    root = math.sqrt(square)
    return square * (root * (D - t * H) - t * h) / (H * square * root + h * n2)


@inlined
def slopes(t: float, H: float, h: float, n: float) -> tuple[float, float, float, float, float]:
    """Return kappa, Q/D and the partials of Q by H, h and n, docs/theory.md: those of `flat.incidence`.

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
        t * H * h * n * (1.0 + t * t) * share,
    )


@compiled
def set_incidence(
    rays: Rays,
    v: FloatArray,
    by_camera: FloatArray,
    by_ground: FloatArray,
    by_level: FloatArray,
    by_index: FloatArray,
) -> None:
    """Set what `flat.Incidence` has of rays.

    They go in blocks through short loops over rows of their own, which become vector instructions.
    """
    e0, e1, e2, u0, u1, u2, H, h, n, D, t, kappa, ratio, Q_H, Q_h, Q_n = np.empty((16, _BLOCK))
    for start in range(0, len(rays.depth), _BLOCK):
        size = min(_BLOCK, len(rays.depth) - start)
        for k in range(size):
            r = start + k
            e0[k] = rays.ground[r, 0] - rays.camera[r, 0]
            e1[k] = rays.ground[r, 1] - rays.camera[r, 1]
            e2[k] = rays.ground[r, 2] - rays.camera[r, 2]
            u0[k], u1[k], u2[k] = rays.up[r, 0], rays.up[r, 1], rays.up[r, 2]
            h[k], n[k] = rays.depth[r] if rays.wet[r] else 0.0, rays.refraction[r]
        for k in range(size):
            fall = -(u0[k] * e0[k] + u1[k] * e1[k] + u2[k] * e2[k])
            x, y, z = e0[k] + u0[k] * fall, e1[k] + u1[k] * fall, e2[k] + u2[k] * fall
            distance, height = math.sqrt(x * x + y * y + z * z), fall - h[k]
            share = 1.0 / (distance if distance > 0.0 else 1.0)  # 0 at the nadir
            e0[k], e1[k], e2[k] = x * share, y * share, z * share
            D[k], H[k], t[k] = distance, height, distance / (height + h[k] / n[k])
        for _ in range(MAX_STEPS):
            waiting = 0
            for k in range(size):
                step = newton_step(t[k], H[k], h[k], D[k], n[k])
                t[k] += step
                waiting += H[k] > 0.0 and abs(step) > 1e-8 * abs(t[k])
            if not waiting:
                break
        for k in range(size):  # the convergence is quadratic: one more step ends at rounding
            t[k] += newton_step(t[k], H[k], h[k], D[k], n[k])
            kappa[k], ratio[k], Q_H[k], Q_h[k], Q_n[k] = slopes(t[k], H[k], h[k], n[k])
        for k in range(size):
            r = start + k
            if not rays.wet[r]:
                _set_dry(r, rays, v, by_camera, by_ground, by_level, by_index)
                continue
            x, y, z, a, b, c = e0[k], e1[k], e2[k], u0[k], u1[k], u2[k]  # read once: what is set may be anywhere
            Q, height, along, across = H[k] * t[k], H[k], kappa[k] - ratio[k], ratio[k]
            by_H, by_h, by_n = Q_H[k], Q_h[k], Q_n[k]
            for i in range(3):
                e, u = (x, a) if i == 0 else (y, b) if i == 1 else (z, c)
                v[r, i] = e * Q - u * height
                by_level[r, i] = e * (by_h - by_H) + u
                by_index[r, i] = e * by_n
                for j in range(3):
                    f, w = (x, a) if j == 0 else (y, b) if j == 1 else (z, c)
                    K = along * e * f - across * u * w + (across if i == j else 0.0)
                    by_camera[r, i, j] = (e * by_H - u) * w - K
                    by_ground[r, i, j] = K - e * by_h * w


@inlined
def _set_dry(
    r: int,
    rays: Rays,
    v: FloatArray,
    by_camera: FloatArray,
    by_ground: FloatArray,
    by_level: FloatArray,
    by_index: FloatArray,
) -> None:
    """Set the row of a ray that is straight."""
    for i in range(3):
        v[r, i], by_level[r, i], by_index[r, i] = rays.ground[r, i] - rays.camera[r, i], 0.0, 0.0
        for j in range(3):
            by_ground[r, i, j] = 1.0 if i == j else 0.0
            by_camera[r, i, j] = -by_ground[r, i, j]
