"""Profiles: order, spikes, thinning, even steps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from musatpy.surfaces.profiles import profile

START, END = np.array([10.0, 20.0]), np.array([40.0, 60.0])  # 50 m


def line(count: int = 41, seed: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Return places along the line in any order, up to 0.5 m beside it, and their stations."""
    draws = np.random.default_rng(seed)
    station = draws.permutation(np.linspace(0.0, 50.0, count))
    along = (END - START) / 50.0
    left = np.array([-along[1], along[0]])
    offset = draws.uniform(-0.5, 0.5, count)
    return START + station[:, None] * along + offset[:, None] * left, station


def test_readings_come_in_the_order_of_their_stations() -> None:
    xy, station = line()
    done = profile(xy, 0.1 * station, START, END, spike=np.inf, tolerance=0.0)
    np.testing.assert_allclose(done.station, np.sort(station), atol=1e-12)
    np.testing.assert_allclose(station[done.rows], done.station, atol=1e-12)
    assert np.abs(done.offset).max() <= 0.5 and (done.offset > 0.0).any() and (done.offset < 0.0).any()
    assert not done.spike.any() and done.kept.all()


def test_spikes_are_those_that_leave_the_median() -> None:
    xy, station = line()
    value = 5.0 + np.sin(station / 10.0)
    wrong = [4, 20]
    value[wrong] += [3.0, -2.0]
    done = profile(xy, value, START, END, spike=1.0, tolerance=0.0)
    assert sorted(done.rows[done.spike].tolist()) == wrong
    posts, values = done.at_steps(5.0)
    np.testing.assert_allclose(posts, np.arange(0.0, 51.0, 5.0), atol=1e-9)
    np.testing.assert_allclose(
        values, 5.0 + np.sin(posts / 10.0), atol=0.02
    )  # straight between readings 1.25 m apart


def test_a_straight_bottom_needs_its_ends() -> None:
    xy, station = line()
    done = profile(xy, 2.0 - 0.3 * station, START, END, spike=np.inf, tolerance=0.01)
    assert np.flatnonzero(done.kept).tolist() == [0, 40]


@given(st.lists(st.floats(-20.0, 20.0), min_size=3, max_size=30), st.floats(0.01, 5.0))
def test_what_is_thinned_stays_within_the_tolerance(values: list[float], tolerance: float) -> None:
    station = np.arange(float(len(values)))
    xy = START + station[:, None] * (END - START) / 50.0
    done = profile(xy, np.array(values), START, END, spike=np.inf, tolerance=tolerance)
    kept = done.kept
    again = np.interp(done.station, done.station[kept], done.value[kept])
    assert np.abs(again - done.value).max() <= tolerance + 1e-9
    assert kept[0] and kept[-1]


def test_no_readings_give_no_steps() -> None:
    done = profile(np.zeros((0, 2)), np.zeros(0), START, END, spike=1.0, tolerance=1.0)
    assert [len(part) for part in done.at_steps(1.0)] == [0, 0]
    one = profile(START[None], np.array([3.0]), START, END, spike=1.0, tolerance=1.0)
    assert one.at_steps(1.0)[1].tolist() == pytest.approx([3.0])
