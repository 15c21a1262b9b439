"""Space resection from three points and more, vertical and oblique, among gross errors."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.geometry import collinearity
from musatpy.geometry.rotations import attitude_matrix
from musatpy.orientation.resection import image_errors, resection

UP = np.array([0.0, 0.0, 1.0])
C = np.array([1000.0, 2000.0, 3000.0])
CORNERS = np.array([[-0.6, -0.5], [0.55, -0.6], [0.6, 0.6], [-0.5, 0.6], [0.0, 0.1]])


def photo(points: int, tilt: float, relief: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return tangents, ground points and M of a photo at C; the first points are spread over the plate."""
    rng = np.random.default_rng(seed)
    M = attitude_matrix([*rng.uniform(-tilt, tilt, 2), rng.uniform(-np.pi, np.pi)])
    x = np.concatenate([CORNERS, rng.uniform(-0.6, 0.6, (max(points - 5, 0), 2))])[:points]
    ray = np.concatenate([x, -np.ones((points, 1))], axis=1) @ M
    X = C + ray * ((relief * rng.normal(size=points) - 1.0) * 3000.0 / ray[:, 2])[:, None]
    return collinearity.image(X - C, M, np.ones(points), np.zeros(2)), X, M


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("points", "tilt"), [(3, 0.02), (4, 0.1), (5, 0.35), (12, 0.35)])
@pytest.mark.parametrize("relief", [0.0, 0.05])
def test_exact_images_give_the_station(points: int, tilt: float, relief: float, seed: int) -> None:
    x, X, M = photo(points, tilt, relief, seed)
    found = resection(x, X, UP, 7e-5)
    assert found is not None
    np.testing.assert_allclose(found.C, C, atol=1e-4)  # m: rounding, times the worst condition of three points
    np.testing.assert_allclose(found.M, M, atol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_gross_errors_do_not_draw_the_station(seed: int) -> None:
    x, X, _ = photo(20, 0.3, 0.02, seed)
    rng = np.random.default_rng(seed)
    x = x + rng.normal(0.0, 7e-5, x.shape)
    wrong = rng.choice(20, 4, replace=False)
    x[wrong] += rng.choice([-1.0, 1.0], (4, 2)) * rng.uniform(0.01, 0.3, (4, 2))
    found = resection(x, X, UP, 7e-5)
    assert found is not None
    assert (found.weight[wrong] < 0.1).all()
    assert np.linalg.norm(found.C - C) < 5.0 * found.sigma  # no station beyond five sigmas


def test_too_few_points_or_points_on_a_line_give_no_sure_station() -> None:
    x, X, _ = photo(2, 0.02, 0.0, 1)
    assert resection(x, X, UP, 7e-5) is None
    line = np.stack([np.linspace(-0.5, 0.5, 5), np.zeros(5)], axis=1)
    ground = np.column_stack([3000.0 * line, np.zeros(5)])
    found = resection(line, ground, UP, 7e-5)
    assert found is None or found.sigma > 1000.0


def test_the_partials_of_the_images() -> None:
    x, X, M = photo(6, 0.3, 0.05, 3)
    _, J = image_errors(x, X, M, C)
    for column in range(6):
        step = np.eye(6)[column]
        size = 1e-2 if column < 3 else 1e-6  # m, rad
        ends = []
        for sign in (1.0, -1.0):
            w = sign * size * step[3:]
            turn = np.eye(3) + np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
            ends.append(image_errors(x, X, turn @ M, C + sign * size * step[:3])[0])
        numerical = (ends[0] - ends[1]) / (2.0 * size)
        np.testing.assert_allclose(J[..., column], numerical, atol=1e-9)  # rounding 1e-16 / size, and size squared
