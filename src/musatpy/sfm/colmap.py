"""Models of COLMAP, as text or binary: cameras, images, points3D. Rigs and frames beside them say nothing more.

An image is q, t from the world to its camera, in pixels from the corner (colmap.github.io/format.html).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import FloatArray, IntArray
from musatpy.errors import Problem
from musatpy.pointfiles.columns import FAR
from musatpy.reduction.pixel_lens import PixelLens
from musatpy.sfm.model import Model, ModelError, checked, chosen_component, refused

_PLACED = ("f", "cx", "cy"), ("fx", "fy", "cx", "cy")
# By their numbers in binary files; None: not read.
LENSES: tuple[tuple[str, tuple[str, ...] | None], ...] = (
    ("SIMPLE_PINHOLE", _PLACED[0]),
    ("PINHOLE", _PLACED[1]),
    ("SIMPLE_RADIAL", (*_PLACED[0], "k1")),
    ("RADIAL", (*_PLACED[0], "k1", "k2")),
    ("OPENCV", (*_PLACED[1], "k1", "k2", "p1", "p2")),
    ("OPENCV_FISHEYE", (*_PLACED[1], "k1", "k2", "k3", "k4")),
    ("FULL_OPENCV", (*_PLACED[1], "k1", "k2", "p1", "p2", "k3", "d1", "d2", "d3")),
    ("FOV", None),
    ("SIMPLE_RADIAL_FISHEYE", (*_PLACED[0], "k1")),
    ("RADIAL_FISHEYE", (*_PLACED[0], "k1", "k2")),
    ("THIN_PRISM_FISHEYE", None),
    ("RAD_TAN_THIN_PRISM_FISHEYE", None),
    ("SIMPLE_DIVISION", None),
    ("DIVISION", None),
    ("SIMPLE_FISHEYE", _PLACED[0]),
    ("FISHEYE", _PLACED[1]),
)
_POINT = np.dtype([("id", "<u8"), ("xyz", "<f8", 3), ("colour", "u1", 3), ("error", "<f8"), ("track", "<u8")])
_TRACK = 43  # bytes before the length of its track
_COUNT, _CAMERA, _IMAGE = (struct.Struct(form) for form in ("<Q", "<iiQQ", "<I7dI"))
_SCALAR_LAST, _SCALAR_FIRST = [1, 2, 3, 0], [3, 0, 1, 2]  # of quaternions: those of scipy, and of COLMAP
_FEATURE = np.dtype([("xy", "<f8", 2), ("point", "<i8")])
# Poses of photos, rows of the images on each, points, and their tracks: photo and place, photo and place, ...
_Bundle = tuple[list[list[float]], list[IntArray], NDArray[np.void], list[IntArray]]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Image:
    """One image of a file."""

    name: str
    camera: int
    pose: Sequence[float]  # qw qx qy qz tx ty tz
    pixel: FloatArray  # (f, 2) of the features that belong to a point
    point: IntArray  # (f,)


def is_colmap(folder: Path) -> bool:
    """Return whether a folder has a model of COLMAP."""
    return any((folder / f"images{suffix}").is_file() for suffix in (".bin", ".txt"))


def component_of(path: Path, component: int) -> Path:
    """Return the folder of a model: `path`, or one of those in it or in its folder `sparse`, 0, 1, ...

    `component` counts from 1; 0: the only one. Raises `ModelError` that says how many photos each has.
    """
    below = (path,) if is_colmap(path) else (*path.glob("*"), *path.glob("sparse/*"))
    folders = sorted(filter(is_colmap, below), key=lambda folder: (len(folder.name), folder.name))
    if not folders:
        raise ModelError.of("it has no model of COLMAP: images.bin or images.txt", path)
    many = len(folders) > 1 and not component
    sizes = [len(read_model(folder).photos) if many else 0 for folder in folders]
    return folders[chosen_component(sizes, component, str(path))]


def read_model(folder: Path) -> Model:
    """Return the model of a folder, of its binary files where it has both.

    Features that belong to no point are left out. Raises `ModelError` with file and line, or byte.
    """
    binary = (folder / "images.bin").is_file()
    suffix = ".bin" if binary else ".txt"
    paths = [folder / f"{name}{suffix}" for name in ("cameras", "images", "points3D")]
    refused([Problem(message="there is no such file", file=str(path)) for path in paths if not path.is_file()])
    cameras, images, points = (
        (_binary_cameras, _binary_images, _binary_points) if binary else (_text_cameras, _text_images, _text_points)
    )
    lenses = dict[int, PixelLens]()
    for camera, lens in cameras(paths[0]):
        if camera in lenses:
            raise ModelError([Problem(message=f"camera {camera} stands twice", file=str(paths[0]))])
        lenses[camera] = lens
    every = list(images(paths[1]))
    return _assembled(paths, lenses, every, points(paths[2]))


def write_model(model: Model, folder: Path) -> None:
    """Write a model into a folder, lenses as FULL_OPENCV or OPENCV_FISHEYE. Raises `ModelError`.

    As text, or as binary where the name of a photo has a blank, at which COLMAP's reader of text ends names.
    """
    refused(
        [
            Problem(message=f"camera {name}: COLMAP has no shear and no fourth radial coefficient of usual lenses")
            for name, lens in zip(model.cameras, model.lenses, strict=True)
            if lens.shear or (not lens.fisheye and len(lens.k) > 3 and lens.k[3])
        ]
    )
    from scipy.spatial.transform import Rotation

    shift = -np.einsum("nij,nj->ni", model.rotation, model.centre)
    poses = np.column_stack([Rotation.from_matrix(model.rotation).as_quat()[:, _SCALAR_FIRST], shift]).tolist()
    rows = _parts(model.photo, len(model.photos))
    place = np.empty(len(model.photo), dtype=np.int64)  # of an image among the features of its photo
    for of in rows:
        place[of] = np.arange(len(of))
    points = np.zeros(len(model.points), _POINT)
    points["id"], points["xyz"], points["track"] = np.arange(len(points)) + 1, model.position, model.counts
    points["colour"] = 128 if model.colour is None else model.colour
    size = np.nan_to_num(np.linalg.norm(model.residuals(), axis=1))
    points["error"] = np.bincount(model.point, size, len(points)) / np.maximum(model.counts, 1)
    track = np.stack([model.photo + 1, place], axis=1)
    tracks = [track[of].reshape(-1) for of in _parts(model.point, len(points))]
    folder.mkdir(parents=True, exist_ok=True)
    write = _write_binary if any(" " in name for name in model.photos.tolist()) else _write_text
    write(model, folder, (poses, rows, points, tracks))


def _parts(of: IntArray, count: int) -> list[IntArray]:
    """Return the rows of images (m,) that are of each of so many things."""
    order = np.argsort(of, kind="stable")
    return np.split(order, np.searchsorted(of[order], np.arange(1, count))) if count else []


def _write_text(model: Model, folder: Path, bundle: _Bundle) -> None:
    poses, rows, points, tracks = bundle
    lines = [
        f"{number} {name} {lens.width} {lens.height} {' '.join(repr(float(value)) for value in values)}"
        for number, lens in enumerate(model.lenses, 1)
        for name, values in (_written(lens),)
    ]
    (folder / "cameras.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    with (folder / "images.txt").open("w", encoding="utf-8") as file:
        for number, name in enumerate(model.photos.tolist()):
            pose, of = " ".join(map(repr, poses[number])), rows[number]
            file.write(f"{number + 1} {pose} {model.camera[number] + 1} {name}\n")
            features = zip(model.pixel[of].tolist(), (model.point[of] + 1).tolist(), strict=True)
            file.write(" ".join(f"{x!r} {y!r} {point}" for (x, y), point in features) + "\n")
    columns = (points[name].tolist() for name in ("id", "xyz", "colour", "error"))
    with (folder / "points3D.txt").open("w", encoding="utf-8") as file:
        for number, xyz, colour, error, track in zip(*columns, tracks, strict=True):
            file.write(" ".join(map(repr, [number, *xyz, *colour, error, *track.tolist()])) + "\n")


def _write_binary(model: Model, folder: Path, bundle: _Bundle) -> None:
    poses, rows, points, tracks = bundle
    cameras, images = bytearray(_COUNT.pack(len(model.lenses))), bytearray(_COUNT.pack(len(poses)))
    for number, lens in enumerate(model.lenses, 1):
        name, values = _written(lens)
        cameras += _CAMERA.pack(number, [*dict(LENSES)].index(name), lens.width, lens.height)
        cameras += np.array(values, dtype="<f8").tobytes()
    for number, (name, of) in enumerate(zip(model.photos.tolist(), rows, strict=True)):
        images += _IMAGE.pack(number + 1, *poses[number], int(model.camera[number]) + 1) + name.encode() + b"\0"
        features = np.zeros(len(of), _FEATURE)
        features["xy"], features["point"] = model.pixel[of], model.point[of] + 1
        images += _COUNT.pack(len(of)) + features.tobytes()
    entries = (point.tobytes() + track.astype("<u4").tobytes() for point, track in zip(points, tracks, strict=True))
    (folder / "cameras.bin").write_bytes(cameras)
    (folder / "images.bin").write_bytes(images)
    (folder / "points3D.bin").write_bytes(b"".join([_COUNT.pack(len(points)), *entries]))


def _written(lens: PixelLens) -> tuple[str, tuple[float, ...]]:
    """Return the name and the parameters of a lens as it is written."""
    place = (*lens.focal, *lens.centre)
    k = (*lens.k, 0.0, 0.0, 0.0, 0.0)
    if lens.fisheye:
        return "OPENCV_FISHEYE", (*place, *k[:4])
    d = (*lens.d, 0.0, 0.0, 0.0)
    return "FULL_OPENCV", (*place, *k[:2], *lens.p, k[2], *d[:3])


def _lens(path: Path, line: int | None, name: str, size: tuple[int, int], values: Sequence[float]) -> PixelLens:
    """Return the lens of a camera. Raises `ModelError`."""
    parameters = dict(LENSES).get(name)
    if parameters is None:
        known = ", ".join(name for name, has in LENSES if has)
        message = f"lenses of the model {name} are not read; those that are: {known}"
        raise ModelError([Problem(message=message, file=str(path), line=line)])
    if len(values) != len(parameters) or not np.isfinite(values).all() or min(size) <= 0:
        message = f"a camera {name} has width, height and {' '.join(parameters)}, all numbers"
        raise ModelError([Problem(message=message, file=str(path), line=line)])
    of = dict(zip(parameters, values, strict=True))
    return PixelLens(
        width=size[0],
        height=size[1],
        focal=(of.get("fx", of.get("f", 0.0)), of.get("fy", of.get("f", 0.0))),
        centre=(of["cx"], of["cy"]),
        k=tuple(of[key] for key in ("k1", "k2", "k3", "k4") if key in of),
        d=tuple(of[key] for key in ("d1", "d2", "d3") if key in of),
        p=(of.get("p1", 0.0), of.get("p2", 0.0)),
        fisheye=name.endswith("FISHEYE"),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Points3D:
    ids: IntArray  # (p,)
    position: FloatArray  # (p, 3)
    colour: IntArray  # (p, 3)
    error: FloatArray  # (p,) px


def _assembled(paths: list[Path], lenses: dict[int, PixelLens], every: list[_Image], points: _Points3D) -> Model:
    """Return the model of what files say. Raises `ModelError` where they contradict each other."""
    problems = [
        Problem(message=f"image {image.name}: there is no camera {image.camera}", file=str(paths[1]))
        for image in every
        if image.camera not in lenses
    ]
    counts = [len(image.point) for image in every]
    point = np.concatenate([np.zeros(0, dtype=np.int64), *(image.point for image in every)])
    pixel = np.concatenate([np.zeros((0, 2)), *(image.pixel for image in every)])
    photo, order = np.repeat(np.arange(len(every)), counts), np.argsort(points.ids)
    ids = points.ids[order]
    row = np.minimum(np.searchsorted(ids, point), max(len(ids) - 1, 0))
    known = ids[row] == point if len(ids) else np.zeros(len(point), dtype=bool)
    if not known.all():
        name, missing = every[photo[~known][0]].name, point[~known][0]
        message = f"image {name} names point {missing}, which is not in {paths[2].name}"
        problems.append(Problem(message=message, file=str(paths[1])))
    refused(problems)
    from scipy.spatial.transform import Rotation  # which other formats do without

    poses = np.array([image.pose for image in every]).reshape(-1, 7)
    R, turned = np.full((len(every), 3, 3), np.nan), np.isfinite(poses).all(axis=1) & poses[:, :4].any(axis=1)
    R[turned] = Rotation.from_quat(poses[turned][:, _SCALAR_LAST]).as_matrix()
    numbers = {camera: row for row, camera in enumerate(lenses)}
    model = Model(
        program="colmap",
        cameras=tuple(map(str, lenses)),
        lenses=tuple(lenses.values()),
        photos=np.array([image.name for image in every], dtype=np.str_),
        camera=np.array([numbers[image.camera] for image in every], dtype=np.int64),
        rotation=R,
        centre=-np.einsum("nji,nj->ni", R, poses[:, 4:]),
        points=points.ids.astype(np.str_),
        position=points.position,
        photo=photo,
        point=order[row] if len(order) else row,
        pixel=pixel,
        colour=points.colour,
        stored=points.error,
    )
    return checked(model, str(paths[1].parent))


def _rows(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a text file that are no comment, with their numbers; blank ones too."""
    with path.open(encoding="utf-8-sig", errors="surrogateescape") as file:
        for number, line in enumerate(file, 1):
            if not line.lstrip().startswith("#"):
                yield number, line


