"""Earth curvature, for jobs whose plane coordinates are those of a grid and whose heights count from the curved
earth.

A point at the distance s from the nadir lies s^2/(2 R) below the tangent plane, so that its image falls short of
where a flat ground would put it by dr = H' r^3 / (2 R f^2) on a vertical photo, H' the height above the ground
and R the radius of the earth. Geographic and geocentric jobs have the true shape of the ground, and must not be
corrected.
"""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.arrays import FloatArray
from musatpy.reduction import nadir
from musatpy.reduction.inversion import invert
from musatpy.reduction.nadir import View

EARTH_RADIUS = 6371000.0  # m, mean radius


@dataclass(frozen=True, kw_only=True, eq=False)
class Curvature:
    """The curvature that one photo sees."""

    view: View
    height: float  # m, of the camera above the ground
    radius: float = EARTH_RADIUS  # m

    def apply(self, xy: FloatArray) -> FloatArray:
        """Return the images (..., 2) mm that a flat ground would give: moved away from the nadir."""
        return nadir.bend(self.view, xy, 0.0, self._c)

    def inverse(self, xy: FloatArray) -> FloatArray:
        """Return the images (..., 2) of the curved earth."""
        return invert(self.apply, self.partials, xy)

    def partials(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (..., 2, 2) of the flattened images by the images xy."""
        return nadir.bend_partials(self.view, xy, 0.0, self._c)

    def by_parameters(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (..., 2, 1) of the flattened images by the height above ground, mm/m."""
        by_c = nadir.bend_by_parameters(self.view, xy, 0.0, self._c)[..., 1:]
        return -by_c / (2.0 * self.radius)

    @property
    def _c(self) -> float:
        """The drop over the height, H' tan^2(q)/(2 R), shortens the vertical part of the vector."""
        return -self.height / (2.0 * self.radius)
