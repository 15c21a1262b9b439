"""What a page says of the flight."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from musatpy.page.flight import hull_area

RNG = np.random.default_rng(5)


@pytest.mark.parametrize("number", [3, 4, 17, 400])
def test_the_area_of_a_hull_is_that_of_qhull(number: int) -> None:
    for scale in ([1.0, 1.0], [1000.0, 1.0]):
        places = RNG.normal(size=(number, 2)) * scale + [5e5, 5e6]
        assert hull_area(places) == pytest.approx(ConvexHull(places).volume, rel=1e-7)


def test_a_grid_has_the_area_of_its_outline() -> None:
    x, y = np.meshgrid(np.arange(11.0), np.arange(6.0))
    assert hull_area(np.column_stack([x.ravel(), y.ravel()])) == pytest.approx(50.0)


@pytest.mark.parametrize(
    "places", [[[0.0, 0.0]], [[0.0, 0.0], [1.0, 1.0]], [[0.0, 1.0], [1.0, 2.0], [2.0, 3.0]], [[3.0, 3.0]] * 4]
)
def test_a_line_has_no_area(places: list[list[float]]) -> None:
    assert hull_area(np.array(places)) == pytest.approx(0.0, abs=1e-12)
