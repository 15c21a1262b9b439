"""Where points stand: their coordinates in a file, the axes of the stations, and the vertical over each of them.

Stations of a local job and points stand in one rectangular system with Z up. On the ellipsoid stations are
geocentric, points in any system, and every point has its own vertical: the water over it is a plane across that, at
the tide above the ellipsoid, as in the adjustment. Tilted water is a plane too, across its own normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.collinearity import cross
from musatpy.geometry.systems import LocalRectangular, System, geographic
from musatpy.refraction.apparent import Verticals

LOCAL = LocalRectangular()


@dataclass(frozen=True, kw_only=True, eq=False)
class Tilt:
    """Water that rises by `slope` (3,), in the axes of the stations, from `pivot` (3,) m there."""

    slope: FloatArray
    pivot: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedPoints:
    """n points in the axes of the stations, and each in its own vertical; None: that is Z of these axes."""

    position: FloatArray  # (n, 3) m
    upright: FloatArray  # (n, 3) m in the verticals
    verticals: Verticals | None


@dataclass(frozen=True, kw_only=True, eq=False)
class PointSystem:
    """The coordinate system of points, and how their water is tilted, if it is."""

    system: System = LOCAL
    tilt: Tilt | None = None

    def placed(self, given: FloatArray) -> PlacedPoints:
        """Return finite points (n, 3) as they are placed. Raises `SystemsError` where the system does not reach."""
        ellipsoid = self.system.ellipsoid
        if ellipsoid is None:
            if self.tilt is None:
                return PlacedPoints(position=given, upright=given, verticals=None)
            position, height, axes = given, given[:, 2], np.broadcast_to(np.eye(3), (len(given), 3, 3))
        else:
            level = self.system.level(given)
            position, height, axes = ellipsoid.geocentric(level), level[:, 2], ellipsoid.frame(level)
        if self.tilt is not None:
            height = height - (position - self.tilt.pivot) @ self.tilt.slope
            axes = _tilted(axes, self.tilt.slope)
        upright = np.zeros_like(position)
        upright[:, 2] = height
        origin = position - height[:, None] * axes[:, 2]
        return PlacedPoints(position=position, upright=upright, verticals=Verticals(origin=origin, axes=axes))

    def restated(self, upright: FloatArray, verticals: Verticals) -> FloatArray:
        """Return the coordinates (n, 3) of points in their verticals."""
        return self.coordinates(verticals.origin + np.einsum("nij,ni->nj", verticals.axes, upright))

    def coordinates(self, position: FloatArray) -> FloatArray:
        """Return the coordinates (n, 3) of positions in the axes of the stations."""
        ellipsoid = self.system.ellipsoid
        return position if ellipsoid is None else self.system.coordinates(geographic(ellipsoid, position))


def _tilted(axes: FloatArray, slope: FloatArray) -> FloatArray:
    """Return axes (n, 3, 3) turned so that the third is normal to water of a slope (3,) over the second two."""
    up = axes[:, 2]
    normal = up - (slope - up * (up @ slope)[:, None])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    north = cross(normal, axes[:, 0])
    north /= np.linalg.norm(north, axis=1)[:, None]
    return np.stack([cross(north, normal), north, normal], axis=1)
