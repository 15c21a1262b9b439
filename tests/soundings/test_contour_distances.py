"""Lines beside lines: distances, lengths and areas in closed form, both ways."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from musatpy.arrays import FloatArray
from musatpy.soundings.contour_distances import area_between, largest_of_most, offsets

ROUNDING = 1e-9  # m


def line(*vertices: tuple[float, float]) -> FloatArray:
    return np.array(vertices, dtype=float)


def circle(radius: float, number: int = 3600) -> FloatArray:
    """Return a closed polygon, at most 4e-5 m within a circle of 100 m."""
    angle = np.linspace(0.0, 2.0 * np.pi, number + 1)
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring[-1] = ring[0]
    return ring


def test_parallel_lines() -> None:
    a, b = line((0, 0), (30, 0), (100, 0)), line((100, 7), (0, 7))
    forward, backward = offsets([a], [b]), offsets([b], [a])
    for way in (forward, backward):
        np.testing.assert_allclose(way.distance, 7.0, atol=ROUNDING)
        assert not way.beyond.any() and way.interval.sum() == pytest.approx(100.0)
    assert len(forward.xy) == 100 and forward.xy[0].tolist() == [0.5, 0.0]
    assert area_between(forward, backward) == pytest.approx(700.0)


def test_what_lies_past_an_open_end_has_no_partner() -> None:
    a, b = line((0, 0), (100, 0)), line((40, 7), (140, 7))
    forward, backward = offsets([a], [b]), offsets([b], [a])
    np.testing.assert_array_equal(forward.beyond, forward.xy[:, 0] < 40.0)
    np.testing.assert_array_equal(backward.beyond, backward.xy[:, 0] > 100.0)
    assert area_between(forward.part(~forward.beyond), backward.part(~backward.beyond)) == pytest.approx(60.0 * 7.0)


def test_pieces_that_join_are_one_line() -> None:
    """The ends at x 40 are no ends, nor is a repeated vertex at an open end a segment."""
    a = line((0, 0), (100, 0))
    pieces = [line((40, 7), (20, 7), (20, 7)), line((40, 7), (80, 7), (80, 7))]
    forward = offsets([a], pieces)
    np.testing.assert_array_equal(forward.beyond, (forward.xy[:, 0] < 20.0) | (forward.xy[:, 0] > 80.0))
    np.testing.assert_allclose(forward.part(~forward.beyond).distance, 7.0, atol=ROUNDING)


@pytest.mark.parametrize(
    "others",
    [
        [line((0, 0), (10, 0), (10, 10))],
        [line((0, 0), (10, 0)), line((10, 0), (10, 10))],
        [line((10, 0), (10, 10), (0, 10), (0, 0), (10, 0))],
    ],
)
def test_a_corner_is_no_end(others: list[FloatArray]) -> None:
    """Neither within a line, nor where two meet, nor where a closed one begins."""
    corner = offsets([line((12.9, -4), (13.1, -4))], others)
    np.testing.assert_allclose(corner.nearest, [[10.0, 0.0]], atol=ROUNDING)
    assert corner.distance[0] == pytest.approx(5.0) and not corner.beyond[0]


@pytest.mark.parametrize("inner", [88.0, 100.0])
def test_concentric_circles(inner: float) -> None:
    outer = 112.0
    a, b = circle(inner), circle(outer)
    forward, backward = offsets([a], [b]), offsets([b], [a])
    for way, radius in ((forward, inner), (backward, outer)):
        assert not way.beyond.any()
        np.testing.assert_allclose(way.distance, outer - inner, atol=1e-4)  # arrows of both polygons
        assert way.interval.sum() == pytest.approx(2.0 * np.pi * radius, rel=1e-6)
    assert area_between(forward, backward) == pytest.approx(np.pi * (outer**2 - inner**2), rel=1e-5)
    one_way = float(forward.interval @ forward.distance)
    assert one_way == pytest.approx(2.0 * np.pi * inner * (outer - inner), rel=1e-5)


def test_a_wedge() -> None:
    """Distances grow evenly from 0: their mean, RMS and 95 % are known, and the area is that of the triangle."""
    angle, length = np.radians(20.0), 400.0
    a, b = line((0, 0), (length, 0)), line((0, 0), (length * np.cos(angle), length * np.sin(angle)))
    forward, backward = offsets([a], [b]), offsets([b], [a])
    assert not forward.beyond.any() and not backward.beyond.any()
    farthest = length * np.sin(angle)
    assert forward.distance.mean() == pytest.approx(farthest / 2.0)
    assert np.sqrt(np.mean(np.square(forward.distance))) == pytest.approx(
        farthest / np.sqrt(3.0), rel=1e-4
    )  # of steps
    most = largest_of_most(forward.distance, forward.interval)
    assert most == pytest.approx(0.95 * farthest, abs=np.sin(angle))  # a step of a metre
    assert area_between(forward, backward) == pytest.approx(0.5 * length * farthest)


def test_the_largest_of_most_goes_by_length() -> None:
    values, weight = np.array([3.0, 1.0, 2.0]), np.array([0.04, 0.5, 0.46])
    assert largest_of_most(values, weight) == 2.0
    assert largest_of_most(values, weight[::-1]) == 3.0
    assert np.isnan(area_between(offsets([line((0, 0), (1, 0))], [line((0, 1), (1, 1))]).part(np.zeros(1, bool)),
                                 offsets([line((0, 0), (1, 0))], [line((0, 1), (1, 1))])))  # fmt: skip


@pytest.mark.parametrize("waves", [2, 5, 9])
def test_the_area_between_rings_that_cross_is_that_of_their_polygons(waves: int) -> None:
    """The nearest place is not across a line that is oblique to the other: less than 1 % of the area."""
    angle = np.linspace(0.0, 2.0 * np.pi, 3601)
    ring = (100.0 + 6.0 * np.sin(waves * angle))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring[-1] = ring[0]
    other = circle(102.0) + np.array([3.0, -1.0])
    area = area_between(offsets([ring], [other]), offsets([other], [ring]))
    assert area == pytest.approx(shapely.Polygon(ring).symmetric_difference(shapely.Polygon(other)).area, rel=0.01)
