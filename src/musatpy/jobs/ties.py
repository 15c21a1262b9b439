"""Which photos have points in common, and which hang together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import IntArray
from musatpy.model import Block
from musatpy.model.tables import Table, per_row


@dataclass(frozen=True, kw_only=True, eq=False)
class Overlaps(Table):
    """The c pairs of photos with points in common, by measurements not flagged N, in the order of the photos."""

    first: IntArray = per_row(link="photos")  # (c,)
    second: IntArray = per_row(link="photos")  # (c,), after the first one
    points: IntArray = per_row()  # (c,) number of points in common


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
    label = np.arange(photos)
    strong = pairs.points >= at_least
    first, second = pairs.first[strong], pairs.second[strong]
    while True:
        low = np.minimum(label[first], label[second])
        before = label.copy()
        np.minimum.at(label, label[first], low)
        np.minimum.at(label, label[second], low)
        label = label[label]
        if np.array_equal(label, before):
            return np.unique(label, return_inverse=True)[1]