def _wrong(path: Path, line: int, text: str, expected: str) -> ModelError:
    return ModelError([Problem(file=str(path), line=line, found=text[:60].rstrip(), expected=expected)])


def _text_cameras(path: Path) -> Iterator[tuple[int, PixelLens]]:
    """Yield the cameras of cameras.txt by their ids."""
    for number, line in _rows(path):
        words = line.split()
        if not words:
            continue
        try:
            camera, width, height = (int(words[place]) for place in (0, 2, 3))
            values = [float(word) for word in words[4:]]
        except (ValueError, IndexError):
            raise _wrong(path, number, line, "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]") from None
        yield camera, _lens(path, number, words[1], (width, height), values)


def _text_images(path: Path) -> Iterator[_Image]:
    """Yield the images of images.txt: two lines each, the second of which may be empty."""
    rows = _rows(path)
    for number, line in rows:
        if not line.strip():
            continue
        words = line.split(maxsplit=9)
        try:
            pose, camera, name = [float(word) for word in words[1:8]], int(words[8]), words[9].strip()
        except (ValueError, IndexError):
            raise _wrong(path, number, line, "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME") from None
        number, line = next(rows, (number, ""))
        try:
            features = np.array(line.split(), dtype=float).reshape(-1, 3)
            if not (np.abs(features) < FAR).all():
                raise ValueError
        except ValueError:
            raise _wrong(path, number, line, "POINTS2D[] as X Y POINT3D_ID") from None
        features = features[features[:, 2] >= 0.0]
        point = features[:, 2].astype(np.int64)
        yield _Image(name=name, camera=camera, pose=pose, pixel=features[:, :2], point=point)


