"""A file of exposure stations, and which of their cameras sees a point.

Comma-separated values under a line of names, in any order and case: `name,x,y,z`, and as far as they are known
`tide` (height of the water), `omega,phi,kappa` (degrees) and `focal,width,height` (mm) of the camera.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.depth.point_positions import LOCAL, Tilt
from musatpy.errors import DepthError, Problem
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.systems import System
from musatpy.pointfiles.csv_tables import number, separator_faults
from musatpy.refraction.apparent import Stations
from musatpy.units import DEGREE

_Vector = tuple[FloatArray, FloatArray, FloatArray]

_PLACE, _TIDE = ("x", "y", "z"), ("tide",)
_ATTITUDE, _CAMERA = ("omega", "phi", "kappa"), ("focal", "width", "height")
_NUMBERS = (*_PLACE, *_TIDE, *_ATTITUDE, *_CAMERA)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cameras:
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

    @property
    def has_rule(self) -> bool:
        """True where something says what a camera sees."""
        return self.camera is not None or self.limit is not None

    def only(self, rows: Sequence[int]) -> Cameras:
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
) -> Cameras:
    """Return the cameras of a file; `level` and `camera` (focal length, width, height) where it has none.

    Without `water` a file may do without tides: the level is minus infinity where it has none. Raises `DepthError`
    with every line that cannot be used, and `OSError`.
    """
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        rows = [(number, row) for number, row in enumerate(csv.reader(file), 1) if any(row)]
    if not rows:
        raise DepthError([Problem(file=str(path), message="no line of names")])
    header = [name.strip().lower() for name in rows[0][1]]
    level = -math.inf if not water and "tide" not in header else level
    problems = list(_header_faults(header, level, camera))
    names, values = [], []
    for line, row in rows[1:] if not problems else ():
        faults, read = _row(header, row)
        name = row[header.index("name")].strip() if len(row) == len(header) else ""
        if not faults and name in names:
            faults = [f"station {name} is given twice"]
        problems += [Problem(file=str(path), line=line, message=message) for message in faults]
        names.append(name)
        values.append(read)
    if not problems and not names:
        problems = [Problem(message="no station")]
    if problems:
        raise DepthError([p if p.file else Problem(file=str(path), message=p.message) for p in problems])
    columns = {key: np.array([row[key] for row in values]) for key in values[0]}
    return _cameras(path, tuple(names), columns, level, camera, limit)


def _header_faults(
    header: Sequence[str], level: float | None, camera: tuple[float, float, float] | None
) -> Iterator[Problem]:
    if faults := separator_faults(header):
        yield Problem(message=faults[0])
        return
    for name in ("name", *_PLACE):
        if name not in header:
            yield Problem(message=f"no column {name} among {', '.join(header)}")
    for together in (_ATTITUDE, _CAMERA):
        present = [name for name in together if name in header]
        if present and len(present) < len(together):
            yield Problem(message=f"{', '.join(together)} go together: only {', '.join(present)} found")
    if "tide" not in header and level is None:
        yield Problem(message="no column tide, and no water level is given")
    for name, given, what in (("tide", level, "a water level"), ("focal", camera, "a camera")):
        if name in header and given is not None:
            yield Problem(message=f"there is a column {name}, and {what} is given too: one or the other")
    for name in dict.fromkeys(header):
        if header.count(name) > 1:
            yield Problem(message=f"two columns {name}")
        elif name not in ("name", *_NUMBERS):
            yield Problem(message=f"unknown column {name}")


def _row(header: Sequence[str], row: Sequence[str]) -> tuple[list[str], dict[str, float]]:
    """Return what is wrong with a line, and its numbers."""
    if len(row) != len(header):
        return [f"{len(row)} values for {len(header)} columns"], {}
    given = dict(zip(header, (value.strip() for value in row), strict=True))
    faults, numbers = [], {}
    if not given["name"] or set(given["name"]) & set(' ,"'):
        faults.append(f"a name without blanks, commas and quotes is needed, not '{given['name']}'")
    for name in header:
        if name == "name":
            continue
        numbers[name] = number(given[name])
        if not math.isfinite(numbers[name]):
            faults.append(f"{name}: '{given[name]}' is no number")
        elif name in _CAMERA and numbers[name] <= 0.0:
            faults.append(f"{name}: {numbers[name]:g} mm is not greater than zero")
    if not faults and numbers.get("tide", -math.inf) >= numbers["z"]:
        faults.append(f"the water at {numbers['tide']:g} m is not below the station")
    return faults, numbers


def _cameras(
    path: Path,
    names: tuple[str, ...],
    columns: Mapping[str, FloatArray],
    level: float | None,
    camera: tuple[float, float, float] | None,
    limit: float | None,
) -> Cameras:
    count = len(names)
    rotation = None
    if "omega" in columns:
        rotation = attitude_matrix(np.column_stack([columns[name] for name in _ATTITUDE]) * DEGREE)
    formats = None
    if "focal" in columns:
        formats = np.column_stack([columns[name] for name in _CAMERA])
    elif camera is not None:
        formats = np.tile(camera, (count, 1))
    if formats is not None and rotation is None:
        raise DepthError([Problem(file=str(path), message="a format needs attitudes: no omega, phi, kappa")])
    tides = columns["tide"] if "tide" in columns else np.full(count, level)
    try:
        stations = Stations(
            position=np.column_stack([columns[name] for name in _PLACE]),
            level=np.asarray(tides, dtype=float),
            axis=None if rotation is None else -rotation[:, 2],
        )
    except ValueError as error:
        raise DepthError([Problem(file=str(path), message=str(error))]) from error
    return Cameras(names=names, stations=stations, rotation=rotation, camera=formats, limit=limit)
