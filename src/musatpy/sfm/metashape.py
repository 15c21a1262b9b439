"""Cameras of Agisoft Metashape, cameras.xml: stations and lenses. Images are read by `bingo`.

A camera is a matrix from its axes to the chunk; the component's (versions 2) or the chunk's rotation, translation
and scale lead on to geocentric metres. Pixels count from the corner, cx and cy from the middle; p1 and p2 stand the
other way round than in OpenCV; B1 adds to the focal length along x, B2 is the shear.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import Problem
from musatpy.pointfiles.columns import number
from musatpy.reduction.pixel_lens import PixelLens
from musatpy.sfm.model import LOCAL, NO_TURN, Model, ModelError, checked, chosen_component, refused

_K = ("k1", "k2", "k3", "k4")
_NO = ("false", "0")  # of enabled
_NO_SHIFT = re.compile(r",\s*TOWGS84\[[0.,\s]*\]", re.IGNORECASE)  # of zeros, which shift nothing
_DECLARED = re.compile(rb"<!(DOCTYPE|ENTITY)")


def read_model(path: Path, component: int = 0) -> Model:
    """Return the stations and lenses of a file, without points and images.

    `component` counts from 1; 0: the only one. Photos that are disabled or not aligned are left out, and said.
    Raises `ModelError` with file and item.
    """
    chunk = chunk_of(path)
    lenses = dict(_lenses(path, chunk))
    sizes = {str(sensor.get("id")): _nominal(sensor)[:2] for sensor in chunk.iterfind("./sensors/sensor")}
    every = chunk.findall("./cameras//camera")
    absent = Counter(map(_absence, every))
    aligned = [camera for camera in every if not _absence(camera)]
    chosen, transform = _component(path, chunk, aligned, component)
    wrong, placed = dict[str, None](), []
    for camera in chosen:
        name, sensor, matrix = (
            camera.get("label", ""),
            camera.get("sensor_id"),
            _matrix(camera.findtext("transform"), 4),
        )
        if matrix is None or not np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=NO_TURN):
            wrong[f"camera {name}: its transform is no rotation and place"] = None
        elif sensor not in lenses:
            wrong[f"sensor {sensor} has no calibration as frame or fisheye"] = None
        elif np.isinf(reference := _reference(camera)).any():
            wrong[f"camera {name}: its reference is not three numbers"] = None
        else:
            placed.append((name, list(lenses).index(sensor), matrix, reference))
    refused([Problem(message=message, file=str(path)) for message in wrong])
    matrices = np.array([matrix for _, _, matrix, _ in placed]).reshape(-1, 4, 4)
    system = stated_system(chunk.findtext("reference"))
    model = Model(
        program="metashape",
        cameras=tuple(lenses),
        lenses=tuple(lenses.values()),
        photos=np.array([name for name, *_ in placed], dtype=np.str_),
        camera=np.array([row for _, row, _, _ in placed], dtype=np.int64),
        rotation=np.swapaxes(matrices[:, :3, :3], 1, 2),
        centre=matrices[:, :3, 3],
        points=np.zeros(0, dtype=np.str_),
        position=np.zeros((0, 3)),
        photo=np.zeros(0, dtype=np.int64),
        point=np.zeros(0, dtype=np.int64),
        pixel=np.zeros((0, 2)),
        pixel_size=np.array([sizes[name] for name in lenses]).reshape(-1, 2),
        initial=tuple(lens for _, lens in _lenses(path, chunk, initial=True)),
        to_geocentric=None if system == LOCAL else transform,
        reference=np.array([reference for *_, reference in placed]).reshape(-1, 3),
        reference_system=system,
        notes=(
            *(f"{absent[what]} of {len(every)} photos {what}: they are left out" for what in absent if what),
            *(
                f"sensor {sensor.get('label')} has a rolling shutter: what it moves within a photo is not corrected"
                for sensor in chunk.iterfind("./sensors/sensor")
                if sensor.find("./property[@name='rolling_shutter'][@value='true']") is not None
            ),
        ),
    )
    return checked(model, str(path))


def _absence(camera: Element) -> str:
    """Return why a camera is left out, empty where it is not."""
    if camera.get("enabled") in _NO:
        return "are disabled"
    if camera.find("transform") is None:
        return "are not aligned" if camera.get("master_id") is None else "follow the master of a rig"
    return ""


def chunk_of(path: Path) -> Element:
    """Return the chunk of a file. Raises `ModelError`."""
    try:
        data = path.read_bytes()
        if _DECLARED.search(data.replace(b"\0", b"")):  # in UTF-16 too
            raise ModelError.of("it declares a document type or entities, which no file of Metashape does", path)
        chunks = list(ElementTree.fromstring(data).iter("chunk"))
    except (OSError, ElementTree.ParseError) as error:
        raise ModelError.of(f"it cannot be read: {error}", path) from None
    if len(chunks) != 1:
        message = f"it has {len(chunks) or 'no'} chunk{'s' * (len(chunks) > 1)}: an export of cameras has one"
        raise ModelError.of(message, path)
    return chunks[0]


def stated_system(wkt: str | None) -> str:
    """Return the system of a reference, `local` for local coordinates, empty where none is stated."""
    return LOCAL if (wkt or "").lstrip().startswith("LOCAL_CS") else _NO_SHIFT.sub("", (wkt or "").strip())


def _nominal(sensor: Element) -> FloatArray:
    """Return width and height of a pixel and the focal length (3,) mm, NaN where they are not stated."""
    stated = {of.get("name"): number(of.get("value", "")) for of in sensor.iterfind("property")}
    values = np.array([stated.get(key, np.nan) for key in ("pixel_width", "pixel_height", "focal_length")])
    return np.where(values > 0.0, values, np.nan)


def _lenses(path: Path, chunk: Element, initial: bool = False) -> Iterator[tuple[str, PixelLens]]:
    """Yield the adjusted, else the initial calibration of each sensor that is a frame camera.

    Or the `initial` one, else that of its nominal focal length, which Metashape begins with.
    """
    for sensor in chunk.iterfind("./sensors/sensor"):
        every = [part for part in sensor.iterfind("calibration") if part.get("type") in ("frame", "fisheye")]
        size = sensor.find(".//resolution")  # its own, else that of its calibration
        if not every or size is None:
            continue
        of = min(every, key=lambda part: (part.get("class") == "adjusted") == initial)
        name = sensor.get("label", sensor.get("id", ""))
        try:
            width, height = (int(size.get(side, "")) for side in ("width", "height"))
            f, cx, cy, p1, p2, b1, b2, *k = (
                float(of.findtext(key) or 0.0) for key in ("f", "cx", "cy", "p1", "p2", "b1", "b2", *_K)
            )
            unread = [key for key in ("p3", "p4") if float(of.findtext(key) or 0.0)]
        except ValueError as error:
            raise ModelError.of(f"sensor {name}: {error}", path) from None
        if unread:
            message = f"sensor {name} has {' and '.join(unread)}, which is not read: calibrate it without"
            raise ModelError.of(message, path)
        w, h, nominal = _nominal(sensor).tolist()
        if initial and of.get("class") == "adjusted" and np.isfinite(nominal / w / h):
            f, b1, cx, cy, p1, p2, b2, *k = nominal / h, nominal / w - nominal / h, *(0.0,) * 9
        if not (min(f, f + b1, width, height) > 0.0 and np.isfinite([f, cx, cy, p1, p2, b1, b2, *k]).all()):
            message = f"sensor {name} has no size, no focal length above zero, or what is no number"
            raise ModelError.of(message, path)
        if of.get("type") == "fisheye" and (p1 or p2):
            message = (
                f"sensor {name} is a fisheye lens with p1 and p2, which is not read: calibrate it without them"
            )
            raise ModelError.of(message, path)
        yield (
            str(sensor.get("id")),
            PixelLens(
                width=width,
                height=height,
                focal=(f + b1, f),
                centre=(0.5 * width + cx, 0.5 * height + cy),
                shear=b2,
                k=tuple(k),
                p=(p2, p1),
                fisheye=of.get("type") == "fisheye",
            ),
        )


def _component(
    path: Path, chunk: Element, aligned: list[Element], component: int
) -> tuple[list[Element], FloatArray | None]:
    """Return the cameras of one component, and its matrix (4, 4) to geocentric metres, None without one."""
    components = chunk.findall("./components/component")
    sizes = [sum(camera.get("component_id") == part.get("id") for camera in aligned) for part in components]
    row = chosen_component(sizes or [len(aligned)], component, str(path))
    if not components:
        return aligned, _to_geocentric(chunk.find("transform"))
    part = components[row]
    chosen = [camera for camera in aligned if camera.get("component_id", part.get("id")) == part.get("id")]
    of_component = part.find("transform")
    return chosen, _to_geocentric(chunk.find("transform") if of_component is None else of_component)


def _to_geocentric(transform: Element | None) -> FloatArray | None:
    """Return the matrix (4, 4) of a rotation, translation and scale, None where one is missing."""
    if transform is None:
        return None
    rotation, translation = _matrix(transform.findtext("rotation"), 3), transform.findtext("translation")
    try:
        scale = float(transform.findtext("scale") or "nan")
        shift = [float(word) for word in (translation or "").split()]
    except ValueError:
        return None
    if rotation is None or len(shift) != 3 or not scale > 0.0:
        return None
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = scale * rotation, shift
    return out


def _matrix(text: str | None, size: int) -> FloatArray | None:
    """Return a square matrix, None where the text is none."""
    try:
        values = np.array((text or "").split(), dtype=float)
    except ValueError:
        return None
    good = values.size == size * size and np.isfinite(values).all()
    return values.reshape(size, size) if good else None


def _reference(camera: Element) -> list[float]:
    """Return the reference position of a camera, NaN where it has none, infinite where it is no number."""
    reference = camera.find("reference")
    if reference is None or reference.get("enabled") in _NO or not {*"xyz"} <= reference.attrib.keys():
        return [np.nan] * 3
    place = [number(reference.attrib[axis]) for axis in "xyz"]
    return [np.inf if np.isnan(value) else value for value in place]
