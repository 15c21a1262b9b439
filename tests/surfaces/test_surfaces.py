"""Triangles, contours, posts, planes about places, and profiles."""

from collections.abc import Callable

import numpy as np
import pytest

from musatpy.arrays import FloatArray
from musatpy.compilation.profiles import profile
from musatpy.errors import SurfaceError
from musatpy.surfaces import tin as surfaces_of_points
from musatpy.surfaces.contours import Contours, bounds, contours, grid_contours, levels_between
from musatpy.surfaces.tin import FEW, INSIDE, LAND, LONG_EDGE, OUTSIDE, Tin, planes_at


def scattered(number: int = 400, seed: int = 3) -> FloatArray:
    """Return places (n, 2) in a square of 100 m, its corners among them."""
    inside = np.random.default_rng(seed).uniform(0.0, 100.0, (number, 2))
    return np.concatenate([inside, [[0, 0], [100, 0], [0, 100], [100, 100]]])


def lattice(spacing: float) -> FloatArray:
    """Return the places (n, 2) of a lattice over the square from -50 to 50 m."""
    side = np.arange(-50.0, 50.0 + spacing / 2.0, spacing)
    return np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)


def posts(spacing: float, west: float, south: float, size: float) -> FloatArray:
    """Return the places (rows, columns, 2) of posts over a square."""
    side = np.arange(0.0, size + 0.5 * spacing, spacing)
    return np.stack(np.meshgrid(west + side, south + side), axis=-1)


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
    """Beyond a long edge, outside, and in a bay whose shore comes in from both sides, between its arms."""
    xy = np.concatenate([scattered(300), [[300.0, 50.0]]])
    tin = Tin.of(with_values(xy, np.zeros(len(xy))), longest_edge=30.0)
    found = tin.at(np.array([[50.0, 50.0], [250.0, 50.0], [500.0, 0.0]]))
    assert found.reason.tolist() == [INSIDE, LONG_EDGE, OUTSIDE]
    assert np.isfinite(found.value).tolist() == [True, False, False]
    shore = np.array([[0.0, 100.0], [40.0, 100.0], [40.0, 60.0], [60.0, 60.0], [60.0, 100.0], [100.0, 100.0]])
    water = np.array([[0.0, 0.0], [100.0, 0.0], [50.0, 20.0], [20.0, 50.0], [80.0, 50.0]])
    xyz = np.concatenate([with_values(shore, np.zeros(6)), with_values(water, np.full(5, 5.0))])
    at = Tin.of(xyz, shore=np.arange(11) < 6).at(np.array([[50.0, 90.0], [50.0, 50.0], [20.0, 80.0]]))
    assert at.reason.tolist() == [LAND, INSIDE, INSIDE]


def test_what_makes_no_surface_and_points_in_one_place() -> None:
    for points, message in (
        ([[0.0, 0, 0], [1, 1, 0]], "three places"),
        ([[0.0, 0, 0], [1, 1, 0], [3, 3, 0]], "on a line"),
    ):
        with pytest.raises(SurfaceError, match=message):
            Tin.of(np.array(points))
    tin = Tin.of(np.array([[0.0, 0, 1], [0, 0, 3], [10, 0, 2], [0, 10, 2]]), sigma=np.full(4, 0.2))
    assert tin.merged == 1 and tin.z[0] == 2.0 and tin.sigma[0] == pytest.approx(0.2 / np.sqrt(2.0))
    np.testing.assert_allclose(levels_between(-2.5, 6.0, 2.0), [-2.0, 0.0, 2.0, 4.0, 6.0])
    with pytest.raises(SurfaceError, match="2000 are the most"):
        levels_between(0.0, 1e6, 0.1)


def drawn_by(way: str, of: Callable[[FloatArray], FloatArray], spacing: float, levels: list[float]) -> Contours:
    """Return the contours of values at places in a square of 100 m, its middle nowhere on a node."""
    west, south = -49.63, -49.63
    at = posts(spacing, west, south, 100.0)
    if way == "posts":
        return grid_contours(of(at), (west, south), spacing, levels, index=levels[1:2])
    xy = at.reshape(-1, 2)
    return contours(Tin.of(with_values(xy, of(xy))), levels, index=levels[1:2])


