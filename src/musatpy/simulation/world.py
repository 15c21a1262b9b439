"""The world of a simulated job: from plan coordinates to places that a deck can hold without rounding.

Every true coordinate is rounded to the precision of the cards before anything is imaged, so that a deck without
errors is consistent to the rounding of its plate coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyproj
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray, InRows
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import CoordinateSystem, EllipsoidSpec
from musatpy.simulation.scene_keys import JobKeys
from musatpy.units import DEGREE, dms_from_radians, radians_from_dms

SECONDS_DECIMALS = 5  # of latitudes and longitudes on the cards
ATTITUDE_DECIMALS = 4  # of the seconds of attitudes
METRE_DECIMALS = 4  # of heights, X, Y, Z


@dataclass(frozen=True, kw_only=True)
class TruePlaces(InRows):
    """k places, on the grid of the cards."""

    job: FloatArray  # (k, 3) in the job's system, as model.Photos and model.Control hold it
    xyz: FloatArray  # (k, 3) m, geocentric or local
    natural: FloatArray  # (k, 3) latitude, longitude (rad), height (m); in local jobs X, Y, Z
    vertical: FloatArray  # (k, 3, 3) from xyz to east, north, up


def on_grid(angle: ArrayLike, decimals: int) -> FloatArray:
    """Return angles (rad) rounded to that many decimals of a second, as a card gives them back."""
    return radians_from_dms(*dms_from_radians(angle, decimals))


class World:
    """The coordinate system of a simulated job: its plan is the tangent plane at the centre, east and north in m.

    In a local job the vertical is +Z everywhere; else it stands on an ellipsoid, geographic or geocentric. Raises
    `ValueError` where PROJ does not know the ellipsoid.
    """

    def __init__(self, job: JobKeys) -> None:
        self.ellipsoid: EllipsoidSpec | None = None  # the card; None in local jobs
        self.axes_of_ellipsoid: tuple[float, float] | None = None  # semi-major axis, m, and eccentricity squared
        self.earth: Ellipsoid | None = None
        self.geographic = job.system == CoordinateSystem.GEOGRAPHIC
        self.origin, self.to_plan = np.array([*job.centre, 0.0]), np.eye(3)
        if job.system != CoordinateSystem.LOCAL:
            self.ellipsoid = EllipsoidSpec(name=job.ellipsoid)
            self.earth = Ellipsoid.of(self.ellipsoid)
            size = pyproj.Geod(initstring=self.earth.definition)
            self.axes_of_ellipsoid = float(size.a), float(size.es)
            centre = self.origin * [DEGREE, DEGREE, 1.0]
            self.origin, self.to_plan = self.earth.geocentric(centre), self.earth.frame(centre)

    def at_plan(self, plan: FloatArray, height: FloatArray) -> TruePlaces:
        """Return the places at plan coordinates (k, 2) m, east and north of the centre, and heights (k,) m."""
        return self.at_natural(np.column_stack([self.plane(plan), height]))

    def plane(self, plan: FloatArray) -> FloatArray:
        """Return latitudes and longitudes (rad), or local X and Y, (k, 2), of plan coordinates (k, 2) m."""
        xyz = self.origin + plan @ self.to_plan[:2]
        return xyz[:, :2] if self.earth is None else self.earth.geographic(xyz)[:, :2]

    def at_job(self, job: FloatArray) -> TruePlaces:
        """Return the places of coordinates (k, 3) in the job's system, put on the grid of the cards."""
        job = np.column_stack([job[:, :2], np.round(job[:, 2], METRE_DECIMALS)])
        job[:, :2] = (
            on_grid(job[:, :2], SECONDS_DECIMALS) if self.geographic else np.round(job[:, :2], METRE_DECIMALS)
        )
        if self.earth is None:
            vertical = np.broadcast_to(np.eye(3), (len(job), 3, 3))
            return TruePlaces(job=job, xyz=job, natural=job, vertical=vertical)
        natural = job if self.geographic else self.earth.geographic(job)
        xyz = self.earth.geocentric(job) if self.geographic else job
        return TruePlaces(job=job, xyz=xyz, natural=natural, vertical=self.earth.frame(natural))

    def at_xyz(self, xyz: FloatArray) -> TruePlaces:
        """Return the places of Cartesian coordinates (k, 3), put on the grid of the cards."""
        return self.at_job(self.earth.geographic(xyz) if self.earth and self.geographic else xyz)

    def at_natural(self, natural: FloatArray) -> TruePlaces:
        """Return the places of latitudes, longitudes (rad) and heights, or of local X, Y, Z (k, 3), on the grid."""
        return self.at_job(natural if self.earth is None or self.geographic else self.earth.geocentric(natural))

    def plan(self, places: TruePlaces) -> FloatArray:
        """Return plan coordinates (k, 2) m."""
        return (places.xyz - self.origin) @ self.to_plan[:2].T

    def axes(self, xyz: FloatArray) -> FloatArray:
        """Return east, north, up (3, 3) at Cartesian coordinates (3,)."""
        return np.eye(3) if self.earth is None else self.earth.frame(self.earth.geographic(xyz))
