"""The numbers behind pictures: functions of arrays, held against other ways to the same."""

import numpy as np
import pyproj
import pytest
from scipy import stats

from musatpy.arrays import rows_of
from musatpy.geometry.collinearity import attitude_matrix, image
from musatpy.plots.depth_profile import along, half_corridor, strips
from musatpy.plots.exposures import correlated, joined
from musatpy.plots.maps import confidence_ellipses, free_sides, largest_of_cells, view_of, without_paths
from musatpy.plots.plane import footprints, frames, plane_of, turned
from musatpy.plots.plate_residuals import CELLS, cell_means
from musatpy.plots.point_quality import graded, steps
from musatpy.soundings.s44 import orders_met, survey_orders

RNG = np.random.default_rng(12)


def covariances(number: int, size: int = 3) -> np.ndarray:
    half = RNG.normal(size=(number, size, size))
    return half @ np.swapaxes(half, 1, 2)


def test_points_of_an_ellipse_are_as_unlikely_as_it_says() -> None:
    """On the ellipse of 95 % v' inv(Q) v is the quantile of chi-square, in the axes of the plane."""
    covariance, turn = covariances(6), np.array([0.0, 0.3, -0.4, 1.0, 2.0, -3.0])
    axes, angle = confidence_ellipses(covariance, turn)
    for Q, (a, b), alpha, gamma in zip(covariance[:, :2, :2], axes, angle, turn, strict=True):
        t = np.linspace(0.0, 6.0, 11)
        along_axes = np.column_stack([a * np.cos(t), b * np.sin(t)])
        xy = along_axes @ np.array([[np.cos(alpha), np.sin(alpha)], [-np.sin(alpha), np.cos(alpha)]])
        v = turned(xy, np.full(len(xy), -gamma))  # back to east and north
        np.testing.assert_allclose(
            np.sum(v * np.linalg.solve(Q, v.T).T, axis=1), stats.chi2.ppf(0.95, 2), rtol=1e-9
        )
    assert (axes[:, 0] >= axes[:, 1]).all()


@pytest.mark.parametrize("number", [7, 50, 4000])
def test_of_many_places_the_largest_of_each_cell_is_kept(number: int) -> None:
    places, sizes = RNG.uniform(0.0, [300.0, 100.0], (number, 2)), RNG.uniform(size=number)
    rows = largest_of_cells(places, sizes, 50)
    if number <= 50:
        np.testing.assert_array_equal(rows, np.arange(number))
        return
    assert 40 <= len(rows) <= 100 and (np.diff(rows) > 0).all() and sizes.argmax() in rows
    side = np.sqrt(np.ptp(places, axis=0).prod() / 50)
    cells = [tuple(cell) for cell in np.floor((places - places.min(axis=0)) / side).astype(int).tolist()]
    best: dict[tuple[int, ...], int] = {}
    for row, cell in enumerate(cells):
        if cell not in best or sizes[row] > sizes[best[cell]]:
            best[cell] = row
    assert sorted(best.values()) == rows.tolist()


def test_names_are_found_in_their_order() -> None:
    ids, names = np.array(["A", "B", "C"]), np.array(["B", "B", "X", "A", "A", "A", "B", "C"])
    assert rows_of(ids, names).tolist() == [1, 1, -1, 0, 0, 0, 1, 2]
    assert rows_of(ids, names[:0]).tolist() == [] and rows_of(ids[:0], names[:1]).tolist() == [-1]


def test_footprints_are_imaged_at_the_corners() -> None:
    """Collinearity takes the corners of a footprint back to those of the format."""
    corners = np.tile([[-110.0, -100.0], [115.0, -100.0], [115.0, 120.0], [-110.0, 120.0]], (3, 1, 1))
    attitude = np.array([[0.02, -0.03, 0.5], [0.0, 0.0, 0.0], [0.1, 0.1, -2.0]])
    station, f = np.array([[0.0, 0.0, 1500.0], [5.0, 7.0, 900.0], [1.0, 2.0, 800.0]]), np.full(3, 152.0)
    flat = footprints(station, attitude, corners, f, 40.0)
    ground = np.concatenate([flat, (40.0 - station[:, 2])[:, None, None] * np.ones((3, 4, 1))], axis=2)
    for photo in range(3):
        M = np.broadcast_to(attitude_matrix(attitude[photo]), (4, 3, 3))
        xy = image(ground[photo], M, np.full(4, 152.0), np.zeros((4, 2)))
        np.testing.assert_allclose(xy, corners[photo], atol=1e-9)  # mm


