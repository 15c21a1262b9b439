"""A file of exposure stations, which of their cameras sees a point, and the system that a file of points is in.

A table with columns `name,x,y,z`, or bare lines of these four, and as far as they are known
`tide` (height of the water), `omega,phi,kappa` (degrees), `focal,width,height` (mm) of the camera, the sigmas of
place and attitude `sigma_x,sigma_y,sigma_z,sigma_omega,sigma_phi,sigma_kappa`, and `sigma_tide`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.depth.point_positions import LOCAL, Tilt
from musatpy.errors import DepthError, Problem
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.crs import own_ellipsoid, system_of
from musatpy.geometry.systems import System
from musatpy.pointfiles.columns import ABOVE_ZERO, AXES, FileColumn, Wanted, place_columns
from musatpy.pointfiles.las_files import SUFFIXES, crs_definition
from musatpy.pointfiles.point_tables import read_table
from musatpy.refraction.apparent import Stations
from musatpy.units import DEGREE

_Vector = tuple[FloatArray, FloatArray, FloatArray]

_ATTITUDE, _CAMERA = ("omega", "phi", "kappa"), ("focal", "width", "height")
_SIGMAS = tuple(f"sigma_{name}" for name in (*AXES, *_ATTITUDE))
_STATIONS = Wanted(
    columns=(
        FileColumn(name="name", kind="text", unique=True, expected="a name"),
        *place_columns(),
        FileColumn(name="tide", unit="m", required=False),
        *(FileColumn(name=name, unit="deg", required=False) for name in _ATTITUDE),
        *(
            FileColumn(
                name=name, unit="mm", required=False, least=ABOVE_ZERO, expected="a number greater than zero"
            )
            for name in _CAMERA
        ),
        *(FileColumn(name=name, unit="m", required=False, least=0.0) for name in (*_SIGMAS[:3], "sigma_tide")),
        *(FileColumn(name=name, unit="deg", required=False, least=0.0) for name in _SIGMAS[3:]),
    ),
    together=(_ATTITUDE, _CAMERA, _SIGMAS),
    bare=("name", *AXES),
    closed=True,
)


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

        def part(values: FloatArray | None) -> FloatArray | None:
            return None if values is None else values[picked]

        stations: dict[str, Any] = {name: part(values) for name, values in vars(self.stations).items()}
        return replace(
            self,
            names=tuple(self.names[row] for row in picked),
            stations=replace(self.stations, **stations),
            rotation=part(self.rotation),
            camera=part(self.camera),
            axes=part(self.axes),
            sigma=part(self.sigma),
        )

    def sees(self, points: FloatArray) -> BoolArray:
        """Return (n, k) which cameras see apparent points (n, 3), in the axes of the stations, by their images."""
        seen = np.empty((len(points), len(self.names)), dtype=bool)
        X, Y, Z = np.ascontiguousarray(points.T)
        with np.errstate(invalid="ignore", divide="ignore"):
            for row, (x, y, z) in enumerate(self.stations.position.tolist()):
                gap = X - x, Y - y, Z - z
                if self.axes is not None:
                    gap = _turned(self.axes[row], gap)
                seen[:, row] = gap[2] < 0.0
                if self.limit is not None:
                    far = math.tan(self.limit) ** 2 * gap[2] * gap[2]
                    seen[:, row] &= gap[0] * gap[0] + gap[1] * gap[1] <= far
                if self.camera is not None:
                    seen[:, row] &= self._in_format(row, gap)
        return seen

    def _in_format(self, row: int, gap: _Vector) -> BoolArray:
        assert self.camera is not None and self.rotation is not None
        f, width, height = self.camera[row].tolist()
        M = self.rotation[row]
        u, v, w = _turned(M, gap)
        reach = -w / f  # image vector (x, y, -f) times this
        return (reach > 0.0) & (np.abs(u) <= width / 2.0 * reach) & (np.abs(v) <= height / 2.0 * reach)


def _turned(R: FloatArray, gap: _Vector) -> _Vector:
    u, v, w = (R[i, 0] * gap[0] + R[i, 1] * gap[1] + R[i, 2] * gap[2] for i in range(3))
    return u, v, w


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
    for row, name in enumerate(names):
        if set(name) & set(' ,"'):
            table.refuse(f"a name without blanks, commas and quotes is needed, not '{name}'", row, "name")
    for row in np.flatnonzero(tides >= table.numbers("z")).tolist():
        table.refuse(f"the water at {tides[row]:g} m is not below the station", row, "tide")
    table.require(DepthError, empty="no station")
    rotation = attitude_matrix(table.numbers(*_ATTITUDE) * DEGREE) if table.has("omega") else None
    formats = table.numbers(*_CAMERA) if table.has("focal") else None
    if camera is not None:
        formats = np.tile(camera, (len(names), 1))
    if formats is not None and rotation is None:
        raise DepthError([Problem(file=str(path), message="a format needs attitudes: no omega, phi, kappa")])
    if not water and level is None:
        level = -math.inf
    try:
        stations = Stations(
            position=table.numbers(*AXES),
            level=tides if table.has("tide") else np.full(len(names), level, dtype=float),
            axis=None if rotation is None else -rotation[:, 2],
        )
    except ValueError as error:
        raise DepthError([Problem(file=str(path), message=str(error))]) from error
    sigma = None
    if table.has("sigma_x"):
        if formats is None:
            message = "sigmas of stations need attitudes, focal length and format"
            raise DepthError([Problem(file=str(path), message=message)])
        sigma = np.nan_to_num(table.numbers(*_SIGMAS, "sigma_tide"))  # a tide without one is known
        sigma[:, 3:6] *= DEGREE
    return CameraStations(
        names=names, stations=stations, rotation=rotation, camera=formats, limit=limit, sigma=sigma
    )


def system_of_points(
    points: Path, cameras: CameraStations, crs: str | None = None, geoid: str | None = None
) -> System:
    """Return the system of the points of a file, which is that of the stations where these are in no register.

    `crs`: code, PROJ string or WKT; `geoid`: grid file of the geoid above which heights are. Raises `SystemsError`
    for a system that cannot be used, `DepthError` for words that go with no such stations and for a LAS file that
    cannot be read, and `OSError`.
    """
    ellipsoid = cameras.system.ellipsoid
    if ellipsoid is None:
        if crs or geoid:
            message = (
                f"--{'crs' if crs else 'geoid'}: the stations stand nowhere on the ellipsoid, nor do the points"
            )
            raise DepthError([Problem(message=message)])
        return cameras.system
    if not crs and points.suffix.lower() in SUFFIXES:
        crs = crs_definition(points)
    if crs:
        return system_of(crs, ellipsoid, geoid or "")
    if geoid:
        message = "--geoid goes with --crs: the system of the run has its own heights"
        raise DepthError([Problem(message=message)])
    return cameras.system


def system_alone(crs: str | None, geoid: str | None = None) -> System | None:
    """Return the system of points of which no stations are known, None where nothing is said: they are local.

    Raises `SystemsError` for a system that cannot be used, and `DepthError` for a geoid without one.
    """
    if not crs:
        if geoid:
            raise DepthError([Problem(message="--geoid goes with --crs")])
        return None
    return system_of(crs, own_ellipsoid(crs), geoid or "")
