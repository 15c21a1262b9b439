"""`musat correct` of drawing and GIS files, of surfaces, from one format into another; `as11 correct`."""

import subprocess
import sys
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import pyproj
import pytest
import rasterio
from click.testing import Result
from scipy.interpolate import LinearNDInterpolator

from cli.commands import musat
from compilation.scenes import grid, readings_at
from musatpy.arrays import FloatArray
from musatpy.compilation.loop import stages
from musatpy.compilation.stereomodels import set_up
from musatpy.compilation.triangulation import of_record
from musatpy.compilation.true_points import true_points
from musatpy.correction import rasters
from musatpy.geometry.crs import LongitudeLatitude, system_of
from musatpy.geometry.projected import crs_of
from musatpy.geometry.systems import System
from musatpy.interchange import geotiff, xyz
from musatpy.interchange.any_file import Layers, read_layers, write_layers
from musatpy.interchange.layers import LOCAL, Grid, LayerColumn, Lines, Points
from musatpy.refraction.apparent import Stations, apparent_points

INDEX = 1.34
STATIONS = """name,x,y,z,tide,omega,phi,kappa,focal,width,height,\
sigma_x,sigma_y,sigma_z,sigma_omega,sigma_phi,sigma_kappa
1,0,0,3000,0,0,0,0,152.4,228.6,228.6,.05,.05,.08,.002,.002,.002
2,1800,0,3000,0,0,0,0,152.4,228.6,228.6,.05,.05,.08,.002,.002,.002
"""


@pytest.fixture
def stations(tmp_path: Path) -> Path:
    """Return a table of two stations of a local job, with sigmas."""
    path = tmp_path / "stations.csv"
    path.write_text(STATIONS)
    return path


def by_stations(stations: Path, source: Path, target: Path, *options: str) -> Result:
    given = ("--stations", stations, "--index", INDEX, "--pointing", 5, "-j", 1)
    return musat("correct", source, "-o", target, *given, *options)


def by_model(record: Path, source: Path, target: Path, *options: str) -> Result:
    return musat("as11", "correct", record, "21", "22", source, "-o", target, "-j", "1", *options)


def seen_from_air(true: FloatArray) -> FloatArray:
    """Return the apparent points (n, 3) of true ones below the water of the table."""
    position = np.array([[0.0, 0.0, 3000.0], [1800.0, 0.0, 3000.0]])
    axis = np.tile([0.0, 0.0, -1.0], (2, 1))
    return apparent_points(true, Stations(position=position, level=np.zeros(2), axis=axis), INDEX)[0]


def bottom_of(record: Path, system: System | None = None) -> tuple[FloatArray, FloatArray]:
    """Return true and apparent points of the model 21, 22 of a run, by the loop of an analytical plotter."""
    run = of_record(record)
    assert run.ellipsoid is not None
    stereo, system = set_up(run, "21", "22"), system or LongitudeLatitude(run.ellipsoid)
    true = np.column_stack([grid((-600.0, 600.0), 1200.0, 7), np.linspace(-20.0, -2.0, 49)])
    readings = readings_at(stages(stereo, true))
    apparent = run.frame.working(true_points(run, stereo.photos, readings).apparent)
    first, second = (system.coordinates(run.frame.level(points)) for points in (stereo.working(true), apparent))
    return first, second


def test_points_of_a_model_are_those_of_its_compilation(run_record: Path, tmp_path: Path) -> None:
    """Places of the plotter's loop, and sigmas that the compilation has of the same images."""
    true, apparent = bottom_of(run_record)
    np.savetxt(tmp_path / "a.csv", apparent, "%.10f", ",", header="Longitude,Latitude,Elevation", comments="")
    result = by_model(run_record, tmp_path / "a.csv", tmp_path / "true.csv")
    assert result.exit_code == 0 and "49 points, 49 corrected" in result.output, result.output
    assert "taken as longitude and latitude in degrees" in result.output
    rows = xyz.read(tmp_path / "true.csv").columns
    found = np.column_stack([rows[f"true_{axis}"].values for axis in "xyz"])
    assert (np.abs(found - true) < [1e-9, 1e-9, 1e-4]).all()  # written to 0.1 mm
    run = of_record(run_record)
    stereo = set_up(run, "21", "22")
    level = LongitudeLatitude(run.ellipsoid).level(true)
    xy = stages(stereo, stereo.model(run.frame.from_level(level)))
    pointing = run.block.options.plate_sigma * run.unit_sigma
    points = true_points(run, stereo.photos, readings_at(xy, sigma=pointing))
    expected = np.sqrt(np.diagonal(points.covariance, axis1=1, axis2=2))
    sigmas = np.column_stack([rows[f"sigma_{name}"].values for name in ("east", "north", "height")])
    np.testing.assert_allclose(sigmas, expected, rtol=0.0, atol=6e-5)
    np.testing.assert_allclose(rows["sigma_depth"].values, points.depth_sigma, rtol=0.0, atol=6e-5)
    vertical, depth = 1.96 * sigmas[:, 2], rows["depth"].values
    assert (vertical > np.hypot(0.5, 0.013 * depth)).all() and (vertical < np.hypot(1.0, 0.023 * depth)).all()
    assert (rows["s44"].values == 2).all()  # S-44 6.1.0: not 1a or 1b, but 2


