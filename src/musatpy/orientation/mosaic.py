"""Near-vertical photos laid side by side: a block of plane similarities, which two common points a pair can hold.

Where photos have too few points in common for relative orientation, the images of flat ground on vertical photos
still fit by plane similarities, with errors of some degrees and some per cent of the flying height. Scale and
heading come first, as logarithms, so that no scale shrinks; the places follow. Both are linear and robust.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from musatpy.arrays import ComplexArray, FloatArray, IntArray, sums
from musatpy.geometry.similarity import cauchy, spread
from musatpy.orientation.relative import plane_similarity
from musatpy.orientation.strips import PhotoModel, Tangents, common_images, common_tangents

_FEWEST = 3  # common points of a pair: with two every gross error would pass
_ROUNDS = 12  # of robust weights
_FLOOR = 1e-3  # of the flying height, and rad: the least error of a mosaic


def mosaics(sights: Tangents) -> list[PhotoModel]:
    """Return models of vertical photos over flat ground, one for each part that pairs hold together."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # heavy, of few jobs

    first, second, turn, weight = _links(sights)
    if not len(first):
        return []
    photos = np.unique([first, second])
    i, j = np.searchsorted(photos, (first, second))
    count, part = connected_components(coo_array((weight, (i, j)), shape=(len(photos),) * 2), directed=False)
    inside = (part[i] == number for number in range(count))
    return [_laid(sights, first[rows], second[rows], turn[rows], weight[rows]) for rows in inside]


def _links(sights: Tangents) -> tuple[IntArray, IntArray, ComplexArray, FloatArray]:
    """Return pairs of photos (k,), first and second, their turns (k,) and weights (k,).

    A turn is the logarithm of scale and turn from the second to the first: the headings, and the ground units of a
    tangent of the one over those of the other.
    """
    first, second, ends, rows = common_images(sights, _FEWEST)
    if not len(first):
        return first, second, np.zeros(0, dtype=complex), np.zeros(0)
    x1, x2, weight, _ = common_tangents(sights, ends, rows)
    a, _, robust = plane_similarity(x1, x2, weight)
    # the spread of the points is what turns errors of images into those of scale and turn
    z = x1[..., 0] + 1j * x1[..., 1]
    share = weight * robust
    middle = (share * z).sum(axis=1) / np.maximum(share.sum(axis=1), 1e-300)
    width = (share * np.square(np.abs(z - middle[:, None]))).sum(axis=1)
    good = np.isfinite(a) & (np.abs(a) > 0.2) & (np.abs(a) < 5.0) & (width > 0)
    # x2 = a x1 + b, and on the ground a1 x1 = a2 x2 but for the places: log a2 = log a1 - log a
    return first[good], second[good], -np.log(a[good]), width[good]


def _laid(
    sights: Tangents, first: IntArray, second: IntArray, turn: ComplexArray, weight: FloatArray
) -> PhotoModel:
    """Return the model of the photos of pairs that hold together."""
    part = np.unique([first, second])
    i, j = np.searchsorted(part, (first, second))
    a = np.exp(_turns(i, j, turn, weight, len(part)))
    rows = np.flatnonzero(np.isin(sights.photo, part))
    photo = np.searchsorted(part, sights.photo[rows])
    arms = a[photo] * (sights.x[rows, 0] + 1j * sights.x[rows, 1])
    point, index, count = np.unique(sights.point[rows], return_inverse=True, return_counts=True)
    many = count[index] > 1
    b, w = _places(photo[many], index[many], arms[many], sights.weight[rows[many]], len(part), len(point))
    height, turned = np.abs(a), a / np.abs(a)
    M = np.zeros((len(part), 3, 3))
    M[:, 0, 0] = M[:, 1, 1] = turned.real
    M[:, 0, 1], M[:, 1, 0] = turned.imag, -turned.imag
    M[:, 2, 2] = 1.0
    tied = count > 1
    return PhotoModel(
        photo=part,
        M=M,
        C=np.stack([b.real, b.imag, height], axis=1),
        point=point[tied],
        X=np.stack([w.real, w.imag, np.zeros(len(w))], axis=1)[tied],
    )


def _turns(i: IntArray, j: IntArray, turn: ComplexArray, weight: FloatArray, photos: int) -> ComplexArray:
    """Return log a (n,) of the photos from the differences log a_j - log a_i; that of photo 0 is 0.

    Headings are first carried along the surest pairs, because differences are known but for whole turns.
    """
    logs = _carried(i, j, turn, weight, photos)
    robust = weight
    for _ in range(_ROUNDS):
        off = turn - (logs[j] - logs[i])
        off = off - 2j * np.pi * np.rint(off.imag / (2 * np.pi))
        robust = cauchy(np.abs(off), spread(np.abs(off), _FLOOR), weight)
        N = np.zeros((photos, photos))
        np.add.at(N, (np.concatenate([i, j]), np.concatenate([j, i])), -np.tile(robust, 2))
        N -= np.diag(N.sum(axis=1))
        logs = logs + _solved(N, sums(robust * off, j, photos) - sums(robust * off, i, photos))
    return logs


def _carried(i: IntArray, j: IntArray, turn: ComplexArray, weight: FloatArray, photos: int) -> ComplexArray:
    """Return log a (n,) carried along the tree of the surest pairs, from photo 0."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    tree = minimum_spanning_tree(coo_array((1.0 / weight, (i, j)), shape=(photos, photos)))
    order, before = breadth_first_order(tree, 0, directed=False)
    turns = dict(zip(zip(i.tolist(), j.tolist(), strict=True), turn.tolist(), strict=True))
    logs = np.zeros(photos, dtype=complex)
    for photo, last in zip(order[1:].tolist(), before[order[1:]].tolist(), strict=True):
        logs[photo] = logs[last] + (turns[last, photo] if (last, photo) in turns else -turns[photo, last])
    return logs


def _places(
    photo: IntArray, point: IntArray, arms: ComplexArray, weight: FloatArray, photos: int, points: int
) -> tuple[ComplexArray, ComplexArray]:
    """Return the places b (n,) of the principal points and w (p,) of the points: b + arm = w, b of photo 0 is 0."""
    robust = weight
    b, w = np.zeros(photos, dtype=complex), np.zeros(points, dtype=complex)
    for _ in range(_ROUNDS):
        total = np.maximum(np.bincount(point, robust, points), 1e-300)
        # points eliminated: N = D - S' S / total over the shared ones, dense in the photos
        shares = np.zeros((points, photos))
        np.add.at(shares, (point, photo), robust)
        N = np.diag(np.bincount(photo, robust, photos)) - shares.T @ (shares / total[:, None])
        mean_arm = sums(robust * arms, point, points) / total
        rhs = -sums(robust * (arms - mean_arm[point]), photo, photos)
        b = _solved(N, rhs)
        w = sums(robust * (b[photo] + arms), point, points) / total
        off = np.abs(b[photo] + arms - w[point])
        robust = cauchy(off, spread(off, _FLOOR), weight)
    return b, w


def _solved(N: FloatArray, rhs: ComplexArray) -> ComplexArray:
    """Return the solution with that of unknown 0 zero; what nothing holds stays near zero."""
    part = N[1:, 1:] + 1e-9 * np.diag(np.diagonal(N)[1:]) + 1e-12 * np.eye(len(N) - 1)
    out = np.zeros(len(N), dtype=complex)
    factor = cho_factor(part, lower=True)
    out[1:] = cho_solve(factor, rhs[1:].real) + 1j * cho_solve(factor, rhs[1:].imag)
    return out
