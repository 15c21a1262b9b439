"""Products of vectors."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.geometry.vectors import cross

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