WAYS = pytest.mark.parametrize("way", ["triangles", "posts"])


@WAYS
def test_contours_of_a_plane_are_straight(way: str) -> None:
    """To 1e-9 m, from edge to edge, with the greater values on their right."""
    slope = np.array([0.1, 0.05])
    drawn = drawn_by(way, lambda xy: xy @ slope, 2.5, [-2.0, 3.5, 50.0])
    assert [(line.level, line.index) for line in drawn.lines] == [(-2.0, False), (3.5, True)]
    for line in drawn.lines:
        np.testing.assert_allclose(line.xy @ slope, line.level, rtol=0.0, atol=1e-9)
        ends = line.xy[[0, -1]] + 49.63
        assert not line.closed and np.abs(ends * (100.0 - ends)).min(axis=1).max() < 1e-6
        along = line.xy[-1] - line.xy[0]
        assert slope @ [along[1], -along[0]] > 0.0
        assert line.length == pytest.approx(np.linalg.norm(along))


@WAYS
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_contours_of_a_cone_are_circles_to_the_second_order(way: str, sign: float) -> None:
    """Halving the spacing quarters errors of area and length; around greater values the line runs clockwise."""
    wrong = []
    for spacing in (4.0, 2.0, 1.0):
        drawn = drawn_by(way, lambda xy: sign * np.linalg.norm(xy, axis=-1), spacing, [sign * 30.0])
        (line,) = drawn.lines
        assert line.closed and np.abs(np.hypot(*line.xy.T) - 30.0).max() < 0.02 * spacing**2
        assert np.sign(line.area) == sign  # greater values outside: deeper on the right, counter-clockwise
        ((_, number, length, area),) = bounds(drawn.lines)
        assert number == 1
        wrong.append([abs(area / (np.pi * 900.0) - 1.0), abs(length / (np.pi * 60.0) - 1.0)])
    np.testing.assert_allclose(np.array(wrong[1:]) / wrong[:-1], 0.25, atol=0.075)


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
    (cut,) = grid_contours(np.array([[0.0, 1.0], [0.0, np.nan]]), (0.0, 0.0), 1.0, [0.5]).lines
    assert cut.xy[-1, 1] > cut.xy[0, 1]  # by the three posts of the cell


def test_places_in_blocks_are_those_in_one(monkeypatch: pytest.MonkeyPatch) -> None:
    draws = np.random.default_rng(4)
    xy, places = draws.uniform(0.0, 1000.0, (300, 2)), draws.uniform(-200.0, 1200.0, (40, 2))
    z = draws.normal(size=300)
    plane = planes_at(places, xy, 3.0 + xy @ [0.02, -0.01], np.full(300, 0.1), 120.0)
    good = plane.reason == INSIDE
    np.testing.assert_allclose(plane.value[good], 3.0 + places[good] @ [0.02, -0.01], atol=1e-9)  # rounding
    np.testing.assert_allclose(plane.gradient[good], np.tile([0.02, -0.01], (good.sum(), 1)), atol=1e-9)
    whole = planes_at(places, xy, z, np.full(300, 0.1), 120.0)
    monkeypatch.setattr(surfaces_of_points, "_PAIRS", 20)
    blocks = planes_at(places, xy, z, np.full(300, 0.1), 120.0)
    np.testing.assert_array_equal(whole.value, blocks.value)
    np.testing.assert_array_equal(whole.gradient, blocks.gradient)
    assert set(whole.reason) == {INSIDE, FEW}


def test_sigma_and_weights() -> None:
    """In the middle of a square the value is the mean: its sigma is half that of a point; weights move it."""
    xy = np.array([[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-10.0, 10.0], [500.0, 0.0]])
    z, sigma = np.array([1.0, 1.0, 1.0, 5.0, 99.0]), np.full(5, 0.2)
    middle = np.zeros((1, 2))
    at = planes_at(middle, xy, z, sigma, 20.0)
    assert (at.value[0], at.sigma[0]) == (2.0, 0.1)
    sigma[3] = 20.0
    assert abs(planes_at(middle, xy, z, sigma, 20.0).value[0] - 1.0) < 1e-3  # of a weight of 1e-4
    plain = planes_at(middle, xy, z, np.array([0.0, 1.0, 1.0, 1.0, 1.0]), 20.0)
    assert (plain.value[0], plain.sigma[0]) == (2.0, 0.0)


