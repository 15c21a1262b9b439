"""`musat correct`: true points with sigmas, by two photographs and by all, in tables and clouds."""

import csv
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import laspy
import numpy as np
import pytest

from cli.commands import musat
from compilation.scenes import readings_at
from musatpy import model
from musatpy.adjustment.job import adjust
from musatpy.arrays import BoolArray, FloatArray
from musatpy.as11_runs import of_solution
from musatpy.compilation.loop import stages
from musatpy.compilation.stereomodels import set_up
from musatpy.compilation.triangulation import of_record
from musatpy.compilation.true_points import PointSigmas
from musatpy.compilation.true_points import true_points as points_of_readings
from musatpy.geometry.collinearity import attitude_matrix, image, image_by_vector
from musatpy.geometry.crs import LongitudeLatitude
from musatpy.geometry.projected import crs_of
from musatpy.interchange import geotiff
from musatpy.interchange.any_file import read_layers
from musatpy.interchange.layers import LOCAL, Grid, Points
from musatpy.refraction.apparent import Stations, true_points
from musatpy.refraction.flat import incidence
from musatpy.reports.record import dumps, record
from musatpy.simulation import simulate
from musatpy.simulation.simulation_spec import spec_from_table

Method = Callable[[Path], tuple[tuple[float, float, float], tuple[object, ...]]]
DRAWS, NOISE, CONTROL, TIDE = 60, 0.006, 0.05, 0.04  # mm, m, m
DEPTHS = [4.0, 12.0, 8.0, 2.0, 9.0, 3.0, 14.0, 6.0, 11.0, 5.0, 7.0, 13.0, 3.0, 10.0, 2.0, 6.0]
BOTTOM = np.array([(x, y) for y in (-300.0, 0.0, 250.0, 500.0) for x in (-400.0, -130.0, 130.0, 400.0)])
BOTTOM = np.column_stack([BOTTOM, np.negative(DEPTHS)])


@cache
def perfect() -> model.Block:
    """Return a block of two strips without errors, whose cards have the sigmas of those that draws make.

    The tides of all photos have one error in common, and points of control stand on land.
    """
    spec = {
        "seed": 3,
        "job": {"system": "LOCL"},
        "flight": {"photos": 3, "strips": 2, "height": 1500.0, "forward_overlap": 0.7, "side_overlap": 0.5},
        "water": {"level": 0.0, "tide_sigma": TIDE},
        "terrain": {"level": 12.0, "relief": 6.0},
        "points": {"per_site": 6},
        "shoal": [{"share": 0.4, "depth": [2.0, 15.0]}],
        "control": [{"kind": "full", "number": 12, "sigma": [CONTROL] * 3}],
        "measurement": {"noise": 0.0, "sigma": 1e3 * NOISE},
        "options": {"program": "IIIA", "refraction": "RIGOROUS"},
    }
    block = simulate(spec_from_table(spec)).block
    groups = np.full(len(block.photos.ids), "A")
    return replace(block, photos=replace(block.photos, tide_group=groups))


def images(photos: model.Photos, cameras: model.Cameras, X: FloatArray, index: float) -> FloatArray:
    """Return the images (k, n, 2) mm of points X (n, 3) below the water on all photos."""
    f, M = cameras.focal_length[photos.camera], attitude_matrix(photos.attitude)[:, None]
    C, depth = photos.position[:, None], photos.tide[:, None] - X[:, 2]
    v = incidence(C, X[None], np.array([0.0, 0.0, 1.0]), depth, index).v
    return image(v, M, f[:, None], cameras.principal_point[photos.camera][:, None])


def apparent(photos: model.Photos, cameras: model.Cameras, xy: FloatArray, seen: BoolArray) -> FloatArray:
    """Return where straight rays of images xy (k, n, 2) meet by their least squares, of photos seen (n, k)."""
    X, f, M = BOTTOM.copy(), cameras.focal_length[photos.camera], attitude_matrix(photos.attitude)[:, None]
    for _ in range(6):
        at, by = image_by_vector(
            X - photos.position[:, None], M, f[:, None], cameras.principal_point[photos.camera][:, None]
        )
        for row, used in enumerate(seen):
            B, v = by[used, row].reshape(-1, 3), (xy - at)[used, row].reshape(-1)
            X[row] += np.linalg.lstsq(B, v, rcond=None)[0]
    return X


