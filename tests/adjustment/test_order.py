"""The order of whole numbers."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from musatpy.arrays import order_of

LARGEST = 2**63 - 1


@given(st.lists(st.integers(-LARGEST, LARGEST) | st.integers(-3, 3)))
def test_whole_numbers_are_ordered_as_by_a_stable_sort(numbers: list[int]) -> None:
    """Those that have room for their rows beside them, and those that have none."""
    values = np.array(numbers, dtype=np.int64)
    np.testing.assert_array_equal(order_of(values), np.argsort(values, kind="stable"))
