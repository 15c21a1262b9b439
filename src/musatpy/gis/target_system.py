"""The coordinate system in which the layers of a run are written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from musatpy.errors import Problem, SystemsError
from musatpy.geometry.crs import LongitudeLatitude, system_of
from musatpy.geometry.projected import Geoid, Projected, crs_of
from musatpy.geometry.systems import Geocentric, LocalRectangular, System
from musatpy.records.run_tables import job_system
from musatpy.records.tables import Tables

if TYPE_CHECKING:
    import pyproj

_ELLIPSOIDAL = "above the ellipsoid of the job"


@dataclass(frozen=True, kw_only=True, eq=False)
class TargetSystem:
    """A system, as PROJ has it (None of a local job), and in words what heights are above."""

    system: System
    crs: pyproj.CRS | None
    heights: str


def target_system(tables: Tables, crs: str = "") -> TargetSystem:
    """Return the system of layers: `crs`; that of the job's answer; longitude and latitude on its ellipsoid.

    A local job has none of a register: its layers are as it is. Raises `SystemsError` for a `crs` that PROJ does
    not know, that is geocentric or not on the ellipsoid of the job, and for any of a local job.
    """
    import pyproj

    own = job_system(tables)
    if own.ellipsoid is None:
        if crs:
            raise SystemsError([Problem(message="--crs: the run is a local job, in no system of a register")])
        return TargetSystem(system=LocalRectangular(), crs=None, heights="heights of the job")
    if crs:
        target = system_of(crs, own.ellipsoid)
        if isinstance(target, Geocentric):
            raise SystemsError([Problem(message=f"--crs: {crs} is geocentric, and maps are not")])
        return TargetSystem(system=target, crs=crs_of(crs), heights=_ELLIPSOIDAL)
    if isinstance(own, Projected):
        heights = f"above {own.geoid.name}" if isinstance(own.geoid, Geoid) else _ELLIPSOIDAL
        return TargetSystem(system=own, crs=pyproj.CRS.from_user_input(own.definition), heights=heights)
    degrees = pyproj.CRS.from_user_input(f"+proj=longlat {own.ellipsoid.definition} +no_defs +type=crs")
    return TargetSystem(system=LongitudeLatitude(own.ellipsoid), crs=degrees, heights=_ELLIPSOIDAL)
