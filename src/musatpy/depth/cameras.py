"""Exposure stations of a file or of a run, which of their cameras sees a point, and the system that points are in.

A file is the record that `musat run` leaves, or a table with columns `name,x,y,z`, or bare lines of these four,
and as far as they are known `tide` (height of the water), `omega,phi,kappa` (degrees), `focal,width,height` (mm) of
the camera, the sigmas of place and attitude `sigma_x,sigma_y,sigma_z,sigma_omega,sigma_phi,sigma_kappa`, and
`sigma_tide`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import DepthError, Problem, SystemsError
from musatpy.geometry.body import BodyAngles, body_matrix
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.crs import own_ellipsoid, system_of
from musatpy.geometry.geodesy import middle_of
from musatpy.geometry.systems import LocalRectangular, System, geographic
from musatpy.model import Initial
from musatpy.pointfiles.columns import ABOVE_ZERO, AXES, FileColumn, Wanted, place_columns
from musatpy.pointfiles.las_files import SUFFIXES, crs_definition
from musatpy.pointfiles.point_tables import read_table
from musatpy.records import run_tables
from musatpy.records.json_files import read_record
from musatpy.records.tables import Tables, numbers
from musatpy.refraction.apparent import Stations
from musatpy.units import DEGREE

LOCAL = LocalRectangular()
RECORD = ".json"  # suffix of the record of a run
_ATTITUDE, _CAMERA = ("omega", "phi", "kappa"), ("focal", "width", "height")
# as Metashape has them: all zero where a photo looks down with its top to the north
_FLOWN = ("roll", "pitch", "yaw")
_PHOTO = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # of a body: its top forward, right, up
_SIGMAS = tuple(f"sigma_{name}" for name in (*AXES, *_ATTITUDE))
_STATIONS = Wanted(
    columns=(
        FileColumn(name="name", kind="text", unique=True, expected="a name"),
        *place_columns(),
        FileColumn(name="tide", unit="m", required=False),
        *(FileColumn(name=name, unit="deg", required=False) for name in (*_ATTITUDE, *_FLOWN)),
        *(
            FileColumn(
                name=name, unit="mm", required=False, least=ABOVE_ZERO, expected="a number greater than zero"
            )
            for name in _CAMERA
        ),
        *(FileColumn(name=name, unit="m", required=False, least=0.0) for name in (*_SIGMAS[:3], "sigma_tide")),
        *(FileColumn(name=name, unit="deg", required=False, least=0.0) for name in _SIGMAS[3:]),
    ),
    together=(_ATTITUDE, _FLOWN, _CAMERA, _SIGMAS),
    bare=("name", *AXES),
    closed=True,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tilt:
    """Water that rises by `slope` (3,), in the axes of the stations, from `pivot` (3,) m there."""

    slope: FloatArray
    pivot: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraStations:
    """k stations with names. A camera sees what lies in its format, and within a limit of the vertical.

    Either rule may be missing, the format or the limit; with neither every camera sees every point. Stations are
    rectangular with Z up, or geocentric with `axes` and a `system` that stands on the ellipsoid.
    """

    names: tuple[str, ...]
    stations: Stations
    rotation: FloatArray | None = None  # (k, 3, 3) ground to photo, from east, north, up of the station
    camera: FloatArray | None = None  # (k, 3) mm: focal length, width (x) and height (y) of the format
    limit: float | None = None  # rad, of the angle between the ray to an apparent point and the vertical
    index: float | None = None  # of the water, where a run has it
    axes: FloatArray | None = None  # (k, 3, 3) east, north, up of geocentric stations; None: Z is up
    system: System = LOCAL  # in which the run gives its points
    tilt: Tilt | None = None  # of the water, where a run has found one
    sigma: FloatArray | None = None  # (k, 7) m, rad: of places, attitudes and tides, where a file has them

    @property
    def has_rule(self) -> bool:
        """True where something says what a camera sees."""
        return self.camera is not None or self.limit is not None

    def only(self, rows: Sequence[int]) -> CameraStations:
        """Return some of the cameras, in this order."""
        picked = list(rows)

        def parts(table: Any) -> dict[str, Any]:
            return {name: values[picked] for name, values in vars(table).items() if isinstance(values, np.ndarray)}

        names = tuple(self.names[row] for row in picked)
        return replace(self, names=names, stations=replace(self.stations, **parts(self.stations)), **parts(self))

    def sees(self, points: FloatArray) -> BoolArray:
        """Return (n, k) which cameras see apparent points (n, 3), in the axes of the stations, by their images."""
        seen = np.empty((len(points), len(self.names)), dtype=bool)
        across = np.ascontiguousarray(points.T)
        with np.errstate(invalid="ignore", divide="ignore"):
            for row, station in enumerate(self.stations.position):
                gap = across - station[:, None]
                if self.axes is not None:
                    gap = self.axes[row] @ gap
                here = gap[2] < 0.0
                if self.limit is not None:
                    here &= np.square(gap[0]) + np.square(gap[1]) <= math.tan(self.limit) ** 2 * np.square(gap[2])
                if self.camera is not None and self.rotation is not None:
                    f, width, height = self.camera[row].tolist()
                    u, v, w = self.rotation[row] @ gap
                    reach = -w / f  # image vector (x, y, -f) times this
                    here &= (reach > 0.0) & (np.abs(u) <= width / 2.0 * reach) & (np.abs(v) <= height / 2.0 * reach)
                seen[:, row] = here
        return seen


def read_cameras(
    path: Path,
    *,
    level: float | None = None,
    camera: tuple[float, float, float] | None = None,
    limit: float | None = None,
    water: bool = True,
) -> CameraStations:
    """Return the cameras of a file; `level` and `camera` (focal length, width, height) where it has none.

    Without `water` a file may do without tides: the level is minus infinity where it has none. Raises `DepthError`
    with every line that cannot be used, and `OSError`.
    """
    table = read_table(path, _STATIONS)
    names, tides = tuple(table.texts("name")), table.numbers("tide")
    if water and level is None and not table.has("tide"):
        table.refuse("no column tide, and no water level is given")
    for column, given, what in (("tide", level, "a water level"), ("focal", camera, "a camera")):
        if table.has(column) and given is not None:
            table.refuse(f"there is a column {column}, and {what} is given too: one or the other")
    if table.has("omega", "roll"):
        table.refuse("columns omega, phi, kappa and roll, pitch, yaw: one is meant")
    for row, name in enumerate(names):
        if set(name) & set(' ,"'):
            table.refuse(f"a name without blanks, commas and quotes is needed, not '{name}'", row, "name")
    for row in np.flatnonzero(tides >= table.numbers("z")).tolist():
        table.refuse(f"the water at {tides[row]:g} m is not below the station", row, "tide")
    table.require(DepthError, empty="no station")
    rotation = attitude_matrix(table.numbers(*_ATTITUDE) * DEGREE) if table.has("omega") else None
    if table.has("roll"):
        rotation = _PHOTO @ body_matrix(table.numbers(*_FLOWN) * DEGREE, BodyAngles.ROLL_PITCH_HEADING)
    formats = table.numbers(*_CAMERA) if table.has("focal") else None
    if camera is not None:
        formats = np.tile(camera, (len(names), 1))
    if formats is not None and rotation is None:
        raise DepthError.of("a format needs attitudes: no omega, phi, kappa or roll, pitch, yaw", file=path)
    if not water and level is None:
        level = -math.inf
    try:
        stations = Stations(
            position=table.numbers(*AXES),
            level=tides if table.has("tide") else np.full(len(names), level, dtype=float),
            axis=None if rotation is None else -rotation[:, 2],
        )
    except ValueError as error:
        raise DepthError.of(error, file=path) from error
    sigma = None
    if table.has("sigma_x"):
        if formats is None:
            raise DepthError.of("sigmas of stations need attitudes, focal length and format", file=path)
        sigma = np.nan_to_num(table.numbers(*_SIGMAS, "sigma_tide"))  # a tide without one is known
        sigma[:, 3:6] *= DEGREE
    return CameraStations(
        names=names, stations=stations, rotation=rotation, camera=formats, limit=limit, sigma=sigma
    )


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
    tables = read_record(path, ("program", "solution", *run_tables.STATIONS))
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
        return [run_tables.port_fault(tables) or "the run knows no water"]
    if fault := run_tables.water_fault(tables):
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
    photos, cameras = run_tables.photos_of(tables), run_tables.cameras_of(tables)
    system = run_tables.job_system(tables)
    formats = np.column_stack([cameras.focal_length, cameras.format_size])[photos.camera]
    known = np.isfinite(formats).all()
    if not known and camera is not None:
        formats = np.where(np.isfinite(formats), formats, camera)
    rotation = attitude_matrix(photos.attitude)
    level = run_tables.level_positions(tables, photos.position)
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
    given = run_tables.level_positions(tables, numbers(tables["stations"], "given_position", 3))
    if system.ellipsoid is None:
        pivot = middle_of(given)
        axes = np.eye(3)
    else:
        pivot = middle_of(system.ellipsoid.geocentric(given))
        axes = system.ellipsoid.frame(geographic(system.ellipsoid, pivot))
    return Tilt(slope=np.array(tables["adjusted_water"]["tilt"], dtype=float) @ axes[:2], pivot=pivot)


def system_of_points(points: Path, system: System, crs: str | None = None, geoid: str | None = None) -> System:
    """Return the system of the points of a file: where nothing else is said `system`, that of the stations.

    `crs`: code, PROJ string or WKT; `geoid`: grid file of the geoid above which heights are. Raises `SystemsError`
    for a system that cannot be used, `DepthError` for words that go with no such stations and for a LAS file that
    cannot be read, and `OSError`.
    """
    ellipsoid = system.ellipsoid
    if ellipsoid is None:
        if crs or geoid:
            message = (
                f"--{'crs' if crs else 'geoid'}: neither the stations nor the points have a place on the ellipsoid"
            )
            raise DepthError.of(message)
        return system
    if not crs and points.suffix.lower() in SUFFIXES:
        crs = crs_definition(points)
    if crs:
        return system_of(crs, ellipsoid, geoid or "")
    if geoid:
        raise DepthError.of("--geoid goes with --crs: the system of the run has its own heights")
    return system


def system_alone(crs: str | None, geoid: str | None = None) -> System | None:
    """Return the system of points of which no stations are known, None where nothing is said: they are local.

    Raises `SystemsError` for a system that cannot be used, and `DepthError` for a geoid without one.
    """
    if not crs:
        if geoid:
            raise DepthError.of("--geoid goes with --crs")
        return None
    return system_of(crs, own_ellipsoid(crs), geoid or "")
