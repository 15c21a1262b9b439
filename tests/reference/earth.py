"""Where points and frames are, for the reference adjustment: safe for complex arguments, checked against pyproj.

Ground points are held in the job's own parameters, (latitude, longitude, height) or local (X, Y, Z), so that the
height of a point needs no iteration and a fixed height or a fixed horizontal position is a parameter left out.
"""

from dataclasses import dataclass

import numpy as np
import pyproj

from musatpy.model import Block, CoordinateSystem, EllipsoidSpec


@dataclass(frozen=True, kw_only=True)
class LocalEarth:
    """A rectangular frame with the vertical +Z everywhere."""

    def native(self, position: np.ndarray) -> np.ndarray:
        """Ground parameters of positions in the job's system: the same."""
        return np.array(position, dtype=float)

    def given(self, native: np.ndarray) -> np.ndarray:
        """Positions in the job's system of ground parameters: the same."""
        return np.array(native, dtype=float)

    def cartesian(self, native: np.ndarray) -> np.ndarray:
        """(..., 3) rectangular coordinates of ground parameters."""
        return native

    def from_cartesian(self, xyz: np.ndarray) -> np.ndarray:
        """Ground parameters of rectangular coordinates."""
        return np.array(xyz, dtype=float)

    def frame(self, native: np.ndarray) -> np.ndarray:
        """(..., 3, 3) rows east, north, up at ground parameters."""
        return np.broadcast_to(np.eye(3), (*np.shape(native)[:-1], 3, 3))

    def shift(self, native: np.ndarray, enu: np.ndarray) -> np.ndarray:
        """Ground parameters moved by (east, north, up) metres."""
        return native + enu


@dataclass(frozen=True, kw_only=True)
class EllipsoidalEarth:
    """An ellipsoid; the job's system is geographic (latitude, longitude, height) or geocentric."""

    a: float
    es: float  # eccentricity squared
    geocentric: bool
    transformer: pyproj.Transformer
    origin: np.ndarray  # (3,) taken off every rectangular coordinate

    def native(self, position: np.ndarray) -> np.ndarray:
        """(..., 3) latitude, longitude (rad), height of positions in the job's system."""
        position = np.array(position, dtype=float)
        return self.from_cartesian(position - self.origin) if self.geocentric else position

    def given(self, native: np.ndarray) -> np.ndarray:
        """Positions in the job's system of (latitude, longitude, height)."""
        native = np.array(native, dtype=float)
        return self.cartesian(native) + self.origin if self.geocentric else native

    def cartesian(self, native: np.ndarray) -> np.ndarray:
        """(..., 3) geocentric coordinates minus the origin."""
        lat, lon, h = np.moveaxis(native, -1, 0)
        nu = self.a / np.sqrt(1.0 - self.es * np.sin(lat) ** 2)
        rho = (nu + h) * np.cos(lat)
        z = ((1.0 - self.es) * nu + h) * np.sin(lat)
        return np.stack([rho * np.cos(lon), rho * np.sin(lon), z], axis=-1) - self.origin

    def from_cartesian(self, xyz: np.ndarray) -> np.ndarray:
        """(..., 3) latitude, longitude, height of geocentric coordinates minus the origin, by PROJ."""
        x, y, z = np.moveaxis(np.asarray(xyz, dtype=float) + self.origin, -1, 0)
        lon, lat, h = self.transformer.transform(x, y, z, radians=True, direction="INVERSE")
        return np.stack([lat, lon, h], axis=-1)

    def frame(self, native: np.ndarray) -> np.ndarray:
        """(..., 3, 3) rows east, north, up."""
        lat, lon, _ = np.moveaxis(native, -1, 0)
        sp, cp, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
        east = np.stack([-sl, cl, np.zeros_like(sl)], axis=-1)
        north = np.stack([-sp * cl, -sp * sl, cp], axis=-1)
        up = np.stack([cp * cl, cp * sl, sp], axis=-1)
        return np.stack([east, north, up], axis=-2)

    def shift(self, native: np.ndarray, enu: np.ndarray) -> np.ndarray:
        """(latitude, longitude, height) moved by (east, north, up) metres along the parameter lines."""
        lat, lon, h = np.moveaxis(native, -1, 0)
        east, north, up = np.moveaxis(enu, -1, 0)
        w2 = 1.0 - self.es * np.sin(lat) ** 2
        meridian = self.a * (1.0 - self.es) / w2**1.5 + h
        parallel = (self.a / np.sqrt(w2) + h) * np.cos(lat)
        return np.stack([lat + north / meridian, lon + east / parallel, h + up], axis=-1)


Earth = LocalEarth | EllipsoidalEarth


def ellipsoid_terms(spec: EllipsoidSpec) -> str:
    """PROJ parameters of an ellipsoid given by name or by a and 1/f."""
    return f"+ellps={spec.name}" if spec.name else f"+a={spec.semi_major_axis!r} +rf={spec.inverse_flattening!r}"


def earth_of(block: Block) -> Earth:
    """The earth of a block; its origin is near the first station."""
    if block.options.system == CoordinateSystem.LOCAL:
        return LocalEarth()
    terms = ellipsoid_terms(block.ellipsoid)
    geod = pyproj.Geod(terms)
    transformer = pyproj.Transformer.from_pipeline(f"+proj=cart {terms}")
    first = block.photos.position[0]
    geocentric = block.options.system == CoordinateSystem.GEOCENTRIC
    origin = first if geocentric else np.array(transformer.transform(first[1], first[0], 0.0, radians=True))
    return EllipsoidalEarth(
        a=geod.a, es=geod.es, geocentric=geocentric, transformer=transformer, origin=np.round(origin, -2)
    )