def test_few_points_points_on_a_line_and_points_to_one_side_make_none() -> None:
    xy = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 1e-4], [200.0, 0.0], [210.0, 0.0], [205.0, 8.0]])
    places = np.array([[10.0, 0.0], [100.0, 0.0], [205.0, 3.0], [205.0, 12.0], [200.0, 0.0]])
    at = planes_at(places, xy, np.ones(6), np.full(6, 0.1), 35.0)
    assert at.reason.tolist() == [FEW, FEW, INSIDE, FEW, INSIDE]
    assert np.isfinite(at.value).tolist() == [False, False, True, False, True]
    assert (planes_at(places, xy[:1], np.ones(1), np.ones(1), 1.0).reason == FEW).all()


START, END = np.array([10.0, 20.0]), np.array([40.0, 60.0])  # 50 m


def line(count: int = 41, seed: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Return places along the line in any order, up to 0.5 m beside it, and their stations."""
    draws = np.random.default_rng(seed)
    station = draws.permutation(np.linspace(0.0, 50.0, count))
    along = (END - START) / 50.0
    left = np.array([-along[1], along[0]])
    offset = draws.uniform(-0.5, 0.5, count)
    return START + station[:, None] * along + offset[:, None] * left, station


def test_readings_come_in_the_order_of_their_stations() -> None:
    xy, station = line()
    done = profile(xy, 0.1 * station, START, END, spike=np.inf, tolerance=0.0)
    np.testing.assert_allclose(done.station, np.sort(station), atol=1e-12)
    np.testing.assert_allclose(station[done.rows], done.station, atol=1e-12)
    assert np.abs(done.offset).max() <= 0.5 and (done.offset > 0.0).any() and (done.offset < 0.0).any()
    assert not done.spike.any() and done.kept.all()
    straight = profile(xy, 2.0 - 0.3 * station, START, END, spike=np.inf, tolerance=0.01)
    assert np.flatnonzero(straight.kept).tolist() == [0, 40]  # a straight bottom needs its ends
    nothing = profile(np.zeros((0, 2)), np.zeros(0), START, END, spike=1.0, tolerance=1.0)
    assert [len(part) for part in nothing.at_steps(1.0)] == [0, 0]
    one = profile(START[None], np.array([3.0]), START, END, spike=1.0, tolerance=1.0)
    assert one.at_steps(1.0)[1].tolist() == pytest.approx([3.0])


def test_spikes_are_those_that_leave_the_median() -> None:
    xy, station = line()
    value = 5.0 + np.sin(station / 10.0)
    wrong = [4, 20]
    value[wrong] += [3.0, -2.0]
    done = profile(xy, value, START, END, spike=1.0, tolerance=0.0)
    assert sorted(done.rows[done.spike].tolist()) == wrong
    posts, values = done.at_steps(5.0)
    np.testing.assert_allclose(posts, np.arange(0.0, 51.0, 5.0), atol=1e-9)
    np.testing.assert_allclose(
        values, 5.0 + np.sin(posts / 10.0), atol=0.02
    )  # straight between readings 1.25 m apart


@pytest.mark.parametrize("seed", range(20))
def test_what_is_thinned_stays_within_the_tolerance(seed: int) -> None:
    draws = np.random.default_rng(seed)
    values, tolerance = draws.uniform(-20.0, 20.0, draws.integers(3, 31)), draws.uniform(0.01, 5.0)
    xy = START + np.arange(float(len(values)))[:, None] * (END - START) / 50.0
    done = profile(xy, values, START, END, spike=np.inf, tolerance=tolerance)
    kept = done.kept
    again = np.interp(done.station, done.station[kept], done.value[kept])
    assert np.abs(again - done.value).max() <= tolerance + 1e-9
    assert kept[0] and kept[-1]