def test_contours_of_a_map_go_through_a_geopackage(run_record: Path, tmp_path: Path) -> None:
    """Lines in UTM, zone 20 north, of NAD 27, which stands on the ellipsoid of the run; GDAL reads the result."""
    true, apparent = bottom_of(run_record, system_of("EPSG:26720", of_record(run_record).ellipsoid))
    lines = Lines(
        vertices=[apparent[:20], apparent[20:]], closed=np.zeros(2, bool), crs=pyproj.CRS.from_epsg(26720),
        columns={"depth": LayerColumn.of(np.array([5.0, 10.0]), "m")},
    )  # fmt: skip
    write_layers(tmp_path / "a.gpkg", {"contours": lines})
    result = by_model(run_record, tmp_path / "a.gpkg", tmp_path / "true.gpkg")
    assert result.exit_code == 0 and "NAD27 / UTM zone 20N" in result.output, result.output
    done = read_layers(tmp_path / "true.gpkg")["lines"]
    assert isinstance(done, Lines) and done.columns["depth"].values.tolist() == [5.0, 10.0]
    assert np.abs(np.concatenate(done.vertices) - true).max() < 2e-6
    assert pyogrio.read_info(tmp_path / "true.gpkg")["crs"] == "EPSG:26720"


def test_lines_are_cut_where_no_photo_shows_them_and_stay_on_land(stations: Path, tmp_path: Path) -> None:
    x = np.array([900.0, 950.0, 9000.0, 1000.0, 1050.0, 9000.0, 1100.0])
    ring = np.array([[900.0, 0.0, -5.0], [950.0, 0.0, -5.0], [950.0, 50.0, 2.0]])
    lines = Lines(
        vertices=[np.column_stack([x, np.zeros(7), np.full(7, -4.0)]), ring],
        closed=np.array([False, True]),
        columns={"name": LayerColumn.of(["a", "b"])},
    )
    write_layers(tmp_path / "a.gpkg", {"lines": lines})
    result = by_stations(stations, tmp_path / "a.gpkg", tmp_path / "true.gpkg")
    assert result.exit_code == 0, result.output
    assert (
        "1 not corrected: not below the water" in result.stdout
        and "2 not corrected: no camera sees it" in result.stdout
    )
    done = read_layers(tmp_path / "true.gpkg")["lines"]
    assert isinstance(done, Lines)
    assert [len(path) for path in done.vertices] == [2, 2, 3] and done.closed.tolist() == [False, False, True]
    assert done.columns["name"].values.tolist() == ["a", "a", "b"]
    np.testing.assert_array_equal(done.vertices[2][2], ring[2])
    assert (done.vertices[2][:2, 2] < -6.5).all()


