"""Orientation through water from nothing, against scipy's least squares on the bundle of the same images.

The peer has numerical derivatives and everything that saves it work: it starts next to the truth, at true points.
Run as a script it prints processor times of all methods and how many starts are adjusted per second side by side;
run by pytest it asserts equal minima, and that models of pairs and triplets come 20 times as fast as the peer's.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from musatpy.geometry.rotations import attitude_matrix
from musatpy.orientation.twomedia.helmert import adjust
from musatpy.orientation.twomedia.oriented import orient
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Plane, Sights, problem_of
from musatpy.refraction.flat import air_tangent
from orientation.twomedia.geometries import HOUSE, KINDS, Scene, geometry, points_of, scene, sights_of, truth_of
from orientation.twomedia.methods import METHODS

POINTS = {"SINGLE-RAY": 20, "SINGLE-FERMAT": 20}  # 100 in the others
CONTROL = {"SINGLE-RAY": 20, "SINGLE-FERMAT": 20, "COMBINED": 8}
REPEATS, STARTS = 5, 100


def problem(name: str, method: str) -> tuple[Scene, Sights]:
    """Return the geometry of a method with many points, and its images with noise."""
    kind, photos = KINDS[name], geometry(name, method)
    shift = kind.B / 2 if method == "TRIPLET" else 0.0
    true = scene(kind, points_of(kind, 12, POINTS.get(method, 100), shift), photos.stations, photos.angles)
    sights = sights_of(true, CONTROL.get(method, 0))
    noise = np.random.default_rng(1).normal(size=sights.image.shape) * sights.image_sigma
    return true, replace(sights, image=sights.image + noise)


def images(at: Orientation, X: np.ndarray) -> np.ndarray:
    """Return the tangents (m, p, 2) of points (p, 3) below the water on the photos of an orientation."""
    n = np.array([*-at.slope, 1.0]) / np.sqrt(1.0 + at.slope @ at.slope)
    gap = X - at.station[:, None]
    height = (at.station - [0.0, 0.0, at.level]) @ n
    fall = -gap @ n
    across = gap + fall[..., None] * n
    D = np.linalg.norm(across, axis=-1)
    t = air_tangent(np.broadcast_to(height[:, None], D.shape), fall - height[:, None], D, at.index)
    ray = (across * (t / D)[..., None] - n) @ np.swapaxes(attitude_matrix(at.attitude), 1, 2)
    return -ray[..., :2] / ray[..., 2:]


def seconds(function: Callable[[], object], repeats: int) -> float:
    """Return the processor time of the best of some repeats."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return min(times)


def disturbed(true: Scene, unknown: np.ndarray, starts: int) -> Orientation:
    """Return the truth with errors of 5 degrees, a tenth of the height, and slopes of .05 (one sigma)."""
    at, H = truth_of(true), true.kind.H
    sigma = np.array(([np.radians(5.0)] * 3 + [0.1 * H] * 3) * at.photos + [0.05, 0.05, 0.1 * H, 0.0])
    errors = np.random.default_rng(2).normal(size=(starts, len(sigma)))
    return Orientation.of(at.vector + errors * sigma * unknown)


def by_least_squares(true: Scene, sights: Sights, start: Orientation, unknown: np.ndarray) -> float:
    """Return the least squares of the peer: unknowns are the orientation and the points without control."""
    vector, X = start.vector[0].copy(), true.points * HOUSE
    new, count = ~sights.is_control, int(unknown.sum())
    measured = sights.image.reshape(len(sights.photos), -1, 2)
    sigma = sights.image_sigma.reshape(measured.shape)

    def residuals(values: np.ndarray) -> np.ndarray:
        vector[unknown], X[new] = values[:count], values[count:].reshape(-1, 3)
        return ((images(Orientation.of(vector), X) - measured) / sigma).ravel()

    values = np.concatenate([vector[unknown], X[new].ravel()])
    return 2.0 * float(least_squares(residuals, values, x_scale="jac", ftol=1e-10, xtol=1e-10, gtol=1e-10).cost)


def compared(name: str, method: str) -> tuple[float, float]:
    """Return the processor times of the orientation from nothing and of the peer, at one minimum."""
    true, sights = problem(name, method)
    adjustment = problem_of(sights, METHODS[method], Plane())
    squares = []
    ours = seconds(lambda: orient(sights, METHODS[method], Plane(), true.kind.B), REPEATS)
    start = disturbed(true, adjustment.unknown, 1)
    peer = seconds(lambda: squares.append(by_least_squares(true, sights, start, adjustment.unknown)), 1)
    oriented = orient(sights, METHODS[method], Plane(), true.kind.B)
    # differences for derivatives leave the peer at a slope of about 1e-8
    assert oriented.adjusted.squares[0] == pytest.approx(squares[0], rel=1e-6)
    return ours, peer


@pytest.mark.parametrize("method", ["PAIR-INDEPENDENT", "PAIR-SUCCESSIVE", "TRIPLET"])
def test_models_come_20_times_as_fast_as_the_peers(method: str) -> None:
    ours, peer = compared("lab", method)
    assert peer >= 20.0 * ours


def main() -> None:
    for name in KINDS:
        for method in METHODS:
            ours, peer = compared(name, method)
            true, sights = problem(name, method)
            adjustment = problem_of(sights, METHODS[method], Plane())
            starts = disturbed(true, adjustment.unknown, STARTS)
            side_by_side = seconds(lambda: adjust(adjustment, starts), 1)  # noqa: B023 it is called at once
            print(
                f"{name:7}{method:17}{len(true.points):4} points: {1e3 * ours:5.0f} ms from nothing, peer "
                f"{1e3 * peer:6.0f} ms, ratio {peer / ours:4.0f}; {STARTS} starts in {side_by_side:.2f} s"
            )


if __name__ == "__main__":
    main()
