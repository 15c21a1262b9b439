"""The plane on which a job is drawn, and what its photos show there.

It has the coordinates of the job where these are metres of a map; else it is a map about the stations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, rows_of
from musatpy.errors import SystemsError
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.crs import local_map
from musatpy.geometry.projected import Projected
from musatpy.geometry.systems import System, TangentPlane, geographic
from musatpy.plots.picture import NothingToShowError
from musatpy.records.run_tables import job_system, level_positions
from musatpy.records.tables import Tables, numbers, part, texts

_FARTHEST = 1e6  # m from the middle of the stations, of what has a place
_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
_LOWEST = -0.1  # cosine from straight up of a ray that still goes down
_BORDER = 1.05  # of what was measured, where a camera has no format


@dataclass(frozen=True, kw_only=True, eq=False)
class MapPlane:
    """Where positions of a record are drawn: x and y in metres, and heights."""

    system: System
    middle: FloatArray  # (3,) of the stations: level coordinates
    tables: Tables
    labels: tuple[str, str]  # of the axes
    north: str  # what is up
    own: bool  # x and y are coordinates of the job

    def places(self, positions: FloatArray) -> FloatArray:
        """Return x, y, height (n, 3) m of positions of the record; NaN of what has none, or lies far off."""
        return self.places_of_level(level_positions(self.tables, positions))

    def places_of_xyz(self, positions: FloatArray) -> FloatArray:
        """Return x, y, height (n, 3) m of geocentric positions, those of the job in local ones."""
        ellipsoid = self.system.ellipsoid
        return self.places_of_level(positions if ellipsoid is None else geographic(ellipsoid, positions))

    def places_of_level(self, level: FloatArray) -> FloatArray:
        """Return x, y, height (n, 3) m of latitude, longitude (rad), height; in local jobs of X, Y, Z."""
        near = self._near(level)
        if self.system.ellipsoid is None:
            return near
        out = self.system.coordinates(near)
        if isinstance(self.system, TangentPlane):  # its Z is no height
            out[:, 2] = level[:, 2]
        return out

    def heights(self, positions: FloatArray, height: FloatArray) -> FloatArray:
        """Return heights (n,) of the plane at positions (n, 3) of the record, of heights (n,) of the record."""
        if self.system.ellipsoid is None:
            return height
        level = np.column_stack([level_positions(self.tables, positions)[:, :2], height])
        return self.places_of_level(level)[:, 2]

    def turns(self, positions: FloatArray) -> FloatArray:
        """Return by which angle (n,) rad north of the plane stands clockwise of true north at positions."""
        out = np.zeros(len(positions))
        if self.system.ellipsoid is None or not len(positions):
            return out
        level = self._near(level_positions(self.tables, positions))
        known = np.isfinite(level).all(axis=1)
        factors = self.system.factors(level[known])
        out[known] = 0.0 if factors is None else factors.convergence
        return out

    def _near(self, level: FloatArray) -> FloatArray:
        """Return level coordinates, NaN where they are not those of a place near the stations."""
        ellipsoid = self.system.ellipsoid
        xyz, middle = (at if ellipsoid is None else ellipsoid.geocentric(at) for at in (level, self.middle))
        near = np.linalg.norm(xyz - middle, axis=1) < _FARTHEST
        return np.where(near[:, None], level, np.nan)


def plane_of(tables: Tables) -> MapPlane:
    """Return the plane of a record. Raises `NothingToShowError` where its system, or a station, is not there."""
    if is_compilation(tables):
        tables = _as_run(tables)
    system, middle = _system_and_middle(tables)
    if system.ellipsoid is None:
        return MapPlane(system=system, middle=middle, tables=tables, labels=("X, m", "Y, m"), north="Y", own=True)
    if system.plane and isinstance(system, Projected | TangentPlane) and system.units[0] == "m":
        x, y = system.names[:2]
        return MapPlane(
            system=system, middle=middle, tables=tables, labels=(f"{x}, m", f"{y}, m"), north=y, own=True
        )
    return map_about(tables)


def is_compilation(tables: Tables) -> bool:
    """Tell whether tables are of the record of a compilation, and not of a run."""
    return "job" in tables


def _as_run(tables: Tables) -> Tables:
    """Return what a compilation says of its system as the record of a run does, about its points."""
    job = part(tables, "job")
    return {
        "options": {"system": job["system"]},
        "ellipsoid": None if job["system"] == "LOCL" else job["ellipsoid"],
        "stations": {"position": part(tables, "points")["position"]},
    }


def map_about(tables: Tables) -> MapPlane:
    """Return a map about the stations of a job on an ellipsoid, the plane of a local one. Raises as `plane_of`."""
    system, middle = _system_and_middle(tables)
    if system.ellipsoid is None:
        return plane_of(tables)
    latitude, longitude = np.degrees(middle[:2]).tolist()
    labels = (f"east of {_angle(longitude, 'EW')}, m", f"north of {_angle(latitude, 'NS')}, m")
    about = local_map(system.ellipsoid, middle)
    return MapPlane(system=about, middle=middle, tables=tables, labels=labels, north="N", own=False)


def _system_and_middle(tables: Tables) -> tuple[System, FloatArray]:
    """Return the system of a job, and the middle (3,) of its stations, level coordinates."""
    positions = numbers(part(tables, "stations"), "position", 3)
    positions = positions[np.isfinite(positions).all(axis=1)]
    if not len(positions):
        raise NothingToShowError("no station has a position")
    try:
        return job_system(tables), np.median(level_positions(tables, positions), axis=0)
    except (SystemsError, ValueError, TypeError, KeyError) as error:
        raise NothingToShowError(f"the system of the job cannot be had: {error}") from error


def _angle(degrees: float, letters: str) -> str:
    """Return an angle in degrees and minutes, with its letter."""
    minutes = round(abs(degrees) * 60.0 * 1000.0) / 1000.0
    return f"{int(minutes // 60)}\N{DEGREE SIGN}{minutes % 60:06.3f}'{letters[degrees < 0.0]}"


def turned(vectors: FloatArray, turn: FloatArray) -> FloatArray:
    """Return vectors (n, 2) of east and north along axes that stand `turn` (n,) rad clockwise of these."""
    c, s = np.cos(turn), np.sin(turn)
    return np.column_stack([c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]])


def footprints(
    station: FloatArray, attitude: FloatArray, corners: FloatArray, focal_length: FloatArray, ground: float
) -> FloatArray:
    """Return corners (n, 4, 2) m east and north of stations (n, 3) where their rays (n, 4, 2) mm meet a height.

    `attitude` (n, 3) rad, `focal_length` (n,) mm; rays through image points from the principal point. NaN where one
    of the rays of a photo does not go down, or the station is not above the ground.
    """
    M = attitude_matrix(attitude)
    image = np.concatenate([corners, np.broadcast_to(-focal_length[:, None, None], (*corners.shape[:2], 1))], 2)
    ray = np.einsum("nji,ncj->nci", M, image)
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    reach = (ground - station[:, 2])[:, None] / ray[..., 2]
    down = (ray[..., 2] < _LOWEST).all(axis=1) & (station[:, 2] > ground)
    return np.where(down[:, None, None], ray[..., :2] * reach[..., None], np.nan)


def frames(tables: Tables) -> tuple[FloatArray, FloatArray]:
    """Return the corners (n, 4, 2) mm of the photos from the principal point, and focal lengths (n,) mm.

    Of a camera without a format these are the corners of what was measured on its photos.
    """
    cameras, stations, plates = part(tables, "cameras"), part(tables, "stations"), part(tables, "plates")
    of = rows_of(texts(cameras, "camera"), texts(stations, "camera"))
    size, centre = numbers(cameras, "format_size", 2), numbers(cameras, "principal_point", 2)
    unknown = np.flatnonzero(~np.isfinite(size).all(axis=1)).tolist()
    camera = of[rows_of(texts(stations, "photo"), texts(plates, "photo"))] if unknown else of
    for row in unknown:
        mine = numbers(plates, "xy", 2)[camera == row]
        if len(mine):
            size[row] = 2.0 * _BORDER * np.abs(mine).max(axis=0)
    corners = _CORNERS * size[of, None, :] - centre[of, None, :]
    return corners, numbers(cameras, "focal_length")[of]


def ground_of(places: FloatArray) -> float:
    """Return the median height of places (n, 3), 0 where none is known."""
    heights = places[np.isfinite(places).all(axis=1), 2]
    return float(np.median(heights)) if len(heights) else 0.0


def outlines(tables: Tables, plane: MapPlane, ground: float) -> FloatArray:
    """Return the corners (n, 4, 2) m on the plane of what each photo shows at a height; NaN where it has none."""
    stations = part(tables, "stations")
    position = numbers(stations, "position", 3)
    places = plane.places(position)
    corners, focal_length = frames(tables)
    flat = footprints(places, numbers(stations, "attitude", 3), corners, focal_length, ground)
    turns = np.repeat(plane.turns(position), 4)
    return places[:, None, :2] + turned(flat.reshape(-1, 2), turns).reshape(-1, 4, 2)
