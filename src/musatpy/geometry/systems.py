"""Coordinate systems in which a job may be stated: positions both ways, their rates, and the axes of attitudes.

Between all systems on the ellipsoid stand level coordinates, as in `frames`: latitude and longitude (rad) and
ellipsoidal height (m); those of a local rectangular job are its X, Y, Z. Projected systems are in `projected`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import SystemsError
from musatpy.geometry.geodesy import Ellipsoid


@dataclass(frozen=True, kw_only=True, eq=False)
class MapFactors:
    """What a map does at n points on the ellipsoid, (...)."""

    convergence: FloatArray  # rad, from true to grid north, clockwise
    meridian_scale: FloatArray  # map over ellipsoid along the meridian
    parallel_scale: FloatArray  # along the parallel; that of the meridian where the map is conformal


class HeightModel(Protocol):
    """A geoid model."""

    def reached(self, level: ArrayLike) -> FloatArray:
        """Return the undulations (...) at level positions (..., 3). Raises `SystemsError` outside its grid."""


class System(ABC):
    """One coordinate system. Arrays are (..., 3); a coordinate that is not a number is not known."""

    ellipsoid: Ellipsoid | None = None  # None: not on the ellipsoid
    names: tuple[str, str, str]  # of the three coordinates
    units: tuple[str, str, str] = ("m", "m", "m")  # of these
    plane_alone = True  # two coordinates are a horizontal position whatever the third
    height_alone = True  # the third is a height wherever it is
    own_axes = True  # attitudes can refer to axes of the system
    plane = True  # the first two coordinates are lengths in a plane
    geoid: HeightModel | None = None  # above which heights are; None: the ellipsoid, or Z

    def __init__(self, text: str) -> None:
        self.text = text  # what the system is, in a line

    @property
    def decimals(self) -> tuple[int, int, int]:
        """How many decimals of coordinates are worth writing in a file: 0.1 mm."""
        return 4, 4, 4

    def coordinates(self, level: ArrayLike) -> FloatArray:
        """Return coordinates of level ones: these. Raises `SystemsError` where the system does not reach."""
        return np.array(level, dtype=float)

    def level(self, coordinates: ArrayLike) -> FloatArray:
        """Return level coordinates: these. Raises `SystemsError` where the system does not reach."""
        return np.array(coordinates, dtype=float)

    def undulation(self, level: ArrayLike) -> FloatArray:
        """Return the height (...) m of the surface from which heights count, above the ellipsoid.

        Raises `SystemsError` outside the grid of a geoid model.
        """
        return np.zeros(np.shape(level)[:-1]) if self.geoid is None else self.geoid.reached(level)

    def outside(self, level: ArrayLike) -> BoolArray:
        """Return (...) where positions lie outside the area for which the system is meant."""
        return np.zeros(np.shape(level)[:-1], dtype=bool)

    def factors(self, level: ArrayLike) -> MapFactors | None:
        """Return convergence and scale factors of a map at level positions (..., 3); None of what is no map."""
        return None

    @abstractmethod
    def jacobian(self, level: ArrayLike) -> FloatArray:
        """Return d(coordinates)/d(east, north, up) (..., 3, 3), by metres along the local axes there."""

    def axes(self, level: ArrayLike) -> FloatArray:
        """Return the axes of the system (..., 3, 3) that attitudes refer to, as rows along east, north, up."""
        return self.jacobian(level)


class LocalRectangular(System):
    """A right-handed rectangular system that stands nowhere on the ellipsoid: the vertical is +Z everywhere."""

    names = ("X", "Y", "Z")

    def __init__(self) -> None:
        super().__init__("local rectangular")

    def jacobian(self, level: ArrayLike) -> FloatArray:
        return np.broadcast_to(np.eye(3), (*np.shape(level)[:-1], 3, 3))


class Geographic(System):
    """Latitude and longitude (rad) and ellipsoidal height (m)."""

    names = ("latitude", "longitude", "height")
    units = ("rad", "rad", "m")
    own_axes = plane = False

    def __init__(self, ellipsoid: Ellipsoid) -> None:
        super().__init__("geographic, ellipsoidal heights")
        self.ellipsoid: Ellipsoid = ellipsoid

    def jacobian(self, level: ArrayLike) -> FloatArray:
        meridian, parallel = radii(self.ellipsoid, level)
        out = np.zeros((*meridian.shape, 3, 3))
        out[..., 0, 1] = 1.0 / meridian
        out[..., 1, 0] = 1.0 / parallel
        out[..., 2, 2] = 1.0
        return out

    def axes(self, level: ArrayLike) -> FloatArray:
        raise SystemsError.of("attitudes have no axes of a geographic system to refer to")


class Geocentric(System):
    """Geocentric X, Y, Z (m)."""

    names = ("X", "Y", "Z")
    plane_alone = height_alone = plane = False

    def __init__(self, ellipsoid: Ellipsoid) -> None:
        super().__init__("geocentric")
        self.ellipsoid: Ellipsoid = ellipsoid

    def coordinates(self, level: ArrayLike) -> FloatArray:
        return self.ellipsoid.geocentric(level)

    def level(self, coordinates: ArrayLike) -> FloatArray:
        return geographic(self.ellipsoid, coordinates)

    def jacobian(self, level: ArrayLike) -> FloatArray:
        return np.swapaxes(self.ellipsoid.frame(level), -1, -2)


class TangentPlane(System):
    """Local rectangular coordinates (m) in the tangent plane at an origin: X east, Y north, Z up there.

    `origin` is the latitude, longitude (rad) and height (m) of the point whose coordinates are `false`. Away from
    it the vertical leans: the Z of a point is no height (0.8 m less than one at 3.2 km).
    """

    names = ("X", "Y", "Z")
    plane_alone = height_alone = False

    def __init__(self, ellipsoid: Ellipsoid, origin: ArrayLike, false: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        self.ellipsoid: Ellipsoid = ellipsoid
        self.origin, self.false = np.array(origin, dtype=float), np.array(false, dtype=float)
        given = self.origin.shape == self.false.shape == (3,) and np.isfinite([self.origin, self.false]).all()
        if not given or abs(self.origin[0]) > np.pi / 2.0:
            message = "a tangent plane needs latitude (within 90 degrees), longitude and height of its origin"
            raise SystemsError.of(message)
        latitude, longitude = np.degrees(self.origin[:2])
        place = f"latitude {latitude:.8f}, longitude {longitude:.8f} degrees, height {self.origin[2]:.3f} m"
        false_place = ", ".join(f"{name} {value:.3f}" for name, value in zip(self.names, self.false, strict=True))
        super().__init__(f"tangent plane at {place}" + (f" ({false_place} there)" if self.false.any() else ""))
        self._centre, self._frame = ellipsoid.geocentric(self.origin), ellipsoid.frame(self.origin)

    def coordinates(self, level: ArrayLike) -> FloatArray:
        gap = self.ellipsoid.geocentric(level) - self._centre
        return gap @ self._frame.T + self.false

    def level(self, coordinates: ArrayLike) -> FloatArray:
        gap = (np.asarray(coordinates, dtype=float) - self.false) @ self._frame
        return geographic(self.ellipsoid, self._centre + gap)

    def jacobian(self, level: ArrayLike) -> FloatArray:
        return self._frame @ np.swapaxes(self.ellipsoid.frame(level), -1, -2)


def geographic(ellipsoid: Ellipsoid, geocentric: ArrayLike) -> FloatArray:
    """Return latitude, longitude (rad) and height (m), (..., 3), of X, Y, Z (..., 3) m, to the last bits.

    PROJ's formula (Bowring's) is good to a micrometre up to some kilometres of height; a Newton step mends that.
    """
    xyz = np.asarray(geocentric, dtype=float)
    out = ellipsoid.geographic(xyz)
    missed = xyz - ellipsoid.geocentric(out)
    return moved(ellipsoid, out, np.einsum("...ij,...j->...i", ellipsoid.frame(out), missed))


def moved(ellipsoid: Ellipsoid, level: ArrayLike, metres: ArrayLike) -> FloatArray:
    """Return level positions (..., 3) moved by small east, north, up (..., 3) m."""
    out, metres = np.array(level, dtype=float), np.asarray(metres)
    meridian, parallel = radii(ellipsoid, out)
    out[..., 0] += metres[..., 1] / meridian
    out[..., 1] += metres[..., 0] / parallel
    out[..., 2] += metres[..., 2]
    return out


def radii(ellipsoid: Ellipsoid, level: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return metres per radian (...) of latitude and of longitude at level positions (..., 3), in their heights."""
    level = np.asarray(level, dtype=float)
    a, b = ellipsoid.axes
    eccentricity_squared = 1.0 - (b / a) ** 2
    latitude, height = level[..., 0], level[..., 2]
    w = np.sqrt(1.0 - eccentricity_squared * np.sin(latitude) ** 2)
    meridian = a * (1.0 - eccentricity_squared) / w**3 + height
    return meridian, (a / w + height) * np.cos(latitude)