@pytest.mark.slow
def test_errors_are_as_large_as_their_sigmas() -> None:
    """By 60 draws of all that the block is measured by: east, north, height and depth, RMS of errors in sigmas.

    By the first two photographs that see each point, and by all. The RMS of sixteen points has a sigma of .02 (by
    two) to .06 (depths by all) by its scatter, that of four points in 100 draws has .03 to .06.
    """
    block = perfect()
    truth, draws = adjust(block), np.random.default_rng(11)
    assert block.water is not None
    index = block.water.index
    photos = replace(block.photos, position=truth.stations.position, attitude=truth.stations.attitude)
    exact = images(photos, block.cameras, BOTTOM, index)
    seen = (np.abs(exact) < block.cameras.format_size[0] / 2.0).all(axis=2).T
    views = {"two": seen & (np.cumsum(seen, axis=1) <= 2), "all": seen}
    ratios: dict[str, list[FloatArray]] = {name: [] for name in views}
    assert (seen.sum(axis=1) >= 3).all()
    for _ in range(DRAWS):
        plates = block.plates.xy + NOISE * draws.normal(size=block.plates.xy.shape)
        control = block.control.position + CONTROL * draws.normal(size=block.control.position.shape)
        solution = adjust(
            replace(
                block,
                plates=replace(block.plates, xy=plates),
                control=replace(block.control, position=control),
                photos=replace(block.photos, tide=block.photos.tide + TIDE * draws.normal()),
            )
        )
        run = of_solution(solution)
        now, xy = run.block.photos, exact + NOISE * draws.normal(size=exact.shape)
        stations = Stations(position=now.position, level=now.tide, axis=-attitude_matrix(now.attitude)[:, 2])
        errors = PointSigmas(run=run, photos=np.arange(len(now.ids)), pointing=NOISE * solution.unit_sigma)
        for name, chosen in views.items():
            found = true_points(apparent(now, block.cameras, xy, chosen), stations, index, chosen)
            sigma, depth_sigma = errors(found.position, chosen)
            off = np.column_stack([found.position - BOTTOM, found.depth - photos.tide.mean() + BOTTOM[:, 2]])
            ratios[name].append(off / np.column_stack([sigma, depth_sigma]))
    for name, found in ratios.items():
        rms = np.sqrt(np.mean(np.square(found), axis=(0, 1)))
        assert (np.abs(rms - 1.0) < 0.12).all(), (name, rms)


def test_sigmas_are_those_of_the_run_for_its_own_points() -> None:
    """Of points of two rays that the run keeps out, whose covariances it propagates by itself."""
    block = perfect()
    chosen = np.flatnonzero(block.points.bathymetric)[::3]
    out = np.isin(block.plates.point, chosen)
    solution = adjust(replace(block, plates=replace(block.plates, triangulated=~out)))
    seen = np.zeros((len(chosen), len(block.photos.ids)), dtype=bool)
    seen[np.searchsorted(chosen, block.plates.point[out]), block.plates.photo[out]] = True
    errors = PointSigmas(
        run=of_solution(solution), photos=np.arange(len(block.photos.ids)), pointing=NOISE * solution.unit_sigma
    )
    sigma, depth = errors(solution.points.position[chosen], seen)
    covariance = solution.points.covariance[chosen]
    np.testing.assert_allclose(sigma, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)), rtol=1e-6)
    rows = np.array([np.flatnonzero(solution.bathymetric.point == point)[0] for point in chosen])
    np.testing.assert_allclose(depth, solution.bathymetric.depth_sigma[rows], rtol=1e-6)


STATIONS = """name,x,y,z,tide,omega,phi,kappa,focal,width,height
1,0,0,900,0.1,0,0,0,152.4,228.6,228.6
2,500,0,900,0.1,0,0,0,152.4,228.6,228.6
3,250,400,905,0.1,0,0,180,152.4,228.6,228.6
"""
POINTS = np.array(
    [[100.0, 50.0, -6.0], [250.0, 150.0, -9.0], [300.0, -20.0, 3.0], [-600.0, 0.0, -5.0], [9e3, 0.0, -5.0]]
)


