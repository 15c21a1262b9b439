"""The survey of fixtures/lagoon on the ellipsoid, made without the package: by pyproj and textbook formulas.

Every station and true point of the lagoon keeps its numbers: x and y east and north of an origin on a conformal
map, z the height above the ellipsoid; attitudes are those in the vertical of each station, tides those above the
ellipsoid. The water is the level surface: over 1.6 km it bends by 5 cm from any plane, so that images differ from
those of the local job, and are traced anew, as is where their rays meet in air. True points are the same.
"""

import math
from functools import cache

import numpy as np
import pyproj
from scipy.optimize import brentq, least_squares

from depth import lagoon

LATITUDE, LONGITUDE = 18.338, -64.93  # St. Thomas
_A, _F = 6378137.0, 1.0 / 298.257223563  # WGS 84
MAP = f"+proj=tmerc +lat_0={LATITUDE} +lon_0={LONGITUDE} +ellps=WGS84"
GEOCENTRIC = "+proj=geocent +ellps=WGS84"


def geographic(place: np.ndarray) -> np.ndarray:
    """Latitude, longitude (rad) and height of map coordinates and height."""
    longitude, latitude = pyproj.Proj(MAP)(place[0], place[1], inverse=True)
    return np.array([math.radians(latitude), math.radians(longitude), place[2]])


def geocentric(level: np.ndarray) -> np.ndarray:
    latitude, longitude, height = level
    e2 = _F * (2.0 - _F)
    normal = _A / math.sqrt(1.0 - e2 * math.sin(latitude) ** 2)
    out = (normal + height) * math.cos(latitude)
    return np.array(
        [
            out * math.cos(longitude),
            out * math.sin(longitude),
            (normal * (1.0 - e2) + height) * math.sin(latitude),
        ]
    )


def vertical(level: np.ndarray) -> np.ndarray:
    """East, north and up as rows."""
    (sb, cb), (sl, cl) = ((math.sin(a), math.cos(a)) for a in level[:2])
    return np.array([[-sl, cl, 0.0], [-sb * cl, -sb * sl, cb], [cb * cl, cb * sl, sb]])


class Station:
    """A station of the lagoon on the ellipsoid."""

    def __init__(self, name: str, numbers: list[float]) -> None:
        x, y, z, self.tide, *self.angles = numbers
        self.name, self.level = name, geographic(np.array([x, y, z]))
        self.place = geocentric(self.level)
        self.matrix = lagoon.rotation(*self.angles) @ vertical(self.level)

    def straight(self, place: np.ndarray) -> np.ndarray:
        """The image (mm) by a straight ray."""
        u, v, w = self.matrix @ (place - self.place)
        return np.array([-lagoon.FOCAL * u / w, -lagoon.FOCAL * v / w])

    def image(self, level: np.ndarray) -> np.ndarray:
        """The image (mm) of a ground point through the water over it, level where its ray enters."""
        place, axes = geocentric(level), vertical(level)
        east, north, up = axes @ (self.place - place)
        D, h = math.hypot(east, north), self.tide - level[2]
        H = up - h
        if h <= 0.0:
            return self.straight(place)

        def missed(i: float) -> float:
            return H * math.tan(i) + h * math.tan(math.asin(math.sin(i) / lagoon.INDEX)) - D

        reach = H * math.tan(brentq(missed, 0.0, 1.5, xtol=1e-15))
        share = 1.0 - reach / D
        return self.straight(place + axes.T @ np.array([share * east, share * north, h]))


@cache
def stations() -> list[Station]:
    return [Station(name, numbers) for name, numbers in lagoon.stations()]


@cache
def points() -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name, true place on the map with its height, and apparent place (geocentric) of what two photographs show."""
    found = []
    for name, place, _, photos in lagoon.survey():
        if len(photos) < 2:
            continue
        level = geographic(place)
        seen = [station for station in stations() if station.name in photos]
        images = [station.image(level) for station in seen]

        def residuals(
            at: np.ndarray, seen: list = seen, images: list = images, about: np.ndarray = level
        ) -> np.ndarray:
            here = geocentric(about) + at
            return np.concatenate([one.straight(here) - xy for one, xy in zip(seen, images, strict=True)])

        at = least_squares(residuals, np.zeros(3), xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        found.append((name, place, geocentric(level) + at))
    return found


def restated(places: np.ndarray, source: str, target: str) -> np.ndarray:
    """Places (n, 3) of one system in another of one datum, x before y; heights stay ellipsoidal."""
    way = pyproj.Transformer.from_crs(three(source), three(target), always_xy=True)
    return np.column_stack(way.transform(*places.T))


def three(definition: str) -> pyproj.CRS:
    """A system with a height."""
    return pyproj.CRS.from_user_input(definition).to_3d()
