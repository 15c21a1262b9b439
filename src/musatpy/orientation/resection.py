"""Space resection of one photo from known points, among gross errors, without any approximation.

Grunert's direct solution of three points gives the starts, least squares with Cauchy's weights the result.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.collinearity import cross, orthogonal, skew, turn
from musatpy.geometry.similarity import TO_SIGMA, cauchy

_SAMPLES = 150  # of three points
_ROUNDS = 15
_SAME = 1e-8  # of the robust scale, by which the images change in the last round
_BEHIND = -1e-9  # greatest height of a point in the axes of the photo
_REAL = 0.1  # imaginary part up to which a root is taken as real: noise parts a double root


@dataclass(frozen=True, kw_only=True)
class Resection:
    """Station C (3,) and M (3, 3), axes of the points to photo; robust scale (tangent) and weights (k,).

    `sigma` is the size of the error of the station that the images leave, in units of the points: infinite where
    they do not determine it.
    """

    M: FloatArray
    C: FloatArray
    scale: float
    weight: FloatArray
    sigma: float


def resection(x: FloatArray, X: FloatArray, up: FloatArray, floor: float) -> Resection | None:
    """Return the resection of a photo from tangents x (k, 2) of the points X (k, 3), None without a solution.

    Three points leave up to four solutions, from which the most vertical one against `up` (3,) is taken; more
    points decide for themselves. `floor` is the least image error (tangent).
    """
    return resections(x, X[None], up[None], floor)[0]


def resections(x: FloatArray, X: FloatArray, up: FloatArray, floor: float) -> list[Resection | None]:
    """Return the resections of a photo in t trial places of its points, X (t, k, 3), with `up` (t, 3)."""
    if len(x) < 3:
        return [None] * len(X)
    trial, M, C = _starts(x, X)
    place = np.unique(trial)
    rows = [np.flatnonzero(trial == t) for t in place]
    chosen = np.array(
        [_chosen(x, X[t], M, C, row, up[t], floor) for t, row in zip(place, rows, strict=True)], dtype=int
    )
    refined = dict(zip(place.tolist(), _refined(x, X[place], orthogonal(M[chosen]), C[chosen], floor), strict=True))
    return [refined.get(t) for t in range(len(X))]


def _chosen(
    x: FloatArray, X: FloatArray, M: FloatArray, C: FloatArray, rows: IntArray, up: FloatArray, floor: float
) -> int:
    """Return the most vertical one of the solutions in some rows that fit the points best."""
    error = np.linalg.norm(_images((X - C[rows, None]) @ np.swapaxes(M[rows], 1, 2)) - x, axis=-1)
    # the three points of a sample fit whatever it says: the middle of the others tells
    rank = min((len(x) + 3) // 2, len(x) - 1)
    middle = np.partition(error, rank, axis=1)[:, rank]
    good = middle <= 2.0 * np.maximum(middle.min(), floor)
    return int(rows[np.where(good, M[rows, 2] @ up, -np.inf).argmax()])


def _starts(x: FloatArray, X: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return trial (s,), M (s, 3, 3) and C (s, 3) of all solutions of samples of three points."""
    sample = _samples(len(x))
    j = np.concatenate([x, np.full((len(x), 1), -1.0)], axis=1)
    j = np.tile((j / np.linalg.norm(j, axis=1, keepdims=True))[sample], (len(X), 1, 1))
    P = X[:, sample].reshape(-1, 3, 3)
    row, s = _distances(j, P)
    return row // len(sample), *_placed(s[..., None] * j[row], P[row])


@cache
def _samples(points: int) -> IntArray:
    """Return samples (s, 3) of the first thirty of some points."""
    every = np.array(list(combinations(range(min(points, 30)), 3)))
    return np.random.default_rng(points).permutation(every)[:_SAMPLES] if len(every) > _SAMPLES else every


