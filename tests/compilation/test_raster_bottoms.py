"""Soundings beside rasters of depths: planes, empty posts, systems; and the posts of a compilation."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest

from cli.commands import musat
from compilation.scenes import soundings_at
from musatpy.arrays import FloatArray
from musatpy.compilation.other_bottoms import NOT_IN_OTHER, Matching, contoured, sounded
from musatpy.compilation.rasters import read_raster_bottom
from musatpy.errors import CompilationError, SoundingError
from musatpy.geometry.crs import system_of
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.interchange.any_file import write_layers
from musatpy.interchange.layers import Grid
from musatpy.soundings.contours import ContourLines
from musatpy.surfaces.tin import EMPTY, INSIDE, OUTSIDE, REASONS
from musatpy.units import DEGREE
from stage_readings import DECK, SOUNDINGS

WGS84 = Ellipsoid("", 6378137.0, 298.257223563)
EAST, NORTH = 290000.0, 2030000.0
CORNER = np.array([EAST, NORTH])
SLOPE = np.array([0.1, -0.04])


def raster(path: Path, crs: pyproj.CRS | None, **bands: FloatArray) -> Path:
    """Write a plane, 10 m deep in the corner, posts every 5 m over 100 m, with a sigma of .2 m."""
    x, y = np.meshgrid(np.arange(0.0, 101.0, 5.0), np.arange(0.0, 101.0, 5.0))
    depth = 10.0 + SLOPE[0] * x + SLOPE[1] * y
    depth[10, 10] = np.nan
    values = bands or {"depth": depth, "sigma": np.full(depth.shape, 0.2)}
    write_layers(path, {"grid": Grid(west=EAST, south=NORTH, spacing=5.0, bands=values, crs=crs)})
    return path


def test_a_plane_is_exact_between_posts(tmp_path: Path) -> None:
    bottom = read_raster_bottom(raster(tmp_path / "a.tif", None), None)
    draws = np.random.default_rng(2).uniform(0.0, 100.0, (2000, 2))
    at = bottom.at(bottom.places(draws + CORNER))
    empty = (np.abs(draws - 50.0) < 5.0).all(axis=1)
    assert 0 < empty.sum() < 50 and (at.reason == np.where(empty, EMPTY, INSIDE)).all()
    good = ~empty
    np.testing.assert_allclose(at.value[good], 10.0 + draws[good] @ SLOPE, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(at.gradient[good], np.tile(SLOPE, (good.sum(), 1)), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(at.sigma[good], 0.2)
    beside = bottom.at(np.array([[-0.1, 50.0], [50.0, 100.1], [100.0, 100.0], [0.0, 0.0]]))
    assert beside.reason.tolist() == [OUTSIDE, OUTSIDE, INSIDE, INSIDE]
    assert beside.value[3] == pytest.approx(10.0) and np.isnan(beside.value[0])


@pytest.mark.parametrize("definition", ["EPSG:32620", "EPSG:4326"])
def test_soundings_find_their_places_on_the_globe(tmp_path: Path, definition: str) -> None:
    """On the map, and in degrees: slopes are by metres, so the error of a place counts alike."""
    crs, zone = pyproj.CRS(definition), system_of("EPSG:32620", WGS84)
    grid = {"west": EAST, "south": NORTH, "spacing": 5.0}
    if definition == "EPSG:4326":
        grid = {"west": -64.99, "south": 18.34, "spacing": 5e-5}
    x, y = np.meshgrid(np.arange(21.0), np.arange(21.0))
    bands = {"depth": 10.0 + 0.5 * y, "sigma": np.full(x.shape, 0.2)}
    write_layers(tmp_path / "a.tif", {"grid": Grid(**grid, bands=bands, crs=crs)})
    bottom = read_raster_bottom(tmp_path / "a.tif", WGS84)
    if definition == "EPSG:4326":
        place = np.array([[18.34 + 5e-5 * 7.0, -64.99 + 5e-5 * 3.5]]) * DEGREE
        north = pyproj.Geod(ellps="WGS84").inv(-64.99, 18.34, -64.99, 18.34005)[2]
    else:
        place = zone.level(np.array([[EAST + 17.5, NORTH + 35.0, 0.0]]))[:, :2]
        # 5 m on the map are 5 m over its scale, by .05 %, on the ellipsoid.
        north = 5.0
    soundings = soundings_at(place, np.array([13.0]), angular=True, sigma=0.1)
    compared = sounded([bottom], soundings, Matching(plan_sigma=2.0))
    assert compared.differences.difference[0] == pytest.approx(0.5, abs=1e-6)
    expected = np.sqrt(0.2**2 + 0.1**2 + (2.0 * 0.5 / north) ** 2)
    assert compared.differences.sigma[0] == pytest.approx(expected, rel=1e-3)


def test_reasons_of_a_raster_are_told(tmp_path: Path) -> None:
    bottom = read_raster_bottom(raster(tmp_path / "a.tif", None), None)
    place = np.array([[50.0, 50.0], [500.0, 0.0], [20.0, 20.0]]) + CORNER
    soundings = soundings_at(place, np.full(3, 10.0))
    compared = sounded([bottom], soundings, Matching())
    assert compared.reasons == {0: REASONS[EMPTY], 1: REASONS[OUTSIDE]} and compared.rows.tolist() == [2]


@pytest.mark.parametrize("crs", [None, pyproj.CRS("EPSG:32620")])
def test_contours_of_a_raster_beside_others(tmp_path: Path, crs: pyproj.CRS | None) -> None:
    """A plane that falls to the east by a tenth; others have its contour of 12.1 m 3 m farther: .3 m less deep."""
    x, _ = np.meshgrid(np.arange(0.0, 101.0, 5.0), np.arange(0.0, 101.0, 5.0))
    job = WGS84 if crs else None
    bottom = read_raster_bottom(raster(tmp_path / "a.tif", crs, depth=10.0 + 0.1 * x), job)
    line = np.array([[EAST + 24.0, NORTH - 10.0, 0.0], [EAST + 24.0, NORTH + 110.0, 0.0]])
    places = system_of("EPSG:32620", WGS84).level(line)[:, :2] if crs else line[:, :2]
    lines = ContourLines(places=(places, places), angular=crs is not None, depth=np.array([12.1, 30.0]))
    compared = contoured([bottom], lines, levels=[15.0])
    forward, backward = compared.distances
    assert (forward.length, forward.mean, backward.mean) == pytest.approx((100.0, 3.0, 3.0), rel=1e-3)
    assert (forward.mean_depth, backward.mean_depth) == pytest.approx((0.3, 0.3), rel=1e-3)
    assert {row.depth: row.reason for row in compared.areas} == {
        12.1: "", 15.0: NOT_IN_OTHER, 30.0: "the surface goes from 10.00 to 20.00 m",
    }  # fmt: skip
    with pytest.raises(SoundingError, match="give the contours in these"):
        contoured([bottom], replace(lines, angular=crs is None))


@pytest.mark.parametrize(
    ("write", "job", "message"),
    [
        (lambda path: raster(path, None, z=np.zeros((3, 3))), None, "it has no band depth but z"),
        (lambda path: raster(path, None, depth=np.zeros((1, 3))), None, "two rows and columns"),
        (lambda path: raster(path, None, depth=np.full((3, 3), np.nan)), None, "all of its posts are empty"),
        (lambda path: raster(path, None), WGS84, "it has no coordinate system, and the job one of the globe"),
        (lambda path: raster(path, pyproj.CRS("EPSG:32620")), None, "and the job a local one"),
        (lambda path: raster(path, pyproj.CRS("EPSG:26720")), WGS84, "no datum is shifted"),
    ],
)
def test_rasters_that_are_no_bottom(
    tmp_path: Path, write: Callable[[Path], Path], job: Ellipsoid | None, message: str
) -> None:
    path = write(tmp_path / "a.tif")
    with pytest.raises(CompilationError, match=message) as caught:
        read_raster_bottom(path, job)
    assert caught.value.problems[0].file == str(path)


def test_soundings_beside_the_posts_of_a_compilation(run_record: Path, tmp_path: Path) -> None:
    """The grid of posts of the deck, of 100 m: as good as its triangles to the scatter of the bottom, .3 m."""
    assert musat("as11", "compile", run_record, DECK, "-o", tmp_path, "--gis").exit_code == 0
    words = (
        "as11",
        "compare-soundings",
        run_record,
        tmp_path / "st_thomas_as11.BAY.tif",
        SOUNDINGS,
        "-o",
        tmp_path,
    )
    result = musat(*words, "--plots")
    assert result.exit_code == 0, result.output
    record = json.loads((tmp_path / "soundings.soundings.json").read_text())
    assert abs(record["regression"]["b"]) < 0.02 and record["point_orders"] == {}
    assert "posts of a raster" in (tmp_path / "soundings.soundings.lst").read_text()
    assert (tmp_path / "soundings.soundings.png").read_bytes().startswith(b"\x89PNG")
    result = musat(*words, "--radius", "20")
    assert result.exit_code == 1 and "--radius goes with points" in result.output
