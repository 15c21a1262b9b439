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

from musatpy.arrays import FloatArray
from musatpy.errors import Problem
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.systems import geographic
from musatpy.pointfiles.columns import FAR, number
from musatpy.reduction.pixel_lens import PixelLens
from musatpy.sfm.model import Model, ModelError, checked, chosen_component, links, refused
from musatpy.units import DEGREE

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
_NO_GPS = 1e3  # m: as good as none, of which OpenSfM says 999999


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
    cameras, shots, points = (_items(path, reconstruction, key) for key in ("cameras", "shots", "points"))
    of_shots = [str(shot.get("camera")) for shot in shots.values()]
    lenses = {name: _lens(path, name, of) for name, of in cameras.items() if name in of_shots}
    camera, known = links(of_shots, list(lenses))
    refused(
        [
            Problem(message=f"shot {name}: there is no camera {shot.get('camera')!r}", file=str(path))
            for (name, shot), there in zip(shots.items(), known.tolist(), strict=True)
            if not there
        ]
    )
    rotation, shift = (_numbers(path, shots, "shot", key) for key in ("rotation", "translation"))
    position = _numbers(path, points, "point", "coordinates")
    from scipy.spatial.transform import Rotation  # which other formats do without

    R = Rotation.from_rotvec(rotation).as_matrix() if len(rotation) else np.zeros((0, 3, 3))
    of_photo, of_track, xy = _tracks(tracks)
    photo, seen = links(of_photo, list(shots))
    point, kept = links(of_track, list(points))
    used = seen & kept
    size = np.array([(lens.width, lens.height) for lens in lenses.values()], dtype=float).reshape(-1, 2)
    size = size[camera[photo[used]]]
    to_geocentric = _reference(path, reconstruction)
    model = Model(
        program="opensfm",
        cameras=tuple(lenses),
        lenses=tuple(lenses.values()),
        photos=np.array(list(shots), dtype=np.str_),
        camera=camera,
        rotation=R,
        centre=-np.einsum("nji,nj->ni", R, shift),
        points=np.array(list(points), dtype=np.str_),
        position=position,
        photo=photo[used],
        point=point[used],
        pixel=xy[used] * size.max(axis=1, keepdims=True) + 0.5 * size,
        to_geocentric=to_geocentric,
        reference=_positions(path, shots, to_geocentric),
        reference_system="EPSG:4326",
    )
    return checked(model, str(path))


def _component(path: Path, content: Any, component: int) -> Mapping[str, Any]:
    """Return one of the reconstructions of a file. Raises `ModelError` where it is not said which."""
    if not isinstance(content, list) or not all(isinstance(part, dict) for part in content) or not content:
        raise ModelError.of("it has no list of reconstructions", path)
    sizes = [len(_items(path, part, "shots")) for part in content]
    return content[chosen_component(sizes, component, str(path))]


def _items(path: Path, reconstruction: Mapping[str, Any], key: str) -> Mapping[str, Mapping[str, Any]]:
    """Return the items of a reconstruction by their names. Raises `ModelError`."""
    items = reconstruction.get(key, {})
    if not isinstance(items, dict) or not all(isinstance(item, dict) for item in items.values()):
        raise ModelError.of(f"its {key} are no items by their names", path)
    return items


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ModelError.of(f"it cannot be read: {error}", path) from None


