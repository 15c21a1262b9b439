"""Files of points with their covariance: comma-separated values, or the JSON record of a run.

A CSV file has a line of names, `id,x,y,z` and, all three or none, the sigmas `sx,sy,sz` (m), in any order and case.
A line may leave all three empty. The coordinates may have other names.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.depth.run_cameras import job_system, level_positions, read_record
from musatpy.errors import Problem, SeaError
from musatpy.geometry.crs import Plan
from musatpy.geometry.projected import Projected
from musatpy.geometry.systems import System
from musatpy.pointfiles.csv_tables import names_of, number, separator_faults
from musatpy.sea.stereo.surface_points import SurfacePoints, intersection_covariance

_PLACE, _SIGMA = ("x", "y", "z"), ("sx", "sy", "sz")
_NEEDS = {"options": ("system",), "points": ("point", "position", "covariance")}  # of the record of a run


@dataclass(frozen=True, kw_only=True, eq=False)
class Precision:
    """How precise points without sigmas of their own are: sigmas (m), or a pair and the sigma of images (rad)."""

    sigma: tuple[float, float, float] | None = None
    cameras: FloatArray | None = None  # (2, 3) m, geocentric beside points on the ellipsoid
    image_sigma: float = math.nan

    @property
    def is_known(self) -> bool:
        """Whether it is said at all."""
        return self.sigma is not None or self.cameras is not None

    def covariance(self, position: FloatArray, plan: Plan | None = None) -> FloatArray | None:
        """Return (n, 3, 3) m2 of points (n, 3), on the map of a plan if there is one; None if nothing is known."""
        if self.sigma is not None:
            return np.tile(np.diag(np.square(self.sigma)), (len(position), 1, 1))
        if self.cameras is not None:
            cameras = self.cameras if plan is None else plan.stations(self.cameras)
            return intersection_covariance(cameras, position, self.image_sigma)
        return None


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadPoints:
    """Points of a file, and what was left out: lines that say which and why."""

    points: SurfacePoints
    left: tuple[str, ...] = ()
    plan: Plan | None = None  # of points on the ellipsoid: they stand on its map

    def coordinates(self, places: FloatArray) -> FloatArray:
        """Return places (n, 3) in the system of the file."""
        return places if self.plan is None else self.plan.coordinates(places)

    @property
    def decimals(self) -> tuple[int, int, int]:
        """How many decimals of these coordinates are worth writing."""
        return (4, 4, 4) if self.plan is None else self.plan.system.decimals


def read_points(
    path: Path,
    precision: Precision,
    only: Sequence[str] = (),
    columns: Sequence[str] = _PLACE,
    system: System | None = None,
    surface_map: Projected | None = None,
) -> ReadPoints:
    """Return the points of a file (.json: the record of a run), those whose id fits one of the patterns `only`.

    `columns` are the names of the three coordinates in a CSV file, in any case, `system` is theirs. Points
    on the ellipsoid come on `surface_map`, or on a map about their middle. Raises `SeaError` with every line that
    cannot be used, and where a precision is given that no point needs; `SystemsError`, `OSError`.
    """
    if path.suffix.lower() == ".json":
        return _read_record(path, precision, only, surface_map)
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    lines = [(place, line) for place, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        raise SeaError([Problem(file=str(path), message="no line of names")])
    header = [name.lower() for name in names_of(lines[0][1])]
    place_names = tuple(name.lower() for name in columns)
    problems = list(_header_faults(path, lines[0][0], header, precision, place_names))
    if problems:
        raise SeaError(problems)
    rows, seen = [], dict[str, int]()
    for place, line in lines[1:]:
        faults, row = _row(path, place, line, header, precision)
        if not faults and row["id"] in seen:
            message = f"point {row['id']} is given twice, before in line {seen[row['id']]}"
            faults = [Problem(file=str(path), line=place, field="id", message=message)]
        problems += faults
        if not faults:
            seen[row["id"]] = place
            rows.append(row)
    if problems:
        raise SeaError(problems)
    kept = [row for row in rows if _wanted(row["id"], only)]
    _check_any(path, len(kept), only)
    position = np.array([[row[name] for name in place_names] for row in kept])
    plan = _plan(system, position, surface_map)
    position = position if plan is None else plan.places(position)
    sigma = np.array([[row.get(name, math.nan) for name in _SIGMA] for row in kept])
    known = np.isfinite(sigma[:, 0])
    if known.all() and precision.is_known:
        message = "there are columns of sigmas, and sigmas are given too: no point is without its own"
        raise SeaError([Problem(file=str(path), message=message)])
    covariance = np.square(sigma)[:, :, None] * np.eye(3)
    if not known.all():
        others = precision.covariance(position[~known], plan)
        assert others is not None  # header and rows were checked
        covariance[~known] = others
    ids = tuple(row["id"] for row in kept)
    points = SurfacePoints(ids=ids, position=position, covariance=covariance)
    return ReadPoints(points=points, plan=plan)


def _plan(system: System | None, coordinates: FloatArray, surface_map: Projected | None) -> Plan | None:
    """Return the plan of points (n, 3) on the ellipsoid, None of others."""
    if system is None or system.ellipsoid is None:
        return None
    return Plan.about(system, coordinates) if surface_map is None else Plan(system=system, map=surface_map)


def _wanted(name: str, only: Sequence[str]) -> bool:
    return not only or any(fnmatchcase(name, pattern) for pattern in only)


def _check_any(path: Path, count: int, only: Sequence[str]) -> None:
    if not count:
        message = f"no point fits {', '.join(only)}" if only else "no point"
        raise SeaError([Problem(file=str(path), message=message)])


def _header_faults(
    path: Path, line: int, header: Sequence[str], precision: Precision, place: Sequence[str]
) -> Iterator[Problem]:
    def problem(message: str) -> Problem:
        return Problem(file=str(path), line=line, message=message)

    if faults := separator_faults(header):
        yield problem(faults[0])
        return
    for name in place:
        if name in ("id", *_SIGMA):
            yield problem(f"column {name} is none of coordinates")
    for name in ("id", *place):
        if name not in header:
            yield problem(f"no column {name} among {', '.join(header)}")
    for name in dict.fromkeys(header):
        if header.count(name) > 1:
            yield problem(f"two columns {name}")
        elif name not in ("id", *place, *_SIGMA):
            yield problem(f"unknown column {name}")
    given = [name for name in _SIGMA if name in header]
    if given and len(given) < len(_SIGMA):
        yield problem(f"{', '.join(_SIGMA)} go together: only {', '.join(given)} found")
    if not given and not precision.is_known:
        yield problem("no columns sx, sy, sz, and no sigmas are given: how precise the points are is not known")


def _row(
    path: Path, place: int, line: str, header: Sequence[str], precision: Precision
) -> tuple[list[Problem], dict[str, Any]]:
    """Return what is wrong with a line, each with its columns, and its values, without sigmas where it has none."""
    values = next(csv.reader([line]))
    if len(values) != len(header):
        message = f"{len(values)} values for {len(header)} columns"
        return [Problem(file=str(path), line=place, message=message, text=line)], {}
    problems, row, start = [], dict[str, Any](), 1
    texts = dict(zip(header, (value.strip() for value in values), strict=True))
    bare = not any(texts.get(name) for name in _SIGMA)
    for name, value in zip(header, values, strict=True):
        message = ""
        if name == "id":
            row[name] = value.strip()
            message = "" if value.strip() else "a point needs a name"
        elif name in _SIGMA and bare:
            needed = name == _SIGMA[0] and not precision.is_known
            message = "no sigmas here, and none are given for points without" if needed else ""
        else:
            row[name] = number(value.strip())
            if not math.isfinite(row[name]):
                message = f"'{value.strip()}' is no number"
            elif name in _SIGMA and row[name] <= 0.0:
                message = f"a sigma of {row[name]:g} m is not greater than zero"
        if message:
            columns = (start, start + max(len(value), 1) - 1) if '"' not in line else None
            problems.append(
                Problem(file=str(path), line=place, columns=columns, field=name, message=message, text=line)
            )
        start += len(value) + 1
    return problems, row


def _read_record(
    path: Path, precision: Precision, only: Sequence[str], surface_map: Projected | None
) -> ReadPoints:
    if precision.is_known:
        message = "the record of a run has covariances, and sigmas are given too: one or the other"
        raise SeaError([Problem(file=str(path), message=message)])
    record = read_record(path, _NEEDS)
    system = job_system(record)
    points = record["points"]
    wanted = [row for row, name in enumerate(points["point"]) if _wanted(name, only)]
    positions = np.array(points["position"], dtype=float).reshape(-1, 3)
    covariances = np.array(points["covariance"], dtype=float).reshape(-1, 3, 3)
    usable = _are_usable(positions, covariances)
    rows = [row for row in wanted if usable[row]]
    left = [f"point {points['point'][row]}: no position with a covariance" for row in wanted if not usable[row]]
    _check_any(path, len(rows), only)
    position = positions[rows]
    plan = None
    if system.ellipsoid is not None:
        level = level_positions(record, position)
        plan = _plan(system, system.coordinates(level), surface_map)
        assert plan is not None
        position = plan.map.coordinates(level)
    try:
        known = SurfacePoints(
            ids=tuple(points["point"][row] for row in rows), position=position, covariance=covariances[rows]
        )
    except ValueError as error:
        raise SeaError([Problem(file=str(path), message=str(error))]) from error
    return ReadPoints(points=known, left=tuple(left), plan=plan)


def _are_usable(position: FloatArray, covariance: FloatArray) -> BoolArray:
    """Tell which points (n,) have a position, and a covariance that is one: not one that is held fixed."""
    usable = np.logical_and(np.isfinite(position).all(axis=1), np.isfinite(covariance).all(axis=(1, 2)))
    usable[usable] = np.linalg.eigvalsh(covariance[usable])[:, 0] > 0.0
    return usable
