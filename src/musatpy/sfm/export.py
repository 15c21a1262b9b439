"""The adjusted stations and lenses of a run as a model again, for dense matching in COLMAP or Metashape."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from musatpy.arrays import FloatArray, rows_of
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.model import ObservationKind
from musatpy.records import run_tables
from musatpy.records.json_files import read_record
from musatpy.records.tables import Tables, flags, numbers, texts
from musatpy.reduction.pixel_lens import CorrectedLens, PixelLens
from musatpy.sfm.block import TURN
from musatpy.sfm.model import Model, ModelError
from musatpy.sfm.source import FileCameras, cameras_of_job

TABLES = (*run_tables.BLOCK, "bathymetric_points")


def read_run(path: Path, names: Sequence[str]) -> Tables:
    """Return tables of the record of a run. Raises `RecordError`, and `ModelError` where it has not converged."""
    tables = read_record(path, ("solution", *names))
    if not tables["solution"]["converged"]:
        raise ModelError.of("the run has not converged", path)
    return tables


def adjusted_lenses(tables: Tables, cameras: FileCameras) -> tuple[PixelLens, ...]:
    """Return the lenses of a run, as adjusted, those that were held as the file has them."""
    table = tables["adjusted_parameters"]
    lens = texts(table, "kind") == ObservationKind.LENS.label
    owner, name = texts(table, "of")[lens], texts(table, "parameter")[lens]
    value = numbers(table, "adjusted")[lens]
    lenses = []
    for number, camera in enumerate(texts(tables["cameras"], "camera").tolist()):
        of = owner == camera
        lenses.append(cameras.adjusted(number, dict(zip(name[of].tolist(), value[of].tolist(), strict=True))))
    return tuple(lenses)


def model_of_run(run: Path, job: Path, *, apparent: bool = False) -> Model:
    """Return `adjusted_model` of the record of a run of a job. Raises `RecordError`, `DeckError`, `ModelError`."""
    return adjusted_model(read_run(run, TABLES), cameras_of_job(job), apparent=apparent)


def adjusted_model(tables: Tables, cameras: FileCameras, *, apparent: bool = False) -> Model:
    """Return the model of a run in the gauge of its file: stations, lenses, points and their images.

    Submerged points stand where they are, or where straight rays of the new cameras meet: `apparent`, with which a
    matcher that knows of no water must agree. Raises `ModelError` where the run is not of these cameras.
    """
    photos = run_tables.photos_of(tables)
    placement, notes, lenses = cameras.placement, list[str](), list[PixelLens]()
    if not np.isin(photos.ids, cameras.photos).any():
        raise ModelError.of("none of the photos of the run is one of the cameras of the job")
    axes = placement.axes(photos.position)
    for row, lens in enumerate(adjusted_lenses(tables, cameras)):
        if isinstance(lens, CorrectedLens):
            lens, miss = cameras.fitted(row, lens)
            notes.append(
                f"camera {row + 1}: the lens that is written misses the adjusted one by up to {miss:.3f} px"
            )
        lenses.append(lens)
    M = attitude_matrix(photos.attitude) @ axes
    points, ids = tables["points"], texts(tables["points"], "point")
    position = _metres(cameras, numbers(points, "position", 3))
    if apparent:
        wet = tables["bathymetric_points"]
        position[rows_of(ids, texts(wet, "point"))] = numbers(wet, "no_refraction", 3)
    known = np.flatnonzero(np.isfinite(position).all(axis=1))
    number = np.full(len(ids), -1)
    number[known] = np.arange(len(known))
    plates = tables["plates"]
    photo, point = rows_of(photos.ids, texts(plates, "photo")), number[rows_of(ids, texts(plates, "point"))]
    used = np.flatnonzero((point >= 0) & flags(plates, "triangulated"))
    pixel, camera = numbers(plates, "xy", 2)[used], photos.camera[photo[used]]
    for row in range(len(cameras.lenses)):
        of = camera == row
        pixel[of] = cameras.pixels_of(row, pixel[of])
    return Model(
        program=cameras.program,
        cameras=tuple(texts(tables["cameras"], "camera").tolist()),
        lenses=tuple(lenses),
        photos=photos.ids,
        camera=photos.camera,
        rotation=TURN @ M @ placement.rotation,
        centre=_in_gauge(cameras, _metres(cameras, photos.position)),
        points=ids[known],
        position=_in_gauge(cameras, position[known]),
        photo=photo[used],
        point=point[used],
        pixel=pixel,
        to_geocentric=_matrix(cameras),
        notes=tuple(notes),
    )


def _metres(cameras: FileCameras, position: FloatArray) -> FloatArray:
    """Return geocentric, or local, metres (n, 3) of positions as a block has them; NaN stays."""
    ellipsoid = cameras.placement.ellipsoid
    return position if ellipsoid is None else ellipsoid.geocentric(position)


def _in_gauge(cameras: FileCameras, metres: FloatArray) -> FloatArray:
    """Return the coordinates (n, 3) in the model of geocentric, or local, metres."""
    placement = cameras.placement
    return (metres - placement.shift) @ placement.rotation / placement.scale


def _matrix(cameras: FileCameras) -> FloatArray | None:
    placement = cameras.placement
    if placement.ellipsoid is None:
        return None
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = placement.scale * placement.rotation, placement.shift
    return out


def write_cameras(model: Model, path: Path) -> None:
    """Write stations and lenses as cameras.xml of Metashape. Raises `ModelError` for a lens that it lacks."""
    document = Element("document", version="2.0.0")
    chunk = SubElement(document, "chunk", label="musatpy", enabled="true")
    sensors = SubElement(chunk, "sensors", next_id=str(len(model.lenses)))
    for number, (name, lens) in enumerate(zip(model.cameras, model.lenses, strict=True)):
        if any(lens.d):
            raise ModelError.of(f"camera {name}: Metashape has no lens with a denominator")
        _add_sensor(sensors, number, name, lens)
    cameras = SubElement(chunk, "cameras", next_id=str(len(model.photos)), next_group_id="0")
    for number, name in enumerate(model.photos.tolist()):
        camera = SubElement(cameras, "camera", id=str(number), sensor_id=str(model.camera[number]), label=name)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = model.rotation[number].T, model.centre[number]
        _add(camera, "transform", matrix)
    if model.to_geocentric is not None:
        linear = model.to_geocentric[:3, :3]
        scale = float(np.cbrt(np.linalg.det(linear)))
        transform = SubElement(chunk, "transform")
        _add(transform, "rotation", linear / scale)
        _add(transform, "translation", model.to_geocentric[:3, 3])
        _add(transform, "scale", scale)
    ElementTree.indent(document)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(ElementTree.tostring(document, encoding="utf-8", xml_declaration=True))


def _add_sensor(sensors: Element, number: int, name: str, lens: PixelLens) -> None:
    kind = "fisheye" if lens.fisheye else "frame"
    sensor = SubElement(sensors, "sensor", id=str(number), label=name, type=kind)
    size = {"width": str(lens.width), "height": str(lens.height)}
    SubElement(sensor, "resolution", size)
    of = SubElement(sensor, "calibration", {"type": kind, "class": "adjusted"})
    SubElement(of, "resolution", size)
    (fx, fy), (cx, cy), (p1, p2) = lens.focal, lens.centre, lens.p
    values = {"f": fy, "cx": cx - 0.5 * lens.width, "cy": cy - 0.5 * lens.height, "b1": fx - fy, "b2": lens.shear}
    values |= {f"k{row}": value for row, value in enumerate(lens.k, 1)} | {"p1": p2, "p2": p1}
    for tag, value in values.items():
        _add(of, tag, value)


def _add(parent: Element, tag: str, values: Any) -> None:
    SubElement(parent, tag).text = " ".join(repr(value) for value in np.ravel(values).tolist())