@pytest.mark.parametrize(("source", "target"), [("a.las", "t.csv"), ("a.csv", "t.laz"), ("a.xyz", "t.gpkg")])
def test_points_go_from_one_format_into_another(stations: Path, tmp_path: Path, source: str, target: str) -> None:
    """At their true places with the apparent ones beside, as in a LAS file; those on land stay, with the reason."""
    true = np.column_stack([grid((500.0, 1300.0), 300.0, 4), np.linspace(-9.0, -1.0, 16)])
    apparent = np.vstack([seen_from_air(true), [900.0, 0.0, 3.0]])
    np.savetxt(tmp_path / "a.csv", apparent, "%.6f", ",", header="x,y,z", comments="")
    np.savetxt(tmp_path / "a.xyz", apparent, "%.6f")
    cloud = laspy.LasData(laspy.LasHeader(version="1.4", point_format=6))
    cloud.header.scales = np.full(3, 1e-6)
    cloud.x, cloud.y, cloud.z = apparent.T
    cloud.write(tmp_path / "a.las")
    result = by_stations(stations, tmp_path / source, tmp_path / target)
    assert result.exit_code == 0 and "17 points, 16 corrected" in result.output, result.output
    (points,) = read_layers(tmp_path / target, crs_of(LOCAL)).values()
    assert isinstance(points, Points)
    np.testing.assert_allclose(points.xyz[:16], true, rtol=0.0, atol=1.1e-4)
    np.testing.assert_allclose(points.xyz[16], apparent[16], rtol=0.0, atol=1e-9)
    columns = points.columns
    np.testing.assert_allclose(columns["apparent_z"].values, apparent[:, 2], rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(columns["depth"].values[:16], -true[:, 2], rtol=0.0, atol=1.1e-4)
    assert (columns["sigma_depth"].values[:16] > 0.05).all() and np.isnan(columns["sigma_depth"].values[16])
    reasons = columns["reason"].values.tolist()
    assert reasons[0] in ("", 0) and reasons[16] in ("not below the water", 2)


@pytest.mark.parametrize("suffix", ["gpkg", "tif"])
def test_results_state_the_system_that_was_named(run_record: Path, tmp_path: Path, suffix: str) -> None:
    """A file in zone 20 that says zone 19, or nothing: it is read, and written, by the name that is right."""
    _, apparent = bottom_of(run_record, system_of("EPSG:26720", of_record(run_record).ellipsoid))
    for stated in (pyproj.CRS("EPSG:26719"), None):
        layers: Layers = {"points": Points(xyz=apparent, crs=stated)}
        if suffix == "tif":
            west, south = np.rint(apparent[24, :2]).tolist()
            bands = {"z": np.full((6, 8), -5.0)}
            layers = {"grid": Grid(west=west, south=south, spacing=10.0, bands=bands, crs=stated)}
        write_layers(tmp_path / f"a.{suffix}", layers)
        result = by_model(run_record, tmp_path / f"a.{suffix}", tmp_path / f"t.{suffix}", "--crs", "EPSG:26720")
        assert result.exit_code == 0, result.output
        (true,) = read_layers(tmp_path / f"t.{suffix}").values()
        assert true.crs == pyproj.CRS("EPSG:26720")


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ("0,3900,-3", "x and y exchanged"),
        ("2952.7,7217.8,-9.8", "feet"),
        ("2600,0,2500", "depths positive down"),
    ],
)
def test_points_elsewhere_are_told_what_would_bring_them(
    stations: Path, tmp_path: Path, points: str, words: str
) -> None:
    for suffix in ("csv", "gpkg"):
        place = np.array([[float(value) for value in points.split(",")]])
        (tmp_path / "a.csv").write_text(f"x,y,z\n{points}\n")
        write_layers(tmp_path / "a.gpkg", {"points": Points(xyz=place)})
        result = by_stations(stations, tmp_path / f"a.{suffix}", tmp_path / f"t.{suffix}")
        assert result.exit_code == 1 and f"They are seen as {words}" in result.output, result.output
        assert not (tmp_path / f"t.{suffix}").exists()


LON_LAT = "x,y,z\n-64.936,18.33,-3.0\n"


