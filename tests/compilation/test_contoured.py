"""Contours of plane bottoms beside lines: distances, depths by the slope with their signs, areas, reasons."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from musatpy.arrays import FloatArray
from musatpy.compilation.contoured import NO_BOTTOM, NOT_IN_OTHER, NOT_ON_IT, PAST_ENDS, contoured
from musatpy.compilation.joined_surfaces import BottomPoints, Surface
from musatpy.errors import SoundingError
from musatpy.soundings.contour_files import ContourLines
from musatpy.surfaces.tin import Tin

SLOPE = 0.1


def patch(south: float, north: float, shift: float = 0.0) -> FloatArray:
    """Return points of a bottom that falls towards east, x 0 to 100 m."""
    x, y = np.meshgrid(np.linspace(0.0, 100.0, 11), np.linspace(south, north, 5))
    return np.column_stack([x.ravel(), y.ravel(), SLOPE * x.ravel() + shift])


def surface(points: FloatArray, longest: float = np.inf, plan: Any = None) -> Surface:
    bottom = BottomPoints(
        xy=points[:, :2], depth=points[:, 2], sigma=np.zeros(len(points)), water=np.zeros(len(points))
    )
    return Surface(models=("M",), points=bottom, tin=Tin.of(points, None, longest), plan=plan)


def others(*lines: tuple[float, list[tuple[float, float]]]) -> ContourLines:
    places = tuple(np.array(xy, dtype=float) for _, xy in lines)
    return ContourLines(places=places, angular=False, depth=np.array([depth for depth, _ in lines]))


@pytest.mark.parametrize(("x", "depth"), [(60.0, 1.0), (45.0, -0.5)])
@pytest.mark.parametrize("turned", [1, -1])
def test_a_contour_on_the_deeper_side_says_that_the_bottom_is_deeper(x: float, depth: float, turned: int) -> None:
    """Compiled 5 m are at x 50: where the other has them farther out, the compiled bottom is deeper than 5 m."""
    compared = contoured([surface(patch(0.0, 40.0))], others((5.0, [(x, -10.0), (x, 60.0)][::turned])))
    forward, backward = compared.distances
    assert (forward.of, backward.of) == ("compiled", "other")
    for way in (forward, backward):
        assert way.length == pytest.approx(40.0, abs=1.0)  # a sample at the edge
        assert (way.mean, way.rms, way.most) == pytest.approx([abs(x - 50.0)] * 3)
        assert way.mean_depth == pytest.approx(depth)
        assert (way.rms_depth, way.most_depth) == pytest.approx([abs(depth)] * 2)
        assert way.beyond == 0.0
    (area,) = compared.areas
    assert area.area == pytest.approx(40.0 * abs(x - 50.0)) and area.width == pytest.approx(abs(x - 50.0))
    assert compared.rms == pytest.approx(abs(x - 50.0)) and not area.reason


def test_a_datum_is_added_to_the_depths_of_the_other() -> None:
    compared = contoured([surface(patch(0.0, 40.0))], others((4.5, [(52.0, -10.0), (52.0, 60.0)])), datum=0.5)
    assert [row.depth for row in compared.areas] == [5.0]
    again = contoured([surface(patch(0.0, 40.0))], others((0.3, [(9.0, -10.0), (9.0, 60.0)])), levels=[3 * 0.1])
    assert [(row.depth, row.reason) for row in again.areas] == [(0.3, "")]
    assert compared.distances[0].mean == pytest.approx(2.0)


def test_a_turned_contour_has_depths_on_both_sides() -> None:
    """Deeper in the north, shoaler in the south: the mean depth is none, its RMS that of an even spread."""
    compared = contoured([surface(patch(0.0, 40.0))], others((5.0, [(48.0, -20.0), (52.0, 60.0)])))
    forward = compared.distances[0]
    assert forward.mean_depth == pytest.approx(0.0, abs=1e-6)
    most = SLOPE * 20.0 * np.sin(np.arctan(4.0 / 80.0))
    assert forward.rms_depth == pytest.approx(most / np.sqrt(3.0), rel=1e-3)  # of 40 steps
    assert forward.most_depth == pytest.approx(0.95 * most, abs=most / 20.0)


def test_what_lies_past_an_end_is_left_out_and_has_no_area() -> None:
    """The other contour ends in the middle: half of the compiled one has no partner."""
    compared = contoured([surface(patch(0.0, 40.0))], others((5.0, [(60.0, -10.0), (60.0, 20.0)])))
    forward, backward = compared.distances
    assert (forward.length, forward.beyond) == pytest.approx((20.0, 20.0))
    assert backward.length == pytest.approx(20.0, abs=1.0) and backward.beyond == 0.0  # a sample at the edge
    assert forward.most == pytest.approx(10.0) and compared.areas[0].area == pytest.approx(200.0)


def test_contours_of_other_places_are_no_partners() -> None:
    """Of two contours of a depth, one 10 m beside that of the surface and one 35 m, the first is within 20 m."""
    both = others((5.0, [(60.0, -10.0), (60.0, 60.0)]), (5.0, [(85.0, -10.0), (85.0, 60.0)]))
    bottom = surface(np.concatenate([patch(0.0, 40.0)]))
    whole, near = contoured([bottom], both), contoured([bottom], both, farthest=20.0)
    assert [row.beyond for row in whole.distances] == [0.0, 0.0]
    assert whole.distances[1].most > 30.0
    forward, backward = near.distances
    assert (forward.length, backward.length) == pytest.approx((40.0, 40.0), abs=1.0)
    assert backward.beyond == pytest.approx(40.0, abs=1.0) and backward.most == pytest.approx(10.0)
    assert near.areas[0].area == pytest.approx(400.0, rel=0.02)
    none = contoured([bottom], both, farthest=5.0)
    assert not none.distances and none.areas[0].reason == PAST_ENDS


def test_reasons() -> None:
    bottom = surface(np.concatenate([patch(0.0, 40.0), patch(60.0, 100.0, 30.0)]), longest=15.0)
    lines = others(
        (5.0, [(50.0, 70.0), (50.0, 90.0)]),
        (6.0, [(50.0, 500.0), (50.0, 600.0)]),
        (20.0, [(50.0, 10.0), (50.0, 30.0)]),
        (90.0, [(50.0, 10.0), (50.0, 30.0)]),
    )
    compared = contoured([bottom], lines, levels=[8.0])
    assert not compared.distances
    assert {row.depth: row.reason for row in compared.areas} == {
        5.0: PAST_ENDS,
        6.0: NOT_ON_IT,
        8.0: NOT_IN_OTHER,
        20.0: NO_BOTTOM,
        90.0: "the surface goes from 0.00 to 40.00 m",
    }


def test_coordinates_of_another_kind_are_refused() -> None:
    bottom = surface(patch(0.0, 40.0), plan=SimpleNamespace())
    with pytest.raises(SoundingError, match="the job has lat and lon"):
        contoured([bottom], others((5.0, [(50.0, 0.0), (50.0, 40.0)])))
    assert not contoured([Surface(models=("M",), points=bottom.points, tin=None, plan=None)], others()).areas
