"""Waves by height, length, azimuth and crest: there and back, and how their speed follows their length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from musatpy.refraction.waves import LENGTH, Trains, about
from musatpy.sea.theory import linear_wave
from refraction.seas import CHOP, SWELL

PLACES = np.array([[0.0, 0.0], [37.0, -80.0], [-400.0, 250.0]])


@pytest.mark.parametrize("depth", [np.nan, 10.0, np.inf])
def test_the_waves_of_a_surface_are_those_of_its_trains(depth: float) -> None:
    for sea in (SWELL, CHOP):
        got, want = Trains.of(sea, depth).surface.relief(PLACES, 4.0), sea.relief(PLACES, 4.0)
        for name in ("height", "gradient", "hessian"):  # rounding of angles of some ten cycles
            np.testing.assert_allclose(getattr(got, name), getattr(want, name), atol=1e-13)


@pytest.mark.parametrize("depth", [8.0, np.inf])
def test_the_speed_follows_the_length_as_in_linear_theory(depth: float) -> None:
    water = depth if np.isfinite(depth) else 1e4  # so deep that tanh kh is 1
    of = [linear_wave(period, water) for period in (9.0, 7.0)]
    sea = replace(SWELL, vector=np.array([[of[0].number, 0.0]]), frequency=np.array([2.0 * np.pi / 9.0]))
    trains = Trains.of(sea, depth)
    values = trains.values.copy()
    values[:, LENGTH] = of[1].length
    # rounding, and what the theory's iteration leaves
    assert trains.with_values(values).speed[0] == pytest.approx(float(of[1].speed), rel=1e-12)
    kept = Trains.of(sea).with_values(values)
    assert kept.speed[0] == pytest.approx(float(of[0].speed), rel=1e-12)


def test_another_place_and_moment_leave_the_waves_where_they_are() -> None:
    moved = about(CHOP, (120.0, -35.0), 7.0)
    got, want = moved.relief(PLACES, 1.0), CHOP.relief(PLACES + np.array([120.0, -35.0]), 8.0)
    np.testing.assert_allclose(got.height, want.height, atol=1e-13)  # rounding
    np.testing.assert_allclose(got.gradient, want.gradient, atol=1e-13)


@pytest.mark.parametrize("depth", [0.0, -3.0])
def test_water_has_a_depth(depth: float) -> None:
    with pytest.raises(ValueError, match="positive"):
        Trains.of(SWELL, depth)


def test_what_is_no_wave_is_told() -> None:
    trains = Trains.of(CHOP)
    assert trains.sensible
    for column, value in ((LENGTH, -1.0), (LENGTH, 0.3), (0, np.nan), (0, 10.0)):
        values = trains.values.copy()
        values[1, column] = value
        assert not trains.with_values(values).sensible
