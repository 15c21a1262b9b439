"""The closed-form similarity against known ones, with weights and among gross errors."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.geometry.rotations import attitude_matrix
from musatpy.geometry.similarity import Similarity, fit, fit_robust

TRUE = Similarity(scale=2.5, rotation=attitude_matrix([0.4, -0.7, 2.9]), shift=np.array([10.0, -20.0, 5.0]))


def cloud(count: int, flat: bool = False) -> np.ndarray:
    x = np.random.default_rng(count).normal(size=(count, 3))
    return x * [1.0, 1.0, 0.0] if flat else x


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("count", [3, 4, 20])
def test_exact_points_give_the_exact_similarity(count: int, flat: bool) -> None:
    x = cloud(count, flat)
    found = fit(x, TRUE.apply(x), np.ones(count))
    assert found.scale == pytest.approx(TRUE.scale, rel=1e-12)  # rounding
    np.testing.assert_allclose(found.rotation, TRUE.rotation, atol=1e-12)
    np.testing.assert_allclose(found.shift, TRUE.shift, atol=1e-12)


def test_a_mirror_image_is_not_a_rotation() -> None:
    x = cloud(10)
    found = fit(x, x * [1.0, 1.0, -1.0], np.ones(10))
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


def test_weights_are_repetitions() -> None:
    rng = np.random.default_rng(3)
    x = cloud(6)
    y = TRUE.apply(x) + rng.normal(0.0, 0.1, x.shape)
    weight = np.array([1, 2, 3, 1, 1, 2])
    weighted = fit(x, y, weight.astype(float))
    repeated = fit(np.repeat(x, weight, axis=0), np.repeat(y, weight, axis=0), np.ones(weight.sum()))
    np.testing.assert_allclose(weighted.apply(x), repeated.apply(x), atol=1e-12)  # rounding


@pytest.mark.parametrize("count", [6, 10, 50])
def test_gross_errors_do_not_draw_it(count: int) -> None:
    x, rng = cloud(count), np.random.default_rng(count)
    y = TRUE.apply(x)
    wrong = rng.choice(count, count // 4, replace=False)
    y[wrong] += rng.choice([-1.0, 1.0], (len(wrong), 3)) * rng.uniform(1.0, 100.0, (len(wrong), 3))
    found, weight = fit_robust(x, y, np.ones(count), 1e-3)
    assert (weight[wrong] < 0.01).all()
    np.testing.assert_allclose(found.apply(x), TRUE.apply(x), atol=1e-3)  # the least error that counts


def test_inverse_and_composition() -> None:
    other = Similarity(scale=0.3, rotation=attitude_matrix([1.0, 0.2, 0.1]), shift=np.array([1.0, 2.0, 3.0]))
    x = cloud(5)
    np.testing.assert_allclose(TRUE.inverse().apply(TRUE.apply(x)), x, atol=1e-12)  # rounding
    np.testing.assert_allclose(other.after(TRUE).apply(x), other.apply(TRUE.apply(x)), atol=1e-12)
    M = attitude_matrix([0.1, 0.2, 0.3])
    np.testing.assert_allclose(
        TRUE.turn(M) @ (TRUE.apply(x[0]) - TRUE.apply(x[1])), TRUE.scale * M @ (x[0] - x[1]), atol=1e-12
    )
