"""Lines and soundings given for a profile: files of other programs, brought on to the plane of a picture."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pyproj

from musatpy.arrays import FloatArray
from musatpy.errors import Problem, ProblemsError, SoundingError
from musatpy.geometry.projected import crs_of
from musatpy.interchange.any_file import TEXTS, read_layers
from musatpy.interchange.layers import Lines, Points
from musatpy.plots.plane import Plane
from musatpy.plots.profile import Line, SoundedPlaces
from musatpy.pointfiles.columns import LON_LAT, MAP_PLACES, PLAN, Wanted
from musatpy.pointfiles.point_tables import read_table
from musatpy.soundings.sounding_files import job_places, read_soundings
from musatpy.units import DEGREE


def given_line(path: Path, crs: str = "") -> Callable[[Plane], Line]:
    """Return the line of a file, on any plane: the points of a CSV file, or the first line of another format.

    `crs` is the system of x and y that a file does not say. Raises `ProblemsError` for a file that cannot be used,
    and the line does on a plane that it cannot be brought to; `OSError`.
    """
    stated = crs_of(crs) if crs else None
    if path.suffix.lower() in TEXTS:
        return partial(_line_on, path, *_of_csv(path), stated)
    layers = list(read_layers(path, stated).values())
    vertices = [layer.paths()[0] for layer in layers if isinstance(layer, Lines)]
    vertices += [layer.xyz for layer in layers if isinstance(layer, Points)]
    if not vertices:
        raise ProblemsError([Problem(file=str(path), message="has no line and no points")])
    return partial(_line_on, path, vertices[0][:, :2], False, layers[0].crs or stated)


def given_soundings(path: Path, crs: str = "", datum: float = 0.0) -> Callable[[Plane], SoundedPlaces]:
    """Return the soundings of a file, on any plane; `datum` is the height (m) from which depths count.

    Raises as `given_line`.
    """
    return partial(_soundings_on, path, crs, datum)


def _line_on(path: Path, xy: FloatArray, angular: bool, crs: pyproj.CRS | None, plane: Plane) -> Line:
    places = _on_plane(path, xy, angular, crs, plane)
    apart = np.append(True, np.linalg.norm(np.diff(places, axis=0), axis=1) > 0.0)
    if apart.sum() < 2:
        raise ProblemsError([Problem(file=str(path), message="a line needs two points in different places")])
    return Line(name=path.name, vertices=places[apart])


def _soundings_on(path: Path, crs: str, datum: float, plane: Plane) -> SoundedPlaces:
    soundings = read_soundings(path, plane.system.ellipsoid, crs="" if plane.own and not crs else crs)
    places = _on_plane(path, soundings.place, soundings.angular, None, plane)
    return SoundedPlaces(places=places, height=datum - soundings.depth, sigma=soundings.sigma)


def _on_plane(path: Path, xy: FloatArray, angular: bool, crs: pyproj.CRS | None, plane: Plane) -> FloatArray:
    """Return places (n, 2) m of latitude and longitude (rad), or x and y of a system. Raises `SoundingError`."""
    ellipsoid = plane.system.ellipsoid
    if angular and ellipsoid is None:
        raise SoundingError(
            [Problem(file=str(path), message="latitudes and longitudes, and the job is a local one")]
        )
    if not angular:
        if plane.own and crs is None:
            return xy
        xy = job_places(path, xy, crs, ellipsoid)
    return plane.places_of_level(np.column_stack([xy, np.zeros(len(xy))]))[:, :2]


def _of_csv(path: Path) -> tuple[FloatArray, bool]:
    """Return the points (v, 2) of a table, rad or m, and whether they are latitude and longitude."""
    table = read_table(path, Wanted(columns=MAP_PLACES, forms=(LON_LAT, PLAN)))
    table.require(ProblemsError)
    if table.has("lat"):
        return table.numbers("lat", "lon") * DEGREE, True
    return table.numbers(*PLAN), False
