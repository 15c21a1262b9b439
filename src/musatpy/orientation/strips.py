"""Models of photo pairs joined to strips, and strips to the block, through the points they have in common.

A tree grows over the photos from the best pairs, whatever the flying pattern. A photo is hung on to a model by one
pair: the photo they share gives the rotation, the distances from its station to common points the scale. Two models
of several photos are joined by a robust similarity of common points and of what the pairs between them carry over;
where both only meet along a line of points, the ground on either side of it is taken to go on level.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry import similarity
from musatpy.geometry.similarity import Similarity
from musatpy.model import Block
from musatpy.orientation.relative import model_points, relative_orientations

FEWEST = 5  # common points of a pair
SUBMERGED = 0.1  # weight of submerged points, whose straight rays do not quite meet
_NEIGHBOURS = 8  # pairs of a photo that are oriented, those with the most points
_CHUNK = 400  # pairs at a time
_SUREST = 0.05  # rad; pairs with a larger error are not used
_KEPT = 0.3  # robust weight from which a point of a pair enters its model
_SHALLOW = 0.02  # rad; rays that meet at a smaller angle give no point
_SPREAD = 0.1  # of the scale by single points, relative to its median, up to which a photo is hung on
_LEVEL = 1e-5  # weight of the level ground, against that of a common point
_FIT = 0.02  # median error of common points, in flying heights, up to which models are joined
_NOISE = 5.0  # least error of a point of a model, in image errors


@dataclass(frozen=True, kw_only=True)
class Tangents:
    """m images as tangents, ((x - xp)/f, (y - yp)/f), sorted by point: `photo`, `point`, `weight` (m,)."""

    photo: IntArray
    point: IntArray
    x: FloatArray  # (m, 2)
    weight: FloatArray


@dataclass(frozen=True, kw_only=True)
class PhotoModel:
    """k photos and q points in axes and units of their own."""

    photo: IntArray  # (k,)
    M: FloatArray  # (k, 3, 3) model to photo
    C: FloatArray  # (k, 3) stations
    point: IntArray  # (q,) sorted
    X: FloatArray  # (q, 3)

    def moved(self, by: Similarity) -> PhotoModel:
        """Return the model in other axes."""
        return replace(self, M=by.turn(self.M), C=by.apply(self.C), X=by.apply(self.X))

    def row(self, photo: int) -> int:
        """Return the row of a photo."""
        return int(np.flatnonzero(self.photo == photo)[0])

    @property
    def height(self) -> float:
        """Typical distance of the points from the nearest station."""
        middle = self.X[:: max(1, len(self.X) // 50)]
        return float(np.median(np.linalg.norm(middle[:, None] - self.C, axis=2).min(axis=1)))

    @property
    def up(self) -> FloatArray:
        """(3,) normal of the ground, to the side of the cameras; their mean axis where the points lie on a line."""
        spread = self.X - self.X.mean(axis=0)
        values, vectors = np.linalg.eigh(spread.T @ spread)
        axis = self.M[:, 2].mean(axis=0)
        n = vectors[:, 0] * np.sign(vectors[:, 0] @ axis)
        flat = values[1] > 0.01 * values[2] and n @ axis > 0.5 * np.linalg.norm(axis)
        return n if flat else axis / np.linalg.norm(axis)


@dataclass(frozen=True, kw_only=True)
class OrientedPair:
    """An oriented pair as a model, and the size of its angular error, rad."""

    first: int
    second: int
    model: PhotoModel
    sigma: float


def sights_of(block: Block) -> Tangents:
    """Return the triangulated images of a block as tangents."""
    plates, cameras = block.plates, block.cameras
    rows = np.flatnonzero(plates.triangulated & np.isfinite(plates.xy).all(axis=1))
    rows = rows[np.argsort(plates.point[rows], kind="stable")]
    camera = block.photos.camera[plates.photo[rows]]
    x = (plates.xy[rows] - cameras.principal_point[camera]) / cameras.focal_length[camera][:, None]
    return Tangents(
        photo=plates.photo[rows],
        point=plates.point[rows],
        x=x,
        weight=np.where(block.points.bathymetric[plates.point[rows]], SUBMERGED, 1.0),
    )


def tangent_sigma(block: Block) -> float:
    """Return the plate sigma of the job as a tangent: the least error that images are taken to have."""
    return float(block.options.plate_sigma / np.median(block.cameras.focal_length))


def models_of(block: Block, sights: Tangents) -> list[PhotoModel]:
    """Return the models that oriented pairs make when joined."""
    sigma = tangent_sigma(block)
    return joined_models(oriented_pairs(sights, sigma), sigma)


def oriented_pairs(sights: Tangents, floor: float) -> list[OrientedPair]:
    """Return the pairs of photos that could be oriented, the surest first; `floor` as in `relative`."""
    first, second, ends, rows = common_images(sights, FEWEST)
    pairs: list[OrientedPair] = []
    for chunk in range(0, len(first), _CHUNK):
        part = slice(chunk, chunk + _CHUNK)
        pairs += _oriented(sights, first[part], second[part], ends[part], rows, floor)
    return sorted(pairs, key=lambda pair: pair.sigma)


def common_images(sights: Tangents, fewest: int) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Return the pairs first, second (k,) with at least `fewest` points in common, and their images.

    These are rows (c, 2) of the sights; those of a pair stand from ends[:, 0] to ends[:, 1]. Of each photo only the
    pairs with the most points are taken.
    """
    number = int(sights.photo.max(initial=0)) + 1
    _, begin, count = np.unique(sights.point, return_index=True, return_counts=True)
    parts = []
    for m in np.unique(count[count > 1]).tolist():
        rays = begin[count == m][:, None] + np.arange(m)
        i, j = np.triu_indices(m, 1)
        parts.append(np.stack([rays[:, i].ravel(), rays[:, j].ravel()], axis=1))
    rows = np.concatenate(parts) if parts else np.zeros((0, 2), dtype=np.int64)
    swapped = sights.photo[rows[:, 0]] > sights.photo[rows[:, 1]]
    rows[swapped] = rows[swapped][:, ::-1]
    key = sights.photo[rows[:, 0]] * number + sights.photo[rows[:, 1]]
    order = np.argsort(key, kind="stable")
    rows = rows[order]
    keys, start, size = np.unique(key[order], return_index=True, return_counts=True)
    first, second = np.divmod(keys, number)
    wanted = (size >= fewest) & (first != second) & _among_the_best(first, second, size)
    ends = np.stack([start, start + size], axis=1)
    by_size = np.flatnonzero(wanted)[np.argsort(size[wanted], kind="stable")]  # alike ones share a chunk
    return first[by_size], second[by_size], ends[by_size], rows


