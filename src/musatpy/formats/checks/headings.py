"""Headings against the images: where the neighbouring stations lie on a photo, by the points in common."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from musatpy.errors import Problem
from musatpy.formats.checks.system_use import fits_system
from musatpy.formats.draft import Draft
from musatpy.formats.draft_rays import common_rays, rays_of
from musatpy.model import CoordinateSystem
from musatpy.units import DEGREE

_LIMIT = 45 * DEGREE
_STEEPEST = 20 * DEGREE  # tilts up to which a photo is taken as vertical
_SPREAD = 5.0  # mm: points in common must spread this far (RMS) to turn one photo on to another
_BASE = 5.0  # mm: and the neighbour's nadir must lie this far from the photo's own
_EARTH = 6.371e6  # m, of the sphere on which directions are good enough
_AGREEMENT = 0.8  # length of the mean of unit vectors that point the same way


@dataclass(frozen=True, kw_only=True, eq=False)
class PhotoPairs:
    """Photo pairs, and y = a x + b from plate coordinates of the first to those of the second (complex, mm)."""

    first: IntArray  # (k,) link to photos
    second: IntArray  # (k,)
    count: IntArray  # (k,) points in common
    a: ComplexArray  # (k,)
    b: ComplexArray  # (k,)


def headings(draft: Draft) -> Iterator[Problem]:
    """Yield the photos whose heading differs by more than 45 degrees from what the images say (readings say none).

    On a photo without tilt the images lie around the nadir as the ground does around the station, turned by the
    heading. The points in common with a neighbour give the place of the neighbour's nadir on the photo; its
    direction against that of the neighbour's station is the heading, good to a few degrees for small tilts. They
    also give the turn from photo to photo, without the stations. A heading is wrong where both contradict it; where
    only the directions do, some station may be wrong instead, unless all photos are off by the same angle.
    """
    if draft.raw or draft.may_lack_station or not all(fits_system(draft, "stations", "photos.position")):
        return
    attitude = draft.by_photo("attitudes", "photos.attitude")
    pairs, heading = photo_pairs(draft, rays_of(draft).sound), np.exp(1j * attitude[:, 2])
    seen = _by_stations(draft, pairs, attitude)
    off = seen * np.conj(heading)
    wrong = np.abs(np.angle(off)) > _LIMIT  # False where nothing is seen
    contradicted = wrong & (np.abs(np.angle(_by_neighbours(pairs, heading))) > _LIMIT)
    known = off[off != 0]
    if known.size > 1 and wrong[off != 0].all() and abs(known.sum()) > _AGREEMENT * np.abs(known).sum():
        contradicted = wrong
    for row, link in enumerate(draft.photo["attitudes"].tolist()):
        if link >= 0 and contradicted[link]:
            given, image = attitude[link, 2] / DEGREE, np.angle(seen[link]) / DEGREE
            message = f"a heading of {round(given)} degrees, where the images point to about {round(image)}"
            yield draft.problem("attitudes", row, message, path="photos.attitude", component=2, severity="warning")


def _by_stations(draft: Draft, pairs: PhotoPairs, attitude: FloatArray) -> ComplexArray:
    """Return (photos,) unit vectors of the headings that the neighbours' nadirs and stations give, else 0."""
    ground = plan(draft, draft.by_photo("stations", "photos.position"))
    photo = np.concatenate([pairs.first, pairs.second])
    neighbour = np.concatenate([pairs.second, pairs.first])
    nadir = np.concatenate([-pairs.b / pairs.a, pairs.b])  # of the other photo
    turn = (ground[neighbour] - ground[photo]) * np.conj(nadir)  # direction on the ground less that on the plate
    level = np.abs(attitude[:, :2]).max(axis=1, initial=0) < _STEEPEST
    good = level[photo] & level[neighbour] & (np.abs(nadir) > _BASE) & (np.abs(turn) > 0)
    return _mean_directions(photo[good], turn[good], np.tile(pairs.count, 2)[good], len(attitude))


def _by_neighbours(pairs: PhotoPairs, heading: ComplexArray) -> ComplexArray:
    """Return (photos,) unit vectors of how far each heading is off if its neighbours' are right, else 0."""
    # y = a x turns by the heading of the first photo less that of the second.
    off = pairs.a * np.conj(heading[pairs.first]) * heading[pairs.second]
    photo = np.concatenate([pairs.first, pairs.second])
    both = np.concatenate([off, np.conj(off)])
    good = np.abs(both) > 0
    return _mean_directions(photo[good], both[good], np.tile(pairs.count, 2)[good], len(heading))


def _mean_directions(photo: IntArray, vectors: ComplexArray, weight: IntArray, photos: int) -> ComplexArray:
    """Return (photos,) unit vectors of the weighted mean directions, 0 where there are none or they disagree."""
    total = sums(weight * vectors / np.abs(vectors), photo, photos)
    agree = np.abs(total) > _AGREEMENT * np.bincount(photo, weights=weight, minlength=photos)
    return np.where(agree, total / np.where(agree, np.abs(total), 1), 0)


def photo_pairs(draft: Draft, wanted: BoolArray) -> PhotoPairs:
    """Return the pairs of photos whose `wanted` (m,) images in common spread well, by a least squares fit."""
    photo, xy = draft.photo["plates"], draft.rows["plates"]["plates.xy"]
    one, other = common_rays(draft, wanted)
    keys, pair = np.unique(photo[one] * len(draft.photo_ids) + photo[other], return_inverse=True)
    first, second = np.divmod(keys, max(len(draft.photo_ids), 1))
    image = xy[:, 0] + 1j * xy[:, 1]
    count = np.bincount(pair, minlength=len(keys))
    x, y = image[one], image[other]
    mean_x, mean_y = sums(x, pair, len(keys)) / count, sums(y, pair, len(keys)) / count
    x, y = x - mean_x[pair], y - mean_y[pair]
    spread = np.bincount(pair, weights=np.abs(x) ** 2, minlength=len(keys))
    product = sums(np.conj(x) * y, pair, len(keys))
    good = (first != second) & (spread > count * _SPREAD**2) & (np.abs(product) > 0)
    a = product[good] / spread[good]
    b = mean_y[good] - a * mean_x[good]
    return PhotoPairs(first=first[good], second=second[good], count=count[good], a=a, b=b)


def sums(values: ComplexArray, index: IntArray, size: int) -> ComplexArray:
    """Return (size,) the sums of the values at each index."""
    real = np.bincount(index, weights=values.real, minlength=size)
    imaginary = np.bincount(index, weights=values.imag, minlength=size)
    return real + 1j * imaginary


def plan(draft: Draft, position: FloatArray) -> ComplexArray:
    """Return (k,) east + i north (m) of positions (k, 3) of the job, good from one to another near by."""
    if draft.system is CoordinateSystem.LOCAL:
        return position[:, 0] + 1j * position[:, 1]
    if draft.system is CoordinateSystem.GEOCENTRIC:
        position = _spherical(position)
    good = position[np.isfinite(position).all(axis=1), :2]
    latitude, longitude = good[0] if len(good) else np.zeros(2)
    east = np.angle(np.exp(1j * (position[:, 1] - longitude)))  # across the date line as well
    return _EARTH * (east * np.cos(latitude) + 1j * position[:, 0])


def _spherical(xyz: FloatArray) -> FloatArray:
    """Return latitude and longitude (rad) on the sphere of geocentric positions, (k, 2)."""
    x, y, z = xyz.T
    return np.stack([np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)], axis=1)
