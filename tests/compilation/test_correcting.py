"""Old compilations corrected, by polynomials too: points, lines, grids, and files that cannot be used."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import rasterio
from click.testing import Result
from scipy.interpolate import LinearNDInterpolator

from cli.commands import musat
from compilation.scenes import at_depth, flat_images, grid, pair, readings_at
from musatpy.arrays import FloatArray
from musatpy.compilation.compiled import OFF_PLATE
from musatpy.compilation.correcting import REASONS, Correction
from musatpy.compilation.correction_fields import smooth
from musatpy.compilation.correction_layers import corrected_lines
from musatpy.compilation.correction_rasters import corrected_grid
from musatpy.compilation.loop import Drive, Loop
from musatpy.compilation.misplaced_points import require_model
from musatpy.compilation.run_records import of_record
from musatpy.compilation.stereomodels import Stereomodel, set_up
from musatpy.compilation.triangulation import Triangulation
from musatpy.compilation.true_points import true_points
from musatpy.errors import CompilationError
from musatpy.geometry.crs import LongitudeLatitude, system_of
from musatpy.geometry.systems import Geocentric, Geographic, LocalRectangular, System
from musatpy.interchange.any_file import Layers, read_layers, write_layers
from musatpy.interchange.layers import Column, Grid, Lines, Points

_X, _Y = (200.0, 1600.0), 1700.0
_POINTING = 0.005


def correction(run: Triangulation, system: System | None = None) -> Correction:
    return Correction(stereo=set_up(run, "1", "2"), system=system or LocalRectangular(), pointing=_POINTING)


def small_format(run: Triangulation) -> Triangulation:
    """Return a run whose photos show no more than a plate of 228.6 mm."""
    cameras = replace(run.block.cameras, format_size=np.full((1, 2), 228.6))
    return replace(run, block=replace(run.block, cameras=cameras))


def apparent_of(stereo: Stereomodel, xy: FloatArray) -> FloatArray:
    """Return where straight rays of images meet, in working coordinates."""
    return stereo.working(Loop(stereo=stereo, drive=Drive.AIR).mark(xy))


@pytest.mark.parametrize("depth", [0.5, 5.0, 30.0])
def test_apparent_points_become_the_true_ones(depth: float) -> None:
    """Images of a flat bottom by the tangent in air; their straight rays meet up to .083 m beside each other."""
    run = pair(3000.0, 1810.0, (0.4, -0.3))
    true = at_depth(grid(_X, _Y), depth)
    corrected = correction(run)
    apparent = run.frame.system(apparent_of(corrected.stereo, flat_images(run, true)))
    done = corrected(apparent)
    # What is left of the last step of both.
    np.testing.assert_allclose(done.xyz, true, rtol=0, atol=1e-6)
    np.testing.assert_allclose(done.depth, depth + 0.05, rtol=0, atol=1e-6)  # below the mean water
    assert done.known.all() and (done.reason == 0).all()
    shift = np.linalg.norm((done.xyz - apparent)[:, :2], axis=1)
    np.testing.assert_allclose(done.shift, shift, rtol=0, atol=1e-9)


@pytest.mark.parametrize("height", [600.0, 3000.0])
@pytest.mark.parametrize("sphere", [False, True])
def test_a_point_is_the_same_by_compile_and_correct(height: float, sphere: bool) -> None:
    """The apparent point that a compilation lists, corrected, is its true one: of images without a y-parallax."""
    run = pair(height, 0.6 * height, (0.4, -0.3), sphere=sphere)
    system = Geographic(run.map_system.ellipsoid) if sphere else None  # type: ignore[union-attr, arg-type]
    corrected = correction(run, system)
    marks = at_depth(grid((-0.25 * height, 0.25 * height), 0.5 * height, 7), 13.0)  # in the model
    xy = Loop(stereo=corrected.stereo).stages(marks).xy
    points = true_points(run, (0, 1), readings_at(xy, sigma=_POINTING))
    done = corrected(points.apparent)
    apart = run.frame.working(done.xyz) - run.frame.working(points.position)
    rounding = 5e-9 if sphere else 1e-9  # five ulps of 6.4e6 m
    assert done.known.all() and np.abs(apart).max() < rounding
    np.testing.assert_allclose(done.depth, points.depth, rtol=0, atol=rounding)
    halfway = run.frame.working(points.apparent) - corrected.stereo.working(corrected.stereo.half_way(xy))
    assert 1e-3 < np.abs(halfway).max()  # another meaning is another point


def test_sigmas_are_those_of_the_images(tmp_path: Path) -> None:
    run = pair(3000.0, 1810.0)
    corrected, true = correction(run), at_depth(grid(_X, _Y, 5), 12.0)
    xy = flat_images(run, true)
    points = true_points(run, (0, 1), readings_at(xy, sigma=_POINTING))
    done = corrected(run.frame.system(apparent_of(corrected.stereo, xy)))
    expected = np.sqrt(np.diagonal(points.covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(done.sigma, expected, rtol=1e-6)
    np.testing.assert_allclose(done.depth_sigma, points.depth_sigma, rtol=1e-6)


def test_points_above_the_water_stay_and_those_that_a_photo_does_not_show_are_named() -> None:
    run = small_format(pair(3000.0, 1810.0))
    points = np.array([[900.0, 100.0, 3.0], [900.0, 100.0, -3.0], [9000.0, 0.0, -3.0], [900.0, 3000.0, 2.0]])
    done = correction(run)(points)
    np.testing.assert_allclose(done.xyz[0], points[0], rtol=0, atol=1e-6)
    assert np.isnan(done.depth[0]) and done.depth[1] == pytest.approx(4.0, abs=0.5)
    assert [REASONS[why] for why in done.reason] == ["", "", OFF_PLATE, OFF_PLATE] and done.known.tolist() == [
        1,
        1,
        0,
        0,
    ]


def test_a_grid_is_read_off_at_its_own_posts() -> None:
    """A bottom that falls by a tenth: its apparent surface from a dense net of points, bilinear between posts."""
    run = small_format(pair(3000.0, 1810.0))
    corrected = correction(run)

    def bottom(xy: FloatArray) -> FloatArray:
        return np.asarray(-6.0 - 0.1 * (xy[:, 0] - 600.0) - 0.05 * xy[:, 1])

    side = np.arange(-60.0, 260.0, 5.0)
    dense = np.stack(np.meshgrid(side + 600.0, side), axis=-1).reshape(-1, 2)
    true = np.column_stack([dense, bottom(dense)])
    true = true[true[:, 2] < -1.0]
    apparent = run.frame.system(apparent_of(corrected.stereo, flat_images(run, true)))
    posts = np.stack(np.meshgrid(600.0 + 10.0 * np.arange(20), 10.0 * np.arange(20)), axis=-1).reshape(-1, 2)
    height = LinearNDInterpolator(apparent[:, :2], apparent[:, 2])(posts).reshape(20, 20)
    given = Grid(west=600.0, south=0.0, spacing=10.0, bands={"z": height})
    result, done = corrected_grid(corrected, given, "z")
    inner = (slice(2, -2), slice(2, -2))  # at the edges a post may come from outside the grid
    expected = bottom(posts).reshape(20, 20)[inner]
    # The apparent surface is bent by some 1e-6 /m; heights without the shift in plan are off by millimetres.
    assert np.abs(result.bands["height"][inner] - expected).max() < 5e-4
    np.testing.assert_allclose(result.bands["depth"][inner], -expected, rtol=0, atol=5e-4)
    assert done.shift > 0.04 and (result.bands["sigma"][inner] > 0.1).all()
    at_posts = corrected(np.column_stack([posts, height.ravel()])).xyz[:, 2].reshape(20, 20)
    assert np.abs(at_posts[inner] - expected).max() > 3e-3


def test_an_empty_post_stays_empty() -> None:
    height = np.full((4, 4), -5.0)
    height[1, 1] = np.nan
    given = Grid(west=800.0, south=0.0, spacing=10.0, bands={"z": height})
    result, done = corrected_grid(correction(pair(3000.0, 1810.0)), given, "z")
    assert np.isnan(result.bands["height"][1, 1]) and np.isfinite(result.bands["height"][3, 3])
    assert done.known < 16 and done.lost[0] == 16 - done.known


def test_lines_are_cut_where_no_photo_shows_them() -> None:
    run = small_format(pair(3000.0, 1810.0))
    x = np.array([900.0, 950.0, 9000.0, 1000.0, 1050.0, 9000.0, 1100.0])
    ring = np.array([[900.0, 0.0, -5.0], [950.0, 0.0, -5.0], [950.0, 50.0, -5.0]])
    lines = Lines(
        vertices=[np.column_stack([x, np.zeros(7), np.full(7, -4.0)]), ring],
        closed=np.array([False, True]),
        columns={"name": Column.of(["a", "b"])},
    )
    result, done = corrected_lines(correction(run), lines)
    assert [len(path) for path in result.vertices] == [2, 2, 3] and result.closed.tolist() == [False, False, True]
    assert result.columns["name"].values.tolist() == ["a", "a", "b"] and done.lost[REASONS.index(OFF_PLATE)] == 2


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([[-600.0, 905.0, -3.0]], "x and y exchanged"),
        ([[905.0 / 0.3048, 2200.0 / 0.3048, -3.0 / 0.3048]], "feet"),
        ([[905.0, 0.0, 2900.0]], "depths positive down"),
    ],
)
def test_points_elsewhere_are_told_what_would_bring_them(points: list[list[float]], words: str) -> None:
    corrected = correction(small_format(pair(3000.0, 1810.0)))
    require_model(corrected, np.array([[905.0, 2000.0, -3.0]]))
    with pytest.raises(CompilationError, match=words):
        require_model(corrected, np.array(points))


# --- the command ---


def corrected(record: Path, source: Path, target: Path, *options: str) -> Result:
    words = ["as11", "correct", str(record), "21", "22", str(source), "-o", str(target), *options]
    return musat(*words)


def bottom_of(record: Path, system: System | None = None) -> tuple[FloatArray, FloatArray, System]:
    """Return true and apparent points of the model, 49 of them, in a system on the ellipsoid of the run."""
    run = of_record(record)
    assert run.map_system is not None and run.map_system.ellipsoid is not None
    stereo, system = set_up(run, "21", "22"), system or LongitudeLatitude(run.map_system.ellipsoid)
    true = np.column_stack([grid((-600.0, 600.0), 1200.0, 7), np.linspace(-20.0, -2.0, 49)])
    apparent = Loop(stereo=stereo, drive=Drive.AIR).mark(Loop(stereo=stereo).stages(true).xy)
    first, second = (system.coordinates(run.frame.level(stereo.working(points))) for points in (true, apparent))
    return first, second, system


def test_a_text_file_is_corrected_in_degrees(run_record: Path, tmp_path: Path) -> None:
    true, apparent, _ = bottom_of(run_record)
    write_layers(tmp_path / "a.csv", {"points": Points(xyz=apparent)})
    np.savetxt(tmp_path / "a.csv", apparent, "%.10f", ",", header="x,y,z", comments="")
    result = corrected(run_record, tmp_path / "a.csv", tmp_path / "true.csv")
    assert result.exit_code == 0, result.output
    assert "points: 49 of 49 with a position, 49 under water; down to " in result.output
    assert "taken as longitude and latitude in degrees" in result.output
    points = read_layers(tmp_path / "true.csv")["points"]
    assert isinstance(points, Points) and "sigma_depth" in points.columns
    # Written to 0.1 mm.
    assert (np.abs(points.xyz - true) < [1e-9, 1e-9, 1e-4]).all()


def test_contours_of_a_map_go_through_a_geopackage(run_record: Path, tmp_path: Path) -> None:
    """Lines in UTM, zone 20 north, of NAD 27, which stands on the ellipsoid of the run; GDAL reads the result."""
    run = of_record(run_record)
    system = system_of("EPSG:26720", run.map_system.ellipsoid)  # type: ignore[union-attr, arg-type]
    true, apparent, _ = bottom_of(run_record, system)
    import pyproj

    crs = pyproj.CRS.from_epsg(26720)
    lines = Lines(
        vertices=[apparent[:20], apparent[20:]], closed=np.zeros(2, bool), crs=crs,
        columns={"depth": Column.of(np.array([5.0, 10.0]), "m")},
    )  # fmt: skip
    write_layers(tmp_path / "a.gpkg", {"contours": lines})
    result = corrected(run_record, tmp_path / "a.gpkg", tmp_path / "true.gpkg")
    assert result.exit_code == 0, result.output
    assert "NAD27 / UTM zone 20N" in result.output
    done = read_layers(tmp_path / "true.gpkg")["lines"]
    assert isinstance(done, Lines)
    assert np.abs(np.concatenate(done.vertices) - true).max() < 1e-6
    assert pyogrio.read_info(tmp_path / "true.gpkg")["crs"] == "EPSG:26720"


def test_a_raster_keeps_its_posts_and_gets_sigmas(run_record: Path, tmp_path: Path) -> None:
    run = of_record(run_record)
    system = system_of("EPSG:26720", run.map_system.ellipsoid)  # type: ignore[union-attr, arg-type]
    true, _, _ = bottom_of(run_record, system)
    middle = np.rint(true[24, :2] / 10.0) * 10.0
    import pyproj

    given = Grid(
        west=float(middle[0]), south=float(middle[1]), spacing=10.0, bands={"z": np.full((6, 8), -5.0)},
        crs=pyproj.CRS.from_epsg(26720),
    )  # fmt: skip
    write_layers(tmp_path / "a.tif", {"grid": given})
    result = corrected(run_record, tmp_path / "a.tif", tmp_path / "true.tif")
    assert result.exit_code == 0, result.output
    with rasterio.open(tmp_path / "true.tif") as dataset:
        assert dataset.descriptions == ("height", "depth", "sigma") and dataset.crs.to_epsg() == 26720
        height = dataset.read(1)
    assert height.shape == (6, 8)
    inner = height[np.isfinite(height)]
    # 5.2 m of apparent depth are 7.0 to 7.6 m.
    assert len(inner) >= 5 * 7 and (inner < -6.7).all() and (inner > -7.6).all()


@pytest.mark.parametrize(
    ("name", "text", "options", "said"),
    [
        (
            "a.csv",
            "x,y,z\n294994.9,2029326.2,-3.0\n",
            (),
            'It shows them as UTM, zone 20 north (--crs "+proj=utm +z',
        ),
        ("a.csv", "x,y,z\n-64.936,18.33,-3.0\n", ("--crs", "EPSG:26720"), "as longitude and latitude in degrees"),
        ("a.csv", "lon,lat,depth\n-64.94,18.33,3.0\n", (), "no column z [m] among lon, lat, depth"),
        ("a.csv", "x,y,z\n-64.94,18.33\n", (), "2 values"),
        ("a.doc", "x,y,z\n", (), "no suffix of a known format"),
        ("a.csv", "", (), "the file is empty"),
    ],
)
def test_files_that_cannot_be_used_are_refused(
    run_record: Path, tmp_path: Path, name: str, text: str, options: tuple[str, ...], said: str
) -> None:
    (tmp_path / name).write_text(text)
    result = corrected(run_record, tmp_path / name, tmp_path / "true.csv", *options)
    assert result.exit_code == 1 and said in result.output, result.output
    assert not (tmp_path / "true.csv").exists()


def test_depths_for_heights_are_told(run_record: Path, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x,y,z\n-64.936,18.330,9.5\n")
    result = corrected(run_record, tmp_path / "a.csv", tmp_path / "true.csv")
    assert result.exit_code == 4 and "rejected: nothing is under water: heights are positive up" in result.output
    assert "true.csv: REJECTED, points: 1 of 1 with a position, 0 under water" in result.output


@pytest.mark.parametrize("names", ["lon,lat,height", "Longitude,Latitude,Elevation", "X,Y,Z"])
def test_coordinates_go_by_other_names(run_record: Path, tmp_path: Path, names: str) -> None:
    (tmp_path / "a.csv").write_text(f"{names}\n-64.936,18.330,-9.5\n")
    result = corrected(run_record, tmp_path / "a.csv", tmp_path / "true.csv")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "true.csv").read_text().startswith("x,y,z,depth [m]")


@pytest.mark.parametrize("suffix", ["gpkg", "tif"])
def test_results_state_the_system_that_was_named(run_record: Path, tmp_path: Path, suffix: str) -> None:
    """A file in zone 20 that says zone 19, or nothing: it is read, and written, by the name that is right."""
    import pyproj

    _, apparent, _ = bottom_of(run_record, system_of("EPSG:26720", of_record(run_record).ellipsoid))  # type: ignore[arg-type]
    for stated in (pyproj.CRS("EPSG:26719"), None):
        layers: Layers = {"points": Points(xyz=apparent, crs=stated)}
        if suffix == "tif":
            west, south = np.rint(apparent[24, :2]).tolist()
            bands = {"z": np.full((6, 8), -5.0)}
            layers = {"grid": Grid(west=west, south=south, spacing=10.0, bands=bands, crs=stated)}
        write_layers(tmp_path / f"a.{suffix}", layers)
        result = corrected(run_record, tmp_path / f"a.{suffix}", tmp_path / f"t.{suffix}", "--crs", "EPSG:26720")
        assert result.exit_code == 0, result.output
        (true,) = read_layers(tmp_path / f"t.{suffix}").values()
        assert true.crs == pyproj.CRS("EPSG:26720")


def test_values_of_empty_posts_are_told(run_record: Path, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x,y,z\n-64.936,18.330,-9.5\n-64.936,18.331,-999\n")
    result = corrected(run_record, tmp_path / "a.csv", tmp_path / "true.csv")
    assert result.exit_code == 0 and "are there values of empty posts or points among the heights" in result.output


def test_formats_hold_what_they_can(run_record: Path, tmp_path: Path) -> None:
    layers: Layers = {"points": Points(xyz=np.array([[-64.94, 18.33, -3.0]]))}
    write_layers(tmp_path / "a.csv", layers)
    result = corrected(run_record, tmp_path / "a.csv", tmp_path / "true.tif")
    assert result.exit_code == 1 and "a .tif file does not hold points" in result.output
    assert corrected(run_record, tmp_path / "a.csv", tmp_path / "true.dxf").exit_code == 0
    assert "+proj=longlat" in (tmp_path / "true.dxf").read_text()


@pytest.fixture(scope="module")
def run(run_record: Path) -> Triangulation:
    return of_record(run_record)


def correction_of(run: Triangulation, system: str) -> Correction:
    assert run.map_system is not None and run.map_system.ellipsoid is not None
    ellipsoid = run.map_system.ellipsoid
    of: System = LongitudeLatitude(ellipsoid) if system == "degrees" else system_of(system, ellipsoid)
    return Correction(stereo=set_up(run, "21", "22"), system=of, pointing=0.005)


@pytest.mark.slow
@pytest.mark.parametrize(("system", "unit"), [("degrees", 110_000.0), ("EPSG:26720", 1.0)])
def test_polynomials_do_what_the_correction_does(run: Triangulation, system: str, unit: float) -> None:
    """Over the ground of both plates and beside it, in water, on land and between the tides (.12 and .31 m)."""
    direct = correction_of(run, system)
    field = smooth(direct, (-30.0, 20.0))
    assert field is not None and field.wet is not None and field.dry is not None
    draws = np.random.default_rng(4)
    beside = 0.1 * (field.high - field.low)
    xy = draws.uniform(field.low - beside, field.high + beside, (3000, 2))
    height = np.concatenate([draws.uniform(-29.0, 19.0, 2900), draws.uniform(0.0, 0.4, 100)])
    points = np.column_stack([xy, height])
    expected, done = direct(points), field(points)
    np.testing.assert_array_equal(done.reason, expected.reason)
    assert 500 < np.count_nonzero(expected.reason) < 2500
    # Tenths of a millimetre, a thousandth of sigmas: what a field is held to where it is made.
    assert np.nanmax(np.abs(done.xyz - expected.xyz) * [unit, unit, 1.0]) < 2e-4
    for name, limit in (("depth", 2e-4), ("moved", 2e-4)):
        assert np.nanmax(np.abs(getattr(done, name) - getattr(expected, name))) < limit
    for name in ("sigma", "depth_sigma"):
        assert np.nanmax(np.abs(getattr(done, name) / getattr(expected, name) - 1.0)) < 2e-3
    np.testing.assert_array_equal(np.isnan(done.depth), np.isnan(expected.depth))


def test_points_outside_the_heights_of_a_field_are_corrected_themselves(run: Triangulation) -> None:
    direct = correction_of(run, "degrees")
    field = smooth(direct, (-10.0, -5.0))
    assert field is not None and field.dry is None
    points = np.array([[-64.936, 18.33, -12.0], [-64.936, 18.33, 3.0], [-64.936, 18.33, -7.0]])
    np.testing.assert_allclose(field(points).xyz, direct(points).xyz, rtol=0, atol=1e-4)


def test_there_is_no_field_where_heights_do_not_say_what_is_wet(run: Triangulation) -> None:
    direct = correction_of(run, "degrees")
    water = run.block.water
    assert water is not None and run.map_system is not None and run.map_system.ellipsoid is not None
    tilted = replace(run, block=replace(run.block, water=replace(water, tilt_east=1e-5)))
    assert smooth(replace(direct, stereo=set_up(tilted, "21", "22")), (-30.0, 20.0)) is None
    assert smooth(replace(direct, system=Geocentric(run.map_system.ellipsoid)), (-30.0, 20.0)) is None
