"""Which tracks of a model go into an adjustment: as many a photo as it needs, spread over it, the best ones.

All others come back after it as intersected points. Nothing is left to chance or to the order of a file: tracks are
numbered by their rank (most rays, widest angle, least residual, id), and photos go by their ids.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.sfm.model import Model
from musatpy.sfm.wet import Wet

COLUMNS, ROWS = 8, 6  # of cells, along the longer and the shorter side of a photo
COMMON = 12  # tracks of each pair of photos that overlap
_ANGLE, _RESIDUAL = 0.1, 0.01  # degree, px: what is nearer counts as equal, on every machine
_AT_A_TIME = 2**18


@dataclass(frozen=True, kw_only=True, eq=False)
class Thinned:
    """Which of p tracks are kept."""

    kept: BoolArray  # (p,)
    double: BoolArray  # (p,) dropped: two images in one photo


def thinned(model: Model, wet: IntArray, per_photo: int = 120) -> Thinned:
    """Return which tracks of a model are kept, so that photos have `per_photo` images at least; 0: all.

    `wet` (p,) are codes of `Wet`: points that are undecided or on the surface are left out, and a third of the
    images of a photo is wet and a third dry where it has so many. Pairs of photos have 12 kept tracks in common, or
    all that they have. Control, checks and markers are no tracks of a model, and all stay.
    """
    count, photos = len(model.points), len(model.photos)
    number = np.argsort(np.argsort(model.photos, kind="stable"), kind="stable")[model.photo]
    pairs = np.sort(number * max(count, 1) + model.point)
    double = np.zeros(count, dtype=bool)
    double[pairs[1:][pairs[1:] == pairs[:-1]] % max(count, 1)] = True
    usable = ~double & (model.counts > 1) & np.isin(wet, (Wet.DRY, Wet.WET))
    if not per_photo:
        return Thinned(kept=usable, double=double)
    order = ranked(model)
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    rows = np.flatnonzero(usable[model.point])
    rows = rows[np.argsort(number[rows] * max(count, 1) + rank[model.point[rows]])]
    track, cell, wet = rank[model.point[rows]], _cells(model)[rows], wet[order]
    starts = np.searchsorted(number[rows], np.arange(photos + 1))
    kept = np.zeros(count, dtype=bool)
    for first, last in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
        here, of = track[first:last], cell[first:last]
        for code in (Wet.WET, Wet.DRY):
            some = wet[here] == code
            _add(kept, here[some], of[some], per_photo // 3)
        _add(kept, here, of, per_photo, per_photo // (COLUMNS * ROWS))
    _link(kept, track, starts)
    return Thinned(kept=kept[rank], double=double)


def ranked(model: Model) -> IntArray:
    """Return the tracks (p,) of a model, the best first: most rays, widest angle, least residual, then by id."""
    size = np.nan_to_num(model.misses, nan=1e6)
    residual = np.bincount(model.point, size, len(model.points)) / np.maximum(model.counts, 1)
    coarse = np.rint(residual / _RESIDUAL), -np.rint(np.degrees(widest_angles(model)) / _ANGLE), -model.counts
    return np.lexsort((model.points, *coarse))


def widest_angles(model: Model) -> FloatArray:
    """Return the widest angle (p,) rad between two rays of each track, 0 without two."""
    order, out = np.argsort(model.point, kind="stable"), np.zeros(len(model.points))
    start = np.cumsum(model.counts) - model.counts
    for length in np.unique(model.counts[model.counts > 1]).tolist():
        tracks = np.flatnonzero(model.counts == length)
        for some in np.array_split(tracks, 1 + len(tracks) * length // _AT_A_TIME):
            photo = model.photo[order[start[some] + np.arange(length)[:, None]]]
            rays = np.moveaxis(model.position[some] - model.centre[photo], 2, 0).copy()  # x, y, z
            with np.errstate(invalid="ignore"):
                rays /= np.sqrt(np.einsum("ait,ait->it", rays, rays))
            cosine = np.ones(len(some))
            for apart in range(1, length):
                pairs = np.einsum("ait,ait->it", rays[:, apart:], rays[:, :-apart])
                np.minimum(cosine, pairs.min(axis=0), out=cosine)
            out[some] = np.arccos(np.clip(cosine, -1.0, 1.0))
    return np.nan_to_num(out)


def _cells(model: Model) -> IntArray:
    """Return the cell (m,) of each image on its photo, as small numbers."""
    size = np.array([(lens.width, lens.height) for lens in model.lenses], dtype=float).reshape(-1, 2)
    cells = np.where(size[:, :1] >= size[:, 1:], [COLUMNS, ROWS], [ROWS, COLUMNS])
    of = model.camera[model.photo]
    most = cells.take(of, axis=0)
    column, row = np.clip(model.pixel / size.take(of, axis=0) * most, 0, most - 1).T.astype(np.int16)
    return row * COLUMNS + column


def _add(kept: BoolArray, track: IntArray, cell: IntArray, wanted: int, each: int = 0) -> None:
    """Keep the best tracks (k,) of a photo, from its cells in turn: `each` of every cell, and so many in all."""
    chosen = kept[track]
    lacking = wanted - int(chosen.sum())
    if lacking <= 0 and not each:
        return
    key = 2 * cell + ~chosen  # within cells those that are kept already, then by rank
    order = np.argsort(key, kind="stable")  # small numbers are sorted in one pass
    of, turn = cell[order], np.empty(len(order), dtype=np.int16)
    turn[order] = np.minimum(np.arange(len(order)) - np.searchsorted(of, of), 2**15 - 1)
    fresh = np.flatnonzero(~chosen)
    most = max(lacking, int((turn[fresh] < each).sum()), 0)
    kept[track[fresh[np.argsort(turn[fresh], kind="stable")[:most]]]] = True


def _link(kept: BoolArray, track: IntArray, starts: IntArray) -> None:
    """Keep more of the tracks (k,) of photos, sorted by photo and rank, until pairs have enough in common."""
    count, order = len(starts) - 1, np.argsort(track, kind="stable")
    photo, place = np.repeat(np.arange(count), np.diff(starts))[order], np.empty_like(order)
    place[order] = np.arange(len(order))
    ends = np.cumsum(np.bincount(track, minlength=len(kept)))  # of the photos of each track
    for start, end in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
        mine, after = track[start:end], place[start:end] + 1
        length = ends[mine] - after  # of the photos of a track those behind this one
        other = photo[np.repeat(after - np.cumsum(length) + length, length) + np.arange(length.sum())]
        every = np.bincount(other, minlength=count)
        lacking = np.minimum(every, COMMON) > np.bincount(other, np.repeat(kept[mine], length), count)
        marked = np.zeros(len(kept), dtype=bool)
        marked[mine] = True
        for another in np.flatnonzero(lacking).tolist():
            shared = track[starts[another] : starts[another + 1]]
            shared = shared[marked[shared]]
            chosen = kept[shared]
            kept[shared[~chosen][: max(COMMON - int(chosen.sum()), 0)]] = True
