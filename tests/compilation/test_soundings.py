"""Soundings over plane bottoms and rasters of depths, why some do not count, and `musat as11 compare-soundings`."""

import datetime
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest
from click.testing import Result

import stage_readings
from cli.commands import musat
from compilation.scenes import soundings_at, surface_of
from musatpy.arrays import FloatArray
from musatpy.compilation.compiled import compiled
from musatpy.compilation.joined_surfaces import JoinedSurface, surfaces_of
from musatpy.compilation.other_bottoms import DRY, NOT_IN_OTHER, STEEP, UNDATED, Matching, contoured, sounded
from musatpy.compilation.rasters import read_raster_bottom
from musatpy.compilation.triangulation import of_record
from musatpy.errors import CompilationError, SoundingError
from musatpy.formats.compilation_deck import read_compilation
from musatpy.geometry.crs import system_of
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.interchange import las
from musatpy.interchange.any_file import write_layers
from musatpy.interchange.layers import Grid, Points
from musatpy.reports.soundings import DOCUMENT
from musatpy.soundings.contours import ContourLines
from musatpy.surfaces.tin import EMPTY, FEW, INSIDE, LONG_EDGE, OUTSIDE, REASONS
from musatpy.units import DEGREE
from record_rows import read_rows, valid_rows
from stage_readings import DECK, SOUNDINGS

SLOPE, WATER = 0.1, 1.0  # the datum is 1 m above the water


def surface(shift: float = 0.0, sigma: float = 0.2, longest: float = np.inf) -> JoinedSurface:
    """Return a bottom that falls towards east from 0 to 10 m below the datum, x and y 0 to 100 m."""
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(0.0, 100.0, 11), np.linspace(0.0, 100.0, 11)))
    return surface_of(np.column_stack([x, y, SLOPE * x + shift]), sigma, WATER, longest)


@pytest.mark.parametrize("radius", [np.inf, 25.0])
def test_depths_and_sigmas_of_triangles_and_of_planes(radius: float) -> None:
    place = np.array([[50.0, 50.0], [30.0, 70.0]])
    how = Matching(datum=0.3, datum_sigma=0.04, sigma=0.1, plan_sigma=2.0, radius=radius)
    compared = sounded([surface()], soundings_at(place, np.array([4.5, 3.2])), how)
    differences = compared.differences
    np.testing.assert_allclose(differences.compiled, [5.0, 3.0])
    np.testing.assert_allclose(differences.difference, [5.0 - 4.8, 3.0 - 3.5])
    points = 21 if np.isfinite(radius) else 1  # within 25 m of a point of a net of 10 m, or the point itself
    np.testing.assert_allclose(differences.sigma, np.sqrt(0.04 / points + 0.01 + (2.0 * SLOPE) ** 2 + 0.04**2))
    np.testing.assert_array_equal(compared.xy, place)


def test_what_is_above_the_water_is_dry() -> None:
    """The water is 1 m below the datum: at x 10."""
    place = np.array([[9.0, 50.0], [11.0, 50.0]])
    compared = sounded([surface()], soundings_at(place, np.array([0.9, 1.1])), Matching())
    assert compared.reasons == {0: DRY} and compared.rows.tolist() == [1]
    covered = sounded([surface(), surface(2.0, 0.5)], soundings_at(place, np.array([0.9, 1.1])), Matching())
    assert not covered.reasons
    np.testing.assert_allclose(covered.differences.compiled, [2.9, 1.1])  # the surer one where both are


def test_every_reason() -> None:
    place = np.array([[500.0, 0.0], [5.0, 50.0], [50.0, 50.0], [60.0, 50.0], [70.0, 50.0]])
    data = soundings_at(place, np.full(5, 5.0), ["1985-01-01", "1985-01-01", "1979-12-31", "NaT", "1980-01-01"])
    how = Matching(not_before=datetime.date(1980, 1, 1))
    compared = sounded([surface()], data, how)
    assert compared.reasons == {0: REASONS[OUTSIDE], 1: DRY, 2: "older than 1980-01-01", 3: UNDATED}
    assert compared.rows.tolist() == [4]
    assert sounded([surface()], data, Matching(steepest=0.05)).reasons[2] == STEEP
    assert sounded([surface(longest=9.0)], data, Matching()).reasons[2] == REASONS[LONG_EDGE]
    assert sounded([surface()], data, Matching(radius=5.0)).reasons[2] == REASONS[FEW]
    none = [replace(surface(), tin=None)]
    assert set(sounded(none, data, Matching()).reasons.values()) == {REASONS[OUTSIDE]}


def test_the_reason_of_the_model_that_covers_a_place_counts() -> None:
    points = surface().points
    far = surface_of(np.column_stack([points.xy + 5000.0, points.depth]), 0.2, WATER)
    place = np.array([[5.0, 50.0], [50.0, 50.0]])
    for surfaces in ([surface(), far], [far, surface()]):
        assert sounded(surfaces, soundings_at(place, np.full(2, 5.0)), Matching()).reasons == {0: DRY}


