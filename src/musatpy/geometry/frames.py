"""The working frame of a job: Cartesian axes in which stations and points are adjusted, and its vertical."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray
from musatpy.geometry.geodesy import Ellipsoid, Value

_FINEST = -6.0  # decimals of a middle of stations


class Frame(ABC):
    """Coordinates of a job in three guises, all (..., 3).

    - system: as the deck gives them;
    - working: Cartesian metres about `origin`, in which the adjustment runs;
    - level: two horizontal coordinates and the height (latitude, longitude, height or X, Y, Z).
    """

    curved = True  # the vertical turns from place to place

    def __init__(self, origin: FloatArray) -> None:
        self.origin = origin

    def working(self, system: ArrayLike) -> FloatArray:
        """Return working coordinates of system ones."""
        return np.asarray(system, dtype=float) - self.origin

    def system(self, working: ArrayLike) -> FloatArray:
        """Return system coordinates of working ones."""
        return np.asarray(working, dtype=float) + self.origin

    @abstractmethod
    def level(self, working: ArrayLike) -> FloatArray:
        """Return level coordinates of working ones."""

    @abstractmethod
    def from_level(self, level: ArrayLike) -> FloatArray:
        """Return working coordinates of level ones."""

    @abstractmethod
    def axes_at(self, level: ArrayLike) -> FloatArray:
        """Return (..., 3, 3): rows east, north, up at level coordinates, in working axes."""

    def axes(self, working: ArrayLike) -> FloatArray:
        """Return the same at working positions."""
        return self.axes_at(self.level(working))

    def height(self, working: ArrayLike) -> FloatArray:
        """Return the height (...) above the ellipsoid, or Z."""
        return self.level(working)[..., 2]

    def vertical(self, working: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the direction up (..., 3) and the height (...) at working positions, in working axes."""
        level = self.level(working)  # once for both
        return self.axes_at(level)[..., 2, :], level[..., 2]

    @abstractmethod
    def vertical_at(self, x: Value, y: Value, z: Value) -> tuple[tuple[Value, Value, Value], Value]:
        """Return `vertical` by components, numbers of one position or arrays of many, without PROJ.

        Heights are those of PROJ to some nanometres near the ellipsoid, to a micrometre 10 km from it.
        """


def middle_of(stations: FloatArray) -> FloatArray:
    """Return the middle (3,) of stations (n, 3): the working origin, about which water tilts.

    Rounded to whole units, so that a restart turns the water about the same place; of scenes below a hundred units
    to the power of ten between a thousandth and a hundredth of the extent of the stations.
    """
    extent = float(np.ptp(stations, axis=0).max())
    step = 10.0 ** np.clip(np.floor(np.log10(extent)) - 2.0, _FINEST, 0.0) if extent > 0.0 else 10.0**_FINEST
    return np.asarray(np.rint(stations.mean(axis=0) / step) * step)


class LocalFrame(Frame):
    """A local rectangular job: the vertical is +Z everywhere."""

    curved = False

    def level(self, working: ArrayLike) -> FloatArray:
        return self.system(working)

    def from_level(self, level: ArrayLike) -> FloatArray:
        return self.working(level)

    def axes_at(self, level: ArrayLike) -> FloatArray:
        shape = np.asarray(level).shape[:-1]
        return np.broadcast_to(np.eye(3), (*shape, 3, 3))

    def height(self, working: ArrayLike) -> FloatArray:
        return np.asarray(working, dtype=float)[..., 2] + self.origin[2]

    def vertical(self, working: ArrayLike) -> tuple[FloatArray, FloatArray]:
        return np.broadcast_to(np.eye(3)[2], np.shape(working)), self.height(working)

    def vertical_at(self, x: Value, y: Value, z: Value) -> tuple[tuple[Value, Value, Value], Value]:
        none = 0.0 * z
        return (none, none, none + 1.0), z + float(self.origin[2])


class GeocentricFrame(Frame):
    """A geocentric job: working axes are the geocentric ones, the vertical is that of the ellipsoid."""

    def __init__(self, origin: FloatArray, ellipsoid: Ellipsoid) -> None:
        super().__init__(origin)
        self.ellipsoid = ellipsoid

    def level(self, working: ArrayLike) -> FloatArray:
        return self.ellipsoid.geographic(np.asarray(working) + self.origin)

    def from_level(self, level: ArrayLike) -> FloatArray:
        return self.ellipsoid.geocentric(level) - self.origin

    def axes_at(self, level: ArrayLike) -> FloatArray:
        return self.ellipsoid.frame(level)

    def vertical_at(self, x: Value, y: Value, z: Value) -> tuple[tuple[Value, Value, Value], Value]:
        a, b, c = self._middle
        return self.ellipsoid.vertical(x + a, y + b, z + c)

    def vertical(self, working: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the same; the longitude is where the place is, which saves its sine and cosine."""
        place = np.asarray(working) + self.origin
        latitude, height = np.moveaxis(self.ellipsoid.geographic(place)[..., [0, 2]], -1, 0)
        up, off_axis = np.empty(place.shape), np.hypot(place[..., 0], place[..., 1])
        scale = np.cos(latitude) / np.where(off_axis > 0.0, off_axis, 1.0)
        np.multiply(place[..., :2], scale[..., None], out=up[..., :2])
        up[..., 2] = np.sin(latitude)
        return up, height

    @cached_property
    def _middle(self) -> tuple[float, float, float]:
        x, y, z = self.origin.tolist()
        return x, y, z


class GeographicFrame(GeocentricFrame):
    """A geographic job: as a geocentric one, its deck in latitude, longitude (rad) and height (m)."""

    def working(self, system: ArrayLike) -> FloatArray:
        return self.from_level(system)

    def system(self, working: ArrayLike) -> FloatArray:
        return self.level(working)
