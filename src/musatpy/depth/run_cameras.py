"""The adjusted stations of a run as those of a correction: from the JSON record that `musat run` leaves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from musatpy.depth.cameras import Cameras
from musatpy.errors import DepthError, Problem, RecordError
from musatpy.geometry.rotations import attitude_matrix
from musatpy.json_files import read_record
from musatpy.model import CoordinateSystem
from musatpy.refraction.apparent import Stations

SUFFIX = ".json"
NEEDS = {
    "program": ("name",),
    "solution": ("converged",),
    "options": ("system",),
    "stated": (),
    "cameras": ("camera", "focal_length", "format_size"),
    "stations": ("photo", "camera", "position", "attitude"),
    "adjusted_water": ("tide", "tilt", "index"),
}


def read_run(
    path: Path, *, camera: tuple[float, float, float] | None = None, limit: float | None = None
) -> Cameras:
    """Return the adjusted stations of a run, with tides, attitudes, cameras and index of water.

    `camera` (focal length, width, height) where a camera has no format. Raises `DepthError` for a file that is no
    record, and for a run whose stations do not stand in one rectangular system with Z up; `OSError`.
    """
    try:
        record = read_record(path, NEEDS)
    except RecordError as error:
        raise DepthError(error.problems) from error
    try:
        problems = _faults(record)
        if not problems:
            return _cameras(record, camera, limit)
    except (KeyError, TypeError, IndexError) as error:  # tables or numbers that every record has are not there
        problems = [f"is not the record of a run: {type(error).__name__} {error}"]
    except ValueError as error:  # of the stations
        problems = [str(error)]
    raise DepthError([Problem(file=str(path), message=message) for message in problems])


def _faults(record: Any) -> list[str]:
    """Return why the stations of a record cannot be used."""
    faults = []
    if record["program"]["name"] != "musatpy":
        faults.append("is not the record of a run")
    if not record["solution"]["converged"]:
        faults.append("the run has not converged")
    if record["options"]["system"] != CoordinateSystem.LOCAL or record["stated"] is not None:
        faults.append("its stations are not in local rectangular coordinates (LOCL): give them as a CSV file")
    if any(record["adjusted_water"]["tilt"]):
        faults.append("the water of the run is tilted; here it is level")
    if None in record["adjusted_water"]["tide"]:
        faults.append("a photo has no tide")
    return faults


def _cameras(record: Any, camera: tuple[float, float, float] | None, limit: float | None) -> Cameras:
    photos, water = record["stations"], record["adjusted_water"]
    kinds = {one["camera"]: [one["focal_length"], *one["format_size"]] for one in record["cameras"]}
    formats = np.array([kinds[photo["camera"]] for photo in photos], dtype=float)
    known = np.isfinite(formats).all()
    if not known and camera is not None:
        formats = np.where(np.isfinite(formats), formats, camera)
    rotation = attitude_matrix(np.array([photo["attitude"] for photo in photos], dtype=float))
    stations = Stations(
        position=np.array([photo["position"] for photo in photos], dtype=float),
        level=np.array(water["tide"], dtype=float),
        axis=-rotation[:, 2],
    )
    return Cameras(
        names=tuple(str(photo["photo"]) for photo in photos),
        stations=stations,
        rotation=rotation,
        camera=formats if known or camera is not None else None,
        limit=limit,
        index=water["index"],
    )
