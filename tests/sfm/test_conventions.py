"""Files of three formats, written from one truth by scalars: right ones are read to the digit, wrong ones named."""

from pathlib import Path

import numpy as np
import pytest

from musatpy.sfm import bingo, colmap, metashape, opensfm
from musatpy.sfm.conventions import Conventions, prove
from musatpy.sfm.model import Model, ModelError
from sfm.written_models import (
    COLMAP,
    METASHAPE,
    OPENSFM,
    Lens,
    Scene,
    geocentric,
    scene,
    to_chunk,
    write_bingo,
    write_colmap,
    write_metashape,
    write_opensfm,
)

pytestmark = pytest.mark.slow  # `test_formats` reads right files of all formats
NAMES = {
    "middle": "pixels count from the middle of the image",
    "corner": "pixels count from the corner of the image",
    "first at 0": "the middle of the first pixel is (0, 0)",
    "first at 1": "the middle of the first pixel is (1, 1)",
    "y up": "y of pixels counts upward",
    "x for y": "x and y of pixels are exchanged",
    "shorter side": "images are normalised by the shorter side",
    "half side": "images are normalised by half of the longer side",
    "focal by shorter side": "focal lengths are normalised by the shorter side",
    "principal point from the middle": "the principal point counts from the middle of the image",
    "principal point from the corner": "the principal point counts from the corner of the image",
    "principal point y up": "y of the principal point counts upward",
    "p1 for p2": "p1 and p2 are exchanged",
    "images to rays": "the distortion leads from images to rays",
    "transposed": "rotations are transposed",
    "inverse": "rotations and places are those of the inverse",
    "t for C": "t and C stand for each other",
    "scalar last": "quaternions have their scalar last",
    "camera y up": "the camera has y up and z backward",
    "y down": "if y points down",
    "x up": "if x points up",
    "x left": "if x points left",
    "x down": "if x points down",
    "micrometres": "x and y are micrometres",
    "pixels": "x and y are pixels",
    "about principal point": "x and y are about the principal point",
    "no distortion": "images have no distortion",
    "initial": "images are those of the initial calibration",
}
PIXEL = 1e-6


def of_metashape(folder: Path, of: Scene, wrong: str = "") -> Model:
    """Return the stations of cameras.xml with the images of image.dat beside it."""
    model = metashape.read_model(write_metashape(folder / "cameras.xml", of, wrong))
    names = [name.partition("/")[2] for name in of.names]
    return bingo.with_images(model, write_bingo(folder / "image.dat", of, wrong, names), None)


@pytest.fixture(scope="module")
def exact() -> Scene:
    return scene()


@pytest.mark.parametrize("binary", [False, True])
def test_colmap_reads_the_truth(tmp_path: Path, exact: Scene, binary: bool) -> None:
    model = colmap.read_model(write_colmap(tmp_path, exact, binary=binary))
    assert [*model.photos] == exact.names
    assert np.abs(model.residuals()).max() < PIXEL
    assert np.allclose(model.centre, exact.C, rtol=0, atol=1e-9)
    assert np.allclose(model.rotation, exact.R, rtol=0, atol=1e-12)
    assert len(model.photo) == len(exact.images)


def test_opensfm_reads_the_truth(tmp_path: Path, exact: Scene) -> None:
    model = opensfm.read_model(write_opensfm(tmp_path, exact))
    assert np.abs(model.residuals()).max() < PIXEL
    assert model.to_geocentric is not None
    for C, place in zip(exact.C, model.centre, strict=True):
        there = model.to_geocentric[:3, :3] @ place + model.to_geocentric[:3, 3]
        assert there == pytest.approx(geocentric(C), abs=1e-4)


def test_metashape_reads_the_truth(tmp_path: Path, exact: Scene) -> None:
    model = of_metashape(tmp_path, exact)
    assert np.abs(model.residuals()).max() < PIXEL
    places = [to_chunk(exact.points[int(name.rpartition("_")[2])]) for name in model.points.tolist()]
    assert np.allclose(model.position, places, rtol=0, atol=1e-8)
    assert model.to_geocentric is not None
    there = model.centre @ model.to_geocentric[:3, :3].T + model.to_geocentric[:3, 3]
    assert np.abs(there - [geocentric(C) for C in exact.C]).max() < 1e-4


def scene_of(wrong: str, noise: float = 0.3) -> Scene:
    return scene(noise, Lens(inverse=wrong == "images to rays"))


def refusal(model: Model, images: Conventions | None = None) -> str:
    with pytest.raises(ModelError) as refused:
        prove(model, "the file", images)
    return str(refused.value)


