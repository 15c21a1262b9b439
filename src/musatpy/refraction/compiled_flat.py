"""The pieces of a ray through level water for compiled loops; the numpy twin is `refraction.flat`."""

from __future__ import annotations

import math

from musatpy.compiling import inlined

MAX_STEPS = 60


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
