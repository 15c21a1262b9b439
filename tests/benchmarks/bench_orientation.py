"""Orientation through water from nothing, against scipy's least squares on the bundle of the same images.

The peer has numerical derivatives, starts next to the truth and has the true points. Run as a script it prints
processor times of all methods: from nothing, from the start of the peer, and from 100 starts side by side; run by
pytest it asserts equal minima. Both are for one thread (OPENBLAS_NUM_THREADS=1): more only add to the peer's times.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.orientation.twomedia.helmert import adjust
from musatpy.orientation.twomedia.oriented import orient
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Sights, WaterPlane, problem_of
from musatpy.orientation.twomedia.strip import orient_strip
from musatpy.refraction.flat import air_tangent
from orientation.twomedia.geometries import (
    HOUSE,
    KINDS,
    METHODS,
    Scene,
    corners,
    geometry,
    points_of,
    scene,
    sights_of,
    strip_scene,
    strip_sights,
    truth_of,
)

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


def timed(function: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Return the processor time of the best of some repeats, and the result."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        result = function()
        times.append(time.process_time() - start)
    return min(times), result


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


def compared(name: str, method: str) -> tuple[float, float, float]:
    """Return the times of the orientation from nothing, of the adjustment and of the peer from one start.

    All three end in one minimum.
    """
    true, sights = problem(name, method)
    adjustment = problem_of(sights, METHODS[method], WaterPlane())
    start = disturbed(true, adjustment.unknown, 1)
    nothing, oriented = timed(lambda: orient(sights, METHODS[method], WaterPlane(), true.kind.B), REPEATS)
    ours, adjusted = timed(lambda: adjust(adjustment, start), REPEATS)
    peer, squares = timed(lambda: by_least_squares(true, sights, start, adjustment.unknown), 1)
    # differences for derivatives leave the peer at a slope of about 1e-8
    assert oriented.adjusted.squares[0] == pytest.approx(squares, rel=1e-6)
    assert adjusted.squares[0] == pytest.approx(squares, rel=1e-6)
    return nothing, ours, peer


@pytest.mark.parametrize("method", METHODS)
def test_all_end_in_one_minimum(method: str) -> None:
    compared("lab", method)


def strip_time(photos: int, control: int) -> float:
    """Return the processor time a photo of a strip of the laboratory, of 100 points a photo and some control."""
    true = strip_scene("lab", photos, 100)
    rows = np.linspace(0, len(true.points) - 1, control, dtype=int)
    sights, _ = strip_sights(true, 1.0, control=corners(true) + rows.tolist())
    return timed(lambda: orient_strip(sights, WaterPlane()), 1)[0] / photos


def main() -> None:
    _, _, peer = compared("lab", "TRIPLET")
    for photos, control in ((50, 0), (200, 0), (200, 100), (1000, 0)):
        ours = strip_time(photos, control)
        print(
            f"lab STRIP of {photos:4} photos, {control + 6:3} control points: {1e3 * ours:4.0f} ms a photo, "
            f"ratio to a triplet of the peer {peer / ours:3.0f}"
        )
    for name in KINDS:
        for method in METHODS:
            nothing, ours, peer = compared(name, method)
            true, sights = problem(name, method)
            adjustment = problem_of(sights, METHODS[method], WaterPlane())
            starts = disturbed(true, adjustment.unknown, STARTS)
            side_by_side, _ = timed(lambda: adjust(adjustment, starts), 1)  # noqa: B023 it is called at once
            print(
                f"{name:7}{method:17}{len(true.points):4} points: {1e3 * nothing:4.0f} ms from nothing; one start "
                f"{1e3 * ours:4.1f} ms, peer {1e3 * peer:4.0f} ms, ratio {peer / ours:3.0f}; {STARTS} starts "
                f"{side_by_side:.2f} s, ratio {STARTS * peer / side_by_side:3.0f}"
            )


if __name__ == "__main__":
    main()