def _among_the_best(first: IntArray, second: IntArray, size: IntArray) -> BoolArray:
    """Return whether a pair has, for one of its photos, one of the largest numbers of points in common."""
    here, pair = np.concatenate([first, second]), np.tile(np.arange(len(first)), 2)
    order = np.lexsort((-size[pair], here))
    _, start, count = np.unique(here[order], return_index=True, return_counts=True)
    rank = np.arange(len(order)) - np.repeat(start, count)
    best = np.zeros(len(first), dtype=bool)
    best[pair[order[rank < _NEIGHBOURS]]] = True
    return best


def _oriented(
    sights: Tangents, first: IntArray, second: IntArray, ends: IntArray, rows: IntArray, floor: float
) -> Iterator[OrientedPair]:
    x1, x2, weight, one = common_tangents(sights, ends, rows)
    orientations = relative_orientations(x1, x2, weight, floor)
    X, distance = model_points(x1, x2, orientations.rotation, orientations.base)
    kept = (orientations.weight > _KEPT * weight) & (weight > 0.0) & (distance > 0).all(axis=-1)
    kept &= np.isfinite(X).all(axis=-1) & (np.linalg.norm(X, axis=-1) < 1.0 / _SHALLOW)
    sure = orientations.is_sound & (orientations.sigma < _SUREST) & (kept.sum(axis=1) >= FEWEST)
    for row in np.flatnonzero(sure).tolist():
        point = sights.point[one[row][kept[row]]]
        order = np.argsort(point)
        model = PhotoModel(
            photo=np.array([first[row], second[row]]),
            M=np.stack([np.eye(3), orientations.rotation[row]]),
            C=np.stack([np.zeros(3), orientations.base[row]]),
            point=point[order],
            X=X[row][kept[row]][order],
        )
        yield OrientedPair(
            first=int(first[row]), second=int(second[row]), model=model, sigma=float(orientations.sigma[row])
        )


