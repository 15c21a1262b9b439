"""Image rays through a plane of water, with what turns and moves them: Okamoto and Mori (1974), (2) to (9).

In the axes of the house: Z up, image vectors (x, y, -1) in tangents, M = R3(kappa) R2(phi) R1(omega) from the ground
to the photo, and the water at z = level + slope . (x, y). The leading axes (...) of all arrays are trial orientations
of the same images, adjusted side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.collinearity import ray, ray_partials
from musatpy.geometry.rotations import attitude_matrix, attitude_matrix_partials
from musatpy.refraction.flat import refracted_ray

ATTITUDE, STATION, SLOPE, LEVEL, INDEX, IMAGE = slice(0, 3), slice(3, 6), slice(6, 8), 8, 9, slice(10, 12)
COLUMNS = 12  # of the partials of a ray: by its photo, by the water, and by its image
PHOTO, WATER = 6, 4  # of them by the photo and by the water


@dataclass(frozen=True, kw_only=True, eq=False)
class Orientation:
    """Trial orientations of m photos over one plane of water.

    attitude (..., m, 3) omega, phi, kappa, rad; station (..., m, 3); slope (..., 2) and level (...) of the water,
    index (...) of refraction. Lengths are those of the control, or of the model.
    """

    attitude: FloatArray
    station: FloatArray
    slope: FloatArray
    level: FloatArray
    index: FloatArray

    @property
    def photos(self) -> int:
        """m."""
        return self.attitude.shape[-2]

    @property
    def vector(self) -> FloatArray:
        """(..., 6 m + 4) attitude and station of each photo, then slope, level and index."""
        photos = np.concatenate([self.attitude, self.station], axis=-1)
        flat = photos.reshape(*photos.shape[:-2], PHOTO * self.photos)
        return np.concatenate([flat, self.slope, self.level[..., None], self.index[..., None]], axis=-1)

    @classmethod
    def of(cls, vector: FloatArray) -> Self:
        """Return the orientations of such a vector."""
        flat = vector[..., :-WATER]
        photos = flat.reshape(*flat.shape[:-1], flat.shape[-1] // PHOTO, PHOTO)
        water = vector[..., -WATER:]
        return cls(
            attitude=photos[..., :3],
            station=photos[..., 3:],
            slope=water[..., :2],
            level=water[..., 2],
            index=water[..., 3],
        )

    def __getitem__(self, rows: object) -> Self:
        return type(self)(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})


@dataclass(frozen=True, kw_only=True, eq=False)
class Rays:
    """Rays of n images: where they start under water and where to.

    origin and unit direction (..., n, 3): of a wet ray its point on the water and the refracted ray, of a dry one the
    station and the image ray. partials (..., n, 6, 12) of origin and direction by attitude, station, slope, level,
    index and image. station (..., n, 3) it comes from; real (..., n) where the camera stands above the water and
    looks down on it.
    """

    origin: FloatArray
    direction: FloatArray
    partials: FloatArray
    station: FloatArray
    real: BoolArray


def rays(at: Orientation, photo: IntArray, image: FloatArray, wet: BoolArray) -> Rays:
    """Return the rays of images (..., n, 2), tangents, of `photo` (n,); those that are `wet` (n,) are refracted."""
    attitude, station = at.attitude[..., photo, :], at.station[..., photo, :]
    M, dM = attitude_matrix(at.attitude)[..., photo, :, :], attitude_matrix_partials(at.attitude)[..., photo, :, :, :]
    one, centre = np.ones(()), np.zeros(2)
    air = ray(image, M, one, centre)
    by_attitude, by_image = ray_partials(image, M, dM, one, centre)
    secant = np.sqrt(1.0 + np.sum(np.square(at.slope), axis=-1))[..., None]  # (..., 1)
    up = np.concatenate([-at.slope, np.ones_like(secant)], axis=-1)[..., None, :] / secant[..., None]
    over = station - np.array([0.0, 0.0, 1.0]) * at.level[..., None, None]
    height = np.sum(up * over, axis=-1)
    cosine = -np.sum(up * air, axis=-1)
    real = (height > 0.0) & (cosine > 0.0)
    index = np.broadcast_to(at.index[..., None], height.shape)
    up = np.broadcast_to(up, air.shape)
    # a ray that meets no water gives numbers all the same, which `real` forbids to use
    bent = refracted_ray(station, air, up, np.where(real, height, 1.0), index)
    partials = np.zeros((*air.shape[:-1], 6, COLUMNS))
    partials[..., :3, ATTITUDE] = bent.origin_by_direction @ by_attitude
    partials[..., 3:, ATTITUDE] = bent.direction_by_direction @ by_attitude
    partials[..., :3, IMAGE] = bent.origin_by_direction @ by_image
    partials[..., 3:, IMAGE] = bent.direction_by_direction @ by_image
    partials[..., :3, STATION] = bent.origin_by_camera
    partials[..., :3, LEVEL] = bent.origin_by_level / secant[..., None]
    partials[..., 3:, INDEX] = bent.direction_by_index
    for column in range(2):
        normal = -np.eye(3)[column] / secant[..., None] - up * (at.slope[..., column, None] / secant**2)[..., None]
        by_slope = _by_normal(air, up, normal, over, height, cosine, index)
        partials[..., 6 + column] = np.concatenate(by_slope, axis=-1)
    dry = ~wet[:, None]
    straight = np.zeros((6, COLUMNS))
    straight[:3, STATION] = np.eye(3)
    in_air = np.broadcast_to(straight, partials.shape).copy()
    in_air[..., 3:, ATTITUDE], in_air[..., 3:, IMAGE] = by_attitude, by_image
    return Rays(
        origin=np.where(dry, station, bent.origin),
        direction=np.where(dry, air, bent.direction),
        partials=np.where(dry[..., None], in_air, partials),
        station=station,
        real=np.where(wet, real, True),
    )


def _by_normal(
    air: FloatArray,
    up: FloatArray,
    change: FloatArray,
    over: FloatArray,
    height: FloatArray,
    cosine: FloatArray,
    index: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return by how much the water point and the refracted ray move as the normal `up` changes by `change`.

    `over` is the station over a point of the plane that stays.
    """
    rise, steeper = np.sum(change * over, axis=-1), -np.sum(change * air, axis=-1)
    water_cosine = np.sqrt(1.0 - (1.0 - cosine**2) / index**2)
    factor = cosine / index - water_cosine
    origin = air * (rise / cosine - height * steeper / cosine**2)[..., None]
    bend = steeper * (1.0 / index - cosine / (index**2 * water_cosine))
    return origin, change * factor[..., None] + up * bend[..., None]
