"""Lenses of all formats by scalars, both ways, and models of COLMAP there and back through pycolmap."""

import json
import math
import struct
from pathlib import Path

import numpy as np
import pytest

from musatpy.sfm import colmap, metashape, opensfm
from musatpy.sfm.model import Model
from sfm.written_models import scene, write_colmap, write_metashape, write_opensfm

EDGES = [(4000.0 * i / 8, 3000.0 * j / 6) for i in range(9) for j in range(7)]
K, P, D = (-0.09, 0.05, -0.011, 0.002), (0.0011, -0.0007), (0.01, -0.004, 0.002)
F, FX, FY, CX, CY = 3100.0, 3100.0, 3092.0, 2014.5, 1489.25
NAMED = {"f": F, "fx": FX, "fy": FY, "cx": CX, "cy": CY, "p1": P[0], "p2": P[1]}
NAMED |= {f"k{n}": k for n, k in enumerate(K, 1)} | {f"d{n}": d for n, d in enumerate(D, 1)}
COLMAP = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 d1 d2 d3",
    "SIMPLE_RADIAL_FISHEYE": "f cx cy k1",
    "RADIAL_FISHEYE": "f cx cy k1 k2",
    "SIMPLE_FISHEYE": "f cx cy",
    "FISHEYE": "fx fy cx cy",
}


def imaged(x: float, y: float, has: set[str], fisheye: bool) -> tuple[float, float]:
    """Return the image of a ray on a plane one focal length off, by the equations of OpenCV."""
    k1, k2, k3, k4, p1, p2, d1, d2, d3 = (
        NAMED[name] if name in has else 0.0 for name in ("k1", "k2", "k3", "k4", "p1", "p2", "d1", "d2", "d3")
    )
    r = math.hypot(x, y)
    if fisheye:
        t = math.atan(r)
        s = t * (1 + k1 * t**2 + k2 * t**4 + k3 * t**6 + k4 * t**8) / r if r else 1.0
        return x * s, y * s
    g = (1 + k1 * r**2 + k2 * r**4 + k3 * r**6 + k4 * r**8) / (1 + d1 * r**2 + d2 * r**4 + d3 * r**6)
    return (
        x * g + 2 * p1 * x * y + p2 * (r**2 + 2 * x**2),
        y * g + p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y,
    )


def check(model: Model, has: set[str], fisheye: bool, fx: float, fy: float, shear: float = 0.0) -> None:
    """Pixels of rays as the equations have them, and the rays of pixels again, over the whole format."""
    (lens,) = model.lenses
    rays = lens.rays(np.array(EDGES))
    for (u, v), (x, y) in zip(EDGES, rays.tolist(), strict=True):
        a, b = imaged(x, y, has, fisheye)
        assert CX + fx * a + shear * b == pytest.approx(u, abs=1e-9)
        assert CY + fy * b == pytest.approx(v, abs=1e-9)
    assert np.abs(lens.pixels(rays) - EDGES).max() < 1e-9


@pytest.mark.parametrize("name", COLMAP)
def test_lenses_of_colmap(tmp_path: Path, name: str) -> None:
    keys = COLMAP[name].split()
    write_colmap(tmp_path, scene(wide=1))
    values = " ".join(repr(NAMED[key]) for key in keys)
    (tmp_path / "cameras.txt").write_text(f"9 {name} 4000 3000 {values}\n")
    two = "fx" in keys
    check(colmap.read_model(tmp_path), set(keys), name.endswith("FISHEYE"), FX if two else F, FY if two else F)


OPENSFM = {
    "perspective": ("k1", "k2"),
    "simple_radial": ("k1",),
    "radial": ("k1", "k2"),
    "brown": ("k1", "k2", "k3", "p1", "p2"),
    "fisheye": ("k1", "k2"),
    "fisheye_opencv": ("k1", "k2", "k3", "k4"),
}


@pytest.mark.parametrize("name", OPENSFM)
def test_lenses_of_opensfm(tmp_path: Path, name: str) -> None:
    path = write_opensfm(tmp_path, scene(wide=1))
    content = json.loads(path.read_text())
    single = name in ("perspective", "fisheye")
    focal = {"focal": F / 4000} if single else {"focal_x": FX / 4000, "focal_y": FY / 4000}
    middle = {} if single else {"c_x": (CX - 2000) / 4000, "c_y": (CY - 1500) / 4000}
    camera = {"projection_type": name, "width": 4000, "height": 3000, **focal, **middle}
    content[0]["cameras"]["one"] = camera | {key: NAMED[key] for key in OPENSFM[name]}
    path.write_text(json.dumps(content))
    model = opensfm.read_model(path)
    if single:
        assert model.lenses[0].centre == (2000.0, 1500.0)
        rays = model.lenses[0].rays(np.array(EDGES) - [CX - 2000.0, CY - 1500.0])
        for (u, v), (x, y) in zip(EDGES, rays.tolist(), strict=True):
            a, b = imaged(x, y, set(OPENSFM[name]), name == "fisheye")
            assert (CX + F * a, CY + F * b) == pytest.approx((u, v), abs=1e-9)
    else:
        check(model, set(OPENSFM[name]), name.startswith("fisheye"), FX, FY)


