"""Files of points with their covariance: tables, or the JSON record of a run.

A table has the columns `id,x,y,z` and, all three or none, the sigmas `sx,sy,sz` (m), which a line may leave empty.
The coordinates may have other names.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import SeaError
from musatpy.geometry.crs import MapPlan
from musatpy.geometry.systems import System
from musatpy.pointfiles.columns import ABOVE_ZERO, AXES, FileColumn, Wanted, place_columns
from musatpy.pointfiles.point_tables import read_table
from musatpy.records.json_files import read_record
from musatpy.records.run_tables import SYSTEM, job_system, level_positions
from musatpy.records.tables import numbers
from musatpy.sea.stereo.surface_points import SurfacePoints, intersection_covariance

SIGMA = ("sx", "sy", "sz")
ID = FileColumn(name="id", kind="text", unique=True, expected="a name")
SIGMA_COLUMNS = tuple(
    FileColumn(
        name=name,
        unit="m",
        required=False,
        blank=True,
        least=ABOVE_ZERO,
        expected="a number greater than zero, or nothing",
    )
    for name in SIGMA
)


@dataclass(frozen=True, kw_only=True, eq=False)
class PointPrecision:
    """How precise points without sigmas of their own are: sigmas (m), or a pair and the sigma of images (rad)."""

    sigma: tuple[float, float, float] | None = None
    cameras: FloatArray | None = None  # (2, 3) m, geocentric beside points on the ellipsoid
    image_sigma: float = math.nan

    @property
    def is_known(self) -> bool:
        """Whether it is said at all."""
        return self.sigma is not None or self.cameras is not None

    def covariance(self, position: FloatArray, plan: MapPlan | None = None) -> FloatArray | None:
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
    plan: MapPlan | None = None  # of points on the ellipsoid: they stand on its map


def read_points(
    path: Path,
    precision: PointPrecision,
    only: Sequence[str] = (),
    columns: Sequence[str] = AXES,
    system: System | None = None,
) -> ReadPoints:
    """Return the points of a file (.json: the record of a run), those whose id fits one of the patterns `only`.

    `columns` are the names of the three coordinates in a CSV file, in any case, `system` is theirs. Points
    on the ellipsoid come on a map about their middle. Raises `SeaError` with every line that
    cannot be used, and where a precision is given that no point needs; `SystemsError`, `OSError`.
    """
    if path.suffix.lower() == ".json":
        return _read_record(path, precision, only)
    places = place_columns(columns, ("m", "m", "m") if system is None else system.units)
    place_names = [place.name for place in places]
    wanted = (ID, *places, *SIGMA_COLUMNS)
    table = read_table(path, Wanted(columns=wanted, together=(SIGMA,), bare=("id", *place_names), closed=True))
    for name in {*place_names} & {"id", *SIGMA}:
        table.refuse(f"column {name} is none of coordinates")
    sigma = table.numbers(*SIGMA)
    given = np.isfinite(sigma)
    if not table.has(*SIGMA) and not precision.is_known:
        table.refuse("no columns sx, sy, sz, and no sigmas are given: how precise the points are is not known")
    for row in np.flatnonzero(~given.all(axis=1)).tolist() if table.has(*SIGMA) else ():
        if given[row].any():
            table.refuse(f"{', '.join(SIGMA)} go together", row, SIGMA[int(np.argmin(given[row]))])
        elif not precision.is_known:
            table.refuse("no sigmas here, and none are given for points without", row, SIGMA[0])
    table.require(SeaError)
    names = table.texts("id")
    kept = [row for row, name in enumerate(names) if is_wanted(name, only)]
    _check_any(path, len(kept), only)
    position = table.numbers(*place_names)[kept]
    plan = None if system is None or system.ellipsoid is None else MapPlan.about(system, position)
    position = position if plan is None else plan.places(position)
    known = given[kept, 0]
    if known.all() and precision.is_known:
        raise SeaError.of("all points have sigmas of their own, so none can be given", file=path)
    covariance = np.square(sigma[kept])[:, :, None] * np.eye(3)
    if not known.all():
        covariance[~known] = precision.covariance(position[~known], plan)
    points = SurfacePoints(ids=tuple(names[row] for row in kept), position=position, covariance=covariance)
    return ReadPoints(points=points, plan=plan)


def is_wanted(name: str, only: Sequence[str]) -> bool:
    """Tell whether an id fits one of some patterns, or there are none."""
    return not only or any(fnmatchcase(name, pattern) for pattern in only)


def _check_any(path: Path, count: int, only: Sequence[str]) -> None:
    if not count:
        raise SeaError.of(f"no point fits {', '.join(only)}" if only else "no point", file=path)


def _read_record(path: Path, precision: PointPrecision, only: Sequence[str]) -> ReadPoints:
    if precision.is_known:
        message = "the record of a run has covariances, and sigmas are given too: one or the other"
        raise SeaError.of(message, file=path)
    tables = read_record(path, (*SYSTEM, "points"))
    system, points = job_system(tables), tables["points"]
    wanted = [row for row, name in enumerate(points["point"]) if is_wanted(name, only)]
    positions, covariances = numbers(points, "position", 3), numbers(points, "covariance", 3, 3)
    # one that is held fixed has no covariance
    usable = np.logical_and(np.isfinite(positions).all(axis=1), np.isfinite(covariances).all(axis=(1, 2)))
    usable[usable] = np.linalg.eigvalsh(covariances[usable])[:, 0] > 0.0
    rows = [row for row in wanted if usable[row]]
    left = [f"point {points['point'][row]}: no position with a covariance" for row in wanted if not usable[row]]
    _check_any(path, len(rows), only)
    position = positions[rows]
    plan = None
    if system.ellipsoid is not None:
        level = level_positions(tables, position)
        plan = MapPlan.about(system, system.coordinates(level))
        position = plan.map.coordinates(level)
    try:
        known = SurfacePoints(
            ids=tuple(points["point"][row] for row in rows), position=position, covariance=covariances[rows]
        )
    except ValueError as error:
        raise SeaError.of(error, file=path) from error
    return ReadPoints(points=known, left=tuple(left), plan=plan)
