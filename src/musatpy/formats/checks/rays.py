"""The rays of a draft: which measurements can help the solution, and how photos with common points lie."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from musatpy.formats.draft import Draft
from musatpy.model import ControlKind, CoordinateSystem

HORIZONTAL = (ControlKind.FULL, ControlKind.HORIZONTAL)
VERTICAL = (ControlKind.FULL, ControlKind.VERTICAL)
_SPREAD = 5.0  # mm: points in common must spread this far (RMS) to turn one photo on to another
_EARTH = 6.371e6  # m, of the sphere on which directions are good enough


@dataclass(frozen=True, kw_only=True, eq=False)
class Rays:
    """The m plate measurements of a draft, and what is known of its p points."""

    sound: BoolArray  # (m,) photo, point and coordinates could be read
    usable: BoolArray  # (m,) triangulated, and the point has another triangulated ray, or a known component
    count: IntArray  # (p,) sound measurements, triangulated or not
    triangulated: IntArray  # (p,) sound measurements that are triangulated
    horizontal: BoolArray  # (p,) horizontally known by its control card
    vertical: BoolArray  # (p,) vertically known


def rays_of(draft: Draft) -> Rays:
    """Return the rays of a draft."""
    rows, points = draft.rows["plates"], len(draft.point_ids)
    point = draft.point["plates"]
    sound = (draft.photo["plates"] >= 0) & (point >= 0) & ~np.isnan(rows["plates.xy"]).any(axis=1)
    if draft.raw:
        sound &= _first_readings(draft)
    triangulated = sound & rows["plates.triangulated"]
    counts = np.bincount(point[triangulated], minlength=points)
    horizontal, vertical = _known(draft, HORIZONTAL), _known(draft, VERTICAL)
    helpful = np.append((counts > 1) | horizontal | vertical, False)  # the last: no point
    return Rays(
        sound=sound,
        usable=triangulated & helpful[point],
        count=np.bincount(point[sound], minlength=points),
        triangulated=counts,
        horizontal=horizontal,
        vertical=vertical,
    )


def _known(draft: Draft, kinds: tuple[ControlKind, ...]) -> BoolArray:
    links = draft.point["control"]
    known = np.zeros(len(draft.point_ids), dtype=bool)
    known[links[np.isin(draft.rows["control"]["control.kind"], kinds) & (links >= 0)]] = True
    return known


def by_camera(draft: Draft, path: str, change: Callable[[FloatArray], FloatArray] = np.asarray) -> FloatArray:
    """Return (cameras + 1, ...) what the card of each camera says, NaN without; the last: no camera."""
    values, links = change(draft.rows["cameras"][path]), draft.camera["cameras"]
    out = np.full((len(draft.camera_ids) + 1, *values.shape[1:]), np.nan)
    out[links] = values
    out[-1] = np.nan
    return out


def _first_readings(draft: Draft) -> BoolArray:
    """Return (m,) True for the first reading of each point of a photo: all of them make one ray."""
    first = np.zeros(len(draft.rows["plates"]), dtype=bool)
    rays = np.stack([draft.photo["plates"], draft.point["plates"]])
    first[np.unique(rays, axis=1, return_index=True)[1]] = True
    return first


def common_rays(draft: Draft, wanted: BoolArray) -> tuple[IntArray, IntArray]:
    """Return rows (c,), (c,) of measurements of one point on two photos, consecutive ones of the `wanted` (m,)."""
    rows = np.flatnonzero(wanted)
    rows = rows[np.lexsort((draft.photo["plates"][rows], draft.point["plates"][rows]))]
    point = draft.point["plates"][rows]
    same = point[1:] == point[:-1]
    return rows[:-1][same], rows[1:][same]


@dataclass(frozen=True, kw_only=True, eq=False)
class PhotoPairs:
    """Photo pairs, and y = a x + b from plate coordinates of the first to those of the second (complex, mm)."""

    first: IntArray  # (k,) link to photos
    second: IntArray  # (k,)
    count: IntArray  # (k,) points in common
    a: ComplexArray  # (k,)
    b: ComplexArray  # (k,)


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
