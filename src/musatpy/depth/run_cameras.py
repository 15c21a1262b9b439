"""The adjusted stations of a run as those of a correction: from the JSON record that `musat run` leaves.

Of any job: in a record stations are latitude, longitude and ellipsoidal height, geocentric or local, whatever
system the deck and its answer are stated in, and tides are heights above the ellipsoid, or Z.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from musatpy import json_files
from musatpy.arrays import FloatArray
from musatpy.depth.cameras import CameraStations
from musatpy.depth.point_positions import Tilt
from musatpy.errors import DepthError, Problem, RecordError, SystemsError
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.crs import LongitudeLatitude
from musatpy.geometry.geodesy import middle_of
from musatpy.geometry.systems import Geographic, System, geographic
from musatpy.json_files import Needs
from musatpy.model import CoordinateSystem, EllipsoidSpec, Initial, SystemSpec
from musatpy.model.water import index_fault
from musatpy.refraction.apparent import Stations
from musatpy.systems import statement_on
from musatpy.systems.statement import ellipsoid_by

SUFFIX = ".json"
_NEEDS = {
    "program": ("name",),
    "solution": ("converged",),
    "options": ("system", "initial"),
    "cameras": ("camera", "focal_length", "format_size"),
    "stations": ("photo", "camera", "position", "attitude", "given_position"),
}
_WATER = {"adjusted_water": ("tide", "tilt", "index"), "waves": ("wave",)}


def read_run(
    path: Path,
    *,
    camera: tuple[float, float, float] | None = None,
    limit: float | None = None,
    water: bool = True,
    waves: bool = False,
) -> CameraStations:
    """Return the adjusted stations of a run, with tides, attitudes, cameras, index and tilt of water.

    `camera` (focal length, width, height) where a camera has no format. Without `water` nothing of it is asked for,
    and levels are minus infinity; with `waves` the caller knows what to do with them. Raises `DepthError` for what
    is no record, and for a run whose water is not known or has waves, or whose system cannot be had again (a
    geoid model that is not there); `OSError`.
    """
    record = read_record(path, _NEEDS | (_WATER if water else {}))
    try:
        problems = [] if record["solution"]["converged"] else ["the run has not converged"]
        problems += _water_faults(record, waves) if water else []
        if not problems:
            return replace(_cameras(record, camera, water), limit=limit)
    except (KeyError, TypeError, IndexError) as error:  # tables or numbers that every record has are not there
        problems = [f"is not the record of a run: {type(error).__name__} {error}"]
    except (ValueError, SystemsError) as error:  # of the stations, and of the system
        problems = [str(error)]
    raise DepthError([Problem(file=str(path), message=message) for message in problems])


def read_record(path: Path, needs: Needs) -> dict[str, Any]:
    """Return the record of a run, what is needed of it as its schema says.

    With what tells its system. Raises `DepthError` where it is none, and `OSError`.
    """
    try:
        return json_files.read_record(path, needs, {"stated": ("answer",), "ellipsoid": (), "water": ("index",)})
    except RecordError as error:
        raise DepthError(error.problems) from error


def job_system(record: Any) -> System:
    """Return the system in which a job gives its points: that of its answer; longitude and latitude in degrees.

    Raises `SystemsError` where it cannot be had again.
    """
    kind = record["options"]["system"]
    answer = {"kind": kind} if record.get("stated") is None else record["stated"]["answer"]
    spec = SystemSpec(
        kind=answer["kind"],
        definition=answer.get("definition") or "",
        geoid=answer.get("geoid") or "",
        origin=_three(answer.get("origin")),
        false=_three(answer.get("false_origin")),
    )
    system = statement_on(spec, _ellipsoid_spec(record)).system
    return LongitudeLatitude(system.ellipsoid) if isinstance(system, Geographic) else system


def level_positions(record: Any, positions: FloatArray) -> FloatArray:
    """Return positions (n, 3) of a record as latitude, longitude (rad) and height (m); of a local job X, Y, Z.

    Raises `SystemsError` where the ellipsoid of the job is unknown.
    """
    if record["options"]["system"] != CoordinateSystem.GEOCENTRIC:
        return positions
    return geographic(ellipsoid_by(_ellipsoid_spec(record), CoordinateSystem.GEOCENTRIC), positions)


def _ellipsoid_spec(record: Any) -> EllipsoidSpec | None:
    given = record.get("ellipsoid")
    return None if given is None else EllipsoidSpec(**{**given, "name": given["name"] or ""})


def _three(values: list[float] | None) -> tuple[float, float, float] | None:
    return None if values is None else (values[0], values[1], values[2])


def _water_faults(record: Any, waves: bool) -> list[str]:
    """Return why the water of a record cannot be used."""
    faults, water = [], record["adjusted_water"]
    if water is None:
        return ["the run knows no water"]
    if fault := index_fault(water["index"], (record.get("water") or {}).get("liquid", "")):
        faults.append(f"{fault} on the card of its deck")
    if any(water["tilt"]) and record["options"]["initial"] != Initial.GIVEN:
        faults.append("the water of the run is tilted, about a place that is known where stations are given")
    if record["waves"]["wave"] and not waves:
        faults.append("the water of the run has waves, here it is still: give its stations as a CSV file")
    photos = record["stations"]["photo"]
    dry = [photo for photo, tide in zip(photos, water["tide"], strict=True) if tide is None]
    if dry:
        faults.append(f"no tide of photo {', '.join(dry)}")
    return faults


def _cameras(record: Any, camera: tuple[float, float, float] | None, with_water: bool) -> CameraStations:
    stations, water = record["stations"], record["adjusted_water"] if with_water else None
    columns = [record["cameras"][name] for name in ("camera", "focal_length", "format_size")]
    kinds = {camera: [focal_length, *size] for camera, focal_length, size in zip(*columns, strict=True)}
    formats = np.array([kinds[camera] for camera in stations["camera"]], dtype=float)
    known = np.isfinite(formats).all()
    if not known and camera is not None:
        formats = np.where(np.isfinite(formats), formats, camera)
    rotation = attitude_matrix(np.array(stations["attitude"], dtype=float))
    system = job_system(record)
    level = level_positions(record, np.array(stations["position"], dtype=float))
    axes = None if system.ellipsoid is None else system.ellipsoid.frame(level)
    seen_from = Stations(
        position=level if system.ellipsoid is None else system.ellipsoid.geocentric(level),
        level=np.full(len(formats), -np.inf) if water is None else np.array(water["tide"], dtype=float),
        axis=-rotation[:, 2] if axes is None else -np.einsum("ki,kij->kj", rotation[:, 2], axes),
        height=level[:, 2],
    )
    return CameraStations(
        names=tuple(stations["photo"]),
        stations=seen_from,
        rotation=rotation,
        camera=formats if known or camera is not None else None,
        index=None if water is None else water["index"],
        axes=axes,
        system=system,
        tilt=_tilt(record, system) if water is not None and any(water["tilt"]) else None,
    )


def _tilt(record: Any, system: System) -> Tilt:
    """Return the tilt of the water: slopes east and north in the middle of the stations as given."""
    given = level_positions(record, np.array(record["stations"]["given_position"], dtype=float))
    if system.ellipsoid is None:
        pivot = middle_of(given)
        axes = np.eye(3)
    else:
        pivot = middle_of(system.ellipsoid.geocentric(given))
        axes = system.ellipsoid.frame(geographic(system.ellipsoid, pivot))
    return Tilt(slope=np.array(record["adjusted_water"]["tilt"], dtype=float) @ axes[:2], pivot=pivot)