def compared(run: Path, folder: Path, text: str, *options: str) -> Result:
    file = folder / "s.csv"
    file.write_text(text)
    return musat("as11", "compare-soundings", run, stage_readings.DECK, file, *options)


def scaled(factor: float, shift: float = 0.0) -> str:
    """Return the soundings with other depths."""
    head, *lines = stage_readings.soundings().splitlines()
    rows = [line.split(",") for line in lines]
    return "\n".join(
        [head, *(",".join([*row[:3], f"{float(row[3]) * factor + shift:.3f}", row[4]]) for row in rows)]
    )


def test_soundings_of_the_bottom(run_record: Path, tmp_path: Path) -> None:
    """No refraction is left (b), the datum is right (a); the scatter is that of bottom and points, .4 m."""
    result = compared(run_record, tmp_path, stage_readings.soundings(), "--plan-sigma", "1")
    assert result.exit_code == 0 and "of 200 soundings, median" in result.output
    record = valid_rows(tmp_path / "s.soundings.json", DOCUMENT.schema())
    line = record["regression"]
    assert abs(line["b"]) < 3.0 * line["b_sigma"] and line["b_sigma"] < 0.01 and abs(line["a"]) < 0.25
    good = record["samples"][1]
    assert abs(good["median"]) < 0.2 and 0.2 < good["rms"] < 0.6
    blunders = {row["sounding"] for row in record["differences"] if row["blunder"]}
    assert {"S020", "S090", "S150"} - {row["sounding"] for row in record["left_out"]} <= blunders
    assert len(record["differences"]) + len(record["left_out"]) == 200
    assert sum(record["point_orders"].values()) == 241  # submerged points of the deck
    listing = (tmp_path / "s.soundings.lst").read_text()
    assert "edition 6.1.0" in listing and max(map(len, listing.splitlines())) <= 132


def test_the_water_over_the_points_of_a_bottom(run_record: Path) -> None:
    """It stands as far above them as they are deep below it."""
    result = compiled(of_record(run_record), read_compilation(stage_readings.DECK)[0])
    depth = result.points.depth
    for surface in surfaces_of(result)[0]:
        points = surface.points
        below = points.depth - points.water
        assert len(below) > 60
        of_points = depth[np.isfinite(depth)]
        assert np.abs(below[:, None] - of_points).min(axis=1).max() < 1e-6  # m, of the mean of two tides


def test_planes_about_soundings_agree_with_triangles(run_record: Path, tmp_path: Path) -> None:
    """To the scatter of the points; soundings without points within the radius say so, and the record says how."""
    assert compared(run_record, tmp_path, stage_readings.soundings(), "--radius", "200").exit_code == 0
    record = valid_rows(tmp_path / "s.soundings.json", DOCUMENT.schema())
    assert record["matching"]["radius"] == 200.0 and "within 200 m" in (tmp_path / "s.soundings.lst").read_text()
    assert abs(record["samples"][1]["median"]) < 0.3 and record["samples"][1]["rms"] < 0.6
    assert abs(record["regression"]["b"]) < 0.02
    assert "too few points within the radius, or to one side" in {row["reason"] for row in record["left_out"]}


def test_old_soundings_are_left_out(run_record: Path, tmp_path: Path) -> None:
    head, *lines = stage_readings.soundings().splitlines()
    dates = ["1975-06-01", "1980-01-01", ""] * len(lines)
    text = "\n".join([f"{head},date", *(f"{line},{date}" for line, date in zip(lines, dates, strict=False))])
    assert compared(run_record, tmp_path, text, "--not-before", "1980-01-01").exit_code == 0
    record = read_rows(tmp_path / "s.soundings.json")
    reasons = [row["reason"] for row in record["left_out"]]
    assert reasons.count("older than 1980-01-01") == 67 and reasons.count("its date is not known") == 66
    assert {int(row["sounding"][1:]) % 3 for row in record["differences"]} == {1}
    result = compared(run_record, tmp_path, stage_readings.soundings(), "--not-before", "1980-01-01")
    assert result.exit_code == 1 and "no column date" in result.output


def test_a_las_file_on_a_map_says_what_the_csv_file_says(run_record: Path, tmp_path: Path) -> None:
    """NAD27, whose ellipsoid is that of the job; heights in place of depths."""
    rows = [line.split(",") for line in stage_readings.soundings().splitlines()[1:]]
    lat, lon, depth = np.array([[float(cell) for cell in row[1:4]] for row in rows]).T
    zone = pyproj.CRS("EPSG:26720")
    east, north = pyproj.Transformer.from_crs(zone.geodetic_crs, zone, always_xy=True).transform(lon, lat)
    cloud = tmp_path / "cloud.las"
    las.write(cloud, Points(xyz=np.column_stack([east, north, -depth]), crs=zone))
    words = ("as11", "compare-soundings", run_record, stage_readings.DECK, cloud, "--sigma", "0.1")
    assert musat(*words).exit_code == 0
    compared(run_record, tmp_path, stage_readings.soundings())
    of_las, of_csv = (read_rows(tmp_path / f"{name}.soundings.json") for name in ("cloud", "s"))
    pairs = list(zip(of_las["differences"], of_csv["differences"], strict=True))
    for of_point, of_line in pairs:
        assert of_point["difference"] == pytest.approx(of_line["difference"], abs=1e-3)  # 0.1 mm on steep slopes
        assert of_point["sigma"] == pytest.approx(of_line["sigma"], abs=1e-3)
    assert len(of_las["left_out"]) == len(of_csv["left_out"]) and len(pairs) == 175


