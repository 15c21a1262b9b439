"""Absolute orientation of a model to control of any kind, among gross errors.

The plane similarity of the horizontal control, the model lying as level as its ground, is the start; least squares
of the seven parameters with Cauchy's weights follow, each known component for itself. Photographs round an object
do not say where up is: the spatial similarity of the full control is another start, if that leads to far less.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.collinearity import turn
from musatpy.geometry.similarity import Similarity, by_change, cauchy, cauchy_cost, fit_robust, spread

_MOST_PAIRS = 2000  # of horizontal points that are tried
_ROUNDS = 12
_FAR_LESS = 0.5  # of what the errors of one start cost: less is another solution, and no rounding
_LEVEL = 0.2  # rad, within which the ground of the model is level


@dataclass(frozen=True, kw_only=True)
class Targets:
    """k known places with their model points: position (k, 3) east, north, up in m, known components (k, 3)."""

    model: FloatArray  # (k, 3)
    position: FloatArray  # (k, 3), anything where not known
    known: BoolArray  # (k, 3) east and north together, up
    weight: FloatArray  # (k,)


def absolute_orientation(targets: Targets, up: FloatArray, floor: float) -> tuple[Similarity, FloatArray] | None:
    """Return the similarity of the model to east, north, up axes and robust weights (k, 3), or None.

    `up` (3,) is about the vertical in the model, `floor` (m) the least error that counts as one. None where fewer
    than two points are horizontally known, or none vertically.
    """
    horizontal, vertical = targets.known[:, 0], targets.known[:, 2]
    if horizontal.sum() < 2 or not vertical.any():
        return None
    start = _start(targets, levelling(up))
    if start is None:
        return None
    first, full = _refined(targets, start, up, floor), targets.known.all(axis=1)
    if full.sum() < 3:
        return first
    start, _ = fit_robust(targets.model[full], targets.position[full], targets.weight[full], floor)
    other = _refined(targets, start, up, floor)
    far_less = _cost(targets, other[0], floor) < _FAR_LESS * _cost(targets, first[0], floor)
    return other if far_less else first


def _cost(targets: Targets, move: Similarity, floor: float) -> float:
    """Return what the errors of the known components cost."""
    error = np.where(targets.known, targets.position - move.apply(targets.model), 0.0)
    return float((targets.weight[:, None] * cauchy_cost(error, floor)).sum())


def levelling(up: FloatArray) -> FloatArray:
    """Return a rotation (3, 3) that takes `up` to (0, 0, 1)."""
    axis = np.eye(3)[np.abs(up).argmin()]
    east = np.cross(axis, up)
    east /= np.linalg.norm(east)
    return np.stack([east, np.cross(up, east), up])


def _start(targets: Targets, level: FloatArray) -> Similarity | None:
    """Return the similarity through the two horizontal points that agree best with all others."""
    x = targets.model @ level.T
    horizontal, vertical = np.flatnonzero(targets.known[:, 0]), np.flatnonzero(targets.known[:, 2])
    z, w = (a[horizontal, 0] + 1j * a[horizontal, 1] for a in (x, targets.position))
    if len(z) * (len(z) - 1) > 2 * _MOST_PAIRS:
        first, second = np.random.default_rng(len(z)).integers(len(z), size=(2, _MOST_PAIRS))
    else:
        first, second = np.triu_indices(len(z), 1)
    base = z[second] - z[first]
    apart = np.abs(base) > 0
    first, second, base = first[apart], second[apart], base[apart]
    if not len(base):
        return None
    a = (w[second] - w[first]) / base
    b = w[first] - a * z[first]
    error = np.abs(w - a[:, None] * z - b[:, None])
    # the median alone knows no best pair of three points; the mean of the better half does
    better = min(max(3, len(z) // 2 + 1), len(z))
    half = np.partition(error, better - 1, axis=1)[:, :better].mean(axis=1)
    good = np.abs(a) > 0
    if not good.any():
        return None
    best = int(np.where(good, half, np.inf).argmin())
    scale = float(np.abs(a[best]))
    c, s = (a[best] / scale).real, (a[best] / scale).imag
    heading = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    height = float(np.median(targets.position[vertical, 2] - scale * x[vertical, 2]))
    return Similarity(scale=scale, rotation=heading @ level, shift=np.array([b[best].real, b[best].imag, height]))


def _refined(targets: Targets, start: Similarity, up: FloatArray, floor: float) -> tuple[Similarity, FloatArray]:
    """Return the robust least squares similarity next to `start`, and the weights of its components."""
    similarity = start
    level = (floor / _LEVEL) ** 2  # weight of the level ground, where that of a known component is 1
    robust = np.zeros(targets.known.shape)
    for _ in range(_ROUNDS):
        Y = similarity.apply(targets.model)
        error = np.where(targets.known, targets.position - Y, 0.0)
        robust = _robust_weights(targets, error, floor)
        middle = Y.mean(axis=0)
        J = by_change(Y - middle)
        N = np.einsum("kia,ki,kib->ab", J, robust, J)
        rhs = np.einsum("kia,ki,ki->a", J, robust, error)
        N[1:3, 1:3] += level * np.eye(2)
        rhs[1:3] += level * np.cross(similarity.rotation @ up, [0.0, 0.0, 1.0])[:2]
        step = np.linalg.lstsq(N, rhs, rcond=1e-14)[0]
        scale, R = max(1.0 + float(step[0]), 0.1), turn(step[1:4])  # about the middle
        change = Similarity(scale=scale, rotation=R, shift=middle + step[4:] - scale * R @ middle)
        similarity = change.after(similarity)
    return similarity, robust


def _robust_weights(targets: Targets, error: FloatArray, floor: float) -> FloatArray:
    """Return weights (k, 3): horizontal errors count by their length, heights for themselves."""
    robust = np.zeros(error.shape)
    for components in (slice(0, 2), slice(2, 3)):
        known = targets.known[:, components.start]
        if known.any():
            off = np.linalg.norm(error[:, components], axis=1) * np.sqrt(targets.weight)
            weight = cauchy(off, spread(off[known], floor), targets.weight * known)
            robust[:, components] = weight[:, None]
    return robust
