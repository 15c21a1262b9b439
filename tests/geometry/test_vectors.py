"""Products of vectors, and angles within half a turn."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.geometry.rotations import cross, wrapped
from musatpy.units import DEGREE

SHAPES = [((3,), (3,)), ((5, 3), (5, 3)), ((4, 1, 3), (2, 3)), ((0, 3), (0, 3))]


@pytest.mark.parametrize(("first", "second"), SHAPES)
@pytest.mark.parametrize("unit", [1.0, 1.0 + 1j])
def test_cross_is_that_of_numpy(first, second, unit):
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=first) * unit, rng.normal(size=second) * unit
    product = cross(a, b)
    assert product.dtype == a.dtype
    # the same products and differences in the same order: equal to the last bit
    np.testing.assert_array_equal(product, np.cross(a, b))


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(0.1, 0.1), (-np.pi, -np.pi), (np.pi, np.pi), (359.0 * DEGREE, -DEGREE), (-350 * DEGREE, 10 * DEGREE)],
)
def test_angles_within_half_a_turn(angle, expected):
    # A turn added and taken away costs a few units in the last place of 2 pi.
    assert wrapped(np.array([angle]))[0] == pytest.approx(expected, abs=4e-15)
    near = wrapped(np.array([angle]), 20.0)[0]
    assert abs(near - 20.0) <= np.pi
    assert np.cos(near - expected) == pytest.approx(1.0, abs=4e-15)