def test_a_camera_without_a_format_has_that_of_its_images() -> None:
    """A twentieth wider than what was measured on its photos, and no photo of another camera counts."""
    tables = {
        "cameras": {
            "camera": ["W", "N"],
            "format_size": [[None, None], [230.0, 180.0]],
            "principal_point": [[1.0, 2.0], [0.0, 0.0]],
            "focal_length": [152.0, 210.0],
        },
        "stations": {"photo": ["1", "2"], "camera": ["W", "N"]},
        "plates": {"photo": ["1", "1", "2"], "xy": [[-80.0, 30.0], [20.0, -60.0], [110.0, -85.0]]},
    }
    corners, focal_length = frames(tables)
    assert focal_length.tolist() == [152.0, 210.0]
    np.testing.assert_allclose(corners[:, 2], [[84.0 - 1.0, 63.0 - 2.0], [115.0, 90.0]])
    np.testing.assert_allclose(corners[:, 0], [[-84.0 - 1.0, -63.0 - 2.0], [-115.0, -90.0]])


def test_a_photo_that_sees_the_horizon_has_no_footprint() -> None:
    corners = np.tile([[-110.0, -110.0], [110.0, -110.0], [110.0, 110.0], [-110.0, 110.0]], (2, 1, 1))
    station = np.array([[0.0, 0.0, 1500.0], [0.0, 0.0, 10.0]])
    flat = footprints(station, np.array([[1.2, 0.0, 0.0], [0.0, 0.0, 0.0]]), corners, np.full(2, 152.0), 40.0)
    assert np.isnan(flat).all()  # the second is below the ground


def test_cells_have_the_means_of_their_residuals() -> None:
    xy, residual = RNG.uniform(-115.0, 115.0, (500, 2)), RNG.normal(0.0, 3.0, (500, 2))
    corners = np.array([[-114.3, -114.3], [114.3, 114.3]])
    found = cell_means(xy, residual, np.full((500, 2), 3.0), corners, "dry points")
    assert found.count.shape == CELLS[::-1] and found.count.sum() == 500
    step = 228.6 / np.array(CELLS)
    for row, column in ((0, 0), (7, 12), (15, 23)):
        middle = found.places[row, column]
        inside = np.clip(np.floor((xy + 114.3) / step), 0, [23, 15]) == np.round((middle + 114.3) / step - 0.5)
        of_cell = residual[inside.all(axis=1)]
        assert found.count[row, column] == len(of_cell)
        if len(of_cell):
            np.testing.assert_allclose(found.mean[row, column], of_cell.mean(axis=0))


def test_chance_puts_one_cell_in_twenty_beyond_its_limit() -> None:
    """Residuals of 1.5 um on sigmas of 5 um: what counts is their own spread; a bias of 1 um is found."""
    number = 40_000
    xy, corners = RNG.uniform(-100.0, 100.0, (number, 2)), np.array([[-100.0, -100.0], [100.0, 100.0]])
    noise, sigma = RNG.normal(0.0, 1.5, (number, 2)), np.full((number, 2), 5.0)
    chance = cell_means(xy, noise, sigma, corners, "dry points")
    assert 0.02 < chance.beyond.sum() / chance.drawn.sum() < 0.09  # 384 cells: 0.05 -+ 0.011
    biased = cell_means(xy, noise + np.array([1.0, 0.0]), sigma, corners, "dry points")
    assert biased.beyond.sum() > 0.9 * biased.drawn.sum()


def test_places_along_a_bent_line() -> None:
    line = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 50.0]])
    distance, offset = along(line, np.array([[30.0, 4.0], [103.0, 20.0], [-5.0, -1.0], [101.0, 60.0]]))
    np.testing.assert_allclose(distance, [30.0, 120.0, np.nan, np.nan])
    np.testing.assert_allclose(offset, [4.0, 3.0, np.inf, np.inf])


def test_names_stand_where_there_is_room() -> None:
    room = np.array([4.0, 1.0])
    places = np.array([[0.0, 0.0]] * 5 + [[4.0, 0.9], [50.0, 0.0]])
    sides = free_sides(places, room, np.empty((0, 2)))
    assert sides.tolist() == [[1, 1], [-1, 1], [1, -1], [-1, -1], [0, 0], [1, 1], [1, 1]]
    middles = (places + 0.5 * sides * room)[[0, 1, 2, 3, 5, 6]]
    apart = (np.abs(middles[:, None] - middles) >= room).any(axis=2)
    assert (apart | np.eye(6, dtype=bool)).all()
    assert free_sides(places[6:], room, np.array([[52.0, 0.5]])).tolist() == [[-1, 1]]


