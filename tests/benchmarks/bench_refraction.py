"""Incidence points: the vectorised Newton against a Python loop of the bisection of 1983, in the same run.

Run as a script it prints the rates; run by pytest it asserts that Newton does at least 200 times as many points
per second.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from musatpy.refraction.flat import air_tangent, incidence, water_vector
from reference.rays import incidence_distance

POINTS, LOOPED, REPEATS = 1_000_000, 5_000, 5


def rate(function, points: int) -> float:
    """Return points per CPU second of the best of some repeats."""
    best = np.inf
    for _ in range(REPEATS):
        start = time.process_time()
        function()
        best = min(best, time.process_time() - start)
    return points / best


def rays() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return heights of cameras, depths and distances of simulated rays."""
    rng = np.random.default_rng(1)
    return rng.uniform(2500, 3500, POINTS), rng.uniform(0.1, 30, POINTS), rng.uniform(0, 2500, POINTS)


def rates(tolerance: float) -> tuple[float, float]:
    """Return points per second of the loop that bisects to `tolerance` (m), and of Newton's method to rounding."""
    H, h, D = rays()
    some = list(zip(H[:LOOPED], h[:LOOPED], D[:LOOPED], strict=True))
    loop = rate(lambda: [incidence_distance(*row, 1.34, tolerance) for row in some], LOOPED)
    return loop, rate(lambda: air_tangent(H, h, D, 1.34), POINTS)


def test_newton_is_200_times_the_loop() -> None:
    loop, newton = rates(1e-2)  # the coarser of the two: the loop is at its fastest
    assert newton >= 200 * loop


def main() -> None:
    for tolerance in (1e-2, 1e-6):
        loop, newton = rates(tolerance)
        print(
            f"bisection to {tolerance:g} m: {loop:,.0f}/s; Newton to rounding: {newton:,.0f}/s; "
            f"ratio {newton / loop:.0f}"
        )
    H, h, D = rays()
    camera = np.zeros((POINTS, 3))
    camera[:, 2] = H
    ground = np.stack([D, 0.0 * D, -h], axis=-1)
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), ground.shape)
    loop, _ = rates(1e-2)
    for function, words in (
        (incidence, "with all partial derivatives"),
        (water_vector, "without partial derivatives"),
    ):
        full = rate(lambda function=function: function(camera, ground, up, h, 1.34), POINTS)
        print(f"incidence points {words}: {full:,.0f}/s; of the loop to 0.01 m {full / loop:.0f}")


if __name__ == "__main__":
    main()
