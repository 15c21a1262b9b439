"""Relative orientation of pairs over flat ground and relief, vertical and oblique, with gross errors."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.geometry import collinearity
from musatpy.geometry.rotations import attitude_matrix
from musatpy.orientation.relative import coplanarity, model_points, relative_orientations

NOISE = 7e-5  # tangent: 10 micrometres at 152 mm
PAIRS = 60


def pairs(
    points: int, tilt: float, relief: float, noise: float, blunders: float, oblique: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return tangents of `PAIRS` pairs at flying height 1, base 0.6 and any headings, and their true R and b."""
    rng = np.random.default_rng(points)
    attitude = np.concatenate(
        [rng.normal(0.0, tilt, (2, PAIRS, 2)), rng.uniform(-np.pi, np.pi, (2, PAIRS, 1))], axis=2
    )
    attitude[..., 0] += oblique
    M1, M2 = attitude_matrix(attitude)
    flight = rng.uniform(-np.pi, np.pi, PAIRS)
    base = np.stack([0.6 * np.cos(flight), 0.6 * np.sin(flight), rng.normal(0.0, 0.03, PAIRS)], axis=1)
    X = np.empty((PAIRS, points, 3))
    X[..., :2] = rng.uniform(-0.45, 0.45, (PAIRS, points, 2)) + 0.5 * base[:, None, :2]
    X[..., 1] += np.tan(oblique)
    X[..., 2] = relief * rng.uniform(-1.0, 1.0, (PAIRS, points)) - 1.0
    one, origin = np.ones((PAIRS, points)), np.zeros(2)
    x1 = collinearity.image(X, M1[:, None], one, origin) + rng.normal(0.0, noise, (PAIRS, points, 2))
    x2 = collinearity.image(X - base[:, None], M2[:, None], one, origin)
    x2 = x2 + rng.normal(0.0, noise, x2.shape)
    wrong = rng.random((PAIRS, points)) < blunders
    x2[wrong] += rng.uniform(-0.03, 0.03, (int(wrong.sum()), 2))  # to 5 mm
    b = np.einsum("kij,kj->ki", M1, base)
    return x1, x2, M2 @ np.swapaxes(M1, 1, 2), b / np.linalg.norm(b, axis=1, keepdims=True)


def angles(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return the angles between rotations (k, 3, 3)."""
    return np.linalg.norm(found - true, axis=(1, 2)) / np.sqrt(2.0)


@pytest.mark.slow
@pytest.mark.parametrize("relief", [0.0, 0.02, 0.1])
@pytest.mark.parametrize(("tilt", "oblique"), [(0.03, 0.0), (0.03, 0.5), (0.2, 0.0)])
def test_exact_images_give_the_exact_orientation(relief: float, tilt: float, oblique: float) -> None:
    x1, x2, R, b = pairs(20, tilt, relief, 0.0, 0.0, oblique)
    found = relative_orientations(x1, x2, np.ones(x1.shape[:2]), NOISE)
    assert found.is_sound.all()
    # the last step of a Gauss-Newton that converges quadratically
    assert angles(found.rotation, R).max() < 1e-6
    assert np.linalg.norm(found.base - b, axis=1).max() < 1e-6


@pytest.mark.parametrize("relief", [0.0, 0.05])
@pytest.mark.parametrize("oblique", [0.0, 0.5])
def test_gross_errors_do_not_draw_the_orientation(relief: float, oblique: float) -> None:
    x1, x2, R, b = pairs(30, 0.03, relief, NOISE, 0.05, oblique)
    found = relative_orientations(x1, x2, np.ones(x1.shape[:2]), NOISE)
    assert found.is_sound.all()
    # five times the size of the error that the orientation says of itself (no pair of 60 beyond five sigmas)
    assert (angles(found.rotation, R) < 5.0 * found.sigma).all()
    assert (np.linalg.norm(found.base - b, axis=1) < 5.0 * found.sigma).all()
    assert np.median(found.sigma) < 2e-3


def test_absent_points_do_not_count() -> None:
    x1, x2, R, _ = pairs(20, 0.03, 0.02, 0.0, 0.0)
    weight = np.ones(x1.shape[:2])
    weight[:, 12:] = 0.0
    x1[:, 12:], x2[:, 12:] = 0.0, 0.7
    found = relative_orientations(x1, x2, weight, NOISE)
    assert angles(found.rotation, R).max() < 1e-6
    assert (found.weight[:, 12:] == 0.0).all()


def test_five_points_are_trusted_only_over_level_ground() -> None:
    x1, x2, R, _ = pairs(5, 0.03, 0.02, 0.0, 0.0)
    found = relative_orientations(x1, x2, np.ones(x1.shape[:2]), NOISE)
    wrong = angles(found.rotation, R) > 0.3
    assert not (found.is_sound & (found.sigma < 0.02) & wrong).any()
    assert (found.is_sound & ~wrong).mean() > 0.5


def test_model_points_are_the_points() -> None:
    x1, x2, R, b = pairs(10, 0.03, 0.1, 0.0, 0.0)
    X, distance = model_points(x1, x2, R, b)
    np.testing.assert_allclose(X[..., :2] / -X[..., 2:], x1, atol=1e-12)  # rounding
    seen = np.einsum("kij,kmj->kmi", R, X - b[:, None])
    np.testing.assert_allclose(seen[..., :2] / -seen[..., 2:], x2, atol=1e-12)
    assert (distance > 0).all()


def test_the_partials_of_the_coplanarity() -> None:
    """The weighting is held, as the docstring says: the partials are those of the volume over its size."""
    x1, x2, R, b = pairs(8, 0.1, 0.1, 1e-3, 0.0)
    residual, partials = coplanarity(x1, x2, R, b)
    u1 = np.concatenate([x1, -np.ones((*x1.shape[:2], 1))], axis=2)
    v = np.concatenate([x2, -np.ones((*x2.shape[:2], 1))], axis=2) @ R

    def volume(w: np.ndarray, base: np.ndarray) -> np.ndarray:
        return np.einsum("ki,kmi->km", base, np.cross(u1, v + np.cross(w, v)))

    size = volume(np.zeros(3), b) / residual
    for column in range(6):
        step = 1e-6 * np.eye(6)[column]
        high = volume(step[:3], b + step[3:])
        low = volume(-step[:3], b - step[3:])
        # the volume is bilinear: a central difference has rounding only, 1e-16 / 1e-6
        np.testing.assert_allclose(partials[..., column], (high - low) / 2e-6 / size, atol=1e-8)
