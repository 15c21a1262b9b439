"""Any coordinate system of PROJ's register for files of points: projected, geographic or geocentric.

Coordinates stand in the order x, y, z whatever order the register gives the axes: easting, northing, height of
projected systems, longitude, latitude, height of geographic ones. Heights are metres, above the ellipsoid or above
a geoid model that is given with the system; the heights of a compound system are not known without one.

A `MapPlan` makes a plane of the ellipsoid: metres east and north of the middle of points, and heights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray
from musatpy.errors import SystemsError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.projected import Geoid, Projected, crs_name, crs_of, require_ellipsoid
from musatpy.geometry.systems import Geocentric, Geographic, System, geographic

_DEGREE = np.pi / 180.0


class LongitudeLatitude(Geographic):
    """Longitude and latitude in the unit of the register, east of its prime meridian, and height (m)."""

    names = ("longitude", "latitude", "height")

    def __init__(self, ellipsoid: Ellipsoid, geoid: Geoid | None = None, crs: Any = None, name: str = "") -> None:
        super().__init__(ellipsoid)
        self.height_alone = geoid is None
        self.geoid, self._unit, self._meridian, unit = geoid, _DEGREE, 0.0, "degree"
        if crs is not None:
            self._unit, unit = float(crs.axis_info[0].unit_conversion_factor), str(crs.axis_info[0].unit_name)
            meridian = crs.prime_meridian
            self._meridian = meridian.longitude * meridian.unit_conversion_factor
        self.units = (unit, unit, "m")
        heights = f"heights above {geoid.name}" if geoid else "ellipsoidal heights"
        self.text = f"{name + ', ' if name else ''}longitude and latitude in {unit}s, {heights}"

    @property
    def decimals(self) -> tuple[int, int, int]:
        return 9, 9, 4

    def coordinates(self, level: ArrayLike) -> FloatArray:
        level = np.asarray(level, dtype=float)
        out = np.empty(level.shape)
        out[..., 0] = (np.remainder(level[..., 1] - self._meridian + np.pi, 2.0 * np.pi) - np.pi) / self._unit
        out[..., 1] = level[..., 0] / self._unit
        out[..., 2] = level[..., 2] - self.undulation(level)
        return out

    def level(self, coordinates: ArrayLike) -> FloatArray:
        coordinates = np.asarray(coordinates, dtype=float)
        out = np.empty(coordinates.shape)
        out[..., 0] = coordinates[..., 1] * self._unit
        out[..., 1] = coordinates[..., 0] * self._unit + self._meridian
        wrong = (np.abs(out[..., 0]) > np.pi / 2.0) | (np.abs(out[..., 1]) > 2.0 * np.pi)
        if wrong.any():
            x, y = coordinates[wrong][0, :2].tolist()
            raise SystemsError.of(f"{self.text}: x {x:.10g}, y {y:.10g} are none")
        out[..., 2] = coordinates[..., 2] + self.undulation(out)
        return out

    def jacobian(self, level: ArrayLike) -> FloatArray:
        rates = super().jacobian(level)[..., [1, 0, 2], :]
        return rates / np.array([[self._unit], [self._unit], [1.0]])


def system_of(definition: str, ellipsoid: Ellipsoid, geoid: str = "") -> System:
    """Return the system of a code (`"EPSG:32620"`), PROJ string or WKT on the ellipsoid of a job.

    `geoid`: the grid file above which heights are, that of a compound system too. Raises `SystemsError` where PROJ
    does not know the system, where it stands on another ellipsoid or asks for a datum shift, and where its heights
    are not those of the ellipsoid and no geoid is given, or are not metres.
    """
    crs = crs_of(definition)
    if crs.is_compound:
        crs, definition = _horizontal(definition, crs, geoid)
    if crs.is_projected:
        return Projected(definition, ellipsoid, Geoid(geoid) if geoid else None)
    name = crs_name(definition, crs)
    if not (crs.is_geographic or crs.is_geocentric):
        message = f"{name} is a {crs.type_name}: a projected, geographic or geocentric system is needed"
        raise SystemsError.of(message, field="definition")
    require_ellipsoid(definition, crs, ellipsoid)
    _require_metres(name, crs.axis_info[0 if crs.is_geocentric else 2 :])
    if crs.is_geographic:
        return LongitudeLatitude(ellipsoid, Geoid(geoid) if geoid else None, crs, name)
    if geoid:
        raise SystemsError.of(f"{name} has no heights: a geoid model has no use", field="geoid")
    return Geocentric(ellipsoid)


def own_ellipsoid(definition: str) -> Ellipsoid:
    """Return the ellipsoid of a system. Raises `SystemsError` where PROJ does not know it, or it has none."""
    crs = crs_of(definition)
    if crs.ellipsoid is None:
        message = f"{crs_name(definition, crs)} is a {crs.type_name}: it stands nowhere on the ellipsoid"
        raise SystemsError.of(message, field="definition")
    return Ellipsoid("", crs.ellipsoid.semi_major_metre, crs.ellipsoid.inverse_flattening)


def local_map(ellipsoid: Ellipsoid, level: ArrayLike) -> Projected:
    """Return a map in metres about a level position (3,): x east and y north of it, ellipsoidal heights.

    Conformal, of scale 1 there: a length at 10 km is 1e-6 longer.
    """
    latitude, longitude = np.degrees(np.asarray(level, dtype=float)[:2]).tolist()
    place = f"+lat_0={latitude:.9f} +lon_0={longitude:.9f}"
    return Projected(f"+proj=tmerc {place} +k_0=1 {ellipsoid.definition}", ellipsoid)


def _horizontal(definition: str, crs: Any, geoid: str) -> tuple[Any, str]:
    """Return the horizontal part of a compound system, and its definition."""
    plane, heights = crs.sub_crs_list[:2]
    name = crs_name(definition, crs)
    if not geoid:
        message = f"{name} has {heights.name}: the grid file of its geoid model is needed (--geoid)"
        raise SystemsError.of(message, field="geoid")
    _require_metres(name, heights.axis_info)
    authority = plane.to_authority()
    return plane, ":".join(authority) if authority else plane.to_wkt()


def _require_metres(name: str, axes: Any) -> None:
    for axis in axes:
        if axis.unit_conversion_factor != 1.0:
            message = f"{name} has {axis.name.lower()} in {axis.unit_name}: metres are needed"
            raise SystemsError.of(message, field="definition")


@dataclass(frozen=True, kw_only=True, eq=False)
class MapPlan:
    """The system of a file of points, and the map on which they are worked with: x, y, ellipsoidal height.

    Where a surface is a function of the place, of which the level one is 0, nothing that hangs on it is bent.
    Straight rays are not straight there: what is traced is traced in the vertical of each point by itself.
    """

    system: System
    map: Projected

    @classmethod
    def about(cls, system: System, coordinates: FloatArray) -> MapPlan:
        """Return the plan about the middle of points (n, 3). Raises `SystemsError`, without points `ValueError`."""
        if not len(coordinates):
            raise ValueError("no point")
        assert system.ellipsoid is not None
        middle = system.ellipsoid.geocentric(system.level(coordinates)).mean(axis=0)
        return cls(system=system, map=local_map(system.ellipsoid, geographic(system.ellipsoid, middle)))

    def places(self, coordinates: FloatArray) -> FloatArray:
        """Return places (n, 3) on the map of coordinates of the system. Raises `SystemsError`."""
        return self.map.coordinates(self.system.level(coordinates))

    def coordinates(self, places: FloatArray) -> FloatArray:
        """Return coordinates (n, 3) of the system of places on the map. Raises `SystemsError`."""
        return self.system.coordinates(self.map.level(places))

    def stations(self, position: FloatArray) -> FloatArray:
        """Return geocentric stations (k, 3) as places on the map."""
        return self.map.coordinates(geographic(self.map.ellipsoid, position))

    def about_points(self, position: FloatArray, places: FloatArray) -> FloatArray:
        """Return geocentric stations (k, 3) in the vertical of each point (n, k, 3), which stays in its place."""
        foot, axes = self._verticals(places)
        return np.einsum("nij,nkj->nki", axes, position - foot[:, None]) + _at(places)[:, None]

    def settled(self, upright: FloatArray, places: FloatArray) -> FloatArray:
        """Return places (n, 3) on the map of points in the verticals at other places (n, 3)."""
        foot, axes = self._verticals(places)
        position = foot + np.einsum("nij,ni->nj", axes, upright - _at(places))
        return self.stations(position)

    def _verticals(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the geocentric foot (n, 3) and the axes (n, 3, 3) of places: along the map, and up."""
        level = self.map.level(_at(places))
        return self.map.ellipsoid.geocentric(level), self.map.axes(level) @ self.map.ellipsoid.frame(level)


def _at(places: FloatArray) -> FloatArray:
    return places * [1.0, 1.0, 0.0]