def test_a_datum_shows_in_a_and_an_option_takes_it_away(run_record: Path, tmp_path: Path) -> None:
    compared(run_record, tmp_path, scaled(1.0, -0.5))
    shifted = read_rows(tmp_path / "s.soundings.json")["regression"]["a"]
    compared(run_record, tmp_path, scaled(1.0, -0.5), "--datum", "0.5")
    right = read_rows(tmp_path / "s.soundings.json")["regression"]["a"]
    assert shifted - right == pytest.approx(0.5, abs=0.01)  # and b times the shift


def test_soundings_in_another_unit_are_named(run_record: Path, tmp_path: Path) -> None:
    result, named = compared(run_record, tmp_path, scaled(100.0)), "they look like centimetres: divide them by 100"
    assert result.exit_code == 0 and named in result.output
    assert named in " ".join((tmp_path / "s.soundings.lst").read_text().split())


@pytest.mark.parametrize(("shift", "words", "datum"), [(2.5, "deeper", -2.5), (-2.5, "less deep", 2.5)])
def test_a_constant_offset_is_named_with_the_datum_that_takes_it_away(
    run_record: Path, tmp_path: Path, shift: float, words: str, datum: float
) -> None:
    result = compared(run_record, tmp_path, scaled(1.0, shift))
    told = re.search(rf"all soundings are (\S+) m {words} than the bottom.* add (\S+) to --datum", result.output)
    assert result.exit_code == 0 and told and float(told[1]) == pytest.approx(2.5, abs=0.2)
    assert float(told[2]) == pytest.approx(datum, abs=0.2)
    right = compared(run_record, tmp_path, scaled(1.0, shift), "--datum", told[2])
    assert right.exit_code == 0 and "than the bottom" not in right.output


WEST_POSITIVE = stage_readings.soundings().replace(",-64.", ",64.")


def test_soundings_that_are_there_twice_are_told(run_record: Path, tmp_path: Path) -> None:
    lines = stage_readings.soundings().splitlines(keepends=True)
    result = compared(run_record, tmp_path, "".join([*lines, lines[5], lines[7]]))
    name = lines[5].partition(",")[0]
    assert result.exit_code == 0 and f"2 soundings are given twice, {name} first" in result.output


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("x,y,depth\n1,2,3\n", (), "give the soundings in these, or name the system of x and y (--crs"),
        (stage_readings.soundings().replace("lat,lon", "lon,lat"), (), "would with lat and lon exchanged"),
        (WEST_POSITIVE, (), "other sign of lon: they look like longitudes that are positive to the west"),
        (WEST_POSITIVE.replace("lat,lon", "lon,lat"), (), "lat and lon exchanged, and the other sign of lon: they"),
        ("lat,lon,depth\n10,20,3\n", (), "no sounding meets the bottom: outside the surface"),
        (stage_readings.soundings(), ("--steepest", "0"), "the bottom is steeper there than the limit"),
    ],
)
def test_soundings_that_meet_nothing(
    run_record: Path, tmp_path: Path, text: str, options: tuple[str, ...], message: str
) -> None:
    result = compared(run_record, tmp_path, text, *options)
    assert result.exit_code == 1 and message in " ".join(result.output.split())
    assert not (tmp_path / "s.soundings.lst").exists()


def test_a_datum_far_from_the_water_is_told(run_record: Path, tmp_path: Path) -> None:
    """Depths below an ellipsoid 36 m off look like soundings, and are none."""
    far = compared(run_record, tmp_path, scaled(1.0, 36.0), "--datum", "-36.0")
    assert far.exit_code == 0, far.output
    assert "the sounding datum is 35.6 m above the water, more than 20 m" in far.stderr
    near = compared(run_record, tmp_path, scaled(1.0, 2.0), "--datum", "-2.0")
    assert "the sounding datum is" not in near.stderr


WGS84 = Ellipsoid("", 6378137.0, 298.257223563)
EAST, NORTH = 290000.0, 2030000.0
CORNER = np.array([EAST, NORTH])
GRADIENT = np.array([0.1, -0.04])


def raster(path: Path, crs: pyproj.CRS | None, **bands: FloatArray) -> Path:
    """Write a plane, 10 m deep in the corner, posts every 5 m over 100 m, with a sigma of .2 m."""
    x, y = np.meshgrid(np.arange(0.0, 101.0, 5.0), np.arange(0.0, 101.0, 5.0))
    depth = 10.0 + GRADIENT[0] * x + GRADIENT[1] * y
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
    np.testing.assert_allclose(at.value[good], 10.0 + draws[good] @ GRADIENT, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(at.gradient[good], np.tile(GRADIENT, (good.sum(), 1)), rtol=0.0, atol=1e-9)
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


@pytest.mark.slow
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
