"""Earth curvature, for jobs whose plane coordinates are those of a grid and whose heights count from the curved
earth.

A point at the distance s from the nadir lies s^2/(2 R) below the tangent plane, so that its image falls short of
where a flat ground would put it by dr = H' r^3 / (2 R f^2) on a vertical photo, H' the height above the ground
and R the radius of the earth. Geographic and geocentric jobs have the true shape of the ground, and must not be
corrected.
"""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.reduction.nadir import Displacement

EARTH_RADIUS = 6371000.0  # m, mean radius


@dataclass(frozen=True, kw_only=True, eq=False)
class Curvature(Displacement):
    """The curvature that one photo sees: its images are moved away from the nadir, as of flat ground."""

    height: float  # m, of the camera above the ground
    radius: float = EARTH_RADIUS  # m

    @property
    def coefficients(self) -> tuple[float, float]:
        """The drop over the height, H' tan^2(q)/(2 R), shortens the vertical part of the vector."""
        return 0.0, -self.height / (2.0 * self.radius)
