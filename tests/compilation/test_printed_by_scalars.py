"""(5.1) to (5.26) of ETL-0306 once more, number by number as they stand there, misprints put right.

A second implementation, by scalars and the normal equations solved by determinants: what the formulas of arrays say
must be the same.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from compilation.scenes import curved_images, grid, pair
from musatpy.compilation.printed import AS_1983, printed_points, true_coordinates
from musatpy.compilation.stereomodels import set_up

Triple = tuple[float, float, float]


def water_point(B: Triple, P: Triple, Zw: float) -> tuple[float, float]:
    """(5.1) to (5.4), with products in the place of the printed sums, and By2 in (5.4)."""
    part = (B[2] - Zw) / (B[2] - P[2])
    return B[0] + part * (P[0] - B[0]), B[1] + part * (P[1] - B[1])


def ray(B: Triple, P: Triple, Zw: float, n: float) -> tuple[float, float, float, float]:
    """Return r13, r23 of (5.17a) to (5.17d), and the right sides of (5.17): X - r13 Z = a1, Y - r23 Z = a2."""
    Xw, Yw = water_point(B, P, Zw)
    D = math.sqrt((Xw - B[0]) ** 2 + (Yw - B[1]) ** 2)  # (5.5), (5.6)
    i = math.atan(D / (B[2] - Zw))  # (5.7), (5.8)
    r = math.asin(math.sin(i) / n)  # (5.9), (5.10)
    k = math.tan(r) / D if D else 0.0  # (5.11), (5.12), each photo its own
    r13, r23 = -k * (Xw - B[0]), -k * (Yw - B[1])
    return r13, r23, Xw - r13 * Zw, Yw - r23 * Zw


def true_point(B: tuple[Triple, Triple], P: tuple[Triple, Triple], Zw: tuple[float, float], n: float) -> Triple:
    """(5.18) to (5.26): the least squares of four equations in X, Y and Z, by Cramer's rule."""
    (r13, r23, a1, a2), (s13, s23, b1, b2) = (ray(*args, n) for args in zip(B, P, Zw, strict=True))
    rows = [
        (2.0, 0.0, -(r13 + s13), a1 + b1),
        (0.0, 2.0, -(r23 + s23), a2 + b2),
        (
            -(r13 + s13),
            -(r23 + s23),
            r13**2 + s13**2 + r23**2 + s23**2,
            -(r13 * a1 + s13 * b1 + r23 * a2 + s23 * b2),  # c3 = Q, and not 0 as printed
        ),
    ]

    def determinant(*columns: int) -> float:
        a, b, c = ([row[column] for row in rows] for column in columns)
        return (
            a[0] * (b[1] * c[2] - b[2] * c[1])
            - b[0] * (a[1] * c[2] - a[2] * c[1])
            + c[0] * (a[1] * b[2] - a[2] * b[1])
        )

    whole = determinant(0, 1, 2)
    return determinant(3, 1, 2) / whole, determinant(0, 3, 2) / whole, determinant(0, 1, 3) / whole


def triples(points: np.ndarray) -> list[Triple]:
    return [(float(x), float(y), float(z)) for x, y, z in points]


def test_the_formulas_of_arrays_are_those_of_the_report() -> None:
    """Of 300 pairs of rays, of which neither meets the other: to the rounding of some kilometres."""
    draws = np.random.default_rng(51)
    B = draws.uniform([-100.0, -100.0, 2900.0], [100.0, 100.0, 3100.0], (300, 2, 3))
    B[:, 1, 0] += 1800.0
    P = draws.uniform([200.0, -1500.0, -30.0], [1600.0, 1500.0, -1.0], (300, 1, 3)) + draws.normal(size=(300, 2, 3))
    P[..., 2] = P[:, :1, 2]
    water, n = draws.uniform(-0.5, 0.5, (300, 2)), 1.34
    expected = [
        true_point(tuple(triples(b)), tuple(triples(p)), (float(w[0]), float(w[1])), n)  # type: ignore[arg-type]
        for b, p, w in zip(B, P, water, strict=True)
    ]
    np.testing.assert_allclose(true_coordinates(B, P, water, n), expected, rtol=0, atol=1e-8)


def test_a_point_below_a_camera_has_no_direction_of_bending() -> None:
    """D is zero: the formulas divide by it, and the ray goes straight down."""
    B, P, water = (
        np.array([[[0.0, 0, 3000], [0, 0, 3000]]]),
        np.array([[[0.0, 0, -9], [500, 0, -9]]]),
        np.zeros((1, 2)),
    )
    left, right = triples(B[0]), triples(P[0])
    expected = true_point((left[0], left[1]), (right[0], right[1]), (0.0, 0.0), 1.34)
    np.testing.assert_allclose(true_coordinates(B, P, water, 1.34)[0], expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("tides", [(0.0, 0.0), (0.4, -0.3)])
def test_the_program_of_1983_to_the_letter(tides: tuple[float, float]) -> None:
    """One model point, one vertical and one height of water, over a sphere."""
    stereo = set_up(pair(2400.0, 1500.0, tides, sphere=True), "1", "2")
    _, xy = curved_images(stereo, grid((0.0, 1500.0), 1300.0, 5), 20.0)
    shared = stereo.half_way(xy)
    water = float(np.mean(tides)) - float(stereo.run.frame.height(stereo.origin[None])[0])
    cameras = triples(stereo.stations)
    expected = [
        true_point((cameras[0], cameras[1]), (point, point), (water, water), 1.34) for point in triples(shared)
    ]
    np.testing.assert_allclose(printed_points(stereo, xy, AS_1983), expected, rtol=0, atol=1e-8)