def _lens(path: Path, name: str, of: Mapping[str, Any]) -> PixelLens:
    """Return the lens of a camera. Raises `ModelError`."""
    kind = str(of.get("projection_type", "perspective"))
    if kind not in _LENSES:
        message = f"camera {name}: lenses of the kind {kind} are not read; those that are: {', '.join(_LENSES)}"
        raise ModelError.of(message, path)
    focal, radial = _LENSES[kind]
    try:
        width, height = int(of["width"]), int(of["height"])
        fx, fy = (float(of[key]) for key in focal)
        c = [float(of.get(key, 0.0)) for key in ("c_x", "c_y")]
        k = tuple(float(of.get(key, 0.0)) for key in radial)
        p = (float(of.get("p1", 0.0)), float(of.get("p2", 0.0)))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ModelError.of(f"camera {name}: {error} is not there, or no number", path) from None
    size = max(width, height)
    if not (min(width, height, fx, fy) > 0 and np.isfinite([fx, fy, *c, *k, *p]).all()):
        raise ModelError.of(f"camera {name} has a number that cannot be", path)
    return PixelLens(
        width=width,
        height=height,
        focal=(fx * size, fy * size),
        centre=(c[0] * size + 0.5 * width, c[1] * size + 0.5 * height),
        k=k,
        p=p,
        fisheye=kind.startswith("fisheye"),
    )


def _numbers(path: Path, items: Mapping[str, Mapping[str, Any]], what: str, key: str) -> FloatArray:
    """Return three numbers of each item. Raises `ModelError` that names those without them."""
    values, problems = np.empty((len(items), 3)), []
    for row, (name, item) in enumerate(items.items()):
        try:
            values[row] = x, y, z = item[key]
            if not (abs(x) < FAR and abs(y) < FAR and abs(z) < FAR):
                raise ValueError
        except (KeyError, TypeError, ValueError):
            problems.append(Problem(message=f"the {key} of {what} {name} is not three numbers", file=str(path)))
    refused(problems)
    return values


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
            _finite(np.array([row[3:5] for row in rows], dtype=float).reshape(-1, 2)),
        )
    except (IndexError, ValueError):
        pass
    for place, line in ((n, line) for n, line in enumerate(text[first:], first + 1) if line.strip()):
        row = line.split("\t")
        try:
            _finite(np.array(row[3:5], dtype=float).reshape(1, 2))
        except (IndexError, ValueError):
            expected = "photo, track, feature, x, y, ... between tabs"
            raise ModelError([Problem(file=str(path), line=place, found=line[:60], expected=expected)]) from None
    raise ModelError.of("its lines have different lengths", path)


def _finite(values: FloatArray) -> FloatArray:
    if not np.isfinite(values).all():
        raise ValueError("no number")
    return values


def _reference(path: Path, reconstruction: Mapping[str, Any]) -> FloatArray | None:
    """Return the matrix (4, 4) from east, north, up about the reference to geocentric metres, None without one.

    The reference is that of the reconstruction, else that of the file beside it, as older versions write.
    """
    beside, content = path.with_name("reference_lla.json"), reconstruction.get("reference_lla")
    if content is None and beside.is_file():
        path, content = beside, _json(beside)
    if content is None:
        return None
    try:
        place = _finite(np.array([float(content[key]) for key in ("latitude", "longitude", "altitude")]))
        if (np.abs(place) > (90.0, 360.0, FAR)).any():
            raise ValueError("no place")
    except (KeyError, TypeError, ValueError):
        message = "latitude, longitude, altitude of its reference are not all there as numbers"
        raise ModelError.of(message, path) from None
    at = place * [DEGREE, DEGREE, 1.0]
    out = np.eye(4)
    out[:3, :3] = _WGS84.frame(at).T
    out[:3, 3] = _WGS84.geocentric(at)
    return out


def _positions(path: Path, shots: Mapping[str, Mapping[str, Any]], to_geocentric: FloatArray | None) -> FloatArray:
    """Return longitude, latitude (degrees) and height of shots by their receivers; NaN where these say none."""
    stated = {
        name: shot
        for name, shot in shots.items()
        if shot.get("gps_position") is not None and not number(str(shot.get("gps_dop"))) > _NO_GPS
    }
    at, local = np.full((len(shots), 3), np.nan), _numbers(path, stated, "shot", "gps_position")
    if to_geocentric is not None and stated:
        row, _ = links(list(stated), list(shots))
        at[row] = geographic(_WGS84, local @ to_geocentric[:3, :3].T + to_geocentric[:3, 3])
    return at[:, [1, 0, 2]] / [DEGREE, DEGREE, 1.0]
