"""Points on the ellipsoid as if on a plane: metres east and north of their middle, and heights.

Where a surface is a function of the place, of which the level one is 0, this makes a plane of the ellipsoid without
bending anything that hangs on it. Straight rays are not straight there: what is traced is traced in the vertical of
each point by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.crs import local_map
from musatpy.geometry.projected import Projected
from musatpy.geometry.systems import System, geographic


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """The system of a file of points, and the map on which they are worked with: x, y, ellipsoidal height."""

    system: System
    map: Projected

    @classmethod
    def about(cls, system: System, coordinates: FloatArray) -> Plan:
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
