"""The coordinate system of a file of points: as it is said, as a LAS file states it, or that of the run."""

from __future__ import annotations

from pathlib import Path

from musatpy.depth.cameras import Cameras
from musatpy.errors import DepthError, Problem
from musatpy.geometry.crs import own_ellipsoid, system_of
from musatpy.geometry.systems import System
from musatpy.pointfiles.las_files import SUFFIXES, crs_definition


def system_of_points(points: Path, cameras: Cameras, crs: str | None = None, geoid: str | None = None) -> System:
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
