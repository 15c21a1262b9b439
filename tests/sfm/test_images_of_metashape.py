"""A model of Metashape with the images of a BINGO export: a job as of COLMAP, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from musatpy.cli.main import main
from musatpy.formats.job_folder import read_job
from musatpy.sfm import bingo, metashape
from musatpy.sfm.model import ModelError
from sfm.written_models import PIXEL_WIDTH, Scene, scene, write_bingo, write_colmap, write_metashape

TIE = "tie_point_number_"


@pytest.fixture(scope="module")
def small() -> Scene:
    of = scene(0.2, wide=2)
    of.names = [name.replace(" ", "_") for name in of.names]
    return of


@pytest.fixture
def folder(tmp_path: Path, small: Scene) -> Path:
    """cameras.xml without references and with square pixels, image.dat, and control in metres."""
    path = write_metashape(tmp_path / "cameras.xml", small)
    path.write_text(re.sub(r"<reference x=[^>]*>", "", path.read_text()).replace('"0.0025"', '"0.0024"'))
    write_images(tmp_path, small)
    rows = [
        f"g{n},{X[0]!r},{X[1]!r},{X[2]!r},{small.names[photo]},{u!r},{v!r}"
        for photo, n, u, v in small.images
        for X in [small.points[n]]
        if n < 12
    ]
    (tmp_path / "gcp.csv").write_text("\n".join(["id,x,y,z,photo,px,py", *rows]) + "\n")
    return tmp_path


def write_images(folder: Path, of: Scene, wrong: str = "", names: list[str] | None = None) -> Path:
    return write_bingo(folder / "image.dat", of, wrong, names, height=PIXEL_WIDTH)


def imported(folder: Path, form: str = "metashape", *more: str, job: str = "new.job") -> str:
    """Return what the command says; nothing is written where it fails."""
    words = ["import", form, folder, "-o", folder / job, "--gcp", folder / "gcp.csv", "--crs", "local", *more]
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert (result.exit_code == 0) == (folder / job).exists(), result.output
    assert (folder / job).exists() or not (folder / "new.photos.csv").exists()
    return result.output


def test_a_job_is_that_of_colmap(folder: Path, small: Scene) -> None:
    """Labels have folders and suffixes, names of images need not."""
    first, second, *others = small.names
    write_images(folder, small, names=[first.partition("/")[2], second.partition("/")[2][:-4], *others])
    assert "wrote" in imported(folder)
    write_colmap(folder, small)
    assert "wrote" in imported(folder, "colmap", job="colmap.job")
    ours, theirs = (read_job(folder / name).tables for name in ("new.job", "colmap.job"))
    assert np.array_equal(ours["stations"]["photos.ids"], theirs["stations"]["photos.ids"])
    for role, path in (
        ("stations", "photos.position"),
        ("attitudes", "photos.attitude"),
        ("control", "control.position"),
    ):
        np.testing.assert_allclose(ours[role][path], theirs[role][path], atol=1e-5)
    number = {f"{TIE}{n}": str(2 * n + 11) for n in range(len(small.points))}

    def images(plates, number):
        keys = zip(plates["plates.photo"].tolist(), plates["plates.point"].tolist(), strict=True)
        return {
            (photo, number.get(point, point)): xy
            for (photo, point), xy in zip(keys, plates["plates.xy"], strict=True)
        }

    ours, theirs = images(ours["plates"], number), images(theirs["plates"], {})
    assert ours.keys() == theirs.keys() and len(ours) > 150
    assert max(np.abs(ours[key] - theirs[key]).max() for key in ours) < 2e-9


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("y down", "it would be 0.1. px if y points down"),
        ("micrometres", "it would be 0.1. px if x and y are micrometres"),
        ("about principal point", "it would be 0.1. px if x and y are about the principal point"),
        ("no distortion", "it would be 0.1. px if images have no distortion"),
    ],
)
def test_a_wrong_convention_is_named(folder: Path, small: Scene, wrong: str, message: str) -> None:
    write_images(folder, small, wrong)
    assert re.search(f"image.dat: .*{message}", imported(folder))


def exchanged(folder: Path, *rows: int) -> list[str]:
    """Write a model of twelve photos of which some have the names of others, in turn; return these names."""
    of = scene(0.2)
    names = [name.partition("/")[2] for name in of.names]
    write_metashape(folder / "cameras.xml", of)
    wrong = [names[rows[(rows.index(n) + 1) % len(rows)]] if n in rows else name for n, name in enumerate(names)]
    write_bingo(folder / "image.dat", of, names=wrong)
    return [names[n] for n in rows]


def test_photos_that_have_the_names_of_others_are_named(tmp_path: Path) -> None:
    names = exchanged(tmp_path, 3, 7)
    model = metashape.read_model(tmp_path / "cameras.xml")
    with pytest.raises(ModelError, match="most of the images are not those of these photos") as refused:
        bingo.with_images(model, tmp_path / "image.dat", None)
    assert re.findall(r"DJI_\d+\.JPG", str(refused.value)) == names


@pytest.mark.slow
def test_photos_that_all_have_the_names_of_others_are_no_other_convention(folder: Path) -> None:
    exchanged(folder, *range(12))
    assert "image.dat: " in (said := imported(folder)) and "no other convention fits" in said


def test_what_is_wrong_in_the_images_is_told_with_its_line(folder: Path) -> None:
    path = folder / "image.dat"
    right = path.read_text()
    one, two = (line.split()[0] for line in right.splitlines()[1:3])
    for old, new, message in (
        (f" {one} ", f" {one} x", r"image.dat:2 cols \d+-\d+ point.x: 'x-?[\d.]+' is not a number"),
        (f" {one} ", f" {two} ", rf"image.dat:3: plates: flight_0/DJI_0000.JPG {two} is given twice"),
        (f" {one} ", f" {'t' * 129} ", r"image.dat:2 .*is not a name of at most 128 letters"),
        (
            "flight_1/DJI_0001.JPG",
            "DJI_0000",
            r"image.dat:\d+: photos DJI_0000 and flight_0/DJI_0000.JPG would both be fl",
        ),
    ):
        path.write_text(right.replace(old, new, 1))
        assert re.search(message, imported(folder)), message
    path.write_text(re.sub(rf" ({one}|{two}) ", r" \1 x", right, count=2))
    assert imported(folder).count("is not a number") == 2
    for text, message in (("", "the file has no records"), ("DJI_0000 1\n-99\n", "it has no images of points")):
        path.write_text(text)
        assert f"image.dat: {message}" in imported(folder)


def test_images_are_beside_the_cameras_or_named(folder: Path, small: Scene) -> None:
    path = (folder / "image.dat").rename(folder / "other.dat")
    assert "cameras.xml: it has no images of points" in imported(folder)
    assert "other.dat" in imported(folder, "metashape", "--images", str(path) + "x")
    assert "--images is of metashape" in imported(folder, "colmap", "--images", str(path))
    xml = folder / "cameras.xml"
    xml.write_text(xml.read_text().replace("pixel_height", "height"))
    assert "other.dat: images in millimetres need the size of a pixel" in imported(
        folder, "metashape", "--images", str(path)
    )
    text = path.read_text()
    path.write_text(text.replace("flight_1/DJI_0001.JPG", "elsewhere"))
    said = imported(folder, "metashape", "--images", str(path), "--pixel-size", "2.4")
    assert "photos of other.dat that the model does not have: elsewhere" in said and "wrote" in said


def test_numbers_for_names_are_refused_with_the_option_that_writes_names(folder: Path, small: Scene) -> None:
    write_images(folder, small, names=[str(n) for n in range(len(small.names))])
    assert "expected: names as flight_0/DJI_0000.JPG, by Metashape's option 'Use item labels'" in imported(folder)
