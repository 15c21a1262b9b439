"""Monotone cubics against those of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from musatpy.interpolation import monotone


@pytest.mark.parametrize("count", [2, 3, 4, 40])
@pytest.mark.parametrize("steps", [False, True])  # readings that are whole: level pieces and crests
def test_values_are_those_of_scipy(count: int, steps: bool) -> None:
    rng = np.random.default_rng(count)
    for _ in range(20):
        x, y = np.cumsum(rng.uniform(0.1, 2.0, count)), rng.normal(0.0, 1.5, count)
        y = np.round(y) if steps else y
        at = np.append(rng.uniform(x[0], x[-1], 50), x)
        assert monotone(x, y, at) == pytest.approx(PchipInterpolator(x, y)(at), abs=1e-12)