def written(folder: Path, sigmas: str = "") -> tuple[str, str]:
    """Write stations, each with the `sigmas`, and points, wet, dry, seen once and never; return their names."""
    names, *rows = STATIONS.splitlines()
    if sigmas:
        names += ",sigma_x,sigma_y,sigma_z,sigma_omega,sigma_phi,sigma_kappa,sigma_tide"
        rows = [f"{row},{sigmas}" for row in rows]
    (folder / "stations.csv").write_text("\n".join([names, *rows]) + "\n")
    lines = [f"{number},{x},{y},{z}" for number, (x, y, z) in enumerate(POINTS)]
    (folder / "points.csv").write_text("\n".join(["id,x,y,z", *lines]) + "\n")
    return str(folder / "stations.csv"), str(folder / "points.csv")


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_sigmas_from_a_table_of_stations(tmp_path: Path) -> None:
    """Sigmas in the table and of the images together; of exact stations those of the images alone."""
    depths = {}
    for name, sigmas in {"exact": "0,0,0,0,0,0,0", "sigmas": ".05,.05,.08,.002,.002,.002,.1", "none": ""}.items():
        stations, points = written(tmp_path, sigmas)
        result = musat(
            "correct", points, "-o", str(tmp_path / f"{name}.csv"), "--stations", stations, "--index", "1.34",
            "--pointing", "6", "-j", "1",
        )  # fmt: skip
        assert result.exit_code == 0, result.output
        assert ("no sigmas: " in result.stdout) == (name == "none")
        rows = rows_of(tmp_path / f"{name}.csv")
        assert [row["reason"] for row in rows] == [
            "", "", "not below the water", "only one camera sees it", "no camera sees it",
        ]  # fmt: skip
        assert all(row["true_x"] == "" and row["x"] for row in rows[2:])
        depths[name] = [float(row.get("sigma_depth", "nan")) for row in rows[:2]]
    options = ("--stations", stations, "--index", "1.34", "-j", "1", "-q", "--photos")
    assert musat("correct", points, "-o", str(tmp_path / "pair.csv"), *options, "1,3").exit_code == 0
    assert rows_of(tmp_path / "pair.csv")[0]["cameras"] == "1 3"
    result = musat("correct", points, "-o", str(tmp_path / "pair.csv"), *options, "1,9")
    assert result.exit_code == 1 and "there is no photo 9" in result.stderr
    # of two vertical images of 6 um, a base of 500 m and a depth that refraction magnifies by a third
    assert np.all(np.array(depths["exact"]) > 0.05) and np.all(np.array(depths["exact"]) < 0.12)
    assert np.all(np.array(depths["sigmas"]) > depths["exact"]) and np.isnan(depths["none"]).all()


def test_a_raster_has_the_points_of_its_posts(tmp_path: Path) -> None:
    """Those of a table of the same places; heights are read as they stand, in any rows."""
    stations, _ = written(tmp_path, ".05,.05,.08,.002,.002,.002,.1")
    heights = np.array([[-6.0, -9.0, 2.0], [-4.0, np.nan, -7.5]])
    grid = Grid(west=100.0, south=50.0, spacing=100.0, bands={"z": heights}, crs=crs_of(LOCAL))
    geotiff.write(tmp_path / "a.tif", grid)
    places = np.column_stack([grid.places(0, 2), heights.ravel()])
    np.savetxt(tmp_path / "a.csv", places, "%.4f", ",", header="x,y,z", comments="")
    options = ("--stations", stations, "--index", "1.34", "--pointing", "6", "-j", "1", "-q")
    for name in ("tif", "csv"):
        assert musat("correct", tmp_path / f"a.{name}", "-o", tmp_path / f"t.{name}", *options).exit_code == 0
    bands, rows = geotiff.read(tmp_path / "t.tif").bands, rows_of(tmp_path / "t.csv")
    for name in ("true_x", "true_y", "true_z", "depth", "sigma_height", "sigma_depth"):
        values = [float(row[name] or "nan") for row in rows]
        np.testing.assert_allclose(bands[name].ravel(), values, atol=5.1e-5)  # four decimals
    np.testing.assert_array_equal(bands["apparent"], heights)
    assert bands["reason"].ravel().tolist() == [0, 0, 2, 0, 1, 0]


