"""The world of a simulated job: from plan coordinates to places that a deck can hold without rounding.

Every true coordinate is rounded to the precision of the cards before anything is imaged, so that a deck without
errors is consistent to the rounding of its plate coordinates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import pyproj
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import CoordinateSystem, EllipsoidSpec
from musatpy.simulation.scene_keys import JobKeys
from musatpy.units import DEGREE, dms_from_radians, radians_from_dms

SECONDS_DECIMALS = 5  # of latitudes and longitudes on the cards
ATTITUDE_DECIMALS = 4  # of the seconds of attitudes
METRE_DECIMALS = 4  # of heights, X, Y, Z


@dataclass(frozen=True, kw_only=True)
class TruePlaces:
    """k places, on the grid of the cards."""

    job: FloatArray  # (k, 3) in the job's system, as model.Photos and model.Control hold it
    xyz: FloatArray  # (k, 3) m, geocentric or local
    natural: FloatArray  # (k, 3) latitude, longitude (rad), height (m); in local jobs X, Y, Z
    vertical: FloatArray  # (k, 3, 3) from xyz to east, north, up

    def __getitem__(self, rows: IntArray) -> TruePlaces:
        return TruePlaces(**{name: values[rows] for name, values in vars(self).items()})

    def with_more(self, others: TruePlaces) -> TruePlaces:
        """Return these places and others, one after the other."""
        return TruePlaces(
            **{name: np.concatenate([values, vars(others)[name]]) for name, values in vars(self).items()}
        )


class World(ABC):
    """What the simulation needs of a coordinate system."""

    ellipsoid: EllipsoidSpec | None = None  # the card; None in local jobs
    axes_of_ellipsoid: tuple[float, float] | None = None  # semi-major axis, m, and eccentricity squared

    def at_plan(self, plan: FloatArray, height: FloatArray) -> TruePlaces:
        """Return the places at plan coordinates (k, 2) m, east and north of the centre, and heights (k,) m."""
        return self.at_natural(np.column_stack([self.plane(plan), height]))

    @abstractmethod
    def plane(self, plan: FloatArray) -> FloatArray:
        """Return latitudes and longitudes (rad), or local X and Y, (k, 2), of plan coordinates (k, 2) m."""

    @abstractmethod
    def at_job(self, job: FloatArray) -> TruePlaces:
        """Return the places of coordinates (k, 3) in the job's system, put on the grid of the cards."""

    def at_xyz(self, xyz: FloatArray) -> TruePlaces:
        """Return the places of Cartesian coordinates (k, 3), put on the grid of the cards."""
        return self.at_job(xyz)

    def at_natural(self, natural: FloatArray) -> TruePlaces:
        """Return the places of latitudes, longitudes (rad) and heights, or of local X, Y, Z (k, 3), on the grid."""
        return self.at_job(natural)

    @abstractmethod
    def plan(self, places: TruePlaces) -> FloatArray:
        """Return plan coordinates (k, 2) m."""

    @abstractmethod
    def axes(self, xyz: FloatArray) -> FloatArray:
        """Return east, north, up (3, 3) at Cartesian coordinates (3,)."""


def on_grid(angle: ArrayLike, decimals: int) -> FloatArray:
    """Return angles (rad) rounded to that many decimals of a second, as a card gives them back."""
    return radians_from_dms(*dms_from_radians(angle, decimals))


def world_of(job: JobKeys) -> World:
    """Return the world of a job. Raises `ValueError` where PROJ does not know the ellipsoid."""
    return LocalWorld(job) if job.system == CoordinateSystem.LOCAL else EarthWorld(job)


class LocalWorld(World):
    """A local rectangular job: the vertical is +Z everywhere."""

    def __init__(self, job: JobKeys) -> None:
        self.centre = np.array(job.centre)

    def plane(self, plan: FloatArray) -> FloatArray:
        return plan + self.centre

    def at_job(self, job: FloatArray) -> TruePlaces:
        xyz = np.round(job, METRE_DECIMALS)
        return TruePlaces(job=xyz, xyz=xyz, natural=xyz, vertical=np.broadcast_to(np.eye(3), (len(xyz), 3, 3)))

    def plan(self, places: TruePlaces) -> FloatArray:
        return places.xyz[:, :2] - self.centre

    def axes(self, xyz: FloatArray) -> FloatArray:
        return np.eye(3)


class EarthWorld(World):
    """A job on an ellipsoid, geographic or geocentric; its plan is the tangent plane at the centre."""

    def __init__(self, job: JobKeys) -> None:
        self.ellipsoid = EllipsoidSpec(name=job.ellipsoid)
        self.earth = Ellipsoid.of(self.ellipsoid)
        size = pyproj.Geod(initstring=self.earth.definition)
        self.axes_of_ellipsoid = float(size.a), float(size.es)
        self.geographic = job.system == CoordinateSystem.GEOGRAPHIC
        centre = np.array([*job.centre, 0.0]) * [DEGREE, DEGREE, 1.0]
        self.origin, self.to_plan = self.earth.geocentric(centre), self.earth.frame(centre)

    def plane(self, plan: FloatArray) -> FloatArray:
        return self.earth.geographic(self.origin + plan @ self.to_plan[:2])[:, :2]

    def at_job(self, job: FloatArray) -> TruePlaces:
        if self.geographic:
            angles = on_grid(job[:, :2], SECONDS_DECIMALS)
            natural = np.column_stack([angles, np.round(job[:, 2], METRE_DECIMALS)])
            given, xyz = natural, self.earth.geocentric(natural)
        else:
            given = xyz = np.round(job, METRE_DECIMALS)
            natural = self.earth.geographic(xyz)
        return TruePlaces(job=given, xyz=xyz, natural=natural, vertical=self.earth.frame(natural))

    def at_xyz(self, xyz: FloatArray) -> TruePlaces:
        return self.at_job(self.earth.geographic(xyz) if self.geographic else xyz)

    def at_natural(self, natural: FloatArray) -> TruePlaces:
        return self.at_job(natural if self.geographic else self.earth.geocentric(natural))

    def plan(self, places: TruePlaces) -> FloatArray:
        return (places.xyz - self.origin) @ self.to_plan[:2].T

    def axes(self, xyz: FloatArray) -> FloatArray:
        return self.earth.frame(self.earth.geographic(xyz))
