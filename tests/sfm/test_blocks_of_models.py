"""Models as blocks, jobs and models again: nothing of an image changes on the way."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from musatpy.adjustment import sightings
from musatpy.adjustment.job import prepared
from musatpy.arrays import FloatArray
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.pipeline import adjust
from musatpy.reduction.pixel_lens import PixelLens
from musatpy.reports.record import record_of
from musatpy.sfm.block import Beside, Placement, block_of, lens_of, lens_parameters
from musatpy.sfm.export import TABLES, adjusted_model
from musatpy.sfm.model import Model, ModelError
from musatpy.sfm.source import FileCameras, spread_over
from musatpy.statistics import Statistics

SIZE = 0.0024
LENS = PixelLens(
    width=4864, height=3648, focal=(3665.6, 3661.1), centre=(2406.5, 1846.2), shear=0.7, k=(0.0069, -0.0171, 0.019),
    p=(0.00064, -0.00157),
)  # fmt: skip
LENSES = (
    LENS,
    replace(LENS, k=(0.07, -0.17, 0.19, -0.02), d=(0.01, 0.02, -0.01)),
    PixelLens(
        width=4000, height=3000, focal=(2500.0, 2510.0), centre=(2010.0, 1490.0), k=(0.02, -0.01, 0.003, -0.001),
        fisheye=True,
    ),
)  # fmt: skip


def pixels(lens: PixelLens) -> FloatArray:
    """Pixels all over a format."""
    x, y = np.meshgrid(np.linspace(0.0, lens.width, 40), np.linspace(0.0, lens.height, 30))
    return np.stack([x, y], axis=-1)


@pytest.mark.parametrize("lens", LENSES)
def test_a_lens_and_its_inverse_agree_and_partials_are_those_of_differences(lens: PixelLens) -> None:
    """1e-9 px all over the format; partials by central differences of 1e-6, which leave some 1e-9."""
    rays = lens.rays(pixels(lens))
    np.testing.assert_allclose(lens.pixels(rays), pixels(lens), atol=1e-9)
    for axis, step in enumerate(1e-6 * np.eye(2)):
        differences = (lens.distorted(rays + step) - lens.distorted(rays - step)) / 2e-6
        np.testing.assert_allclose(lens.partials(rays)[..., axis], differences, atol=1e-8)


def test_a_lens_has_no_rays_beyond_where_its_images_turn_back() -> None:
    lens = PixelLens(width=4000, height=3000, focal=(1000.0, 1000.0), centre=(2000.0, 1500.0), k=(-0.1,))
    assert lens.reach == pytest.approx(np.sqrt(1.0 / 0.3))  # of r - 0.1 r^3
    rays = lens.rays(np.array([[2000.0 + 1300.0, 1500.0], [2000.0 + 1100.0, 1500.0]]))
    assert np.isnan(rays[0]).all() and np.isfinite(rays[1]).all()


def test_parameters_of_cards_are_those_of_a_lens_both_ways() -> None:
    parameters = lens_parameters(LENS, SIZE)
    again = lens_of(parameters, LENS, SIZE)
    np.testing.assert_allclose(again.pixels(LENS.rays(pixels(LENS))), pixels(LENS), atol=1e-9)
    for lens in LENSES[1:]:
        with pytest.raises(ValueError, match="more than three radial coefficients"):
            lens_parameters(lens, SIZE)


def model(lens: PixelLens = LENS, noise: float = 1.0) -> Model:
    """Four photos over points, images with errors of a pixel, in a gauge of its own."""
    rng = np.random.default_rng(5)
    ground = rng.uniform(-1.0, 1.0, (60, 3)) * [40.0, 30.0, 3.0]
    centre = np.array([[-20.0, 0.0, 60.0], [-7.0, 1.0, 61.0], [7.0, -1.0, 59.0], [20.0, 0.0, 60.0]])
    down = np.diag([1.0, -1.0, -1.0])
    R = np.array([Rotation.from_rotvec(turn).as_matrix() @ down for turn in rng.normal(0.0, 0.05, (4, 3))])
    gauge = Rotation.from_rotvec([0.4, 1.2, -0.7]).as_matrix()
    photo, point = (part.reshape(-1) for part in np.meshgrid(np.arange(4), np.arange(60)))
    v = np.einsum("rij,rj->ri", R[photo], ground[point] - centre[photo])
    pixel = lens.pixels(v[:, :2] / v[:, 2:]) + noise * rng.normal(size=(240, 2))
    return Model(
        program="colmap", cameras=("1",), lenses=(lens,), photos=np.array([f"DCIM/{n}.JPG" for n in range(4)]),
        camera=np.zeros(4, dtype=np.int64), rotation=R @ gauge.T, centre=0.1 * centre @ gauge.T,
        points=np.array([f"p{n}" for n in range(60)]), position=0.1 * ground @ gauge.T,
        photo=photo, point=point, pixel=pixel,
    )  # fmt: skip


GAUGE = Rotation.from_rotvec([0.4, 1.2, -0.7]).as_matrix()
LOCAL = Placement(scale=10.0, rotation=GAUGE.T, shift=np.array([500.0, 700.0, 30.0]), ellipsoid=None)
WGS84 = Ellipsoid("WGS84")


def on_the_ellipsoid() -> Placement:
    at = np.array([0.7, -1.2, 20.0])
    return Placement(scale=10.0, rotation=WGS84.frame(at).T @ GAUGE.T, shift=WGS84.geocentric(at), ellipsoid=WGS84)


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("placement", [LOCAL, on_the_ellipsoid()], ids=["local", "geographic"])
def test_residuals_of_a_block_are_those_of_its_model(placement: Placement, held: bool) -> None:
    """Straight rays, to rounding of geocentric metres; ideal plates are those of images without errors."""
    given = model(noise=0.0 if held else 1.0)
    beside = Beside.nothing(4, 60)
    sigma = np.full((4, 3), 0.1)
    beside = replace(beside, position=placement.positions(given.centre), position_sigma=sigma)
    block = block_of(
        given, placement, beside, np.ones(60, dtype=bool), size=SIZE, image_sigma=0.5 * SIZE, index=1.34,
        index_sigma=None, held=held, title="A MODEL",
    )  # fmt: skip
    job, state = prepared(block, None)
    order = [given.points.tolist().index(name) for name in block.points.ids.tolist()]
    state = replace(state, ground=job.network.frame.working(placement.positions(given.position[order])))
    found = sightings.residuals(job.network, state, np.arange(len(block.plates.photo))) / [SIZE, -SIZE]
    np.testing.assert_allclose(found, given.residuals(), atol=1e-5)
    assert not held or block.cameras.principal_point.tolist() == [[0.0, 0.0]]


ARGUMENTS = {"size": SIZE, "image_sigma": 0.001, "index": 1.34, "index_sigma": None, "title": "A MODEL"}


def of_wrong_lens(truth: PixelLens, held: bool = False) -> tuple[Model, Model]:
    """A model whose images are of a true lens, with one that is off by pixels, and what is exported of its run."""
    off = replace(truth, focal=(truth.focal[0] + 5.0, truth.focal[1] + 5.0), k=(truth.k[0] + 1e-3, *truth.k[1:]))
    given = replace(model(truth, noise=0.0), lenses=(truth if held else off,))
    inside = ((given.pixel >= 0.0) & (given.pixel <= [truth.width, truth.height])).all(axis=1)
    images = {name: getattr(given, name)[inside] for name in ("photo", "point", "pixel")}
    given = replace(given, **images)
    beside = Beside.nothing(4, 60)
    beside = replace(beside, position=LOCAL.positions(given.centre), position_sigma=np.full((4, 3), 1e-3))
    block = block_of(given, LOCAL, beside, np.ones(60, dtype=bool), held=held, **ARGUMENTS)
    tables = record_of(Statistics(adjust(block)), {*TABLES})
    return given, adjusted_model(tables, FileCameras.of(given, LOCAL, SIZE, held))


@pytest.mark.parametrize(("lens", "held"), [(LENSES[1], False), (LENSES[2], False), (LENSES[0], True)])
def test_a_lens_that_no_cards_can_state_is_corrected_and_exported(lens: PixelLens, held: bool) -> None:
    """Pixels come back as they were; what corrections cannot hold of the difference is below .02 px."""
    given, exported = of_wrong_lens(lens, held)
    before, after = (
        dict(zip(zip(of.photo.tolist(), of.points[of.point].tolist(), strict=True), of.pixel.tolist(), strict=True))
        for of in (given, exported)
    )
    assert len(after) > 100
    np.testing.assert_allclose(list(after.values()), [before[image] for image in after], atol=1e-6)
    assert np.abs(exported.residuals()).max() < 0.02
    assert abs(exported.lenses[0].focal[1] - lens.focal[1]) < 0.5
    assert exported.lenses[0].fisheye == lens.fisheye and any(exported.lenses[0].d) == any(lens.d)
    assert [note.startswith("camera 1: the lens that is written misses the") for note in exported.notes] == [
        True
    ] * (not held)


def test_images_far_off_the_axis_of_a_fisheye_lens_are_refused_with_their_angle() -> None:
    lens = replace(LENSES[2], focal=(1500.0, 1500.0), k=())
    given = model(lens, noise=0.0)
    outermost = lens.centre[0] + 1500.0 * np.radians(93.0)
    given = replace(given, pixel=np.concatenate([[[outermost, lens.centre[1]]], given.pixel[1:]]))
    with pytest.raises(
        ModelError, match=r"camera 1: fisheye images reach 93 degrees off the axis.* none beyond 75"
    ):
        block_of(given, LOCAL, Beside.nothing(4, 60), np.ones(60, dtype=bool), held=False, **ARGUMENTS)


def test_the_cameras_of_a_file_are_kept_to_the_last_bit() -> None:
    cameras = FileCameras.of(model(LENSES[1]), on_the_ellipsoid(), SIZE, held=True)
    again = FileCameras.read(cameras.arrays(), "x.job")
    x = model().position
    for first, second in zip(cameras.seen(x), again.seen(x), strict=True):
        np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(again.placement.positions(x), cameras.placement.positions(x))
    with pytest.raises(ModelError, match=r"x.job: .* not imported from a model"):
        FileCameras.read({}, "x.job")


def test_a_photo_sees_what_lies_in_the_extent_of_its_cameras_images() -> None:
    given = model()
    left = given.pixel[:, 0] < np.median(given.pixel[:, 0])
    cut = replace(given, photo=given.photo[left], point=given.point[left], pixel=given.pixel[left])
    row, photo, pixel = FileCameras.of(cut, LOCAL, SIZE, held=True).seen(given.position)
    seen = set(zip(row.tolist(), photo.tolist(), strict=True))
    images = set(zip(cut.point.tolist(), cut.photo.tolist(), strict=True))
    assert len(images - seen) <= 4  # those that bound it, by rounding
    assert pixel[:, 0].max() <= cut.pixel[:, 0].max() < given.pixel[:, 0].max()


def test_rays_that_are_kept_lie_evenly_around_a_point() -> None:
    azimuth = np.tile(np.linspace(-3.0, 3.0, 30), 2)
    rows, photo = np.repeat([0, 1], 30), np.tile(np.arange(30), 2)
    kept = spread_over(rows, photo, azimuth, 6)
    assert np.bincount(rows[kept]).tolist() == [6, 6]
    np.testing.assert_array_equal(np.diff(np.flatnonzero(kept[:30])), 5)
    assert spread_over(rows, photo, azimuth, 30).all()
