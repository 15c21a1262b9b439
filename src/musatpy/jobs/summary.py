"""What is in a job before it is run: its photos, points, control, and what ties it together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model import Block, ControlKind
from musatpy.model.tables import Table, per_row, taken

NO_CONTROL = -1
FEW = 5  # points in common that a relative orientation needs


@dataclass(frozen=True, kw_only=True, eq=False)
class PhotoCounts(Table):
    """What is measured on each of the n photos. Rays are measured points, flagged N or not."""

    rays: IntArray = per_row()  # (n,)
    land: IntArray = per_row()  # (n,) rays of points on land
    submerged: IntArray = per_row()  # (n,) rays of submerged points
    kept_out: IntArray = per_row()  # (n,) rays flagged N
    control: IntArray = per_row(4)  # (n, 4) rays of control, by ControlKind
    single: IntArray = per_row()  # (n,) rays of points that are on this photo only
    with_next: IntArray = per_row()  # (n,) points in common with the next photo of the deck, 0 for the last
    neighbours: IntArray = per_row()  # (n,) photos with points in common


@dataclass(frozen=True, kw_only=True, eq=False)
class PointCounts(Table):
    """Where each of the p points is measured, and what is known of it."""

    rays: IntArray = per_row()  # (p,) plate measurements
    used: IntArray = per_row()  # (p,) those not flagged N
    kind: IntArray = per_row()  # (p,) ControlKind, -1 without control
    grouped: BoolArray = per_row()  # (p,) member of an equal elevation group
    only_photo: IntArray = per_row()  # (p,) link to the photo of a point with one ray, else -1


@dataclass(frozen=True, kw_only=True, eq=False)
class Overlaps(Table):
    """The c pairs of photos with points in common, by measurements not flagged N, in the order of the photos."""

    first: IntArray = per_row(link="photos")  # (c,)
    second: IntArray = per_row(link="photos")  # (c,), after the first one
    points: IntArray = per_row()  # (c,) number of points in common


@dataclass(frozen=True, kw_only=True, eq=False)
class Summary:
    """What is in a job."""

    block: Block
    few: int  # points in common below which two photos hang together weakly
    photos: PhotoCounts
    points: PointCounts
    pairs: Overlaps
    part: IntArray  # (n,) photos that hang together by one point in common or more
    strong_part: IntArray  # (n,) by `few` and more
    plate_sigma: FloatArray  # (s,) mm, the sigmas that plate coordinates have, in x or y
    plate_sigma_count: IntArray  # (s,) of how many coordinates

    @property
    def gaps(self) -> IntArray:
        """Photos (links) that have fewer than `few` points in common with the next one of the deck."""
        return np.flatnonzero(self.photos.with_next[:-1] < self.few)

    @property
    def parts(self) -> list[TextArray]:
        """The photos of each part of the job, by one point in common or more."""
        return _members(self.block.photos.ids, self.part)

    @property
    def strong_parts(self) -> list[TextArray]:
        """The photos of each part of the job, by `few` points in common or more."""
        return _members(self.block.photos.ids, self.strong_part)


def summary(block: Block, few: int = FEW) -> Summary:
    """Return what is in a job; photos with fewer than `few` points in common count as weakly tied."""
    counted = replace(block, plates=taken(block.plates, block.plates.first_readings()))
    points, pairs, n = _points(counted), overlaps(counted), len(block.photos.ids)
    sigma = np.where(np.isnan(block.plates.sigma), block.options.plate_sigma, block.plates.sigma)
    values, count = np.unique(sigma, return_counts=True)
    return Summary(
        block=block,
        few=few,
        photos=_photos(counted, points, pairs),
        points=points,
        pairs=pairs,
        part=parts(n, pairs),
        strong_part=parts(n, pairs, few),
        plate_sigma=values,
        plate_sigma_count=count,
    )


def _points(block: Block) -> PointCounts:
    plates, p = block.plates, len(block.points.ids)
    rays = np.bincount(plates.point, minlength=p)
    kind, grouped, only = np.full(p, NO_CONTROL), np.zeros(p, dtype=bool), np.full(p, -1)
    kind[block.control.point] = block.control.kind
    grouped[block.equal_elevations.point] = True
    single = rays[plates.point] == 1
    only[plates.point[single]] = plates.photo[single]
    used = np.bincount(plates.point[plates.triangulated], minlength=p)
    return PointCounts(rays=rays, used=used, kind=kind, grouped=grouped, only_photo=only)


def _photos(block: Block, points: PointCounts, pairs: Overlaps) -> PhotoCounts:
    plates, n = block.plates, len(block.photos.ids)

    def count(rays: BoolArray) -> IntArray:
        return np.bincount(plates.photo[rays], minlength=n)

    wet, kind = block.points.bathymetric[plates.point], points.kind[plates.point]
    with_next = np.zeros(n, dtype=int)
    following = pairs.second == pairs.first + 1
    with_next[pairs.first[following]] = pairs.points[following]
    return PhotoCounts(
        rays=np.bincount(plates.photo, minlength=n),
        land=count(~wet),
        submerged=count(wet),
        kept_out=count(~plates.triangulated),
        control=np.stack([count(kind == member) for member in ControlKind], axis=1),
        single=count(points.rays[plates.point] == 1),
        with_next=with_next,
        neighbours=np.bincount(np.concatenate([pairs.first, pairs.second]), minlength=n),
    )


def overlaps(block: Block) -> Overlaps:
    """Return the pairs of photos of a block that have points in common, and how many."""
    plates, n = block.plates, len(block.photos.ids)
    used = np.flatnonzero(plates.triangulated)
    used = used[np.lexsort((plates.photo[used], plates.point[used]))]
    photo, point = plates.photo[used], plates.point[used]
    pairs: list[IntArray] = []
    for apart in range(1, len(used)):
        same = point[apart:] == point[:-apart]
        if not same.any():
            break
        pairs.append(photo[:-apart][same] * n + photo[apart:][same])
    codes, count = np.unique(np.concatenate([np.zeros(0, dtype=int), *pairs]), return_counts=True)
    different = codes // max(n, 1) != codes % max(n, 1)  # a point that is measured twice on a photo ties nothing
    return Overlaps(first=codes[different] // n, second=codes[different] % n, points=count[different])


def parts(photos: int, pairs: Overlaps, at_least: int = 1) -> IntArray:
    """Return which part (n,) each photo belongs to: photos hang together by pairs with so many points in common.

    Parts are numbered from 0 in the order of their first photos.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    strong = pairs.points >= at_least
    ties = (pairs.points[strong], (pairs.first[strong], pairs.second[strong]))
    return np.asarray(connected_components(coo_array(ties, shape=(photos, photos)), directed=False)[1])


def rays_histogram(job: Summary) -> dict[str, IntArray]:
    """Return how many points have r rays, by r: all, those on land, submerged ones, those with known components.

    Each array (q,) begins with the points of no ray and ends with those of most.
    """
    rays, wet = job.points.rays, job.block.points.bathymetric
    known = (job.points.kind != NO_CONTROL) & (job.points.kind != ControlKind.CHECK)
    longest = int(rays.max(initial=0)) + 1
    masks = {"points": rays >= 0, "land": ~wet, "submerged": wet, "control": known}
    return {name: np.bincount(rays[mask], minlength=longest) for name, mask in masks.items()}


def _members(ids: TextArray, part: IntArray) -> list[TextArray]:
    return [ids[part == number] for number in range(int(part.max(initial=-1)) + 1)]