def _text_points(path: Path) -> _Points3D:
    """Return the points of points3D.txt."""
    table: list[list[float]] = []
    for number, line in _rows(path):
        words = line.split(maxsplit=8)[:8]
        if not words:
            continue
        try:
            table.append([float(word) for word in words])
            if len(words) < 8 or not all(abs(value) < FAR for value in table[-1]):
                raise ValueError
        except ValueError:
            raise _wrong(path, number, line, "POINT3D_ID X Y Z R G B ERROR TRACK[]") from None
    values = np.array(table).reshape(-1, 8)
    ids, colour = values[:, 0].astype(np.int64), values[:, 4:7].astype(np.int64)
    return _Points3D(ids=ids, position=values[:, 1:4], colour=colour, error=values[:, 7])


@dataclass
class _Bytes:
    """A binary file that is read from its beginning."""

    path: Path
    data: bytes
    at: int = 0

    @classmethod
    def of(cls, path: Path, smallest: int) -> tuple[_Bytes, int]:
        """Return a file behind its count, and that count of things of `smallest` bytes at least."""
        file = cls(path=path, data=path.read_bytes())
        count = int(file.take(_COUNT)[0])
        if count * smallest > len(file.data):
            message = f"it says that it has {count} entries, which do not go into {len(file.data)} bytes"
            raise ModelError.of(message, path)
        return file, count

    def take(self, form: struct.Struct) -> tuple[float, ...]:
        """Return the next values. Raises `ModelError` at the end of the file."""
        self.need(form.size)
        values = form.unpack_from(self.data, self.at)
        self.at += form.size
        return values

    def need(self, size: int) -> None:
        """Raise `ModelError` where the file has less than `size` bytes left."""
        if self.at + size > len(self.data):
            raise ModelError.of(f"the file ends at byte {len(self.data)}, in the middle of an entry", self.path)