@pytest.mark.parametrize("kind", ["frame", "fisheye"])
def test_lenses_of_metashape(tmp_path: Path, kind: str) -> None:
    path = write_metashape(tmp_path / "cameras.xml", scene(wide=1))
    text = path.read_text()
    first, last = text.index("<calibration"), text.index("</calibration>")
    has = {"k1", "k2", "k3", "k4"} | ({"p1", "p2"} if kind == "frame" else set())
    values = {"f": FY, "b1": FX - FY, "b2": 1.75, "cx": CX - 2000, "cy": CY - 1500}
    values |= {key: NAMED[key] for key in has}
    if kind == "frame":
        values |= {"p1": P[1], "p2": P[0]}
    body = "".join(f"<{key}>{value!r}</{key}>" for key, value in values.items())
    path.write_text(f'{text[:first]}<calibration type="{kind}" class="adjusted">{body}{text[last:]}')
    check(metashape.read_model(path), has, kind == "fisheye", FX, FY, 1.75)


def test_names_with_blanks_are_written_as_binary(tmp_path: Path) -> None:
    """COLMAP's own reader of text ends a name at its first blank."""
    of = scene(0.4, wide=1)
    model = colmap.read_model(write_colmap(tmp_path / "given", of, binary=True))
    colmap.write_model(model, tmp_path / "binary")
    assert sorted(path.name for path in (tmp_path / "binary").iterdir()) == [
        "cameras.bin",
        "images.bin",
        "points3D.bin",
    ]
    again = colmap.read_model(tmp_path / "binary")
    assert again.photos.tolist() == of.names and len(again.photo) == len(of.images)
    assert again.lenses[0].k[:3] == model.lenses[0].k[:3] and again.lenses[0].p == model.lenses[0].p
    assert np.allclose(again.residuals(), model.residuals(), rtol=0, atol=1e-9)
    assert np.allclose(again.stored, model.stored, rtol=0, atol=1e-9)
    entries = (
        (tmp_path / "binary" / "points3D.bin").read_bytes(),
        (tmp_path / "given" / "points3D.bin").read_bytes(),
    )
    tracks = []  # photos and places of features, counted from the first that belongs to a point
    for first, data in zip((1, 3), entries, strict=True):
        at, found = 8, []
        for _ in again.points:
            (length,) = struct.unpack_from("<Q", data, at + 43)
            track = struct.unpack_from(f"<{2 * length}I", data, at + 51)
            found.append([(photo - first, place - (first == 3)) for photo, place in batched(track)])
            at += 51 + 8 * length
        assert at == len(data)
        tracks.append(found)
    assert tracks[0] == tracks[1]


def batched(values: tuple[int, ...]) -> list[tuple[int, int]]:
    return list(zip(values[::2], values[1::2], strict=True))


@pytest.mark.parametrize(("written", "text"), [(False, False), (True, True), (True, False)])
def test_models_of_colmap_by_pycolmap(tmp_path: Path, written: bool, text: bool) -> None:
    """As the script writes them, and as a model that was read is written again."""
    pycolmap = pytest.importorskip("pycolmap")
    of = scene(0.4)
    if text:
        of.names = [name.replace(" ", "_") for name in of.names]
    model = colmap.read_model(write_colmap(tmp_path / "given", of, binary=not written))
    folder = tmp_path / "given"
    if written:
        folder = tmp_path / "again"
        colmap.write_model(model, folder)
    theirs = pycolmap.Reconstruction(str(folder))
    assert len(theirs.points3D) == len(model.points)
    number = {name: row for row, name in enumerate(model.photos.tolist())}
    images = 0
    for image in theirs.images.values():
        row, pose = number[image.name], image.cam_from_world
        pose = pose() if callable(pose) else pose
        assert np.allclose(pose.rotation.matrix(), model.rotation[row], rtol=0, atol=1e-9)
        assert np.allclose(-model.rotation[row] @ model.centre[row], pose.translation, rtol=0, atol=1e-9)
        seen = [point for point in image.points2D if point.has_point3D()]
        of_photo = model.photo == row
        order = np.argsort(model.pixel[of_photo][:, 0])
        pixels = np.array(sorted(point.xy.tolist() for point in seen))
        assert np.allclose(pixels, model.pixel[of_photo][order], rtol=0, atol=1e-9)
        images += len(seen)
    assert images == len(model.photo)
    theirs.update_point_3d_errors()
    mean = np.bincount(model.point, np.linalg.norm(model.residuals(), axis=1)) / model.counts
    assert theirs.compute_mean_reprojection_error() == pytest.approx(mean.mean(), abs=1e-6)
    again = colmap.read_model(folder)
    assert np.allclose(again.residuals(), model.residuals(), rtol=0, atol=1e-9)
    assert np.allclose(again.stored, model.stored, rtol=0, atol=1e-9)