def _distances(j: FloatArray, P: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return distances (s, 3) from station to points and the sample (s,) that each solution belongs to.

    Grunert 1841 in the form of Haralick, Lee, Ottenberg and Noelle, IJCV 13 (1994) 331, eqs. 9-10.
    """
    a2, b2, c2 = (np.square(P[:, i] - P[:, k]).sum(axis=1) for i, k in ((1, 2), (0, 2), (0, 1)))
    cos_a, cos_b, cos_c = (np.einsum("si,si->s", j[:, i], j[:, k]) for i, k in ((1, 2), (0, 2), (0, 1)))
    b2 = np.maximum(b2, 1e-300)
    d, e = (a2 - c2) / b2, (a2 + c2) / b2
    A = np.stack(
        [
            (d - 1) ** 2 - 4 * c2 / b2 * cos_a**2,
            4 * (d * (1 - d) * cos_b - (1 - e) * cos_a * cos_c + 2 * c2 / b2 * cos_a**2 * cos_b),
            2 * (d**2 - 1 + 2 * d**2 * cos_b**2 - 4 * e * cos_a * cos_b * cos_c)
            + 4 * ((b2 - c2) / b2 * cos_a**2 + (b2 - a2) / b2 * cos_c**2),
            4 * (-d * (1 + d) * cos_b + 2 * a2 / b2 * cos_c**2 * cos_b - (1 - e) * cos_a * cos_c),
            (1 + d) ** 2 - 4 * a2 / b2 * cos_c**2,
        ],
        axis=1,
    )
    leading = np.where(np.abs(A[:, :1]) < 1e-14, 1e-14, A[:, :1])
    companion = np.zeros((len(A), 4, 4))
    companion[:, 0] = -A[:, 1:] / leading
    companion[:, [1, 2, 3], [0, 1, 2]] = 1.0
    usable: BoolArray = np.asarray(np.isfinite(companion).all(axis=(1, 2)))
    roots = np.linalg.eigvals(np.where(usable[:, None, None], companion, 0.0))
    v = roots.real
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ((d - 1)[:, None] * v**2 - 2 * (d * cos_b)[:, None] * v + (1 + d)[:, None]) / (
            2 * (cos_c[:, None] - v * cos_a[:, None])
        )
        s1 = np.sqrt(b2[:, None] / (1 + v**2 - 2 * v * cos_b[:, None]))
    real = (np.abs(roots.imag) < _REAL * np.maximum(1.0, np.abs(v))) & usable[:, None]
    row, column = np.nonzero(real & (v > 0) & (u > 0) & np.isfinite(u) & np.isfinite(s1))
    s1, u, v = s1[row, column], u[row, column], v[row, column]
    return row, np.stack([s1, u * s1, v * s1], axis=1)


def _placed(p: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return M (s, 3, 3) and C (s, 3) with p = M (P - C), p and P (s, 3, 3) point by point."""
    M = np.swapaxes(_axes(p), 1, 2) @ _axes(P)
    return M, P.mean(axis=1) - np.einsum("sji,sj->si", M, p.mean(axis=1))


def _axes(P: FloatArray) -> FloatArray:
    """Return the axes (s, 3, 3), in rows, of triangles (s, 3, 3): a side, the normal, and across the side."""
    side, other = P[:, 1] - P[:, 0], P[:, 2] - P[:, 0]
    normal = cross(side, other)
    axes = np.stack([side, normal, cross(side, normal)], axis=1)
    return axes / np.maximum(np.linalg.norm(axes, axis=2, keepdims=True), 1e-300)


def _images(p: FloatArray) -> FloatArray:
    """Return the tangents (..., 2) of points (..., 3) in the axes of a photo, out of range for those behind it."""
    return -p[..., :2] / np.minimum(p[..., 2:], _BEHIND)


def image_errors(x: FloatArray, X: FloatArray, M: FloatArray, C: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return computed minus measured tangents (..., k, 2) and partials (..., k, 2, 6) by C and a small turn.

    A turn w takes M v to M v + w x M v. Points behind the camera have errors beyond any other.
    """
    p = (X - C[..., None, :]) @ np.swapaxes(M, -1, -2)
    image, z = _images(p), np.minimum(p[..., 2], _BEHIND)
    by_p = np.zeros((*image.shape, 3))
    by_p[..., 0, 0] = by_p[..., 1, 1] = -1.0 / z
    by_p[..., 2] = -image / z[..., None]
    return image - x, np.concatenate([-by_p @ M[..., None, :, :], -by_p @ skew(p)], axis=-1)


def _refined(x: FloatArray, X: FloatArray, M: FloatArray, C: FloatArray, floor: float) -> list[Resection]:
    """Return the robust minima next to M (t, 3, 3) and C (t, 3), for places X (t, k, 3) of the points."""
    for _ in range(_ROUNDS):
        error, J = image_errors(x, X, M, C)
        size = np.linalg.norm(error, axis=-1)
        scale = np.maximum(floor, TO_SIGMA * np.median(size, axis=-1))
        robust = cauchy(size, scale[:, None])
        N, unit = _normals(J, robust)
        rhs = -unit * np.einsum("tkia,tk,tki->ta", J, robust, error)
        change = (np.linalg.pinv(N, rcond=1e-12, hermitian=True) @ rhs[..., None])[..., 0]
        step = unit * change
        C, M = C + step[:, :3], turn(step[:, 3:]) @ M
        if (np.abs(change) <= _SAME * scale[:, None]).all():
            break
    N, unit = _normals(image_errors(x, X, M, C)[1], robust)
    values, vectors = np.linalg.eigh(N)
    with np.errstate(divide="ignore", invalid="ignore"):
        station = np.sum(
            np.square(unit[:, :3, None] * vectors[:, :3]) / np.maximum(values, 0.0)[:, None], axis=(1, 2)
        )
    sigma = scale * np.where(values[:, 0] < 1e-13, np.inf, np.sqrt(station))
    return [
        Resection(M=M[t], C=C[t], scale=float(scale[t]), weight=robust[t], sigma=float(sigma[t]))
        for t in range(len(M))
    ]


def _normals(J: FloatArray, robust: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return normals (t, 6, 6) scaled to a unit diagonal, and the units (t, 6): metres and radians."""
    weighted = (robust[..., None, None] * J).reshape(len(J), -1, 6)
    N = np.swapaxes(weighted, 1, 2) @ J.reshape(weighted.shape)
    unit = 1.0 / np.sqrt(np.maximum(np.diagonal(N, axis1=1, axis2=2), 1e-300))
    return N * unit[:, :, None] * unit[:, None], unit
