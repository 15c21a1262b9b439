"""Planes of the points about places: exact on a plane, sigmas of closed form, nothing where points are few."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.surfaces import nearby
from musatpy.surfaces.nearby import planes_at
from musatpy.surfaces.tin import FEW, INSIDE


def test_a_plane_is_found_exactly() -> None:
    draws = np.random.default_rng(2)
    xy = draws.uniform(0.0, 1000.0, (400, 2))
    z = 3.0 + 0.02 * xy[:, 0] - 0.01 * xy[:, 1]
    places = draws.uniform(200.0, 800.0, (50, 2))
    at = planes_at(places, xy, z, np.full(400, 0.1), 120.0)
    assert (at.reason == INSIDE).all()
    np.testing.assert_allclose(at.value, 3.0 + 0.02 * places[:, 0] - 0.01 * places[:, 1], atol=1e-9)  # rounding
    np.testing.assert_allclose(at.gradient, np.tile([0.02, -0.01], (50, 1)), atol=1e-9)


def test_places_in_blocks_are_those_in_one(monkeypatch: pytest.MonkeyPatch) -> None:
    draws = np.random.default_rng(4)
    xy, places = draws.uniform(0.0, 1000.0, (300, 2)), draws.uniform(-200.0, 1200.0, (40, 2))
    z = draws.normal(size=300)
    whole = planes_at(places, xy, z, np.full(300, 0.1), 120.0)
    monkeypatch.setattr(nearby, "_PAIRS", 20)
    blocks = planes_at(places, xy, z, np.full(300, 0.1), 120.0)
    np.testing.assert_array_equal(whole.value, blocks.value)
    np.testing.assert_array_equal(whole.gradient, blocks.gradient)
    assert set(whole.reason) == {INSIDE, FEW}


def test_sigma_and_weights() -> None:
    """In the middle of a square the value is the mean: its sigma is half that of a point; weights move it."""
    xy = np.array([[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-10.0, 10.0], [500.0, 0.0]])
    z, sigma = np.array([1.0, 1.0, 1.0, 5.0, 99.0]), np.full(5, 0.2)
    middle = np.zeros((1, 2))
    at = planes_at(middle, xy, z, sigma, 20.0)
    assert (at.value[0], at.sigma[0]) == (2.0, 0.1)
    sigma[3] = 20.0
    assert abs(planes_at(middle, xy, z, sigma, 20.0).value[0] - 1.0) < 1e-3  # of a weight of 1e-4
    plain = planes_at(middle, xy, z, np.array([0.0, 1.0, 1.0, 1.0, 1.0]), 20.0)
    assert (plain.value[0], plain.sigma[0]) == (2.0, 0.0)


def test_few_points_points_on_a_line_and_points_to_one_side_make_none() -> None:
    xy = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 1e-4], [200.0, 0.0], [210.0, 0.0], [205.0, 8.0]])
    places = np.array([[10.0, 0.0], [100.0, 0.0], [205.0, 3.0], [205.0, 12.0], [200.0, 0.0]])
    at = planes_at(places, xy, np.ones(6), np.full(6, 0.1), 35.0)
    assert at.reason.tolist() == [FEW, FEW, INSIDE, FEW, INSIDE]
    assert np.isfinite(at.value).tolist() == [False, False, True, False, True]
    assert (planes_at(places, xy[:1], np.ones(1), np.ones(1), 1.0).reason == FEW).all()
