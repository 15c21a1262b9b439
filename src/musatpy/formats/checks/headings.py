"""Headings against the images: where the neighbouring stations lie on a photo, by the points in common."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from musatpy.errors import Problem
from musatpy.formats.checks.systems import fits_system
from musatpy.formats.draft import Draft
from musatpy.formats.rays import common_rays, rays_of
from musatpy.model import CoordinateSystem
from musatpy.model.arrays import FloatArray, IntArray
from musatpy.units import DEGREE

_LIMIT = 45 * DEGREE
_STEEPEST = 20 * DEGREE  # tilts up to which a photo is taken as vertical
_SPREAD = 5.0  # mm: points in common must spread this far (RMS) to turn one photo on to another
_BASE = 5.0  # mm: and the neighbour's nadir must lie this far from the photo's own
_AGREEMENT = 0.8  # mean of the unit vectors of several neighbours' evidence

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True)
class _Pairs:
    """Photo pairs, and y = a x + b from plate coordinates of the first to those of the second (complex, mm)."""

    first: IntArray  # (k,) link to photos
    second: IntArray  # (k,)
    count: IntArray  # (k,) points in common
    a: ComplexArray  # (k,)
    b: ComplexArray  # (k,)


def headings(draft: Draft) -> Iterator[Problem]:
    """Yield the photos whose heading differs by more than 45 degrees from what their neighbours say.

    On a photo without tilt the images lie around the nadir as the ground does around the station, turned by the
    heading. The points in common with a neighbour give the place of the neighbour's nadir on the photo; its
    direction against that of the neighbour's station is the heading, good to a few degrees for small tilts. With
    several neighbours, their evidence must agree.
    """
    if not all(fits_system(draft, "stations", "photos.position")):
        return
    attitude = draft.by_photo("attitudes", "photos.attitude")
    ground, evidence = _ground(draft), np.zeros(len(draft.photo_ids), dtype=complex)
    weight = np.zeros(len(draft.photo_ids))
    level = np.abs(attitude[:, :2]).max(axis=1, initial=0) < _STEEPEST
    pairs = _pairs(draft)
    for here, there, nadir in (
        (pairs.first, pairs.second, -pairs.b / pairs.a),
        (pairs.second, pairs.first, pairs.b),
    ):
        turn = (ground[there] - ground[here]) * np.conj(nadir)  # direction on the ground less that on the plate
        good = level[here] & level[there] & (np.abs(nadir) > _BASE) & (np.abs(turn) > 0)
        np.add.at(evidence, here[good], (pairs.count * turn / np.abs(turn))[good])
        np.add.at(weight, here[good], pairs.count[good])
    agree = (weight > 0) & (np.abs(evidence) > _AGREEMENT * weight)
    difference = np.angle(evidence * np.exp(-1j * attitude[:, 2]))
    for row, link in enumerate(draft.photo["attitudes"].tolist()):
        if link >= 0 and agree[link] and abs(difference[link]) > _LIMIT:
            given, seen = attitude[link, 2] / DEGREE, np.angle(evidence[link]) / DEGREE
            message = f"a heading of {given:.0f} degrees, where the images point to about {seen:.0f}"
            yield draft.problem("attitudes", row, message, path="photos.attitude", component=2, severity="warning")


def _pairs(draft: Draft) -> _Pairs:
    """Return the pairs of photos with points in common that spread well, by a least squares fit to each."""
    photo, xy = draft.photo["plates"], draft.rows["plates"]["plates.xy"]
    one, other = common_rays(draft, rays_of(draft).sound)
    keys, pair = np.unique(photo[one] * len(draft.photo_ids) + photo[other], return_inverse=True)
    first, second = np.divmod(keys, max(len(draft.photo_ids), 1))
    image = xy[:, 0] + 1j * xy[:, 1]
    count = np.bincount(pair, minlength=len(keys))
    x, mean_x = _centred(image[one], pair, count)
    y, mean_y = _centred(image[other], pair, count)
    spread, product = _sums(np.abs(x) ** 2 + 0j, pair, count).real, _sums(np.conj(x) * y, pair, count)
    good = (first != second) & (spread > count * _SPREAD**2) & (np.abs(product) > 0)
    a = product[good] / spread[good]
    return _Pairs(first=first[good], second=second[good], count=count[good], a=a, b=mean_y[good] - a * mean_x[good])


def _sums(values: ComplexArray, pair: IntArray, count: IntArray) -> ComplexArray:
    real = np.bincount(pair, weights=values.real, minlength=len(count))
    imaginary = np.bincount(pair, weights=values.imag, minlength=len(count))
    return np.asarray(real + 1j * imaginary)


def _centred(values: ComplexArray, pair: IntArray, count: IntArray) -> tuple[ComplexArray, ComplexArray]:
    mean = _sums(values, pair, count) / count
    return values - mean[pair], mean


def _ground(draft: Draft) -> ComplexArray:
    """Return (photos,) east + i north of the stations about their mean, metres, good for directions."""
    position = draft.by_photo("stations", "photos.position")
    if draft.system is CoordinateSystem.LOCAL:
        return np.asarray(position[:, 0] + 1j * position[:, 1])
    if draft.system is CoordinateSystem.GEOCENTRIC:
        position = _spherical(position)
    latitude, longitude = position[:, 0], position[:, 1]
    return np.asarray(longitude * np.cos(np.nanmean(latitude)) + 1j * latitude)


def _spherical(xyz: FloatArray) -> FloatArray:
    """Return latitude and longitude (rad) on the sphere of geocentric positions, (k, 2)."""
    x, y, z = xyz.T
    return np.stack([np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)], axis=1)