@pytest.mark.parametrize(
    ("text", "target", "options", "said"),
    [
        (
            "x,y,z\n294994.9,2029326.2,-3.0\n",
            "t.csv",
            (),
            'They are seen as UTM, zone 20 north (--crs "+proj=utm +z',
        ),
        (LON_LAT, "t.csv", ("--crs", "EPSG:26720"), "as longitude and latitude in degrees"),
        ("lon,lat,depth\n-64.94,18.33,3.0\n", "t.csv", (), "no column z [m] among lon, lat, depth"),
        ("x,y,z\n-64.94,18.33\n", "t.csv", (), "2 values"),
        (LON_LAT, "t.tif", (), "a .tif file does not hold points"),
        ("x,y,z,remark\n-64.936,18.33,-3.0,ü\n", "t.las", (), "columns remark: texts; expected: numbers"),
        (LON_LAT, "t.doc", (), "no suffix of a known format"),
        (LON_LAT, "t.csv", ("--surface",), "a surface is that of a raster"),
        ("x,y,z\n-64.936,18.330,9.5\n", "t.csv", (), "nothing is under water: heights are positive up"),
        (
            "x,y,z\n-64.936,18.330,-9.5\n-64.936,18.331,-999\n",
            "t.csv",
            ("--strict",),
            "values of empty posts or points",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_or_doubted(
    run_record: Path, tmp_path: Path, text: str, target: str, options: tuple[str, ...], said: str
) -> None:
    (tmp_path / "a.csv").write_text(text)
    result = by_model(run_record, tmp_path / "a.csv", tmp_path / target, *options)
    rejected = "heights" in said or "empty" in said
    assert result.exit_code == (4 if rejected else 1) and said in result.output, result.output
    assert (tmp_path / target).exists() == rejected
    if options == ("--strict",):
        assert by_model(run_record, tmp_path / "a.csv", tmp_path / target).exit_code == 0
    if target == "t.doc":
        assert by_model(run_record, tmp_path / "a.csv", tmp_path / "t.dxf").exit_code == 0
        assert "+proj=longlat" in (tmp_path / "t.dxf").read_text()


# --- surfaces ---


def slope(xy: FloatArray) -> FloatArray:
    return np.asarray(-6.0 - 0.1 * (xy[:, 0] - 600.0) - 0.05 * xy[:, 1])


def test_a_surface_is_read_off_at_its_own_posts(stations: Path, tmp_path: Path) -> None:
    """A bottom that falls by a tenth: its apparent surface from a dense net of points, bilinear between posts."""
    side = np.arange(-60.0, 260.0, 5.0)
    dense = np.stack(np.meshgrid(side + 600.0, side), axis=-1).reshape(-1, 2)
    true = np.column_stack([dense, slope(dense)])
    apparent = seen_from_air(true[true[:, 2] < -1.0])
    posts = np.stack(np.meshgrid(600.0 + 10.0 * np.arange(20), 10.0 * np.arange(20)), axis=-1).reshape(-1, 2)
    height = LinearNDInterpolator(apparent[:, :2], apparent[:, 2])(posts).reshape(20, 20)
    height[10, 10] = np.nan
    given = Grid(west=600.0, south=0.0, spacing=10.0, bands={"z": height}, crs=crs_of(LOCAL))
    geotiff.write(tmp_path / "a.tif", given)
    assert by_stations(stations, tmp_path / "a.tif", tmp_path / "t.tif", "--surface").exit_code == 0
    bands, inner = geotiff.read(tmp_path / "t.tif").bands, (slice(2, -2), slice(2, -2))
    expected = slope(posts).reshape(20, 20)[inner]
    found = bands["height"][inner]
    known = np.isfinite(found)
    assert not known[8, 8] and (~known).sum() < 5  # beside the empty post
    # The apparent surface is bent by some 1e-6 /m; heights without the shift in plan are off by millimetres.
    assert np.abs(found - expected)[known].max() < 5e-4
    np.testing.assert_allclose(bands["depth"][inner][known], -expected[known], rtol=0, atol=5e-4)
    assert (bands["sigma"][inner][known] > 0.1).all()
    assert by_stations(stations, tmp_path / "a.tif", tmp_path / "t.csv").exit_code == 0
    at_posts = xyz.read(tmp_path / "t.csv")
    off = at_posts.xyz[:, 2] - slope(
        at_posts.columns["apparent_x"].values[:, None] * [1, 0]
        + [0, 1] * at_posts.columns["apparent_y"].values[:, None]
    )
    assert np.abs(off).max() > 3e-3 and np.abs(at_posts.xyz[:, 2] - slope(at_posts.xyz[:, :2])).max() < 5e-4


@pytest.mark.parametrize(("south", "fall"), [(1500.0, -0.01), (-1500.0, 0.01)])
def test_as_many_rows_are_read_as_posts_move_over(
    stations: Path, tmp_path: Path, south: float, fall: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Posts of 2 cm, whose apparent places lie several rows north or south of them: by single rows as in one."""
    height = -8.0 + fall * np.add.outer(np.arange(30.0), np.arange(6.0))
    given = Grid(west=1500.0, south=south, spacing=0.02, bands={"z": height}, crs=crs_of(LOCAL))
    geotiff.write(tmp_path / "a.tif", given)
    assert by_stations(stations, tmp_path / "a.tif", tmp_path / "whole.tif", "--surface").exit_code == 0
    monkeypatch.setattr(rasters, "POSTS", 6)
    assert by_stations(stations, tmp_path / "a.tif", tmp_path / "parts.tif", "--surface").exit_code == 0
    whole, parts = (geotiff.read(tmp_path / f"{name}.tif") for name in ("whole", "parts"))
    assert np.isfinite(whole.bands["height"]).sum() > 10
    for name in ("height", "depth", "sigma"):
        np.testing.assert_allclose(parts.bands[name], whole.bands[name], rtol=0.0, atol=1e-7)


def test_posts_on_land_keep_their_heights(run_record: Path, tmp_path: Path) -> None:
    """By `as11 correct`, which makes surfaces of rasters; depths of an apparent 5.2 m are 7.0 to 7.6 m."""
    heights = np.full((6, 8), -5.0)
    heights[4:] = 3.0
    crs = pyproj.CRS("+proj=longlat +ellps=clrk66 +type=crs")
    given = Grid(west=-64.936, south=18.33, spacing=1e-4, bands={"z": heights, "other": heights}, crs=crs)
    geotiff.write(tmp_path / "a.tif", given)
    result = by_model(run_record, tmp_path / "a.tif", tmp_path / "true.tif")
    assert result.exit_code == 1 and "which band has the heights? --band is one of z, other" in result.output
    assert by_model(run_record, tmp_path / "a.tif", tmp_path / "true.tif", "--band", "z").exit_code == 0
    with rasterio.open(tmp_path / "true.tif") as dataset:
        assert dataset.descriptions == ("height", "depth", "sigma")
        height, depth = dataset.read(1)[::-1], dataset.read(2)[::-1]
    np.testing.assert_array_equal(height[4:], 3.0)
    assert np.isnan(depth[4:]).all()
    inner = height[1:3, 1:-1]
    assert (inner < -6.7).all() and (inner > -7.6).all()


# --- without room ---

_FULL = """
import resource, signal, sys
from musatpy.cli.main import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
limit = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
main()
"""


def written(folder: Path, name: str, count: int) -> Path:
    """Write many apparent points in the model, or posts, in the format of a result; return the file."""
    if name.endswith(".tif"):
        crs, side = pyproj.CRS("+proj=longlat +ellps=clrk66 +type=crs"), int(count**0.5)
        bands = {"z": np.full((side, side), -5.0)}
        geotiff.write(folder / "a.tif", Grid(west=-64.938, south=18.328, spacing=6e-3 / side, bands=bands, crs=crs))
        return folder / "a.tif"
    places = np.random.default_rng(5).uniform([-64.938, 18.328, -12.0], [-64.932, 18.336, -1.0], (count, 3))
    np.savetxt(folder / "a.csv", places, "%.9f", ",", header="x,y,z", comments="")
    return folder / "a.csv"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["true.tif", "true.csv", "true.laz", "true.gpkg", "true.dxf"])
def test_a_full_disk_leaves_the_old_file(run_record: Path, tmp_path: Path, name: str) -> None:
    """The next run takes away what a killed one has left."""
    source = written(tmp_path, name, 3000)
    (tmp_path / name).write_bytes(b"of an earlier run")
    words = ["as11", "correct", run_record, "21", "22", source, "-o", tmp_path / name, "-j", "1"]
    command = [sys.executable, "-B", "-c", _FULL, "20000", *map(str, words)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode == 1 and "Traceback" not in ran.stderr and name in ran.stderr, ran.stderr
    assert (tmp_path / name).read_bytes() == b"of an earlier run"
    assert sorted(left.name for left in tmp_path.iterdir()) == sorted([source.name, name])
    ended = subprocess.Popen([sys.executable, "-c", "pass"])
    ended.wait()
    (tmp_path / f".{name}.{ended.pid}.{'0' * 16}").write_bytes(b"half a fi")
    assert by_model(run_record, written(tmp_path, name, 25), tmp_path / name).exit_code == 0
    assert sorted(left.name for left in tmp_path.iterdir()) == sorted([source.name, name])