def _binary_cameras(path: Path) -> Iterator[tuple[int, PixelLens]]:
    """Yield the cameras of cameras.bin by their ids."""
    file, count = _Bytes.of(path, 24)
    for _ in range(count):
        camera, model, width, height = map(int, file.take(_CAMERA))
        name, parameters = LENSES[model] if 0 <= model < len(LENSES) else (f"number {model}", None)
        values = file.take(struct.Struct(f"<{len(parameters or ())}d"))
        yield camera, _lens(path, None, name, (width, height), values)


def _binary_images(path: Path) -> Iterator[_Image]:
    """Yield the images of images.bin."""
    file, count = _Bytes.of(path, _IMAGE.size + 9)
    for _ in range(count):
        _, *pose, camera = file.take(_IMAGE)
        end = file.data.find(b"\0", file.at)
        file.need(end + 1 - file.at if end >= 0 else len(file.data))
        name = file.data[file.at : end].decode("utf-8", "surrogateescape")
        file.at = end + 1
        features = int(file.take(_COUNT)[0])
        file.need(features * _FEATURE.itemsize)
        rows = np.frombuffer(file.data, _FEATURE, features, file.at)
        rows = rows[rows["point"] >= 0]
        file.at += features * _FEATURE.itemsize
        yield _Image(name=name, camera=int(camera), pose=pose, pixel=rows["xy"], point=rows["point"])


def _binary_points(path: Path) -> _Points3D:
    """Return the points of points3D.bin, each of which has a track of another length behind it."""
    file, count = _Bytes.of(path, _POINT.itemsize)
    length, places = _COUNT.unpack_from, list[int]()
    at, last = file.at, len(file.data) - _POINT.itemsize
    while len(places) < count and at <= last:
        places.append(at)
        at += _POINT.itemsize + 8 * length(file.data, at + _TRACK)[0]
    file.at = at
    file.need(_POINT.itemsize * (count - len(places)))
    entries = np.lib.stride_tricks.sliding_window_view(np.frombuffer(file.data, np.uint8), _POINT.itemsize)
    rows = entries[places].view(_POINT)[:, 0] if count else np.zeros(0, _POINT)
    return _Points3D(
        ids=rows["id"].astype(np.int64),
        position=rows["xyz"].copy(),
        colour=rows["colour"].astype(np.int64),
        error=rows["error"].copy(),
    )
