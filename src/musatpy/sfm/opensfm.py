"""Models of OpenSfM and OpenDroneMap: reconstruction.json, tracks.csv (versions 0 to 2), reference_lla.json.

A shot is a rotation vector and t from the world to its camera. Images are (pixel - width / 2) / max(width, height),
pixels from the corner, focal lengths and principal points likewise (opensfm.org/docs/geometry.html).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from musatpy.arrays import FloatArray
from musatpy.errors import Problem
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.reduction.pixel_lens import PixelLens
from musatpy.sfm.model import Model, ModelError, links, refused

# Projections that are read: the names of focal lengths, and of k1, k2, ...
_LENSES = {
    "perspective": (("focal", "focal"), ("k1", "k2")),
    "simple_radial": (("focal_x", "focal_y"), ("k1",)),
    "radial": (("focal_x", "focal_y"), ("k1", "k2")),
    "brown": (("focal_x", "focal_y"), ("k1", "k2", "k3")),
    "fisheye": (("focal", "focal"), ("k1", "k2")),
    "fisheye_opencv": (("focal_x", "focal_y"), ("k1", "k2", "k3", "k4")),
}
_HEADER = "OPENSFM_TRACKS_VERSION_"
_WGS84 = Ellipsoid("WGS84")


def reconstruction_of(folder: Path) -> Path | None:
    """Return the reconstruction of a folder of OpenSfM or of OpenDroneMap, None without any."""
    for path in (folder / "reconstruction.json", folder / "opensfm" / "reconstruction.json"):
        if path.is_file():
            return path
    return None


def read_model(path: Path, component: int = 0) -> Model:
    """Return the model of a reconstruction.json, its tracks and its reference beside it.

    `component` counts from 1; 0: the only one. Raises `ModelError` with file and item.
    """
    reconstruction = _component(path, _json(path), component)
    tracks = path.with_name("tracks.csv")
    refused([] if tracks.is_file() else [Problem(message="there is no such file", file=str(tracks))])
    cameras = reconstruction.get("cameras", {})
    lenses = {name: _lens(path, name, of) for name, of in cameras.items()}
    shots, points = reconstruction.get("shots", {}), reconstruction.get("points", {})
    ids, camera = list(lenses), []
    for name, shot in shots.items():
        if shot.get("camera") not in lenses:
            message = f"shot {name}: there is no camera {shot.get('camera')!r}"
            raise ModelError([Problem(message=message, file=str(path))])
        camera.append(ids.index(shot["camera"]))
    rotation, shift, position = (
        _numbers(path, what, of)
        for what, of in (
            ("rotation of shot", {name: shot.get("rotation") for name, shot in shots.items()}),
            ("translation of shot", {name: shot.get("translation") for name, shot in shots.items()}),
            ("coordinates of point", {name: point.get("coordinates") for name, point in points.items()}),
        )
    )
    R = Rotation.from_rotvec(rotation).as_matrix() if len(rotation) else np.zeros((0, 3, 3))
    of_photo, of_track, xy = _tracks(tracks)
    photo, seen = links(of_photo, list(shots))
    point, kept = links(of_track, list(points))
    used = seen & kept
    of_camera = np.array(camera, dtype=np.int64)
    size = np.array([(lens.width, lens.height) for lens in lenses.values()], dtype=float)[of_camera[photo[used]]]
    return Model(
        program="opensfm",
        cameras=tuple(lenses),
        lenses=tuple(lenses.values()),
        photos=np.array(list(shots), dtype=np.str_),
        camera=of_camera,
        rotation=R,
        centre=-np.einsum("nji,nj->ni", R, shift),
        points=np.array(list(points), dtype=np.str_),
        position=position,
        photo=photo[used],
        point=point[used],
        pixel=xy[used] * size.max(axis=1, keepdims=True) + 0.5 * size,
        to_geocentric=_reference(path.with_name("reference_lla.json")),
    )


def _component(path: Path, content: Any, component: int) -> Mapping[str, Any]:
    """Return one of the reconstructions of a file. Raises `ModelError` where it is not said which."""
    if not isinstance(content, list) or not all(isinstance(part, dict) for part in content) or not content:
        raise ModelError([Problem(message="it has no list of reconstructions", file=str(path))])
    if not component and len(content) > 1:
        sizes = ", ".join(str(len(part.get("shots", {}))) for part in content)
        message = f"it has {len(content)} components, of {sizes} photos: choose one by --component"
        raise ModelError([Problem(message=message, file=str(path))])
    if component > len(content):
        message = f"it has {len(content)} components, and no number {component}"
        raise ModelError([Problem(message=message, file=str(path))])
    return content[max(component, 1) - 1]


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ModelError([Problem(message=f"it cannot be read: {error}", file=str(path))]) from None


def _lens(path: Path, name: str, of: Mapping[str, Any]) -> PixelLens:
    """Return the lens of a camera. Raises `ModelError`."""
    kind = str(of.get("projection_type", "perspective"))
    if kind not in _LENSES:
        message = f"camera {name}: lenses of the kind {kind} are not read; those that are: {', '.join(_LENSES)}"
        raise ModelError([Problem(message=message, file=str(path))])
    focal, radial = _LENSES[kind]
    try:
        width, height = int(of["width"]), int(of["height"])
        fx, fy = (float(of[key]) for key in focal)
        c = [float(of.get(key, 0.0)) for key in ("c_x", "c_y")]
        k = tuple(float(of.get(key, 0.0)) for key in radial)
        p = (float(of.get("p1", 0.0)), float(of.get("p2", 0.0)))
    except (KeyError, TypeError, ValueError) as error:
        message = f"camera {name}: {error} is not there, or no number"
        raise ModelError([Problem(message=message, file=str(path))]) from None
    size = max(width, height)
    if not (min(width, height) > 0 and np.isfinite([fx, fy, *c, *k, *p]).all()):
        raise ModelError([Problem(message=f"camera {name} has a number that cannot be", file=str(path))])
    return PixelLens(
        width=width,
        height=height,
        focal=(fx * size, fy * size),
        centre=(c[0] * size + 0.5 * width, c[1] * size + 0.5 * height),
        k=k,
        p=p,
        fisheye=kind.startswith("fisheye"),
    )


def _numbers(path: Path, what: str, of: Mapping[str, Any]) -> FloatArray:
    """Return three numbers of each item. Raises `ModelError` that names the first without them."""
    try:
        values = np.array(list(of.values()), dtype=float).reshape(-1, 3)
        if len(values) == len(of) and np.isfinite(values).all():
            return values
    except (TypeError, ValueError):
        pass
    for name, value in of.items():
        try:
            good = np.shape(value) == (3,) and np.isfinite(np.array(value, dtype=float)).all()
        except (TypeError, ValueError):
            good = False
        if not good:
            raise ModelError([Problem(message=f"the {what} {name} is not three numbers", file=str(path))])
    raise ModelError([Problem(message=f"the {what} is not three numbers everywhere", file=str(path))])


def _tracks(path: Path) -> tuple[list[str], list[str], FloatArray]:
    """Return photo, track and normalised place (m, 2) of the images of tracks.csv. Raises `ModelError`."""
    text = path.read_text(encoding="utf-8", errors="surrogateescape").splitlines()
    first = 1 if text and text[0].startswith(_HEADER) else 0
    if first and text[0][len(_HEADER) :] not in ("v1", "v2"):
        message = "tracks of this version are not read; those that are: v0 (without a first line), v1, v2"
        raise ModelError([Problem(message=message, file=str(path), line=1, found=text[0])])
    rows = [line.split("\t") for line in text[first:] if line.strip()]
    try:
        return (
            [row[0] for row in rows],
            [row[1] for row in rows],
            np.array([row[3:5] for row in rows], dtype=float).reshape(-1, 2),
        )
    except (IndexError, ValueError):
        pass
    for number, line in enumerate(text[first:], first + 1):
        row = line.split("\t")
        try:
            float(row[3]), float(row[4])
        except (IndexError, ValueError):
            expected = "photo, track, feature, x, y, ... between tabs"
            raise ModelError([Problem(file=str(path), line=number, found=line[:60], expected=expected)]) from None
    raise ModelError([Problem(message="its lines have different lengths", file=str(path))])


def _reference(path: Path) -> FloatArray | None:
    """Return the matrix (4, 4) from east, north, up about the reference to geocentric metres, None without it."""
    if not path.is_file():
        return None
    content = _json(path)
    try:
        place = [float(content[key]) for key in ("latitude", "longitude", "altitude")]
    except (KeyError, TypeError, ValueError):
        message = "latitude, longitude, altitude are not all there as numbers"
        raise ModelError([Problem(message=message, file=str(path))]) from None
    at = np.array([*np.radians(place[:2]), place[2]])
    out = np.eye(4)
    out[:3, :3] = _WGS84.frame(at).T
    out[:3, 3] = _WGS84.geocentric(at)
    return out