def common_tangents(
    sights: Tangents, ends: IntArray, rows: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Return tangents (k, m, 2) of pairs on both photos, weights (k, m), 0 of none, and the images on the first."""
    place = ends[:, :1] + np.arange(int((ends[:, 1] - ends[:, 0]).max()))
    present = place < ends[:, 1:]
    one, other = np.moveaxis(rows[np.where(present, place, 0)], -1, 0)
    x1, x2 = (np.where(present[..., None], sights.x[table], 0.0) for table in (one, other))
    return x1, x2, np.where(present, np.minimum(sights.weight[one], sights.weight[other]), 0.0), one


@dataclass(frozen=True, kw_only=True)
class _Bridge:
    """What a pair says of two models: the similarity, and stations and points of the one (x) in the other (y)."""

    move: Similarity
    x: FloatArray  # (k, 3)
    y: FloatArray  # (k, 3)


def joined_models(pairs: list[OrientedPair], floor: float) -> list[PhotoModel]:
    """Return the models that all pairs give when joined, the largest first; no photo is in two of them."""
    forest = _Forest(floor=floor, pairs=pairs)
    waiting = pairs
    while True:
        left = [pair for pair in waiting if not forest.take(pair)]
        if len(left) == len(waiting):
            break
        waiting = left
    forest.join_by_points()
    return sorted(forest.parts.values(), key=lambda model: -len(model.photo))


class _Forest:
    """The models as they grow: each photo belongs to one at most."""

    def __init__(self, floor: float, pairs: list[OrientedPair]) -> None:
        self.floor = floor
        self.of_photo: dict[int, int] = {}
        self.parts: dict[int, PhotoModel] = {}
        self.pairs_of: dict[int, list[OrientedPair]] = {}
        self.refused: set[tuple[int, int]] = set()  # models that do not join as they are
        for pair in pairs:
            for photo in (pair.first, pair.second):
                self.pairs_of.setdefault(photo, []).append(pair)

    def take(self, pair: OrientedPair) -> bool:
        """Make the pair part of a model, if that is possible by now; return whether it need not come again."""
        first, second = (self.of_photo.get(photo) for photo in (pair.first, pair.second))
        if first is not None and first == second:
            return True
        if first is None and second is None:
            self._store(max(self.parts, default=0) + 1, pair.model)
            return True
        if first is not None and second is not None:
            return self._join(first, second)
        shared, number = (pair.first, first) if first is not None else (pair.second, second)
        assert number is not None
        whole = self.parts[number]
        move = carried(whole, pair.model, shared)
        if move is None:
            return False
        self._store(number, _united(whole, pair.model.moved(move)))
        return True

    def _store(self, number: int, model: PhotoModel) -> None:
        self.parts[number] = model
        self.refused = {models for models in self.refused if number not in models}
        self.of_photo.update(dict.fromkeys(model.photo.tolist(), number))

    def _join(self, one: int, other: int) -> bool:
        if len(self.parts[one].photo) < len(self.parts[other].photo):
            one, other = other, one
        if (one, other) in self.refused:
            return False
        whole, part = self.parts[one], self.parts[other]
        move = between(whole, part, self._bridges(whole, part), self.floor)
        if move is None:
            self.refused.add((one, other))
            return False
        del self.parts[other]
        self._store(one, _united(whole, part.moved(move)))
        return True

    def _bridges(self, whole: PhotoModel, part: PhotoModel) -> list[_Bridge]:
        """Return the pairs that reach from one model to the other and have a sure scale in both."""
        bridges = []
        inside = set(whole.photo.tolist())
        for photo in part.photo.tolist():
            for pair in self.pairs_of[photo]:
                other = pair.second if pair.first == photo else pair.first
                if other not in inside:
                    continue
                to_whole, to_part = carried(whole, pair.model, other), carried(part, pair.model, photo)
                if to_whole is not None and to_part is not None:
                    bridges.append(_bridge(whole, part, pair.model, to_whole, to_part))
        return bridges

    def join_by_points(self) -> None:
        """Join models that no pair connects, those with the most points in common first."""
        while True:
            shared = [
                (len(np.intersect1d(self.parts[a].point, self.parts[b].point)), a, b)
                for a, b in combinations(self.parts, 2)
            ]
            if not any(self._join(a, b) for count, a, b in sorted(shared, reverse=True) if count >= 3):
                return


def carried(whole: PhotoModel, part: PhotoModel, photo: int) -> Similarity | None:
    """Return the similarity of `part` to `whole` by a photo in both, None without a sure scale by common points."""
    _, in_whole, in_part = np.intersect1d(whole.point, part.point, assume_unique=True, return_indices=True)
    if not len(in_whole):
        return None
    i, j = whole.row(photo), part.row(photo)
    ratio = np.linalg.norm(whole.X[in_whole] - whole.C[i], axis=1) / np.linalg.norm(
        part.X[in_part] - part.C[j], axis=1
    )
    scale = float(np.median(ratio))
    if np.median(np.abs(ratio - scale)) > _SPREAD * scale:
        return None
    rotation = whole.M[i].T @ part.M[j]
    return Similarity(scale=scale, rotation=rotation, shift=whole.C[i] - scale * rotation @ part.C[j])


def _bridge(
    whole: PhotoModel, part: PhotoModel, pair: PhotoModel, to_whole: Similarity, to_part: Similarity
) -> _Bridge:
    """Return what a pair, of which each model holds a photo, carries over: its own place in both tells the rest."""
    x, y = [], []
    for model, move in ((part, to_whole), (whole, to_part)):
        _, in_model, in_pair = np.intersect1d(model.photo, pair.photo, assume_unique=True, return_indices=True)
        _, held, seen = np.intersect1d(model.point, pair.point, assume_unique=True, return_indices=True)
        here = np.concatenate([model.C[in_model], model.X[held]])
        there = move.apply(np.concatenate([pair.C[in_pair], pair.X[seen]]))
        x.append(here if model is part else there)
        y.append(there if model is part else here)
    return _Bridge(move=to_whole.after(to_part.inverse()), x=np.concatenate(x), y=np.concatenate(y))


def between(whole: PhotoModel, part: PhotoModel, bridges: list[_Bridge], floor: float) -> Similarity | None:
    """Return the similarity of `part` to `whole` by common points and stations carried over, None if they disagree.

    `floor` is the least error of an image, a tangent.
    """
    _, in_whole, in_part = np.intersect1d(whole.point, part.point, assume_unique=True, return_indices=True)
    x = np.concatenate([part.X[in_part], *(bridge.x for bridge in bridges)])
    y = np.concatenate([whole.X[in_whole], *(bridge.y for bridge in bridges)])
    if len(x) < 3:
        return None
    height = whole.height
    starts = [bridge.move for bridge in bridges]
    move, robust = similarity.fit_robust(x, y, np.ones(len(x)), _NOISE * floor * height, starts)
    error = np.linalg.norm(y - move.apply(x), axis=1)
    if np.median(error) > _FIT * height or not move.scale > 0:
        return None
    # the ground of both goes on level: told by points above the common ones
    level = np.full(len(in_whole), _LEVEL) * robust[: len(in_whole)]
    x = np.concatenate([x, part.X[in_part] + part.up * height / move.scale])
    y = np.concatenate([y, whole.X[in_whole] + whole.up * height])
    return similarity.fit(x, y, np.concatenate([robust, level]))


def _united(whole: PhotoModel, part: PhotoModel) -> PhotoModel:
    """Return both models as one; photos and points of both keep their place in `whole`."""
    photos, points = ~np.isin(part.photo, whole.photo), ~np.isin(part.point, whole.point)
    point = np.concatenate([whole.point, part.point[points]])
    order = np.argsort(point)
    return PhotoModel(
        photo=np.concatenate([whole.photo, part.photo[photos]]),
        M=np.concatenate([whole.M, part.M[photos]]),
        C=np.concatenate([whole.C, part.C[photos]]),
        point=point[order],
        X=np.concatenate([whole.X, part.X[points]])[order],
    )