def test_strips_end_where_the_flight_turns_and_where_the_next_is_far() -> None:
    first = np.column_stack([np.arange(5) * 100.0, np.zeros(5)])
    back = np.column_stack([400.0 - np.arange(5) * 100.0, np.full(5, 120.0)])
    away = first + np.array([0.0, 900.0])
    np.testing.assert_array_equal(strips(np.concatenate([first, back, away])), np.repeat([0, 1, 2], 5))
    assert strips(first[:2]).tolist() == [0, 0] and strips(first[:1]).tolist() == [0]


def test_the_corridor_is_as_wide_as_it_must_be() -> None:
    offset = np.append(np.arange(1.0, 41.0), np.nan)
    assert half_corridor(offset, 1000.0, 12) == pytest.approx(12.0)
    assert half_corridor(offset, 100.0, 12) == pytest.approx(12.0)
    assert half_corridor(offset, 50.0, 30) == pytest.approx(8.0)  # at most .16 of the line
    assert half_corridor(np.array([np.nan]), 100.0) == pytest.approx(16.0)


def test_classes_are_the_orders_of_s44() -> None:
    """Where the plan is exact, the class of a height is the order that `orders_met` finds."""
    depth, sigma = RNG.uniform(0.0, 40.0, 300), RNG.uniform(0.01, 1.5, 300)
    covariance = np.zeros((300, 3, 3))
    covariance[:, 2, 2] = np.square(sigma)
    grade = graded(1.96 * sigma, steps([order.vertical(depth) for order in survey_orders()]))
    order = np.clip(grade - 1, 0, 4)  # half of the strictest, the orders, the last enlarged, beyond
    np.testing.assert_array_equal(order, orders_met(depth, covariance))
    assert graded(np.array([np.nan]), np.ones((3, 1))).tolist() == [-1]


def test_correlations_of_stations_with_the_water() -> None:
    """Of one covariance that is taken apart and put together again."""
    whole = covariances(1, 14)[0]  # two stations and two of the water
    stations = np.array([whole[:6, :6], whole[6:12, 6:12]])
    shared = np.stack([whole[12:, :6], whole[12:, 6:12]], axis=1)
    found = correlated(joined(stations, whole[12:, 12:], shared))
    sigma = np.sqrt(np.diagonal(whole))
    expected = whole / np.outer(sigma, sigma)
    for photo in (0, 1):
        rows = np.r_[6 * photo : 6 * photo + 6, 12:14]
        np.testing.assert_allclose(found[photo], expected[np.ix_(rows, rows)])


def test_a_point_that_went_astray_is_out_of_view() -> None:
    block = np.array([[0.0, 0.0], [1000.0, 500.0]])
    bounds, seen = view_of(block, np.array([[10.0, 10.0], [1e5, 0.0], [np.nan, 0.0], [1400.0, 200.0]]))
    assert seen.tolist() == [True, False, False, True] and bounds[1, 0] < 2000.0


def test_the_plane_of_a_geographic_job_is_a_map_about_it() -> None:
    """Azimuths and distances are those of the geodesic; north of the map stands where its meridian says."""
    positions = np.radians([[18.3, -64.9, 0.0], [18.32, -64.9, 0.0], [18.31, -64.93, 0.0]])
    positions[:, 2] = 10.0
    tables = {
        "options": {"system": "GEOG"},
        "ellipsoid": {"name": "clrk66", "semi_major_axis": None, "inverse_flattening": None},
        "stations": {"position": positions.tolist()},
    }
    plane = plane_of(tables)
    x, y = plane.places(positions)[:, :2].T
    latitude, longitude = np.degrees(positions[:, :2]).T
    azimuth, _, distance = pyproj.Geod(ellps="clrk66").inv(longitude[0], latitude[0], longitude[2], latitude[2])
    assert np.hypot(x[2] - x[0], y[2] - y[0]) == pytest.approx(distance, abs=1e-3)  # 1e-7 of 3 km
    on_map = np.arctan2(x[2] - x[0], y[2] - y[0]) + plane.turns(positions)[0]
    assert np.degrees(np.remainder(on_map, 2.0 * np.pi)) == pytest.approx(azimuth % 360.0, abs=1e-3)
    assert not plane.own and "18" in plane.labels[1]


def test_names_of_files_stand_in_pictures_without_folders_and_suffixes() -> None:
    names = np.array(["DCIM/DJI_0001.JPG", "a\\b\\c.tif", "1.A", "S1.2", "d/e"])
    assert without_paths(names).tolist() == ["DJI_0001", "c", "1.A", "S1.2", "d/e"]
