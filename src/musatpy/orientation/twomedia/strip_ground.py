"""A strip put to its control and to the plane of water: absolute orientation by a weighted similarity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.collinearity import skew
from musatpy.geometry.similarity import Similarity, fit_robust, small
from musatpy.orientation.twomedia.moved import Moved, moved_places, moved_planes
from musatpy.orientation.twomedia.oriented import OrientationError
from musatpy.orientation.twomedia.strip_chain import Chain
from musatpy.orientation.twomedia.triplet_models import PLANE

MOTIONS = ("scale", "tilt about X", "tilt about Y", "heading", "X", "Y", "Z")
_STEPS = 20
_STILL = 1e-9  # of a change of the similarity, relative to the size of the ground
_FREE = 1e-9  # eigenvalue of the scaled normals up to which a motion is free
_FLAT = 0.05  # of the extent along, that across the control from which it fixes the tilts


@dataclass(frozen=True, kw_only=True, eq=False)
class Known:
    """o observations of the ground: quantities `row` (o,) of triplets `model` (o,) and what is known of them.

    target (o, 3) with NaN for what is not known, variance (o, 3). The variance `shared` (3,) of the components of
    planes is that of one error in all of them.
    """

    model: IntArray
    row: IntArray
    target: FloatArray
    variance: FloatArray
    shared: FloatArray

    @property
    def plane(self) -> BoolArray:
        """(o,) those of the plane of water."""
        return self.row == PLANE

    def __getitem__(self, kept: BoolArray) -> Known:
        rows = {name: getattr(self, name)[kept] for name in ("model", "row", "target", "variance")}
        return Known(**rows, shared=self.shared)


@dataclass(frozen=True, kw_only=True, eq=False)
class Placed:
    """The similarity `move` from the axes of a strip to the ground, and its gain (o, 7, 3) of the observations.

    residual (o, 3) known less placed, NaN for what is not known. `change` is the size of the similarity: 0 where
    the axes were those of the ground.
    """

    move: Similarity
    change: float
    gain: FloatArray
    residual: FloatArray


def placed(known: Known, chain: Chain) -> Placed:
    """Return the absolute orientation of a strip.

    Every observation has the weight of its own error and of that within its triplet. Raises `OrientationError`
    where they leave a motion free.
    """
    value, spread = _in_strip(known, chain)
    given = np.isfinite(known.target)
    planes = max(int(known.plane.sum()), 1)
    variance = known.variance + np.where(known.plane[:, None], planes * known.shared, 0.0)
    move = _start(known, value)
    size = _size(known)
    for _ in range(_STEPS):
        there = _moved(known, move, value)
        residual = np.where(given, known.target - there.value, 0.0)
        V = there.by_old @ spread @ np.swapaxes(there.by_old, 1, 2) + variance[:, None] * np.eye(3)
        both = given[:, :, None] & given[:, None]
        W = np.linalg.pinv(np.where(both, V, 0.0), hermitian=True)
        GW = np.swapaxes(there.by_change, 1, 2) @ W
        N = np.einsum("oxi,oiy->xy", GW, there.by_change)
        _require_rank(N, there.value[~known.plane])
        gain = np.linalg.inv(N) @ GW
        change = np.einsum("oxi,oi->x", gain, residual)
        move = small(change).after(move)
        if np.abs(change).max() <= _STILL * size:
            break
    there = _moved(known, move, value)
    change = max(abs(move.scale - 1.0), np.abs(move.rotation - np.eye(3)).max(), np.abs(move.shift).max() / size)
    return Placed(move=move, change=float(change), gain=gain, residual=known.target - there.value)


def _in_strip(known: Known, chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Return the observed quantities (o, 3) in the axes of the strip, and their covariances in their triplets."""
    value, spread = np.empty((len(known.row), 3)), np.empty((len(known.row), 3, 3))
    for number in np.unique(known.model):
        here = known.model == number
        model, rows = chain.models[number], known.row[here]
        there = model.moved(chain.moves[number], rows)
        J = there.by_old @ model.influence(rows)
        value[here], spread[here] = there.value, (J * model.variance) @ np.swapaxes(J, 1, 2)
    return value, spread


