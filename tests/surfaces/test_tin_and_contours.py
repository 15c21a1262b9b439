"""Networks of triangles and their contours, against planes and cones."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.arrays import FloatArray
from musatpy.errors import SurfaceError
from musatpy.surfaces.contours import bounds, contours, levels_between
from musatpy.surfaces.tin import INSIDE, LAND, LONG_EDGE, OUTSIDE, REASONS, Tin, words_of


def scattered(number: int = 400, seed: int = 3) -> FloatArray:
    """Return places (n, 2) in a square of 100 m, its corners among them."""
    inside = np.random.default_rng(seed).uniform(0.0, 100.0, (number, 2))
    return np.concatenate([inside, [[0, 0], [100, 0], [0, 100], [100, 100]]])


def lattice(spacing: float) -> FloatArray:
    """Return the places (n, 2) of a lattice over the square from -50 to 50 m."""
    side = np.arange(-50.0, 50.0 + spacing / 2.0, spacing)
    return np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)


def with_values(xy: FloatArray, z: FloatArray) -> FloatArray:
    return np.column_stack([xy, z])


def test_a_plane_is_exact() -> None:
    xy, slope = scattered(), np.array([0.03, -0.2])
    tin = Tin.of(with_values(xy, 5.0 + xy @ slope), sigma=np.full(len(xy), 0.1))
    places = scattered(50, 4)[:50]
    found = tin.at(places)
    np.testing.assert_allclose(found.value, 5.0 + places @ slope, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found.gradient, np.tile(slope, (50, 1)), rtol=0.0, atol=1e-9)
    assert (found.reason == INSIDE).all() and tin.area == pytest.approx(1e4)
    assert (found.sigma < 0.1).all() and (found.sigma > 0.1 / np.sqrt(3.0) - 1e-9).all()
    corner = tin.at(tin.xy[:1] * 0.999999 + 5e-5)
    assert corner.sigma[0] == pytest.approx(0.1, rel=0.01)


def test_places_without_a_surface_have_their_reasons() -> None:
    xy = np.concatenate([scattered(300), [[300.0, 50.0]]])
    tin = Tin.of(with_values(xy, np.zeros(len(xy))), longest_edge=30.0)
    found = tin.at(np.array([[50.0, 50.0], [250.0, 50.0], [500.0, 0.0]]))
    assert found.reason.tolist() == [INSIDE, LONG_EDGE, OUTSIDE]
    assert np.isfinite(found.value).tolist() == [True, False, False]
    assert words_of(found.reason) == ["", REASONS[LONG_EDGE], REASONS[OUTSIDE]]


def test_places_in_any_order_are_found() -> None:
    xy = scattered()
    tin = Tin.of(with_values(xy, np.hypot(*xy.T)))
    places = np.random.default_rng(6).uniform(-20.0, 120.0, (500, 2))
    at = tin.at(places)
    alone = [float(tin.at(place[None]).value[0]) for place in places]
    np.testing.assert_array_equal(at.value, alone)
    assert np.isnan(at.value).any() and np.isfinite(at.value).any()


def test_points_in_one_place_are_meaned() -> None:
    points = np.array([[0.0, 0, 1], [0, 0, 3], [10, 0, 2], [0, 10, 2]])
    tin = Tin.of(points, sigma=np.full(4, 0.2))
    assert tin.merged == 1 and tin.z[0] == 2.0 and tin.sigma[0] == pytest.approx(0.2 / np.sqrt(2.0))


@pytest.mark.parametrize(
    ("points", "message"),
    [([[0.0, 0, 0], [1, 1, 0]], "three places"), ([[0.0, 0, 0], [1, 1, 0], [3, 3, 0]], "on a line")],
)
def test_points_that_make_no_surface(points: list[list[float]], message: str) -> None:
    with pytest.raises(SurfaceError, match=message):
        Tin.of(np.array(points))


def test_contours_of_a_plane_are_straight() -> None:
    """To 1e-9 m, cut at the edge, with the greater values on their right."""
    xy, slope = scattered(), np.array([0.1, 0.05])
    tin = Tin.of(with_values(xy, xy @ slope))
    drawn = contours(tin, [2.0, 7.5, 50.0], index=[7.5])
    assert [line.level for line in drawn.lines] == [2.0, 7.5] and [line.index for line in drawn.lines] == [
        False,
        True,
    ]
    for line in drawn.lines:
        np.testing.assert_allclose(line.xy @ slope, line.level, rtol=0.0, atol=1e-9)
        ends = line.xy[[0, -1]]
        assert not line.closed and np.abs(ends * (100.0 - ends)).min(axis=1).max() < 1e-6
        along = line.xy[-1] - line.xy[0]
        assert slope @ [along[1], -along[0]] > 0.0
        assert line.length == pytest.approx(np.linalg.norm(along))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_contours_of_a_cone_are_circles_to_the_second_order(sign: float) -> None:
    """Halving the spacing quarters the error of the area; around greater values the line runs clockwise."""
    wrong = []
    for spacing in (4.0, 2.0):
        xy = lattice(spacing) + 0.37  # the tip is no node
        tin = Tin.of(with_values(xy, sign * np.hypot(*xy.T)))
        (line,) = contours(tin, [sign * 30.0]).lines
        radius = np.hypot(*line.xy.T)
        assert line.closed and np.abs(radius - 30.0).max() < 0.02 * spacing**2
        assert np.sign(line.area) == sign  # greater values outside: deeper on the right, counter-clockwise
        wrong.append(abs(abs(line.area) / (np.pi * 900.0) - 1.0))
    assert wrong[1] / wrong[0] == pytest.approx(0.25, rel=0.3)


def test_no_vertex_of_a_long_open_line_is_left_out() -> None:
    """A quarter circle about a corner over some 200 triangles: at the level at every vertex and between them."""
    xy = lattice(1.0) + 50.0
    tin = Tin.of(with_values(xy, np.hypot(*(xy + 0.3).T)))
    (line,) = contours(tin, [50.0]).lines
    assert not line.closed and len(line.xy) > 128
    for places in (line.xy[1:-1], 0.5 * (line.xy[:-1] + line.xy[1:])):
        np.testing.assert_allclose(tin.at(places).value, 50.0, rtol=0.0, atol=1e-9)


def test_lines_of_levels_in_short() -> None:
    """Open pieces across the corners, 24 m each, are left out; rings are shoals, however short."""
    xy = lattice(1.0)
    tin = Tin.of(with_values(xy, np.hypot(*xy.T)))
    drawn = contours(tin, [3.0, 20.0, 60.0], shortest=70.0)
    assert drawn.dropped == 4
    (shoal, *_), (level, number, length, area) = bounds(drawn.lines)
    assert shoal == 3.0
    assert (level, number) == (20.0, 1)
    assert length == pytest.approx(2.0 * np.pi * 20.0, rel=0.005) and area == pytest.approx(
        np.pi * 400.0, rel=0.005
    )


def test_levels_of_an_interval() -> None:
    np.testing.assert_allclose(levels_between(-2.5, 6.0, 2.0), [-2.0, 0.0, 2.0, 4.0, 6.0])
    with pytest.raises(SurfaceError, match="2000 are the most"):
        levels_between(0.0, 1e6, 0.1)


def test_triangles_between_points_of_the_shoreline_alone_are_land() -> None:
    # A bay: the shore comes in from both sides, and the land lies between its arms.
    shore = np.array([[0.0, 100.0], [40.0, 100.0], [40.0, 60.0], [60.0, 60.0], [60.0, 100.0], [100.0, 100.0]])
    water = np.array([[0.0, 0.0], [100.0, 0.0], [50.0, 20.0], [20.0, 50.0], [80.0, 50.0]])
    xyz = np.concatenate([with_values(shore, np.zeros(6)), with_values(water, np.full(5, 5.0))])
    tin = Tin.of(xyz, shore=np.arange(11) < 6)
    at = tin.at(np.array([[50.0, 90.0], [50.0, 50.0], [20.0, 80.0]]))
    assert at.reason.tolist() == [LAND, INSIDE, INSIDE]
