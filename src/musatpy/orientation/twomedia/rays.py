"""Image rays through a plane of water, and what those of a point must fulfil, with their partial derivatives.

Okamoto and Mori (1974): rays by (2) to (9), conditions (13), (18)', (23), (28), (29), (31) to (33), (46). In the
axes of the house: Z up, image vectors (x, y, -1) in tangents, M = R3(kappa) R2(phi) R1(omega) from the ground to
the photo, and the water at z = level + slope . (x, y), higher by `rise` under some photos. The leading axes (...)
of all arrays are trial orientations of the same images, adjusted side by side. Every condition takes the r rays of
each of k points in s orientations, control points (s, k, 3) and the orientations, and gives q misclosures a point.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, InRows, IntArray
from musatpy.geometry.collinearity import (
    attitude_matrix,
    attitude_matrix_partials,
    coplanarity,
    ray_partials,
    scale_restraint,
)
from musatpy.geometry.collinearity import image as image_at
from musatpy.refraction.flat import incidence, refracted_ray

ATTITUDE, STATION, SLOPE, LEVEL, INDEX, IMAGE = slice(0, 3), slice(3, 6), slice(6, 8), 8, 9, slice(10, 12)
COLUMNS = 12  # of the partials of a ray: by its photo, by the water, and by its image
PHOTO, WATER = 6, 4  # of them by the photo, and by the water
_TOUCHING = 1e-12  # of the coordinates: a camera that near the water has no ray in air left to compute with


@dataclass(frozen=True, kw_only=True, eq=False)
class Orientation(InRows):
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
        flat, water = vector[..., :-WATER], vector[..., -WATER:]
        photos = flat.reshape(*flat.shape[:-1], flat.shape[-1] // PHOTO, PHOTO)
        return cls(
            attitude=photos[..., :3],
            station=photos[..., 3:],
            slope=water[..., :2],
            level=water[..., 2],
            index=water[..., 3],
        )

    @property
    def height(self) -> FloatArray:
        """(...) mean height of the stations over the water."""
        return np.mean(np.abs(self.station[..., 2] - self.water_at(self.station[..., :2])), axis=-1)

    @property
    def units(self) -> FloatArray:
        """(..., 6 m + 4) what the unknowns are measured by: 1, of lengths that height."""
        lengths = np.array(([False] * 3 + [True] * 3) * self.photos + [False, False, True, False])
        return np.where(lengths, self.height[..., None], 1.0)

    def water_at(self, place: FloatArray) -> FloatArray:
        """Return the heights (..., k) of the water at places (..., k, 2)."""
        return self.level[..., None] + np.einsum("...kx,...x->...k", place, self.slope)


@dataclass(frozen=True, kw_only=True, eq=False)
class ImageRays:
    """Rays of images (..., n): where they start and where they go.

    origin and unit direction (..., n, 3): of a wet ray its point on the water and the refracted ray, of a dry one
    the station and the image ray. partials (..., n, 6, 12) of origin and direction by attitude, station, slope,
    level, index and image. station (..., n, 3) that the ray comes from; real (..., n): the camera stands above the
    water and looks down on it.
    """

    origin: FloatArray
    direction: FloatArray
    partials: FloatArray
    station: FloatArray
    real: BoolArray

    def __getitem__(self, images: object) -> Self:
        """Return the rays of some images, in all orientations."""
        key = (slice(None), *(images if isinstance(images, tuple) else (images,)))
        return type(self)(**{name: getattr(self, name)[key] for name in self.__dataclass_fields__})


def image_rays(at: Orientation, photo: IntArray, image: FloatArray, wet: BoolArray, rise: FloatArray) -> ImageRays:
    """Return the rays of images (s, n, 2), tangents, of `photo` (n,) in orientations (s,).

    Those that are `wet` (n,) are refracted at the water, which is higher by `rise` (n,) than its level says.
    """
    station = at.station[:, photo]
    M, dM = attitude_matrix(at.attitude)[:, photo], attitude_matrix_partials(at.attitude)[:, photo]
    tangents, centre = np.ones(()), np.zeros(2)
    air, by_attitude, by_image = ray_partials(image, M, dM, tangents, centre)
    secant = np.sqrt(1.0 + np.sum(np.square(at.slope), axis=-1))[:, None, None]
    up = np.concatenate([-at.slope, np.ones_like(at.level)[:, None]], axis=-1)[:, None] / secant
    over = station.copy()  # above a point of the plane that stays when it is tilted
    over[..., 2] -= at.level[:, None] + rise
    height = np.sum(up * over, axis=-1)
    cosine = -np.sum(up * air, axis=-1)
    apart = height > _TOUCHING * np.sum(np.abs(over) + np.abs(station), axis=-1)
    real = apart & (cosine > 0.0)
    # a ray that meets no water is given numbers all the same, which `real` forbids to use
    height, index = np.where(apart, height, 1.0), at.index[:, None]
    bent = refracted_ray(station, air, up, height, index)
    partials = np.zeros((*air.shape[:-1], 6, COLUMNS))
    by_air = np.concatenate([bent.origin_by_direction, bent.direction_by_direction], axis=-2)
    partials[..., ATTITUDE], partials[..., IMAGE] = by_air @ by_attitude, by_air @ by_image
    partials[..., :3, STATION] = bent.origin_by_camera
    partials[..., :3, LEVEL] = bent.origin_by_level / secant
    partials[..., 3:, INDEX] = bent.direction_by_index
    up_by_slope = -(np.eye(3, 2) + up[..., None] * (at.slope / secant[..., 0])[:, None, None]) / secant[..., None]
    partials[..., SLOPE] = _by_normal(air, up, up_by_slope, over, height, cosine, index)
    dry = np.flatnonzero(~wet)
    partials[:, dry] = 0.0
    partials[:, dry, :3, STATION] = np.eye(3)
    partials[:, dry, 3:, ATTITUDE], partials[:, dry, 3:, IMAGE] = by_attitude[:, dry], by_image[:, dry]
    return ImageRays(
        origin=np.where(wet[:, None], bent.origin, station),
        direction=np.where(wet[:, None], bent.direction, air),
        partials=partials,
        station=station,
        real=real | ~wet,
    )


def images_of(at: Orientation, photo: IntArray, points: FloatArray, wet: BoolArray, rise: FloatArray) -> FloatArray:
    """Return the images (s, n, 2), tangents, of points (s, n, 3): the inverse of `image_rays`.

    NaN where a wet point does not lie under the water, or the camera not over it.
    """
    station = at.station[:, photo]
    up = np.concatenate([-at.slope, np.ones_like(at.level)[:, None]], axis=-1)[:, None]
    up = up / np.linalg.norm(up, axis=-1, keepdims=True)
    depth, height = (
        (at.water_at(place[..., :2]) + rise - place[..., 2]) * up[..., 2] for place in (points, station)
    )
    met = incidence(station, points, up, depth, at.index[:, None], wet & (depth > 0.0) & (height < 0.0))
    images = image_at(met.v, attitude_matrix(at.attitude)[:, photo], np.ones(()), np.zeros(2))
    return np.where((~wet | ((depth > 0.0) & (height < 0.0)))[..., None], images, np.nan)


def _by_normal(
    air: FloatArray,
    up: FloatArray,
    change: FloatArray,
    over: FloatArray,
    height: FloatArray,
    cosine: FloatArray,
    index: FloatArray,
) -> FloatArray:
    """Return the partials (s, n, 6, c) of the water point and the refracted ray by c changes (s, 1, 3, c) of `up`.

    The differential of docs/theory.md's refracted ray; `over` is the station over a point of the plane that stays.
    """
    height_change = (over[..., None, :] @ change)[..., 0, :]
    cosine_change = -(air[..., None, :] @ change)[..., 0, :]
    height, cosine, index = height[..., None], cosine[..., None], index[..., None]
    water_cosine = np.sqrt(1.0 - (1.0 - cosine**2) / index**2)
    run = height_change / cosine - height * cosine_change / cosine**2
    bend = cosine_change * (1.0 / index - cosine / (index**2 * water_cosine))
    shift = (cosine / index - water_cosine)[..., None]
    return np.concatenate(
        [air[..., None] * run[..., None, :], change * shift + up[..., None] * bend[..., None, :]], -2
    )


# --- the axes of the paper ---
# Okamoto and Mori (1974) have Z down, image vectors (x, y, c), the water at a X + b Y + Z + d = 0 and R = R_phi
# R_omega R_kappa (2) from the photo to the ground. The house turned by 180 degrees about X, on the ground and in
# the photo, is the paper: Y, Z and y change their signs.

TURN = np.array([1.0, -1.0, -1.0])  # signs of X, Y, Z; of x, y, c in the photo
SYMBOLS = ("phi", "omega", "kappa", "X0", "Y0", "Z0")  # of a photo
PLANE_SYMBOLS = ("a", "b", "d", "N")


def paper_vector(at: Orientation) -> FloatArray:
    """Return (..., 6 m + 4) phi, omega, kappa, X0, Y0, Z0 of each photo, then a, b, d and N."""
    R = TURN[:, None] * np.swapaxes(attitude_matrix(at.attitude), -1, -2) * TURN
    angles = np.stack(
        [
            np.arctan2(R[..., 0, 2], R[..., 2, 2]),
            np.arcsin(np.clip(-R[..., 1, 2], -1.0, 1.0)),
            np.arctan2(R[..., 1, 0], R[..., 1, 1]),
        ],
        axis=-1,
    )
    photos = np.concatenate([angles, at.station * TURN], axis=-1)
    flat = photos.reshape(*photos.shape[:-2], PHOTO * at.photos)
    plane = np.stack([at.slope[..., 0], -at.slope[..., 1], at.level, at.index], axis=-1)
    return np.concatenate([flat, plane], axis=-1)


def paper_partials(at: Orientation) -> FloatArray:
    """Return the partials (..., 6 m + 4, 6 m + 4) of `paper_vector` by the vector of the orientations."""
    size = at.vector.shape[-1]
    J = np.zeros((*at.level.shape, size, size))
    R = TURN[:, None] * np.swapaxes(attitude_matrix(at.attitude), -1, -2) * TURN
    # the angle third from the end
    dR = TURN[:, None] * np.swapaxes(attitude_matrix_partials(at.attitude), -1, -2) * TURN
    cos_omega = np.sqrt(1.0 - np.square(R[..., 1, 2]))[..., None]
    by_angle = np.stack(
        [
            (R[..., 2, 2, None] * dR[..., :, 0, 2] - R[..., 0, 2, None] * dR[..., :, 2, 2]) / cos_omega**2,
            -dR[..., :, 1, 2] / cos_omega,
            (R[..., 1, 1, None] * dR[..., :, 1, 0] - R[..., 1, 0, None] * dR[..., :, 1, 1]) / cos_omega**2,
        ],
        axis=-2,
    )
    for photo in range(at.photos):
        angles = slice(PHOTO * photo, PHOTO * photo + 3)
        places = np.arange(angles.stop, angles.stop + 3)
        J[..., angles, angles] = by_angle[..., photo, :, :]
        J[..., places, places] = TURN
    plane = np.arange(size - 4, size)
    J[..., plane, plane] = (1.0, -1.0, 1.0, 1.0)
    return J


@dataclass(frozen=True, kw_only=True, eq=False)
class Misclosure:
    """Misclosures (s, k, q), partials by the rays (s, k, q, r, 12) and by the control point (s, k, q, 3)."""

    value: FloatArray
    by_rays: FloatArray
    by_control: FloatArray


Condition = Callable[[ImageRays, FloatArray, Orientation], Misclosure]


@dataclass(frozen=True, kw_only=True, eq=False)
class ConditionGroup:
    """k points on the same r photos (r,) with the same condition: their images (k, r) and control points (k,).

    `control` is None for points that are not known.
    """

    condition: Condition
    photos: tuple[int, ...]
    images: IntArray
    control: IntArray | None = None


def refracted(rays: ImageRays, control: FloatArray, at: Orientation) -> Misclosure:
    """Return how far each ray passes the control point at its height: dX and dY of (13), 2 r a point."""
    s, k, r = rays.real.shape
    direction, gap = rays.direction, rays.origin - control[:, :, None]
    run = direction[..., :2] / direction[..., 2:]
    value = gap[..., :2] - gap[..., 2:] * run
    by_origin = np.concatenate([np.broadcast_to(np.eye(2), (*run.shape, 2)), -run[..., None]], axis=-1)
    by_direction = by_origin * -(gap[..., 2:] / direction[..., 2:])[..., None]
    by_columns = np.concatenate([by_origin, by_direction], axis=-1) @ rays.partials
    by_rays = np.zeros((s, k, r, 2, r, COLUMNS))
    for ray in range(r):
        by_rays[:, :, ray, :, ray] = by_columns[:, :, ray]
    return Misclosure(
        value=value.reshape(s, k, 2 * r),
        by_rays=by_rays.reshape(s, k, 2 * r, r, COLUMNS),
        by_control=-by_origin.reshape(s, k, 2 * r, 3),
    )


def fermat(rays: ImageRays, control: FloatArray, at: Orientation) -> Misclosure:
    """Return Fermat's condition at the water point W of one wet ray a point: (18)'.

    beta (W - C).t - alpha n (G - W).t for both tangents t of the plane, with the ways alpha from station C to W and
    beta from W to control G.
    """
    only = rays[:, 0]
    tangent = np.concatenate([np.broadcast_to(np.eye(2), (len(at.level), 2, 2)), at.slope[:, :, None]], axis=-1)
    n = at.index[:, None, None]
    air, water = only.origin - only.station, control - only.origin
    alpha, beta = (np.sqrt(np.sum(np.square(way), axis=-1))[..., None] for way in (air, water))
    air_along, water_along = (np.einsum("sti,ski->skt", tangent, way) for way in (air, water))
    by_air = beta[..., None] * tangent[:, None] - (n * water_along)[..., None] * (air / alpha)[..., None, :]
    by_water = air_along[..., None] * (water / beta)[..., None, :] - (alpha * n)[..., None] * tangent[:, None]
    by_rays = (by_air - by_water) @ only.partials[..., :3, :]
    by_rays[..., STATION] -= by_air
    by_rays[..., INDEX] -= alpha * water_along
    by_rays[..., SLOPE] += (beta * air[..., 2:] - alpha * n * water[..., 2:])[..., None] * np.eye(2)
    value = beta * air_along - alpha * n * water_along
    return Misclosure(value=value, by_rays=by_rays[..., None, :], by_control=by_water)


def intersection(rays: ImageRays, control: FloatArray, at: Orientation) -> Misclosure:
    """Return the volume by which two rays a point miss each other: (23), (28), (29)."""
    return _of_rays(*coplanarity(rays.origin, rays.direction), rays)


def triple(rays: ImageRays, control: FloatArray, at: Orientation) -> Misclosure:
    """Return the conditions of three rays a point: two coplanarities, and the scale of (46) in the dot form.

    The nine equations (31) to (33) and (46) of such a point have rank 3.
    """
    pairs = [slice(0, 2), slice(1, 3)]
    parts = [intersection(rays[:, pair], control, at) for pair in pairs]
    scale = _of_rays(*scale_restraint(rays.origin, rays.direction), rays)
    by_rays = np.concatenate([np.zeros_like(scale.by_rays)] * 2 + [scale.by_rays], axis=-3)
    for row, (pair, part) in enumerate(zip(pairs, parts, strict=True)):
        by_rays[..., row, pair, :] = part.by_rays[..., 0, :, :]
    value = np.concatenate([*(part.value for part in parts), scale.value], axis=-1)
    return Misclosure(value=value, by_rays=by_rays, by_control=np.zeros((*value.shape, 3)))


def _of_rays(value: FloatArray, by_ray: FloatArray, rays: ImageRays) -> Misclosure:
    """Return a condition of one number (s, k), of its partials (s, k, r, 6) by origin and direction of the rays."""
    by_columns = np.einsum("...i,...ij->...j", by_ray, rays.partials)
    return Misclosure(
        value=value[..., None], by_rays=by_columns[..., None, :, :], by_control=np.zeros((*value.shape, 1, 3))
    )
