"""Ellipsoids and geodetic conversions, through pyproj, and the working frame of a job with its vertical.

The frame has the Cartesian axes in which stations and points are adjusted.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import pyproj
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray
from musatpy.errors import SystemsError
from musatpy.geometry.collinearity import local_vertical

_SAME_AXIS = 1e-6  # m: GRS 80 and WGS 84 differ by 1e-4 m in their semi-minor axes, and are two ellipsoids
_FINEST = -6.0  # decimals of a middle of stations


class EllipsoidNumbers(Protocol):
    """What states an ellipsoid: a name that PROJ knows, or two numbers."""

    @property
    def name(self) -> str: ...
    @property
    def semi_major_axis(self) -> float | None: ...
    @property
    def inverse_flattening(self) -> float | None: ...


class Ellipsoid:
    """An ellipsoid of revolution.

    `Ellipsoid("clrk66")` takes any name that PROJ knows (`pyproj.get_ellps_map`), whatever its case;
    `Ellipsoid(semi_major_axis=6378206.4, inverse_flattening=294.978698214)` its two numbers, an inverse
    flattening of 0 being a sphere. Raises `ValueError` where the name is unknown.
    """

    def __init__(
        self, name: str = "", semi_major_axis: float | None = None, inverse_flattening: float | None = None
    ) -> None:
        if name:
            known = {key.lower(): key for key in pyproj.get_ellps_map()}
            if name.lower() not in known:
                raise ValueError(f"'{name}' is not an ellipsoid that PROJ knows")
            self.definition = f"+ellps={known[name.lower()]}"
        elif semi_major_axis is not None:
            flattening = f"+rf={inverse_flattening!r}" if inverse_flattening else "+f=0"
            self.definition = f"+a={float(semi_major_axis)!r} {flattening}"
        else:
            raise ValueError("an ellipsoid needs a name or a semi-major axis")

    @classmethod
    def of(cls, spec: EllipsoidNumbers) -> Ellipsoid:
        """Return the ellipsoid that the cards of a job state. Raises `ValueError` like the class."""
        return cls(spec.name, spec.semi_major_axis, spec.inverse_flattening)

    def __getstate__(self) -> dict[str, str]:
        """Return what makes the ellipsoid: conversions of PROJ cannot be handed to other processes."""
        return {"definition": self.definition}

    @cached_property
    def axes(self) -> tuple[float, float]:
        """Semi-major and semi-minor axis, m."""
        size = pyproj.Geod(initstring=self.definition)
        return float(size.a), float(size.b)

    def has_axes(self, semi_major: float, semi_minor: float) -> bool:
        """Return whether these are the axes (m) of the ellipsoid, to a micrometre."""
        a, b = self.axes
        return abs(a - semi_major) < _SAME_AXIS and abs(b - semi_minor) < _SAME_AXIS

    @cached_property
    def _cart(self) -> pyproj.Transformer:
        return pyproj.Transformer.from_pipeline(f"+proj=cart {self.definition}")

    def geocentric(self, geographic: ArrayLike) -> FloatArray:
        """Return X, Y, Z (..., 3) m of latitude, longitude (rad) and ellipsoidal height (m), (..., 3)."""
        place = np.asarray(geographic, dtype=float)
        out = np.empty(place.shape)
        out[..., 0], out[..., 1], out[..., 2] = self._cart.transform(
            place[..., 1], place[..., 0], place[..., 2], radians=True
        )
        return out

    def geographic(self, geocentric: ArrayLike) -> FloatArray:
        """Return latitude, longitude (rad) and ellipsoidal height (m), (..., 3), of X, Y, Z (..., 3) m."""
        place = np.asarray(geocentric, dtype=float)
        out = np.empty(place.shape)
        out[..., 1], out[..., 0], out[..., 2] = self._cart.transform(
            place[..., 0], place[..., 1], place[..., 2], radians=True, direction="INVERSE"
        )
        return out

    def frame(self, geographic: ArrayLike) -> FloatArray:
        """Return the rotations geocentric -> east, north, up (..., 3, 3) at geographic positions (..., 3)."""
        geographic = np.asarray(geographic, dtype=float)
        return local_vertical(geographic[..., 0], geographic[..., 1])


def ellipsoid_by(spec: EllipsoidNumbers | None, system: str) -> Ellipsoid:
    """Return the ellipsoid of a spec, for a job of a system. Raises `SystemsError` where missing or unknown."""
    if spec is None:
        raise SystemsError.of(f"a {system} job needs an ellipsoid")
    try:
        return Ellipsoid.of(spec)
    except ValueError as error:
        raise SystemsError.of(error) from error


def metric_differences(
    system: str, spec: EllipsoidNumbers | None, given: FloatArray, other: FloatArray
) -> FloatArray:
    """Return others minus given positions (n, 3) of a job of a system, metres along east, north, up of the given.

    In local jobs the axes are those of the frame. A component that is not given (NaN) is NaN in the result, and
    takes no part in that of the others. Raises `SystemsError` where the ellipsoid is missing or unknown.
    """
    if system == "LOCL":
        return other - given
    ellipsoid, geographic = ellipsoid_by(spec, system), system == "GEOG"
    start = np.where(np.isnan(given), other, given)
    frames = ellipsoid.frame(start if geographic else ellipsoid.geographic(start))
    shift = ellipsoid.geocentric(other) - ellipsoid.geocentric(start) if geographic else other - start
    missing = np.asarray(np.isnan(given))
    if not geographic:  # X, Y, Z mix east, north and up: without one of them none is known
        missing = np.repeat(missing.any(axis=1), 3).reshape(given.shape)
    return np.where(missing, np.nan, np.einsum("nij,nj->ni", frames, shift))


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

    def vertical(self, working: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the same, once for all rays to a point, which follow each other.

        The longitude is where the place is, which saves its sine and cosine.
        """
        place = (np.asarray(working, dtype=float) + self.origin).reshape(-1, 3)
        other = np.append(True, (place[1:] != place[:-1]).any(axis=1))[: len(place)]
        place = place[other]
        latitude, height = self.ellipsoid.geographic(place)[:, [0, 2]].T
        up, off_axis = np.empty(place.shape), np.hypot(place[:, 0], place[:, 1])
        scale = np.cos(latitude) / np.where(off_axis > 0.0, off_axis, 1.0)
        np.multiply(place[:, :2], scale[:, None], out=up[:, :2])
        up[:, 2] = np.sin(latitude)
        row, shape = np.cumsum(other) - 1, np.shape(working)
        return up.take(row, axis=0).reshape(shape), height.take(row).reshape(shape[:-1])