def _moved(known: Known, move: Similarity, value: FloatArray) -> Moved:
    """Return the observed quantities on the ground."""
    parts = Moved(
        value=np.empty_like(value), by_old=np.empty((*value.shape, 3)), by_change=np.empty((*value.shape, 7))
    )
    for rows, moved in ((known.plane, moved_planes), (~known.plane, moved_places)):
        part = moved(move, value[rows])
        parts.value[rows], parts.by_old[rows], parts.by_change[rows] = part.value, part.by_old, part.by_change
    return parts


def _size(known: Known) -> float:
    places = known.target[~known.plane]
    return max(1.0, float(np.nanmax(np.abs(places), initial=0.0)))


def _require_rank(N: FloatArray, places: FloatArray) -> None:
    """Raise `OrientationError` where normals (7, 7) leave a motion free, named about the middle of places."""
    middle = places.mean(axis=0)
    centred = np.eye(7)
    centred[4:, 0], centred[4:, 1:4] = -middle, skew(middle)
    N = centred.T @ N @ centred
    diagonal = np.sqrt(np.diagonal(N))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    values, vectors = np.linalg.eigh(N / np.outer(scale, scale))
    free = [MOTIONS[int(np.argmax(np.abs(vectors[:, row])))] for row in np.flatnonzero(values < _FREE)]
    if free:
        raise OrientationError(
            f"STRIP: control and water leave {', '.join(dict.fromkeys(free))} of the strip free; three full "
            "control points off a line hold it, or two where the tilt of the water is known (LEVEL)"
        )


def _start(known: Known, value: FloatArray) -> Similarity:
    """Return the similarity of full control points, or, where these are few, with the water as level."""
    full = ~known.plane & np.isfinite(known.target).all(axis=1)
    target, place = known.target[full], value[full]
    if len(target) >= 3:
        extent = np.linalg.svd(target - target.mean(axis=0), compute_uv=False)
        if extent[1] > _FLAT * extent[0]:
            floor = 1e-6 * float(extent[0])
            return fit_robust(place, target, np.ones(len(place)), floor)[0]
    return _level_start(known, value)


def _level_start(known: Known, value: FloatArray) -> Similarity:
    """Return the similarity that makes the water of the first triplet level; the rest by X and Y, and by Z."""
    plane = value[known.plane][:1]
    normal = np.append(-plane[0, :2], 1.0) if len(plane) else np.array([0.0, 0.0, 1.0])
    normal /= np.linalg.norm(normal)
    across = np.cross(normal, [0.0, 0.0, 1.0])
    K = np.array([[0, -across[2], across[1]], [across[2], 0, -across[0]], [-across[1], across[0], 0]])
    upright = Similarity(scale=1.0, rotation=np.eye(3) + K + K @ K / (1.0 + normal[2]), shift=np.zeros(3))
    place = upright.apply(value)
    plan = ~known.plane & np.isfinite(known.target[:, :2]).all(axis=1)
    z, w = (part[plan] @ np.array([1.0, 1j]) for part in (place[:, :2], known.target[:, :2]))
    if len(z) < 2 or not np.ptp(np.abs(z - z[:1])) > 0.0:
        raise OrientationError("STRIP: two control points of known X and Y at least give it scale and heading")
    a = np.vdot(z - z.mean(), w - w.mean()) / np.vdot(z - z.mean(), z - z.mean())
    angle, scale = float(np.angle(a)), float(np.abs(a))
    about = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    heights = ~known.plane & np.isfinite(known.target[:, 2])
    Z = float(np.mean(known.target[heights, 2] - scale * place[heights, 2])) if heights.any() else 0.0
    shift = w.mean() - a * z.mean()
    return Similarity(scale=scale, rotation=about, shift=np.array([shift.real, shift.imag, Z])).after(upright)