def pair_through_a_surface(folder: Path) -> tuple[tuple[float, float, float], tuple[object, ...]]:
    sea = Path(__file__).parents[2] / "fixtures/sea"
    assert musat("sea", "fit", sea / "water.csv", "-o", folder, "--most", 1).exit_code == 0
    options = ("--sea", folder / "water.surface.json", "--stations", sea / "cameras.csv", "--index", 1.34)
    return (5093.25, 2948.0, -5.0), (*options, "--pointing", 5, "--focal", 152, "--format", "228,228")


def control(folder: Path) -> tuple[tuple[float, float, float], tuple[object, ...]]:
    """A dozen points, all mapped 1.2 m too high and some."""
    errors = np.random.default_rng(1).normal(1.2, 0.05, 12)
    rows = [f"C{n},{40.0 * (n % 4)},{30.0 * (n // 4)},{error:.3f}" for n, error in enumerate(errors)]
    (folder / "control.csv").write_text("\n".join(["id,x,y,dz", *rows]) + "\n")
    return (60.5, 30.0, -7.25), ("--by-control", folder / "control.csv", "--function", "none")


def three_stations(folder: Path) -> tuple[tuple[float, float, float], tuple[object, ...]]:
    stations, _ = written(folder, ".05,.05,.08,.002,.002,.002,.1")
    return (100.0, 50.5, -4.0), ("--stations", stations, "--index", 1.34, "--pointing", 6, "-j", 1)


@pytest.mark.parametrize("method", [three_stations, pair_through_a_surface, control])
def test_a_point_has_one_true_place(tmp_path: Path, method: Method) -> None:
    """To 1e-9 m in a table, a cloud and a raster, and with its sigma; a printed one to its last digit."""
    (x, y, z), options = method(tmp_path)
    heights = np.full((2, 2), z)
    geotiff.write(tmp_path / "a.tif", Grid(west=x, south=y, spacing=0.5, bands={"z": heights}, crs=crs_of(LOCAL)))
    las = laspy.LasData(laspy.LasHeader(version="1.4", point_format=6))
    las.header.scales, las.header.offsets = np.full(3, 1e-9), np.array([x, y, z])
    las.x, las.y, las.z = np.array([[x], [y], [z]])
    las.write(tmp_path / "a.las")
    (tmp_path / "a.csv").write_text(f"x,y,z\n{x},{y},{z}\n")
    for source, target in (("a.csv", "t.csv"), ("a.csv", "t.gpkg"), ("a.las", "t.las"), ("a.tif", "t.tif")):
        result = musat("correct", tmp_path / source, "-o", tmp_path / target, "-q", *options)
        assert result.exit_code == 0, result.output
    bands, cloud = geotiff.read(tmp_path / "t.tif").bands, laspy.read(tmp_path / "t.las")
    true = np.array([bands[f"true_{axis}"][0, 0] for axis in "xyz"])
    assert 1.0 < abs(true[2] - z) < 2.1
    np.testing.assert_allclose(np.asarray(cloud.xyz)[0], true, rtol=0.0, atol=1e-9)
    vector = read_layers(tmp_path / "t.gpkg")["points"]
    assert isinstance(vector, Points)
    np.testing.assert_allclose(vector.xyz[0], true, rtol=0.0, atol=1e-9)
    (row,) = rows_of(tmp_path / "t.csv")
    assert [row[f"true_{axis}"] for axis in "xyz"] == [f"{value:.4f}" for value in true]
    sigma = bands["sigma_height"][0, 0]
    assert row["sigma_height"] == f"{sigma:.4f}" and cloud["sigma_height"][0] == np.float32(sigma)
    assert vector.columns["sigma_height"].values[0] == pytest.approx(sigma, rel=1e-12)
    assert vector.columns["apparent_z"].values[0] == cloud["apparent_z"][0] == bands["apparent"][0, 0] == z
    assert (row["reason"], cloud["reason"][0], bands["reason"][0, 0]) == ("", 0, 0)


