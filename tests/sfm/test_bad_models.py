"""What no reader takes: every fault ends in a message with file and line, byte or item."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from musatpy.sfm import colmap, metashape, opensfm
from musatpy.sfm.model import ModelError
from sfm.written_models import Scene, scene, write_colmap, write_metashape, write_opensfm


@pytest.fixture(scope="module")
def small() -> Scene:
    return scene(wide=2)


def replaced(path: Path, old: str, new: str, count: int = 1) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))


TEXT: list[tuple[str, str, str, str]] = [  # file, what stands there, what does then, the message
    ("cameras.txt", "FULL_OPENCV", "FOV", "cameras.txt:2: lenses of the model FOV are not read"),
    ("cameras.txt", " 4000 ", " 1e999 ", "cameras.txt:2: '9 FULL_OPENCV 1e999"),
    ("cameras.txt", " 4000 ", " 0 ", "cameras.txt:2: a camera FULL_OPENCV has width, height"),
    ("cameras.txt", "3110.0", "nan", "cameras.txt:2: a camera FULL_OPENCV has width, height"),
    ("cameras.txt", "9 FULL", "8 FULL", "there is no camera 9"),
    ("cameras.txt", "# cameras", "9 PINHOLE 4 3 1 1 2 2", "camera 9 stands twice"),
    ("images.txt", "7.0 8.0 -1", "7.0 8.0", "images.txt:3: '7.0 8.0 "),
    ("images.txt", "7.0 8.0 -1", "7.0 nan -1", "images.txt:3: '7.0 nan -1"),
    ("images.txt", "7.0 8.0 -1", "7.0 8.0 1e300", "images.txt:3: '7.0 8.0 1e300"),
    ("images.txt", "7.0 8.0 -1", "7.0 8.0 4000", "names point 4000, which is not in points3D.txt"),
    ("images.txt", " 9 flight 1/DJI_0001.JPG", "", "images.txt:4: '"),
    ("images.txt", "DJI_0001", "../../../etc/passwd", "its name leads out of the folder"),
    ("images.txt", "flight 1/DJI_0001.JPG", "flight 0/DJI_0002.JPG", "two photos are called flight 0/DJI_0002.JPG"),
    ("images.txt", "DJI_0001", "x" * 200, "is not text of 1 to 128 letters"),
    ("points3D.txt", "\n13 ", "\n11 0 0 0 1 2 3 0.5\n13 ", "two points are called 11"),
    ("points3D.txt", "\n13 ", "\n13 nan ", "points3D.txt:2: '13 nan "),
]


@pytest.mark.parametrize(("name", "old", "new", "message"), TEXT)
def test_text_of_colmap(tmp_path: Path, small: Scene, name: str, old: str, new: str, message: str) -> None:
    write_colmap(tmp_path, small)
    replaced(tmp_path / name, old, new)
    with pytest.raises(ModelError) as refused:
        colmap.read_model(tmp_path)
    assert message in str(refused.value) and str(tmp_path) in str(refused.value)


@pytest.mark.parametrize("name", ["cameras.txt", "points3D.txt"])
def test_a_missing_file_of_colmap(tmp_path: Path, small: Scene, name: str) -> None:
    write_colmap(tmp_path, small)
    (tmp_path / name).unlink()
    with pytest.raises(ModelError, match=f"{name}: there is no such file"):
        colmap.read_model(tmp_path)


@pytest.mark.parametrize("pose", ["0 0 0 0 1 2 3", "nan 0 0 1 1 2 3", "1 0 0 0 1 inf 3"])
def test_a_pose_that_is_none(tmp_path: Path, pose: str) -> None:
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 400 300 500 500 200 150\n")
    (tmp_path / "images.txt").write_text(f"1 {pose} 1 a.jpg\n\n2 1 0 0 0 0 0 0 1 b.jpg\n\n")
    (tmp_path / "points3D.txt").write_text("")
    with pytest.raises(ModelError, match=r"place or rotation of photo a\.jpg is none"):
        colmap.read_model(tmp_path)


def test_photos_without_images_are_read_and_no_photos_are_not(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 400 300 500 500 200 150\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.jpg\n\n")
    (tmp_path / "points3D.txt").write_text("")
    assert len(colmap.read_model(tmp_path).photo) == 0
    (tmp_path / "images.txt").write_text("# none\n")
    with pytest.raises(ModelError, match="it has no photo that is placed"):
        colmap.read_model(tmp_path)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_binary_file_that_is_cut_anywhere(tmp_path: Path, small: Scene, name: str) -> None:
    path = write_colmap(tmp_path, small, binary=True) / name
    data = path.read_bytes()
    for length in [*range(0, min(len(data), 200), 7), len(data) // 2, len(data) - 1]:
        path.write_bytes(data[:length])
        with pytest.raises(ModelError, match=name):
            colmap.read_model(tmp_path)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_counts_of_a_thousand_million(tmp_path: Path, small: Scene, name: str) -> None:
    path = write_colmap(tmp_path, small, binary=True) / name
    path.write_bytes(struct.pack("<Q", 10**9) + path.read_bytes()[8:])
    with pytest.raises(ModelError, match=f"{name}: it says that it has 1000000000 entries"):
        colmap.read_model(tmp_path)


def test_counts_of_features_and_of_tracks(tmp_path: Path, small: Scene) -> None:
    folder = write_colmap(tmp_path, small, binary=True)
    data = bytearray((folder / "points3D.bin").read_bytes())
    data[8 + 43 : 8 + 51] = struct.pack("<Q", 10**9)
    (folder / "points3D.bin").write_bytes(data)
    with pytest.raises(ModelError, match=r"points3D\.bin: the file ends at byte"):
        colmap.read_model(folder)
    data = bytearray((folder / "images.bin").read_bytes())
    end = data.index(b"\0", 8 + 64) + 1
    data[end : end + 8] = struct.pack("<Q", 10**9)
    (folder / "images.bin").write_bytes(data)
    with pytest.raises(ModelError, match=r"images\.bin: the file ends at byte"):
        colmap.read_model(folder)


def test_pickles_are_no_models(tmp_path: Path, small: Scene) -> None:
    """An archive of numpy with a pickle, in the place of each file: its bytes are read as what they should be."""
    np.savez(tmp_path / "pickle.npz", a=np.array([{"a": 1}], dtype=object), allow_pickle=True)
    data = (tmp_path / "pickle.npz").read_bytes()
    folder = write_colmap(tmp_path / "binary", small, binary=True)
    (folder / "images.bin").write_bytes(data)
    (tmp_path / "cameras.xml").write_bytes(data)
    (tmp_path / "reconstruction.json").write_bytes(data)
    for read in (
        lambda: colmap.read_model(folder),
        lambda: metashape.read_model(tmp_path / "cameras.xml"),
        lambda: opensfm.read_model(tmp_path / "reconstruction.json"),
    ):
        with pytest.raises(ModelError):
            read()


def in_shot(key: str, value: Any) -> Callable[[list[Any]], None]:
    return lambda content: content[0]["shots"]["flight 1/DJI_0001.JPG"].update({key: value})


def in_camera(key: str, value: Any) -> Callable[[list[Any]], None]:
    return lambda content: content[0]["cameras"]["one"].update({key: value})


JSON: list[tuple[Callable[[list[Any]], Any], str]] = [
    (in_shot("rotation", [1, 2]), "the rotation of shot flight 1/DJI_0001.JPG is not three numbers"),
    (in_shot("rotation", [1, 2, float("nan")]), "the rotation of shot flight 1/DJI_0001.JPG is not three numbers"),
    (in_shot("translation", None), "the translation of shot flight 1/DJI_0001.JPG is not three numbers"),
    (in_shot("translation", "abc"), "the translation of shot flight 1/DJI_0001.JPG is not three numbers"),
    (in_shot("camera", ["one"]), "shot flight 1/DJI_0001.JPG: there is no camera ['one']"),
    (in_camera("width", 1e999), "camera one: "),
    (in_camera("width", -5), "camera one has a number that cannot be"),
    (in_camera("k1", float("nan")), "camera one has a number that cannot be"),
    (in_camera("focal_x", None), "camera one: "),
    (in_camera("projection_type", "spherical"), "camera one: lenses of the kind spherical are not read"),
    (lambda content: content.append(content[0]), "it has 2 components, of 6, 6 photos: choose one by --component"),
    (lambda content: content.clear(), "it has no list of reconstructions"),
    (lambda content: content[0]["points"].update(p3={"coordinates": [1, 2, 1e300]}), "coordinates of point p3"),
    (lambda content: content[0].update(points=[1, 2]), "its points are no items by their names"),
    (lambda content: content[0].update(shots={"a": 3}), "its shots are no items by their names"),
    (lambda content: content[0].update(shots={}), "it has no photo that is placed"),
    (
        lambda content: content[0]["shots"].update({"../a.jpg": content[0]["shots"]["flight 1/DJI_0001.JPG"]}),
        "photo ../a.jpg: its name leads out of the folder",
    ),
]


@pytest.mark.parametrize(("change", "message"), JSON)
def test_json_of_opensfm(tmp_path: Path, small: Scene, change: Callable[[Any], Any], message: str) -> None:
    path = write_opensfm(tmp_path, small)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(ModelError) as refused:
        opensfm.read_model(path)
    assert message in str(refused.value) and str(path) in str(refused.value)


def test_components_are_chosen(tmp_path: Path, small: Scene) -> None:
    path = write_opensfm(tmp_path, small)
    content = json.loads(path.read_text())
    second = {**content[0], "shots": dict(list(content[0]["shots"].items())[:2])}
    path.write_text(json.dumps([content[0], second]))
    assert len(opensfm.read_model(path, component=2).photos) == 2
    with pytest.raises(ModelError, match="it has 2 components, and no number 3"):
        opensfm.read_model(path, component=3)


@pytest.mark.parametrize("text", ["[" * 200000, "{", "\x00", "[1", '{"a": 1}'])
def test_json_that_is_none(tmp_path: Path, text: str) -> None:
    path = tmp_path / "reconstruction.json"
    path.write_text(text)
    with pytest.raises(ModelError, match=r"reconstruction\.json: it "):
        opensfm.read_model(path)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("a\tb\t1", r"tracks\.csv:2: 'a"),
        ("a\tb\t1\t0.1\tnan\t1", r"tracks\.csv:2: 'a"),
        ("a\tb\t1\t0.1\tx\t1", r"tracks\.csv:2: 'a"),
    ],
)
def test_tracks_of_opensfm(tmp_path: Path, small: Scene, line: str, message: str) -> None:
    path = write_opensfm(tmp_path, small)
    replaced(tmp_path / "tracks.csv", "_v2\n", f"_v2\n{line}\n")
    with pytest.raises(ModelError, match=message):
        opensfm.read_model(path)
    replaced(tmp_path / "tracks.csv", "_v2", "_v7")
    with pytest.raises(ModelError, match=r"tracks\.csv:1: tracks of this version are not read"):
        opensfm.read_model(path)


def test_a_reference_of_opensfm_that_is_none(tmp_path: Path, small: Scene) -> None:
    path = write_opensfm(tmp_path, small)
    (tmp_path / "reference_lla.json").write_text('{"latitude": NaN, "longitude": 1, "altitude": 2}')
    with pytest.raises(
        ModelError, match=r"reference_lla\.json: latitude, longitude, altitude of its reference are not all there"
    ):
        opensfm.read_model(path)


XML: list[tuple[str, str, str]] = [
    ("<document", '<!DOCTYPE a [<!ENTITY b "c">]><document', "it declares a document type or entities"),
    ("</document>", "", "it cannot be read"),
    ("<chunk ", "<block ", "it "),
    ('label="flight 1/DJI_0001.JPG"', 'label="flight 0/DJI_0002.JPG"', "two photos are called flight 0/DJI_0002"),
    ('label="flight 1/DJI_0001.JPG"', 'label="../DJI_0001.JPG"', "its name leads out of the folder"),
    ("<f>3105.0", "<f>nan", "sensor L has no size, no focal length above zero, or what is no number"),
    ('width="4000"', 'width="1e9"', "sensor L: "),
    ('width="4000"', 'width="0"', "sensor L has no size"),
    ('type="frame" class', 'type="fisheye" class', "sensor L is a fisheye lens with p1 and p2"),
    (
        'sensor_id="0" component_id="0" label="flight 1/DJI_0001',
        'sensor_id="7" label="DJI_0001',
        "sensor 7 has no calibration as frame or fisheye",
    ),
    ("<transform>", "<transform>1 ", "its transform is no rotation and place"),
]


@pytest.mark.parametrize(("old", "new", "message"), XML)
def test_xml_of_metashape(tmp_path: Path, small: Scene, old: str, new: str, message: str) -> None:
    path = write_metashape(tmp_path / "cameras.xml", small)
    text = path.read_text()
    at = text.index("<cameras>") if old == "<transform>" else 0
    assert old in text
    path.write_text(text[:at] + text[at:].replace(old, new, 1))
    with pytest.raises(ModelError) as refused:
        metashape.read_model(path)
    assert message in str(refused.value) and str(path) in str(refused.value)


def test_entities_in_utf_16(tmp_path: Path) -> None:
    path = tmp_path / "cameras.xml"
    path.write_bytes('<?xml version="1.0" encoding="UTF-16"?><!DOCTYPE a [<!ENTITY b "c">]><a/>'.encode("utf-16"))
    with pytest.raises(ModelError, match="it declares a document type or entities"):
        metashape.read_model(path)


def test_components_of_metashape(tmp_path: Path, small: Scene) -> None:
    path = write_metashape(tmp_path / "cameras.xml", small)
    replaced(path, "</components>", '<component id="1"/></components>')
    replaced(path, 'component_id="0"', 'component_id="1"', 2)
    with pytest.raises(ModelError, match="it has 2 components, of 4, 2 photos: choose one by --component"):
        metashape.read_model(path)
    assert len(metashape.read_model(path, component=2).photos) == 2
