"""A run as layers: what stands where, with sigmas, residuals and reasons, and the system that they are in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.arrays import FloatArray, at_rows, rows_of
from musatpy.errors import SystemsError
from musatpy.geometry.crs import LongitudeLatitude, system_of
from musatpy.geometry.projected import Geoid, Projected, crs_of
from musatpy.geometry.systems import Geocentric, LocalRectangular, System
from musatpy.interchange.layers import LayerColumn, Lines, Points, Polygons
from musatpy.plots.plane import ground_of, map_about, outlines, plane_of
from musatpy.records.run_tables import job_system
from musatpy.records.tables import Tables, flags, numbers, part, texts
from musatpy.units import DEGREE

if TYPE_CHECKING:
    import pyproj

_AXES = ("east", "north", "up")
_ANGLES = ("x_tilt", "y_tilt", "heading")
_OF_PHOTOS = ("station_position", "station_attitude", "air_base")  # kinds of observations whose owners are photos
_UNITS = {"plate": "mm", "station_attitude": "rad", "water_tilt": "rad", "water_index": ""}  # of others m
NEEDS = (  # tables of a record
    "options", "stations", "cameras", "plates", "points", "bathymetric_points", "control", "observations",
    "adjusted_water", "stated", "ellipsoid",
)  # fmt: skip
_OF_DEPTHS = {  # columns of points, and fields of the record
    "depth": "depth",
    "depth_sigma": "depth_sigma",
    "apparent_depth": "depth_no_refraction",
    "water_level": "water_level",
}
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
            raise SystemsError.of("--crs: the run is a local job, which is in no registered system")
        return TargetSystem(system=LocalRectangular(), crs=None, heights="heights of the job")
    if crs:
        target = system_of(crs, own.ellipsoid)
        if isinstance(target, Geocentric):
            raise SystemsError.of(f"--crs: {crs} is geocentric, and maps are not")
        return TargetSystem(system=target, crs=crs_of(crs), heights=_ELLIPSOIDAL)
    if isinstance(own, Projected):
        heights = f"above {own.geoid.name}" if isinstance(own.geoid, Geoid) else _ELLIPSOIDAL
        return TargetSystem(system=own, crs=pyproj.CRS.from_user_input(own.definition), heights=heights)
    degrees = pyproj.CRS.from_user_input(f"+proj=longlat {own.ellipsoid.definition} +no_defs +type=crs")
    return TargetSystem(system=LongitudeLatitude(own.ellipsoid), crs=degrees, heights=_ELLIPSOIDAL)


def layers_of(tables: Tables, crs: str = "") -> dict[str, Points | Lines]:
    """Return the layers of a run: `stations`, `footprints`, `points`, `control` and `observations`.

    What has no place has no row. Raises `SystemsError` for a system that the job is not in, `NothingToShowError`
    without stations.
    """
    target = target_system(tables, crs)
    plane = replace(plane_of(tables), system=target.system)
    stations = plane.places(numbers(part(tables, "stations"), "position", 3))
    points = plane.places(numbers(part(tables, "points"), "position", 3))
    control = part(tables, "control")
    row = rows_of(texts(part(tables, "points"), "point"), texts(control, "point"))
    layers: dict[str, Points | Lines] = {
        "stations": _placed(stations, _of_stations(tables), target),
        "points": _placed(points, _of_points(tables), target),
    }
    footprints = _footprints(tables, target)
    if footprints.vertices:
        layers["footprints"] = footprints
    if len(row):
        layers["control"] = _placed(at_rows(points, row), _of_control(control), target)
    if part(tables, "observations"):
        layers["observations"] = _observations(tables, stations, points, target)
    return layers


def _placed(places: FloatArray, columns: Mapping[str, LayerColumn], target: TargetSystem) -> Points:
    """Return rows that have a place."""
    known = np.isfinite(places).all(axis=1)
    kept = {name: replace(column, values=column.values[known]) for name, column in columns.items()}
    return Points(xyz=places[known], columns=kept, crs=target.crs, heights=target.heights)


def _vector(name: str, values: FloatArray, unit: str, axes: tuple[str, ...] = _AXES) -> dict[str, LayerColumn]:
    return {f"{name}{axis}": LayerColumn.of(values[:, i], unit) for i, axis in enumerate(axes)}


def _of_stations(tables: Tables) -> dict[str, LayerColumn]:
    stations = part(tables, "stations")
    tide = numbers(part(tables, "adjusted_water"), "tide")
    return {
        "photo": LayerColumn.of(texts(stations, "photo")),
        "camera": LayerColumn.of(texts(stations, "camera")),
        **_vector("", numbers(stations, "attitude", 3) / DEGREE, "deg", _ANGLES),
        **_vector("sigma_", numbers(stations, "position_sigma", 3), "m"),
        **_vector("sigma_", numbers(stations, "attitude_sigma", 3) / DEGREE, "deg", _ANGLES),
        **({"water_level": LayerColumn.of(tide, "m")} if len(tide) else {}),
    }


def _of_points(tables: Tables) -> dict[str, LayerColumn]:
    points, wet = part(tables, "points"), part(tables, "bathymetric_points")
    ids = texts(points, "point")
    row = rows_of(texts(wet, "point"), ids)
    return {
        "point": LayerColumn.of(ids),
        "submerged": LayerColumn.of(flags(points, "bathymetric").astype(np.int64)),
        "dry": LayerColumn.of(flags(points, "dry").astype(np.int64)),
        "status": LayerColumn.of(texts(points, "status")),
        "reason": LayerColumn.of(texts(points, "reason")),
        "rays": LayerColumn.of(np.nan_to_num(numbers(points, "rays")).astype(np.int64)),
        **_vector("sigma_", numbers(points, "sigma", 3), "m"),
        **{name: LayerColumn.of(at_rows(numbers(wet, field), row), "m") for name, field in _OF_DEPTHS.items()},
    }


def _of_control(control: Mapping[str, Any]) -> dict[str, LayerColumn]:
    return {
        "point": LayerColumn.of(texts(control, "point")),
        "kind": LayerColumn.of(texts(control, "kind")),
        **_vector("difference_", numbers(control, "difference", 3), "m"),
    }


def _footprints(tables: Tables, target: TargetSystem) -> Polygons:
    """Return what photos show at the typical height of the points."""
    plane = map_about(tables)
    ground = ground_of(plane.places(numbers(part(tables, "points"), "position", 3)))
    flat = outlines(tables, plane, ground)
    known = np.isfinite(flat).all(axis=(1, 2))
    corners = np.column_stack([flat[known].reshape(-1, 2), np.full(4 * int(known.sum()), ground)])
    around = target.system.coordinates(plane.system.level(corners)).reshape(-1, 4, 3)
    return Polygons.of_outlines(
        list(around),
        columns={"photo": LayerColumn.of(texts(part(tables, "stations"), "photo")[known])},
        crs=target.crs,
        heights=target.heights,
    )


def _observations(tables: Tables, stations: FloatArray, points: FloatArray, target: TargetSystem) -> Points:
    """Return the observations at their points, or else at their stations; those of the water have no place."""
    observed, kinds = part(tables, "observations"), texts(part(tables, "observations"), "kind")
    owners = observed["of"]
    of_photo = np.isin(kinds, (*_OF_PHOTOS, "plate"))
    photo = np.array([of[0] if is_of else "" for of, is_of in zip(owners, of_photo, strict=True)], dtype=np.str_)
    is_point = ~np.isin(kinds, _OF_PHOTOS)
    named = [of[-1] if of and is_of else "" for of, is_of in zip(owners, is_point, strict=True)]
    point = np.array(named, dtype=np.str_)
    at_point = rows_of(texts(part(tables, "points"), "point"), point)
    at_photo = rows_of(texts(part(tables, "stations"), "photo"), photo)
    places = np.where((at_point >= 0)[:, None], at_rows(points, at_point), at_rows(stations, at_photo))
    columns = {
        "kind": LayerColumn.of(kinds),
        "photo": LayerColumn.of(photo),
        "point": LayerColumn.of(point),
        "component": LayerColumn.of(texts(observed, "component")),
        "residual": LayerColumn.of(numbers(observed, "residual")),
        "sigma": LayerColumn.of(numbers(observed, "sigma")),
        "unit": LayerColumn.of([_UNITS.get(kind, "m") for kind in kinds.tolist()]),
        "redundancy": LayerColumn.of(numbers(observed, "redundancy")),
        "standardised": LayerColumn.of(numbers(observed, "standardised")),
    }
    return _placed(places, columns, target)
