"""The adjusted stations of a run as those of a correction: from the JSON record that `musat run` leaves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from musatpy.depth.cameras import CameraStations
from musatpy.depth.point_positions import Tilt
from musatpy.errors import DepthError, Problem, SystemsError
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.geodesy import middle_of
from musatpy.geometry.systems import System, geographic
from musatpy.model import Initial
from musatpy.records.json_files import read_record
from musatpy.records.run_tables import (
    STATIONS,
    cameras_of,
    job_system,
    level_positions,
    photos_of,
    water_fault,
)
from musatpy.records.tables import Tables, numbers
from musatpy.refraction.apparent import Stations

SUFFIX = ".json"


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
    and levels are minus infinity; with `waves` the caller knows what to do with them. Raises `RecordError` for what
    is no record, `DepthError` for a run whose water is not known or has waves, or whose system cannot be had again
    (a geoid model that is not there); `OSError`.
    """
    tables = read_record(path, ("program", "solution", *STATIONS))
    problems = [] if tables["solution"]["converged"] else ["the run has not converged"]
    problems += _water_faults(tables, waves) if water else []
    try:
        if not problems:
            return replace(_cameras(tables, camera, water), limit=limit)
    except (ValueError, SystemsError) as error:  # of the stations, and of the system
        problems = [str(error)]
    raise DepthError([Problem(file=str(path), message=message) for message in problems])


def _water_faults(tables: Tables, waves: bool) -> list[str]:
    """Return why the water of a record cannot be used."""
    faults, water = [], tables["adjusted_water"]
    if water is None:
        return ["the run knows no water"]
    if fault := water_fault(tables):
        faults.append(fault)
    if any(water["tilt"]) and tables["options"]["initial"] != Initial.GIVEN:
        faults.append("the water of the run is tilted, about a place that is known where stations are given")
    if tables["waves"]["wave"] and not waves:
        faults.append("the water of the run has waves, here it is still: give its stations as a CSV file")
    photos = tables["stations"]["photo"]
    dry = [photo for photo, tide in zip(photos, water["tide"], strict=True) if tide is None]
    if dry:
        faults.append(f"no tide of photo {', '.join(dry)}")
    return faults


def _cameras(tables: Tables, camera: tuple[float, float, float] | None, with_water: bool) -> CameraStations:
    photos, cameras, system = photos_of(tables), cameras_of(tables), job_system(tables)
    formats = np.column_stack([cameras.focal_length, cameras.format_size])[photos.camera]
    known = np.isfinite(formats).all()
    if not known and camera is not None:
        formats = np.where(np.isfinite(formats), formats, camera)
    rotation = attitude_matrix(photos.attitude)
    level = level_positions(tables, photos.position)
    axes = None if system.ellipsoid is None else system.ellipsoid.frame(level)
    seen_from = Stations(
        position=level if system.ellipsoid is None else system.ellipsoid.geocentric(level),
        level=photos.tide if with_water else np.full(len(formats), -np.inf),
        axis=-rotation[:, 2] if axes is None else -np.einsum("ki,kij->kj", rotation[:, 2], axes),
        height=level[:, 2],
    )
    water = tables["adjusted_water"] if with_water else None
    return CameraStations(
        names=tuple(photos.ids.tolist()),
        stations=seen_from,
        rotation=rotation,
        camera=formats if known or camera is not None else None,
        index=None if water is None else water["index"],
        axes=axes,
        system=system,
        tilt=_tilt(tables, system) if water is not None and any(water["tilt"]) else None,
    )


def _tilt(tables: Tables, system: System) -> Tilt:
    """Return the tilt of the water: slopes east and north in the middle of the stations as given."""
    given = level_positions(tables, numbers(tables["stations"], "given_position", 3))
    if system.ellipsoid is None:
        pivot = middle_of(given)
        axes = np.eye(3)
    else:
        pivot = middle_of(system.ellipsoid.geocentric(given))
        axes = system.ellipsoid.frame(geographic(system.ellipsoid, pivot))
    return Tilt(slope=np.array(tables["adjusted_water"]["tilt"], dtype=float) @ axes[:2], pivot=pivot)
