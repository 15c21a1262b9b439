"""Space resection of one photo from known points, among gross errors, without any approximation.

Grunert's direct solution of three points gives the starts, least squares with Cauchy's weights the result.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.robust import cauchy, spread
from musatpy.geometry.rotations import orthogonal, skew, turn

_SAMPLES = 150  # of three points
_ROUNDS = 15
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
    if len(x) < 3:
        return None
    M, C = _starts(x, X)
    if not len(M):
        return None
    error = np.stack(
        [np.linalg.norm(image_errors(x, X, rotation, at)[0], axis=1) for rotation, at in zip(M, C, strict=True)]
    )
    # the three points of a sample fit whatever it says: the middle of the others tells
    middle = np.sort(error, axis=1)[:, min((len(x) + 3) // 2, len(x) - 1)]
    good = middle <= 2.0 * np.maximum(middle.min(), floor)
    best = int(np.where(good, M[:, 2] @ up, -np.inf).argmax())
    return _refined(x, X, M[best], C[best], floor)


def _starts(x: FloatArray, X: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return M (s, 3, 3) and C (s, 3) of all solutions of samples of three points."""
    every = np.array(list(combinations(range(min(len(x), 30)), 3)))
    if len(every) > _SAMPLES:
        every = np.random.default_rng(len(x)).permutation(every)[:_SAMPLES]
    j = np.concatenate([x, np.full((len(x), 1), -1.0)], axis=1)
    j = (j / np.linalg.norm(j, axis=1, keepdims=True))[every]
    P = X[every]
    row, s = _distances(j, P)
    return _placed(s[..., None] * j[row], P[row])


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
            2
            * (
                d**2
                - 1
                + 2 * d**2 * cos_b**2
                + 2 * (b2 - c2) / b2 * cos_a**2
                - 4 * e * cos_a * cos_b * cos_c
                + 2 * (b2 - a2) / b2 * cos_c**2
            ),
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
    mean_p, mean_P = p.mean(axis=1), P.mean(axis=1)
    M = orthogonal(np.swapaxes(p - mean_p[:, None], 1, 2) @ (P - mean_P[:, None]))
    return M, mean_P - np.einsum("sji,sj->si", M, mean_p)


def image_errors(x: FloatArray, X: FloatArray, M: FloatArray, C: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return computed minus measured tangents (k, 2) and partials (k, 2, 6) by C and a small turn of the photo.

    A turn w takes M v to M v + w x M v. Points behind the camera have errors beyond any other.
    """
    p = (X - C) @ M.T
    z = np.minimum(p[:, 2], -1e-9)
    image = -p[:, :2] / z[:, None]
    by_p = np.zeros((len(p), 2, 3))
    by_p[:, 0, 0] = by_p[:, 1, 1] = -1.0 / z
    by_p[:, :, 2] = -image / z[:, None]
    return image - x, np.concatenate([-by_p @ M, -by_p @ skew(p)], axis=2)


def _refined(x: FloatArray, X: FloatArray, M: FloatArray, C: FloatArray, floor: float) -> Resection:
    robust, scale = np.ones(len(x)), floor
    for _ in range(_ROUNDS):
        error, J = image_errors(x, X, M, C)
        size = np.linalg.norm(error, axis=1)
        scale = spread(size, floor)
        robust = cauchy(size, scale)
        N = np.einsum("kia,k,kib->ab", J, robust, J)
        unit = 1.0 / np.sqrt(np.maximum(np.diagonal(N), 1e-300))  # metres and radians
        rhs = -np.einsum("kia,k,ki->a", J, robust, error)
        step = unit * np.linalg.lstsq(N * unit * unit[:, None], unit * rhs, rcond=1e-12)[0]
        C, M = C + step[:3], turn(step[3:]) @ M
    return Resection(M=M, C=C, scale=scale, weight=robust, sigma=scale * _station_error(x, X, M, C, robust))


def _station_error(x: FloatArray, X: FloatArray, M: FloatArray, C: FloatArray, robust: FloatArray) -> float:
    """Return the size of the error of the station for unit image errors."""
    _, J = image_errors(x, X, M, C)
    N = np.einsum("kia,k,kib->ab", J, robust, J)
    unit = 1.0 / np.sqrt(np.maximum(np.diagonal(N), 1e-300))
    values, vectors = np.linalg.eigh(N * unit * unit[:, None])
    if values[0] < 1e-13:
        return float("inf")
    return float(np.sqrt(np.sum(np.square(unit[:3, None] * vectors[:3]) / values)))
