"""Near-vertical photos laid side by side: a block of plane similarities, which two common points a pair can hold.

Where photos have too few points in common for relative orientation, the images of flat ground on vertical photos
still fit by plane similarities, with errors of some degrees and some per cent of the flying height. Scale and
heading come first, as logarithms, so that no scale shrinks; the places follow. Both are linear and robust.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from musatpy.arrays import ComplexArray, FloatArray, IntArray
from musatpy.geometry.similarity import cauchy, spread
from musatpy.orientation.relative import plane_similarity
from musatpy.orientation.strips import PhotoModel, Tangents, common_images, common_tangents

_FEWEST = 3  # common points of a pair: with two every gross error would pass
_ROUNDS = 12  # of robust weights
_FLOOR = 1e-3  # of the flying height, and rad: the least error of a mosaic


@dataclass(frozen=True, kw_only=True)
class _Links:
    """k pairs of photos and the logarithm of scale and turn from the second to the first, with weights."""

    first: IntArray
    second: IntArray
    turn: ComplexArray  # log a, a the ground units of a tangent of photo 2 over those of photo 1, and the headings
    weight: FloatArray


def mosaics(sights: Tangents) -> list[PhotoModel]:
    """Return models of vertical photos over flat ground, one for each part that pairs hold together."""
    links = _links(sights)
    return [_laid(sights, links, part) for part in _parts(links)]


def _links(sights: Tangents) -> _Links:
    first, second, ends, rows = common_images(sights, _FEWEST)
    if not len(first):
        none = np.zeros(0, dtype=np.int64)
        return _Links(first=none, second=none, turn=np.zeros(0, dtype=complex), weight=np.zeros(0))
    x1, x2, weight, _ = common_tangents(sights, ends, rows)
    a, _, robust = plane_similarity(x1, x2, weight)
    good = np.isfinite(a) & (np.abs(a) > 0.2) & (np.abs(a) < 5.0)
    # the spread of the points is what turns errors of images into those of scale and turn
    z = x1[..., 0] + 1j * x1[..., 1]
    share = weight * robust
    middle = (share * z).sum(axis=1) / np.maximum(share.sum(axis=1), 1e-300)
    width = (share * np.square(np.abs(z - middle[:, None]))).sum(axis=1)
    good &= width > 0
    # x2 = a x1 + b, and on the ground a1 x1 = a2 x2 but for the places: log a2 = log a1 - log a
    return _Links(first=first[good], second=second[good], turn=-np.log(a[good]), weight=width[good])


def _parts(links: _Links) -> list[IntArray]:
    """Return the photos of each connected part, each in the order of a walk from its first photo."""
    neighbours: dict[int, list[int]] = {}
    for i, j in zip(links.first.tolist(), links.second.tolist(), strict=True):
        neighbours.setdefault(i, []).append(j)
        neighbours.setdefault(j, []).append(i)
    parts, seen = [], set()
    for start in neighbours:
        if start in seen:
            continue
        part = [start]
        seen.add(start)
        for photo in part:  # grows as it goes
            new = [other for other in dict.fromkeys(neighbours[photo]) if other not in seen]
            seen.update(new)
            part += new
        parts.append(np.array(part))
    return parts


def _laid(sights: Tangents, links: _Links, part: IntArray) -> PhotoModel:
    number = np.full(int(max(sights.photo.max(), part.max())) + 1, -1)
    number[part] = np.arange(len(part))
    inside = number[links.first] >= 0
    i, j = number[links.first[inside]], number[links.second[inside]]
    a = np.exp(_turns(i, j, links.turn[inside], links.weight[inside], len(part)))
    rows = np.flatnonzero(number[sights.photo] >= 0)
    photo = number[sights.photo[rows]]
    arms = a[photo] * (sights.x[rows, 0] + 1j * sights.x[rows, 1])
    point, index, count = np.unique(sights.point[rows], return_inverse=True, return_counts=True)
    many = count[index] > 1
    b, w = _places(photo[many], index[many], arms[many], sights.weight[rows[many]], len(part), len(point))
    height, turn = np.abs(a), a / np.abs(a)
    M = np.zeros((len(part), 3, 3))
    M[:, 0, 0] = M[:, 1, 1] = turn.real
    M[:, 0, 1], M[:, 1, 0] = turn.imag, -turn.imag
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
        logs = logs + _solved(
            _laplacian(i, j, robust, photos), _sums(j, robust * off, photos) - _sums(i, robust * off, photos)
        )
    return logs


def _carried(i: IntArray, j: IntArray, turn: ComplexArray, weight: FloatArray, photos: int) -> ComplexArray:
    """Return log a (n,) carried along the tree of the surest pairs (Prim), from photo 0."""
    logs = np.zeros(photos, dtype=complex)
    inside = np.zeros(photos, dtype=bool)
    inside[0] = True
    for _ in range(photos - 1):
        edge = np.where(inside[i] != inside[j], weight, -1.0)
        k = int(edge.argmax())
        if inside[i[k]]:
            logs[j[k]] = logs[i[k]] + turn[k]
        else:
            logs[i[k]] = logs[j[k]] - turn[k]
        inside[i[k]] = inside[j[k]] = True
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
        mean_arm = _sums(point, robust * arms, points) / total
        rhs = -_sums(photo, robust * (arms - mean_arm[point]), photos)
        b = _solved(N, rhs)
        w = _sums(point, robust * (b[photo] + arms), points) / total
        off = np.abs(b[photo] + arms - w[point])
        robust = cauchy(off, spread(off, _FLOOR), weight)
    return b, w


def _laplacian(i: IntArray, j: IntArray, weight: FloatArray, size: int) -> FloatArray:
    N = np.zeros((size, size))
    np.add.at(N, (i, j), -weight)
    np.add.at(N, (j, i), -weight)
    return N - np.diag(N.sum(axis=1))


def _sums(index: IntArray, values: ComplexArray, size: int) -> ComplexArray:
    return np.bincount(index, values.real, size) + 1j * np.bincount(index, values.imag, size)


def _solved(N: FloatArray, rhs: ComplexArray) -> ComplexArray:
    """Return the solution with that of unknown 0 zero; what nothing holds stays near zero."""
    part = N[1:, 1:] + 1e-9 * np.diag(np.diagonal(N)[1:]) + 1e-12 * np.eye(len(N) - 1)
    out = np.zeros(len(N), dtype=complex)
    factor = cho_factor(part, lower=True)
    out[1:] = cho_solve(factor, rhs[1:].real) + 1j * cho_solve(factor, rhs[1:].imag)
    return out