def test_points_below_waves_are_those_of_their_model(tmp_path: Path) -> None:
    """By two photographs: straight rays of the images of true points meet in the given ones; by all too."""
    deck = Path(__file__).parents[2] / "fixtures/waves/strip.crd"
    assert musat("run", "-q", str(deck), "-o", str(tmp_path)).exit_code == 0
    draws = np.random.default_rng(2)
    X = draws.uniform([-81.308, 19.295, -9.0], [-81.304, 19.298, -2.0], (12, 3))
    run, target = str(tmp_path / "strip.json"), tmp_path / "true.csv"
    (tmp_path / "points.csv").write_text("x,y,z\n" + "".join(f"{x:.9f},{y:.9f},{z:.4f}\n" for x, y, z in X))
    given = ("correct", str(tmp_path / "points.csv"), "-o", str(target), "--run", run, "-j", "1")
    assert musat(*given, "--photos", "837,838").exit_code == 0
    rows = rows_of(target)
    triangulation = of_record(Path(run))
    assert triangulation.sea is not None and triangulation.ellipsoid is not None
    pointing = triangulation.block.options.plate_sigma * triangulation.unit_sigma
    system, stereo = LongitudeLatitude(triangulation.ellipsoid), set_up(triangulation, "837", "838")
    true = np.array([[float(row[f"true_{axis}"]) for axis in "xyz"] for row in rows])
    xy = stages(stereo, stereo.model(triangulation.frame.from_level(system.level(true))))
    points = points_of_readings(triangulation, stereo.photos, readings_at(xy, sigma=pointing))
    back = system.coordinates(triangulation.frame.level(triangulation.frame.working(points.apparent)))
    given_places = np.array([[float(row[axis]) for axis in "xyz"] for row in rows])
    np.testing.assert_allclose(back[:, :2], given_places[:, :2], rtol=0.0, atol=2e-9)  # a degree is 111 km
    np.testing.assert_allclose(back[:, 2], given_places[:, 2], rtol=0.0, atol=1e-4)
    depth_sigma = [float(row["sigma_depth"]) for row in rows]
    np.testing.assert_allclose(depth_sigma, points.depth_sigma, rtol=0.0, atol=6e-5)
    assert musat(*given).exit_code == 0
    by_all = rows_of(target)
    assert {row["reason"] for row in by_all} == {""} and max(len(row["cameras"].split()) for row in by_all) > 2
    assert all(float(row["sigma_depth"]) < sigma + 1e-4 for row, sigma in zip(by_all, depth_sigma, strict=True))


def test_a_run_has_the_sigmas_of_its_stations(tmp_path: Path) -> None:
    """By its record: those that its solution has for the same points, to the digits of the table."""
    solution = adjust(perfect())
    (tmp_path / "run.json").write_text(dumps(record(solution)))
    run = of_solution(solution)
    photos = run.block.photos
    xy = images(photos, run.block.cameras, BOTTOM, 1.34)
    seen = (np.abs(xy) < run.block.cameras.format_size[0] / 2.0).all(axis=2).T
    X = apparent(photos, run.block.cameras, xy, seen)
    lines = [",".join(map(repr, row)) for row in X.tolist()]
    (tmp_path / "points.csv").write_text("\n".join(["x,y,z", *lines]) + "\n")
    points, target, source = (str(tmp_path / name) for name in ("points.csv", "true.csv", "run.json"))
    result = musat("correct", points, "-o", target, "--run", source, "-j", "1")
    assert result.exit_code == 0, result.output
    assert "sigma of a depth" in result.stdout
    pointing = solution.block.options.plate_sigma * solution.unit_sigma
    sigma, depth = PointSigmas(run=run, photos=np.arange(len(photos.ids)), pointing=pointing)(BOTTOM, seen)
    for row, place, one, of_depth in zip(rows_of(tmp_path / "true.csv"), BOTTOM, sigma, depth, strict=True):
        np.testing.assert_allclose([float(row[f"true_{axis}"]) for axis in "xyz"], place, atol=1e-3)
        found = [float(row[f"sigma_{name}"]) for name in ("east", "north", "height", "depth")]
        np.testing.assert_allclose(found, [*one, of_depth], atol=6e-5)
