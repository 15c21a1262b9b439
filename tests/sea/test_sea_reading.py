"""Points from the record of a real run, and from files whose sigmas are said elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sea_fixtures
from musatpy.depth.cameras import read_cameras
from musatpy.errors import DepthError, SeaError
from musatpy.geometry.systems import geographic
from musatpy.model import CoordinateSystem
from musatpy.reports.record import dumps, record
from musatpy.sea.stereo.point_records import Precision, read_points
from musatpy.sea.stereo.surface_points import intersection_covariance
from musatpy.systems.statement import ellipsoid_of
from sample_solutions import sample_solution


def test_points_of_a_run_with_their_covariances(tmp_path: Path) -> None:
    solution = sample_solution(CoordinateSystem.LOCAL)
    path = tmp_path / "job.json"
    path.write_text(dumps(record(solution)))
    read = read_points(path, Precision())
    points, block = solution.points, solution.block
    whole = np.isfinite(points.position).all(axis=1) & np.isfinite(points.covariance).all(axis=(1, 2))
    assert whole.any()
    assert read.points.ids == tuple(block.points.ids[whole].tolist())
    np.testing.assert_array_equal(read.points.position, points.position[whole])
    np.testing.assert_array_equal(read.points.covariance, points.covariance[whole])
    assert len(read.left) == (~whole).sum()


@pytest.mark.parametrize("system", [CoordinateSystem.GEOGRAPHIC, CoordinateSystem.GEOCENTRIC])
def test_a_run_on_the_ellipsoid_has_its_points_on_a_map(tmp_path: Path, system: CoordinateSystem) -> None:
    solution = sample_solution(system)
    path = tmp_path / "job.json"
    path.write_text(dumps(record(solution)))
    read = read_points(path, Precision())
    ellipsoid = ellipsoid_of(solution.block)
    points = solution.points.position[np.isin(solution.block.points.ids, read.points.ids)]
    position = points if system is CoordinateSystem.GEOCENTRIC else ellipsoid.geocentric(points)
    apart = np.linalg.norm(read.points.position - read.points.position[0], axis=1)
    # lengths on the map are those in space but for heights: 3 km over 6400 km
    np.testing.assert_allclose(apart, np.linalg.norm(position - position[0], axis=1), rtol=1e-3)
    heights = geographic(ellipsoid, position)[:, 2]
    np.testing.assert_allclose(read.points.position[:, 2], heights, atol=1e-6)
    back = read.coordinates(read.points.position)
    np.testing.assert_allclose(
        back[:, 2] if system is CoordinateSystem.GEOGRAPHIC else back[:, 0],
        heights if system is CoordinateSystem.GEOGRAPHIC else points[:, 0],
        atol=1e-5,
    )
    with pytest.raises(SeaError, match="has covariances, and sigmas are given too"):
        read_points(path, Precision(sigma=(1.0, 1.0, 1.0)))


def test_sigmas_of_the_file_of_all_points_or_of_the_pair(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("Z, ID ,X,Y\n0.5,a,10,20\n\n0.25,b,-10,5\n")
    same = read_points(path, Precision(sigma=(0.1, 0.2, 0.3))).points
    assert same.ids == ("a", "b")
    np.testing.assert_array_equal(same.position, [[10.0, 20.0, 0.5], [-10.0, 5.0, 0.25]])
    np.testing.assert_array_equal(same.covariance, np.tile(np.diag(np.square([0.1, 0.2, 0.3])), (2, 1, 1)))
    cameras = sea_fixtures.SETUP.cameras
    pair = read_points(path, Precision(cameras=cameras, image_sigma=1e-5), only=("b",)).points
    np.testing.assert_array_equal(pair.covariance, intersection_covariance(cameras, pair.position, 1e-5))
    assert pair.ids == ("b",)


def test_points_without_their_own_sigmas_take_those_given(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("id,x,y,z,sx,sy,sz\na,10,20,0.5,1,2,3\nb,-10,5,0.25,, ,\n")
    found = read_points(path, Precision(sigma=(0.1, 0.2, 0.3))).points.covariance
    np.testing.assert_array_equal(found, [np.diag([1.0, 4.0, 9.0]), np.diag(np.square([0.1, 0.2, 0.3]))])
    cameras = sea_fixtures.SETUP.cameras
    pair = read_points(path, Precision(cameras=cameras, image_sigma=1e-5)).points
    np.testing.assert_array_equal(pair.covariance[0], np.diag([1.0, 4.0, 9.0]))
    np.testing.assert_array_equal(pair.covariance[1:], intersection_covariance(cameras, pair.position[1:], 1e-5))
    with pytest.raises(SeaError, match=r"points\.csv:3 col 14 sx: no sigmas here, and none are given") as caught:
        read_points(path, Precision())
    assert len(caught.value.problems) == 1
    path.write_text("id,x,y,z,sx,sy,sz\nb,-10,5,0.25,1,,1\n")
    with pytest.raises(SeaError, match="sy: '' is no number"):
        read_points(path, Precision(sigma=(0.1, 0.2, 0.3)))


def test_coordinates_by_other_names(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("id,NORTH,East,Up,sx,sy,sz\na,20,10,0.5,1,2,3\n")
    points = read_points(path, Precision(), columns=("east", "north", "UP")).points
    np.testing.assert_array_equal(points.position, [[10.0, 20.0, 0.5]])
    with pytest.raises(SeaError, match="no column x among id, north, east, up"):
        read_points(path, Precision())
    with pytest.raises(SeaError, match="column sx is none of coordinates"):
        read_points(path, Precision(), columns=("east", "north", "sx"))


def test_stations_do_without_a_tide_where_the_surface_has_its_level(tmp_path: Path) -> None:
    path = sea_fixtures.SEA / "cameras.csv"
    np.testing.assert_array_equal(read_cameras(path, water=False).stations.level, [-np.inf, -np.inf])
    with pytest.raises(DepthError, match="no column tide"):
        read_cameras(path)
    tides = tmp_path / "tides.csv"
    lines = path.read_text().splitlines()
    tides.write_text("\n".join([f"{lines[0]},tide", *(f"{line},0.5" for line in lines[1:])]))
    np.testing.assert_array_equal(read_cameras(tides, water=False).stations.level, [0.5, 0.5])
