"""Contours of grids, against planes and cones."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.arrays import FloatArray
from musatpy.surfaces.grid_contours import grid_contours

WEST, SOUTH = 290000.0, 2030000.0


def nodes(spacing: float) -> tuple[FloatArray, FloatArray]:
    """Return x and y (rows, columns) of a grid of 100 m from its south-western corner."""
    side = np.arange(0.0, 100.0 + spacing / 2.0, spacing)
    x, y = np.meshgrid(side, side)
    return x, y


def test_contours_of_a_plane_are_straight() -> None:
    """To 1e-9 m, from edge to edge, with the greater values on their right."""
    x, y = nodes(2.5)
    slope = np.array([0.1, 0.05])
    drawn = grid_contours(slope[0] * x + slope[1] * y, (WEST, SOUTH), 2.5, [2.03, 7.51, 50.0], index=[7.51])
    assert [line.level for line in drawn.lines] == [2.03, 7.51]
    assert [line.index for line in drawn.lines] == [False, True]
    for line in drawn.lines:
        xy = line.xy - [WEST, SOUTH]
        np.testing.assert_allclose(xy @ slope, line.level, rtol=0.0, atol=1e-9)
        along = xy[-1] - xy[0]
        assert not line.closed and slope @ [along[1], -along[0]] > 0.0
        assert np.abs(xy[[0, -1]] * (100.0 - xy[[0, -1]])).min(axis=1).max() < 1e-6


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_contours_of_a_cone_are_circles_to_the_second_order(sign: float) -> None:
    """Halving the spacing quarters the error of the area; around greater values the line runs clockwise."""
    wrong = []
    for spacing in (4.0, 2.0):
        x, y = nodes(spacing)
        (line,) = grid_contours(sign * np.hypot(x - 49.6, y - 50.3), (0.0, 0.0), spacing, [sign * 30.0]).lines
        radius = np.hypot(*(line.xy - [49.6, 50.3]).T)
        assert line.closed and np.abs(radius - 30.0).max() < 0.02 * spacing**2
        assert np.sign(line.area) == sign  # greater values outside: deeper on the right, counter-clockwise
        wrong.append(abs(abs(line.area) / (np.pi * 900.0) - 1.0))
    assert wrong[1] / wrong[0] == pytest.approx(0.25, rel=0.3)


def test_lines_end_beside_empty_nodes() -> None:
    x, y = nodes(1.0)
    depth = np.where((x > 40.0) & (x < 60.0), np.nan, y)
    drawn = grid_contours(depth, (0.0, 0.0), 1.0, [20.5])
    ends = sorted(float(value) for line in drawn.lines for value in line.xy[[0, -1], 0])
    assert ends == [0.0, 40.0, 60.0, 100.0]


def test_pieces_that_are_too_short_are_left_out() -> None:
    x, y = nodes(1.0)
    drawn = grid_contours(np.hypot(x - 50.0, y - 50.0), (0.0, 0.0), 1.0, [5.0, 20.0], shortest=40.0)
    assert [line.level for line in drawn.lines] == [20.0] and drawn.dropped == 1
