"""Contours of grids of posts, against planes and cones."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.arrays import FloatArray
from musatpy.surfaces.contours import bounds
from musatpy.surfaces.grid_contours import grid_contours


def posts(spacing: float, west: float, south: float, size: float) -> FloatArray:
    """Return the places (rows, columns, 2) of posts over a square."""
    side = np.arange(0.0, size + 0.5 * spacing, spacing)
    return np.stack(np.meshgrid(west + side, south + side), axis=-1)


def test_contours_of_a_plane_are_straight_to_the_rounding() -> None:
    """At the level to 1e-9 m, from edge to edge, the greater values on their right; length by closed form."""
    at, slope = posts(2.5, 400_000.0, 2_000_000.0, 100.0), np.array([0.1, 0.05])
    local = at - [400_000.0, 2_000_000.0]
    drawn = grid_contours(local @ slope, (400_000.0, 2_000_000.0), 2.5, [2.0, 7.5, 50.0], index=[7.5])
    assert [(line.level, line.index) for line in drawn.lines] == [(2.0, False), (7.5, True)]
    for line in drawn.lines:
        xy = line.xy - [400_000.0, 2_000_000.0]
        np.testing.assert_allclose(xy @ slope, line.level, rtol=0.0, atol=1e-9)
        along = xy[-1] - xy[0]
        assert not line.closed and slope @ [along[1], -along[0]] > 0.0
    # From X = 20 m on the southern edge to Y = 40 m on the western one.
    assert drawn.lines[0].length == pytest.approx(np.hypot(20.0, 40.0), rel=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_contours_of_a_cone_are_circles_to_the_second_order(sign: float) -> None:
    """Halving the spacing quarters the errors of area and length; around greater values the line runs clockwise."""
    wrong = []
    for spacing in (4.0, 2.0, 1.0):
        at = posts(spacing, -50.0, -50.0, 100.0) + 0.37
        drawn = grid_contours(sign * np.linalg.norm(at, axis=-1), (-49.63, -49.63), spacing, [sign * 30.0])
        (line,) = drawn.lines
        assert line.closed and np.abs(np.hypot(*line.xy.T) - 30.0).max() < 0.02 * spacing**2
        assert np.sign(line.area) == sign
        ((_, number, length, area),) = bounds(drawn.lines)
        assert number == 1
        wrong.append([abs(area / (np.pi * 900.0) - 1.0), abs(length / (np.pi * 60.0) - 1.0)])
    ratios = np.array(wrong[1:]) / wrong[:-1]
    np.testing.assert_allclose(ratios, 0.25, atol=0.08)


def test_lines_end_where_there_is_no_surface_and_short_ones_are_left_out() -> None:
    at = posts(10.0, 0.0, 0.0, 100.0)
    values = 0.1 * at[..., 0]
    values[4:7, :] = np.nan  # no surface from 40 to 60 m north: cells from 30 to 70
    drawn = grid_contours(values, (0.0, 0.0), 10.0, [4.5])
    assert sorted(line.length for line in drawn.lines) == pytest.approx([30.0, 30.0])
    assert all(line.xy[-1, 1] > line.xy[0, 1] for line in drawn.lines)  # deeper to the east, on the right
    values[7:, :] = np.nan
    values[1, :] = np.nan
    assert grid_contours(values, (0.0, 0.0), 10.0, [4.5], shortest=15.0).dropped == 1
    assert grid_contours(np.full((1, 5), 2.0), (0.0, 0.0), 1.0, [2.0]).lines == ()


def test_a_ring_is_never_too_short() -> None:
    at = posts(1.0, -20.0, -20.0, 40.0)
    drawn = grid_contours(np.linalg.norm(at, axis=-1), (-20.0, -20.0), 1.0, [3.3, 22.0], shortest=100.0)
    assert [line.level for line in drawn.lines] == [3.3] and drawn.dropped == 4


def test_the_direction_of_a_line_in_cut_cells_is_that_of_their_three_posts() -> None:
    values = np.array([[0.0, 1.0], [0.0, np.nan]])
    (line,) = grid_contours(values, (0.0, 0.0), 1.0, [0.5]).lines
    assert line.xy[-1, 1] > line.xy[0, 1]