class GeographicFrame(GeocentricFrame):
    """A geographic job: as a geocentric one, its deck in latitude, longitude (rad) and height (m)."""

    def working(self, system: ArrayLike) -> FloatArray:
        return self.from_level(system)

    def system(self, working: ArrayLike) -> FloatArray:
        return self.level(working)


def frame_of(system: str, spec: EllipsoidNumbers | None, stations: FloatArray | None = None) -> Frame:
    """Return the frame of a job of a system (LOCL, GEOC, GEOG) about the middle of its stations (n, 3), or about 0.

    Raises `SystemsError` where its ellipsoid is missing or unknown.
    """
    if system == "LOCL":
        return LocalFrame(np.zeros(3) if stations is None else middle_of(stations))
    ellipsoid, kind = ellipsoid_by(spec, system), GeographicFrame if system == "GEOG" else GeocentricFrame
    if stations is None:
        return kind(np.zeros(3), ellipsoid)
    return kind(middle_of(ellipsoid.geocentric(stations) if system == "GEOG" else stations), ellipsoid)


@dataclass(frozen=True, kw_only=True, eq=False)
class TiltedWater:
    """The water surface over ground points: a plane, through the level surface that it is tilted against.

    normal (..., 3), depth (...) m of the ground point below it, along the normal; the two that follow are what
    `by_tilt` needs: the slope vector (..., 3) across the vertical, and 1/cos of the tilt (...).
    """

    normal: FloatArray
    depth: FloatArray
    gradient: FloatArray
    secant: FloatArray


def water_heights(slope: FloatArray, tide: FloatArray, ground: FloatArray) -> FloatArray:
    """Return the heights (...) of the water at ground points (..., 3), working, where tides (...) hold.

    `slope` (3,) is the slope vector in working axes; the surface turns about the working origin, which is the
    middle of the stations.
    """
    if not slope.any():
        return np.broadcast_to(tide, ground.shape[:-1])
    return tide + ground @ slope


def surface(frame: Frame, slope: FloatArray, tide: FloatArray, ground: FloatArray) -> TiltedWater:
    """Return the water surface over ground points (..., 3) at tides (...)."""
    up, height = frame.vertical(ground)
    below = water_heights(slope, tide, ground) - height
    if not slope.any():
        level = np.broadcast_to(0.0, up.shape), np.broadcast_to(1.0, below.shape)  # which take no memory
        return TiltedWater(normal=up, depth=below, gradient=level[0], secant=level[1])
    gradient = slope - up * (up @ slope)[..., None]
    secant = np.sqrt(1.0 + np.sum(np.square(gradient), axis=-1))
    return TiltedWater(
        normal=(up - gradient) / secant[..., None], depth=below / secant, gradient=gradient, secant=secant
    )


def by_tilt(
    at: TiltedWater, axis: FloatArray, ground: FloatArray, camera: FloatArray, v: FloatArray, by_camera: FloatArray,
    by_depth: FloatArray,
) -> FloatArray:  # fmt: skip
    """Return the partial derivative (..., 3) of v = W - C by the slope of the surface along `axis` (3,).

    The surface turns about the ground point by omega, which is the same as turning camera and water point back,
    and rises over it.
    """
    across = np.asarray(at.gradient @ axis)[..., None]
    secant = at.secant[..., None]
    up = secant * at.normal + at.gradient
    normal_by_slope = -(axis - up * (up @ axis)[..., None]) / secant - at.normal * across / secant**2
    omega = np.cross(at.normal, normal_by_slope)
    depth_by_slope = (ground @ axis)[..., None] / secant - at.depth[..., None] * across / secant**2
    back = np.einsum("...ij,...j->...i", by_camera, np.cross(omega, camera - ground))
    return np.cross(omega, v) - back + by_depth * depth_by_slope