def names_in(message: str) -> list[str]:
    return [key for key, name in NAMES.items() if name in message]


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("wrong", COLMAP)
def test_a_wrong_colmap_is_named(tmp_path: Path, wrong: str, stated: bool) -> None:
    model = colmap.read_model(write_colmap(tmp_path, scene_of(wrong), wrong, stated=stated))
    assert names_in(refusal(model)) == [wrong]


@pytest.mark.parametrize("wrong", OPENSFM)
def test_a_wrong_opensfm_is_named(tmp_path: Path, wrong: str) -> None:
    assert names_in(refusal(opensfm.read_model(write_opensfm(tmp_path, scene_of(wrong), wrong)))) == [wrong]


@pytest.mark.slow
@pytest.mark.parametrize("wrong", METASHAPE)
def test_a_wrong_metashape_is_named(tmp_path: Path, wrong: str) -> None:
    model = of_metashape(tmp_path, scene_of(wrong), wrong)
    assert names_in(refusal(model, bingo.CONVENTIONS)) == [wrong]


def test_a_portrait_photo_is_normalised_by_its_height(tmp_path: Path) -> None:
    tall = Lens(width=3000, height=4000, cx=1520.0, cy=1980.0)
    model = opensfm.read_model(write_opensfm(tmp_path, scene(lens=tall)))
    assert np.abs(model.residuals()).max() < PIXEL


@pytest.mark.parametrize("noise", [0.05, 0.3, 1.2])
def test_right_files_are_proven(tmp_path: Path, noise: float) -> None:
    of = scene(noise)
    usual = 1.1774 * noise  # the median of the lengths of two normal errors
    for model, images in (
        (colmap.read_model(write_colmap(tmp_path / "stated", of)), None),
        (colmap.read_model(write_colmap(tmp_path / "not", of, stated=False)), None),
        (opensfm.read_model(write_opensfm(tmp_path / "opensfm", of)), None),
        (of_metashape(tmp_path, of), bingo.CONVENTIONS),
    ):
        proof = prove(model, "the file", images)
        assert not proof.notes
        assert proof.images == len(of.images)
        assert 0.6 * usual < proof.median < 1.1 * usual  # intersected points take up a part


@pytest.mark.parametrize("stated", [True, False])
def test_a_half_pixel_that_the_principal_point_absorbs_is_no_error(tmp_path: Path, stated: bool) -> None:
    model = colmap.read_model(write_colmap(tmp_path, scene(0.3), "absorbed", stated=stated))
    assert prove(model, "the file") is not None


def test_a_half_pixel_is_lost_in_large_residuals_unless_these_are_stated(tmp_path: Path) -> None:
    """By the residuals that the file states it is seen at any noise; else only where it stands out."""
    of = scene(1.2)
    model = colmap.read_model(write_colmap(tmp_path / "stated", of, "first at 0"))
    assert names_in(refusal(model)) == ["first at 0"]
    model = colmap.read_model(write_colmap(tmp_path / "not", scene(2.0), "first at 0", stated=False))
    assert prove(model, "the file") is not None


def test_residuals_that_are_stated_otherwise_are_told(tmp_path: Path) -> None:
    of = scene(0.3)
    of.residual[4] += 0.7
    proof = prove(colmap.read_model(write_colmap(tmp_path, of)), "the file")
    assert proof is not None and len(proof.notes) == 1
    assert f"of 1 of {len(of.points)} points" in proof.notes[0] and "at point 19: " in proof.notes[0]
    assert f"{of.residual[4]:.3f} px stated, {of.residual[4] - 0.7:.3f} px computed" in proof.notes[0]


def test_a_file_that_states_other_figures_is_still_proven(tmp_path: Path) -> None:
    """Other figures than mean residuals: that is told, and half a pixel is seen all the same."""
    of = scene(0.3)
    of.residual = [7.0 * gap for gap in of.residual]
    proof = prove(colmap.read_model(write_colmap(tmp_path / "right", of)), "the file")
    assert proof is not None and "are not those of its images" in proof.notes[0]
    assert names_in(refusal(colmap.read_model(write_colmap(tmp_path / "wrong", of, "first at 1")))) == [
        "first at 1"
    ]


def test_two_wrong_conventions_are_named_together(tmp_path: Path) -> None:
    """A camera with y up and z backward, and pixels that count upward from the lower edge."""
    of = scene(0.3)
    of.images = [(photo, point, u, of.lens.height - v) for photo, point, u, v in of.images]
    model = colmap.read_model(write_colmap(tmp_path, of, "camera y up"))
    assert names_in(refusal(model)) == ["y up", "camera y up"]


def test_a_model_that_no_convention_explains_is_refused(tmp_path: Path) -> None:
    of = scene(0.3)
    of.C = of.C[1:] + of.C[:1]
    message = refusal(colmap.read_model(write_colmap(tmp_path, of)))
    assert names_in(message) == [] and "no other convention fits" in message
