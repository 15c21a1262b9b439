"""Points near the water, which neither heights nor residuals decide: their sigmas cover wet and dry."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest

from musatpy.arrays import BoolArray, FloatArray
from musatpy.compilation.triangulation import of_stations
from musatpy.compilation.true_points import images_of
from musatpy.correction.file_cameras import ByFileCameras
from musatpy.correction.files import correct_file
from musatpy.correction.methods import CorrectedPoints, Tally
from musatpy.errors import Problem
from musatpy.geometry.crs import LongitudeLatitude
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.systems import LocalRectangular
from musatpy.model import Water
from musatpy.reduction.pixel_lens import PixelLens
from musatpy.refraction.apparent import REASONS, Fault
from musatpy.sfm.block import TURN, Placement, pixels_of
from musatpy.sfm.intersection import intersections
from musatpy.sfm.model import Model
from musatpy.sfm.source import FileCameras
from musatpy.sfm.wet import read_water

SIZE, PIXEL = 0.0024, 0.5  # mm of a pixel, px of noise
LENS = PixelLens(width=5472, height=3648, focal=(3666.7, 3666.7), centre=(2736.0, 1824.0))
COUNT, LEVEL = 600, 0.01  # points, m of sigma of the water


@cache
def shore(seed: int = 3) -> tuple[ByFileCameras, FloatArray, FloatArray]:
    """A method, the true places of points up to .3 m above and below a level, and the cloud of straight rays.

    Cameras are true, levels have errors, images noise: so the errors of points are nearly independent.
    """
    rng, n = np.random.default_rng(seed), 6
    centre = np.column_stack([np.linspace(-30.0, 30.0, n), rng.uniform(-10.0, 10.0, n), np.full(n, 80.0)])
    names = tuple(f"{photo}.jpg" for photo in range(n))
    camera = np.tile([3666.7 * SIZE, 5472 * SIZE, 3648 * SIZE], (n, 1))
    sigma = np.tile([1e-4] * 3 + [1e-7] * 3 + [LEVEL], (n, 1))
    level = rng.normal(0.0, LEVEL, n)
    run = of_stations(names, centre, np.tile(np.eye(3), (n, 1, 1)), camera, np.zeros(n), sigma, Water(index=1.34))
    true = of_stations(names, centre, np.tile(np.eye(3), (n, 1, 1)), camera, level, sigma, Water(index=1.34))
    ground = rng.uniform([-20.0, -15.0, -0.3], [20.0, 15.0, 0.3], (COUNT, 3))
    wet = np.ones(COUNT, dtype=bool)
    xy = np.concatenate(
        [images_of(true, (k, k + 1), true.frame.working(ground), wet).swapaxes(0, 1) for k in (0, 2, 4)]
    )
    photo, point = np.repeat(np.arange(n), COUNT), np.tile(np.arange(COUNT), n)
    pixel = pixels_of(LENS, xy.reshape(-1, 2), SIZE) + rng.normal(0.0, PIXEL, (n * COUNT, 2))
    model = Model(
        program="colmap", cameras=("1",), lenses=(LENS,), photos=np.array(names), camera=np.zeros(n, int),
        rotation=np.tile(TURN, (n, 1, 1)), centre=centre, points=np.arange(COUNT).astype(np.str_), position=ground,
        photo=photo, point=point, pixel=pixel,
    )  # fmt: skip
    placement = Placement(scale=1.0, rotation=np.eye(3), shift=np.zeros(3), ellipsoid=None)
    method = ByFileCameras(
        system=LocalRectangular(), cameras=FileCameras.of(model, placement, SIZE, True), run=run, lenses=(LENS,),
        rows=np.arange(n), sigma=PIXEL * SIZE, most=12, in_model=True,
    )  # fmt: skip
    return method, ground, intersections(model, photo, point, pixel, COUNT)


def corrected(method: ByFileCameras, cloud: FloatArray) -> tuple[CorrectedPoints, BoolArray]:
    points = method("cloud.csv", cloud)
    assert isinstance(points, CorrectedPoints) and points.good.all()
    return points, np.asarray(points.fault == Fault.UNDECIDED)


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_errors_near_the_water_are_within_sigmas_that_cover_wet_and_dry() -> None:
    """RMS over sigmas of some 55 and 420 points have sigmas of 10 and 3 %; the levels have six errors."""
    method, ground, cloud = shore()
    points, undecided = corrected(method, cloud)
    height, values = np.abs(ground[:, 2]), points.values
    assert undecided[height < 0.02].mean() > 0.9 and not undecided[height > 0.12].any()
    off = (points.true[:, 2] - ground[:, 2]) / values["sigma_z"]
    assert 0.75 < rms(off[height < 0.03]) < 1.1 and 0.9 < rms(off[height > 0.1]) < 1.1
    assert rms((values["depth"] + ground[:, 2])[undecided] / values["sigma_depth"][undecided]) < 1.0
    assert (np.abs(values["depth"])[~undecided] > 3.0 * values["sigma_depth"][~undecided]).all()
    beyond = np.median(values["sigma_z"][ground[:, 2] < -0.1])  # of wet points, the larger one
    assert (values["sigma_z"][undecided] > 0.8 * beyond).all()
    tally = Tally.of(points, method.reasons)
    near = np.count_nonzero(undecided)
    assert method.lines(tally)[:2] == ["600 points, 600 corrected", f"{near} undecided"]
    assert f"{near} points undecided by height" in method.lines(tally)[2:] and tally.taken.total() == COUNT
    assert tally.corrected == COUNT and np.isfinite(tally.rms("sigma_z"))


def test_a_cloud_that_is_not_where_the_adjusted_points_are_is_doubtful() -> None:
    """Those of a run come another way: a cloud above another datum, or corrected before, misses them."""
    method, ground, cloud = shore()
    method = replace(method, adjusted=ground[::2], run=replace(method.run, caution="the run is rejected"))
    for up, count in ((0.0, 0), (1.0, 1), (-1.0, 1)):
        tally = Tally.of(corrected(method, cloud[::6] + np.array([0.0, 0.0, up]))[0], method.reasons)
        verdict, *others = method.doubts(tally)
        assert verdict == "the run is rejected" and len(others) == count
        assert all(("higher, 0 lower" in text) == (up > 0.0) for text in others)


def test_what_is_outside_of_the_water_is_dry_though_it_is_low(tmp_path: Path) -> None:
    ring = [[-50.0, -50.0], [0.0, -50.0], [0.0, 50.0], [-50.0, 50.0], [-50.0, -50.0]]
    (tmp_path / "water.json").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    method, ground, cloud = shore()
    water = read_water(tmp_path / "water.json", geographic=False)
    (everywhere, undecided), (points, near) = (
        corrected(of, cloud) for of in (method, replace(method, water=water))
    )
    low, land = (ground[:, 2] < -0.12) & ~near, cloud[:, 0] > 2.0  # heights decide nearer to the shore
    np.testing.assert_allclose(points.true[low & land], cloud[low & land], atol=0.01)  # straight rays
    np.testing.assert_array_equal(points.true[low & ~land], everywhere.true[low & ~land])
    assert (points.true[low & land, 2] > everywhere.true[low & land, 2] + 0.02).all()
    both = undecided & near & land  # dry now: within the sigma of before, and the other way round
    for of in (points, everywhere):
        assert (np.abs(points.true - everywhere.true)[both, 2] < of.values["sigma_z"][both]).all()
    order = method.in_words("s44", points)
    assert {order[row] for row in np.flatnonzero(low & ~land)} == {"Exclusive"}
    assert {order[row] for row in np.flatnonzero(low & land)} == {""}
    assert REASONS[Fault.UNDECIDED] in method.in_words("reason", points)


@pytest.mark.parametrize("suffix", [".las", ".csv"])
def test_classes_of_a_cloud_say_what_is_on_the_water_and_below(tmp_path: Path, suffix: str) -> None:
    """Those of the surface are no ground: straight rays, whatever their heights, and decided. Areas go first."""
    method, _, cloud = shore()
    cloud = cloud.round(4)
    everywhere, undecided = corrected(method, cloud)
    ring = [[-50.0, -50.0], [50.0, -50.0], [50.0, 0.0], [-50.0, 0.0], [-50.0, -50.0]]
    (tmp_path / "water.json").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    method = replace(method, water=read_water(tmp_path / "water.json", geographic=False))
    near_shore, south = np.abs(cloud[:, 1]) < 2.0, cloud[:, 1] < 0.0
    classes = np.where(np.arange(COUNT) % 3 == 0, 41, 40)
    with (tmp_path / "cloud.las").open("wb") as file:
        header = laspy.LasHeader(version="1.4", point_format=6)
        header.scales = np.full(3, 1e-4)
        record = laspy.ScaleAwarePointRecord.zeros(COUNT, header=header)
        record.x, record.y, record.z = cloud.T
        record.classification = classes
        with laspy.open(file, mode="w", header=header, closefd=False) as writer:
            writer.write_points(record)
    of, tally = correct_file(tmp_path / "cloud.las", tmp_path / f"true{suffix}", method)
    if suffix == ".las":
        written = laspy.read(tmp_path / "true.las")
        values = {name: np.array(written[name]) for name in ("z", "reason")}
    else:
        columns = np.genfromtxt(tmp_path / "true.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
        values = {name: columns[name] for name in ("z", "reason")}
    surface = near_shore & (classes == 41)
    open_now = np.isin(values["reason"].astype(str), (str(int(Fault.UNDECIDED)), "undecided"))
    assert not open_now[surface].any() and open_now[undecided & ~surface & south].all()
    np.testing.assert_allclose(values["z"][surface], cloud[surface, 2], atol=0.02)
    wet = (everywhere.true[:, 2] < -0.15) & (classes == 40) & (near_shore | south)
    np.testing.assert_allclose(values["z"][wet], everywhere.true[wet, 2], atol=1e-3)
    assert tally.taken["surface by class"] == surface.sum() and tally.taken["wet by class"] > 0
    assert tally.taken["wet or dry against their heights"] > 0
    assert {words.rpartition(" ")[2] for words in tally.taken} == {"class", "area", "heights"}
    assert f"{surface.sum()} points surface by class" in of.lines(tally)


def test_points_that_are_not_of_the_job_have_no_place() -> None:
    """Rays to points far off meet somewhere else where stations have turned since: not where the cloud has them."""
    method, _, cloud = shore()
    photos = method.run.block.photos
    for sign in (1.0, -1.0):  # they meet 30 km below, and behind the cameras
        turned = replace(photos, attitude=photos.attitude + sign * photos.position[:, :1] / 3e4 * [0.0, 1.0, 0.0])
        run = replace(method.run, block=replace(method.run.block, photos=turned))
        points = replace(method, run=run)("cloud.csv", np.array([[0.0, 0.0, -1e6], [0.0, 0.0, 200.0]]))
        assert isinstance(points, CorrectedPoints)
        assert points.fault.tolist() == [Fault.NO_CONVERGENCE, Fault.NO_CAMERA]
        assert np.isnan(points.true).all() and np.isnan(points.values["sigma_z"]).all()
    assert method("cloud.csv", cloud[:3]).good.all()


def test_points_are_in_the_system_that_is_named() -> None:
    ellipsoid = Ellipsoid("WGS84")
    method = replace(shore()[0], system=LongitudeLatitude(ellipsoid), in_model=False)
    assert "UTM zone 20N" in method.placed_in(Path("a.csv"), None, "EPSG:32620", None).system.text
    assert "UTM zone 21N" in method.placed_in(Path("a.tif"), pyproj.CRS("EPSG:32621"), None, None).system.text
    problem = method("a.csv", np.array([[5e5, 5e6, 0.0]]))
    assert isinstance(problem, Problem) and problem.message.endswith("are none: are the points in this system?")
    assert max(len(column.meaning) for column in method.columns.values()) <= 32  # letters of a LAS file
