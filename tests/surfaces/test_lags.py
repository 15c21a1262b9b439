"""The lag of a mark, by lines that are read to and fro over surfaces with known slopes."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.arrays import FloatArray
from musatpy.surfaces.lags import Lag, lag_of
from musatpy.surfaces.profiles import Profile

_STATIONS = np.arange(0.0, 1000.1, 10.0)
_TO_AND_FRO = np.array([1, -1, 1, -1, 1, -1, 1])


def surface(x: FloatArray, y: float) -> FloatArray:
    return np.asarray(10.0 + 0.01 * x + 3.0 * np.sin(x / 90.0) + 0.004 * y + 0.5 * np.cos(y / 60.0))


def lines(lag: float, noise: float, seed: int = 1) -> list[Profile]:
    """Return lines 20 m apart that show the surface `lag` m back in the direction in which they were read."""
    draws = np.random.default_rng(seed)
    found = []
    for row, direction in enumerate(_TO_AND_FRO):
        value = surface(_STATIONS - direction * lag, 20.0 * row) + noise * draws.normal(size=len(_STATIONS))
        nothing = np.zeros(len(_STATIONS), dtype=bool)
        found.append(
            Profile(
                rows=np.arange(len(_STATIONS)), station=_STATIONS, offset=np.zeros(len(_STATIONS)), value=value,
                spike=nothing, kept=~nothing,
            )
        )  # fmt: skip
    return found


def found(lag: float, noise: float, seed: int = 1) -> Lag:
    result = lag_of(lines(lag, noise, seed), _TO_AND_FRO, 10.0)
    assert result is not None and result.posts == 5 * 101
    return result


def test_a_lag_comes_back_and_none_is_none() -> None:
    """A sine of 90 m: slopes of differences over 20 m are 0.8 % too small."""
    assert found(4.0, 0.0).length == pytest.approx(4.0, rel=0.02)
    assert found(-2.0, 0.0).length == pytest.approx(-2.0, rel=0.02)
    assert abs(found(0.0, 0.0).length) < 0.1  # what the surface does across the lines is taken off


def test_the_sigma_of_a_lag_is_that_of_its_scatter() -> None:
    draws = [found(4.0, 0.1, seed) for seed in range(200)]
    scatter = np.std([draw.length for draw in draws])
    assert scatter / np.mean([draw.sigma for draw in draws]) == pytest.approx(1.0, abs=0.15)  # 3 sigmas of 200


def test_lines_that_say_nothing_of_a_lag() -> None:
    few = lines(4.0, 0.0)[:2]
    assert lag_of(few, _TO_AND_FRO[:2], 10.0) is None
    assert lag_of(lines(4.0, 0.0), _TO_AND_FRO, 600.0) is None
    level = [
        Profile(
            rows=np.arange(3), station=np.array([0.0, 50.0, 100.0]), offset=np.zeros(3), value=np.full(3, 5.0),
            spike=np.zeros(3, dtype=bool), kept=np.ones(3, dtype=bool),
        )
        for _ in range(4)
    ]  # fmt: skip
    assert lag_of(level, _TO_AND_FRO[:4], 10.0) is None
