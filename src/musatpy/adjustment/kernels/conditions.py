"""Points of IIA, one after the other: their conditions through full weights, and where they come to rest.

The numpy twins are `pass_points.conditions` and `pass_points.add_full`, `geometry.coplanarity` and
`geometry.collinearity.ray_partials`, and `ground.settle_group`. Rays are straight.
"""

from __future__ import annotations

import math

import numpy as np

from musatpy.adjustment.kernels.compiling import compiled
from musatpy.adjustment.kernels.points import (
    Known,
    Measured,
    Stations,
    Sums,
    Water,
    _images,
    _inverted,
    _point_normals,
)
from musatpy.arrays import FloatArray

_Q = 6  # unknowns of a station


@compiled
def _cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    out[0], out[1], out[2] = x, y, z


@compiled
def _dot(a: FloatArray, b: FloatArray) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _ray(
    p: int, k: int, at: Measured, stations: Stations, u: FloatArray, by_attitude: FloatArray, by_xy: FloatArray
) -> None:
    """Set the unit ray u (3,) of an image, and its partials (3, 3) and (3, 2): `collinearity.ray_partials`."""
    n = at.photo[p, k]
    M, dM = stations.M, stations.M_partials
    c0 = at.xy[p, k, 0] - stations.principal_point[n, 0]
    c1 = at.xy[p, k, 1] - stations.principal_point[n, 1]
    c2 = -stations.focal_length[n]
    length = math.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
    for i in range(3):
        u[i] = (M[n, 0, i] * c0 + M[n, 1, i] * c1 + M[n, 2, i] * c2) / length
    for a in range(5):
        column = by_attitude[:, a] if a < 3 else by_xy[:, a - 3]
        along = 0.0
        for i in range(3):
            if a < 3:
                column[i] = dM[n, a, 0, i] * c0 + dM[n, a, 1, i] * c1 + dM[n, a, 2, i] * c2
            else:
                column[i] = M[n, a - 3, i]
            along += u[i] * column[i]
        for i in range(3):
            column[i] = (column[i] - u[i] * along) / length


@compiled
def _distance(
    B: FloatArray, u: FloatArray, w: FloatArray, of_first: bool, by: FloatArray, room: FloatArray
) -> float:
    """Return k = (B x a).D/|D|^2 with D = u x w, a the first or the second of them; by (3, 3): B, u, w.

    `coplanarity._distance`.
    """
    D, Ba, E, by_a = room[0], room[1], room[2], room[3]
    a = u if of_first else w
    _cross(u, w, D)
    _cross(B, a, Ba)
    D2 = _dot(D, D)
    k = _dot(Ba, D) / D2
    for i in range(3):
        E[i] = Ba[i] - 2.0 * k * D[i]
    _cross(a, D, by[0])
    _cross(w, E, by[1])
    _cross(E, u, by[2])
    _cross(D, B, by_a)
    for i in range(3):
        by[1 if of_first else 2, i] += by_a[i]
        for j in range(3):
            by[j, i] /= D2
    return k


@compiled
def _coplanarity(B: FloatArray, u1: FloatArray, u2: FloatArray, by: FloatArray, room: FloatArray) -> float:
    """Return B.(u1 x u2), and its partials by (2, 2, 3) ray, and P and u: `coplanarity.coplanarity`."""
    D = room[0]
    _cross(u1, u2, D)
    _cross(u2, B, by[0, 1])
    _cross(B, u1, by[1, 1])
    for i in range(3):
        by[0, 0, i], by[1, 0, i] = -D[i], D[i]
    return _dot(B, D)


@compiled
def _scale_restraint(B12: FloatArray, B23: FloatArray, u: FloatArray, by: FloatArray, room: FloatArray) -> float:
    """Return the scale restraint of three rays u (3, 3), and its partials by (3, 2, 3): `scale_restraint`."""
    first, second = room[4:7], room[7:10]
    value = _distance(B12, u[0], u[1], True, first, room)
    value -= _distance(B23, u[1], u[2], False, second, room)
    for i in range(3):
        by[0, 0, i], by[0, 1, i] = -first[0, i], first[1, i]
        by[1, 0, i], by[1, 1, i] = first[0, i] + second[0, i], first[2, i] - second[1, i]
        by[2, 0, i], by[2, 1, i] = -second[0, i], -second[2, i]
    return value


@compiled
def _enter(
    c: int, p: int, k: int, at: Measured, stations: Stations, by: FloatArray, by_attitude: FloatArray,
    by_xy: FloatArray, A: FloatArray, G: FloatArray,
) -> None:  # fmt: skip
    """Set the partials of condition c by the station and the image of ray k, of those by (2, 3) its P and u."""
    n = at.photo[p, k]
    for a in range(3):
        axis = stations.axes[n, a]
        A[c, _Q * k + a] = by[0, 0] * axis[0] + by[0, 1] * axis[1] + by[0, 2] * axis[2]
        A[c, _Q * k + 3 + a] = (
            by[1, 0] * by_attitude[k, 0, a] + by[1, 1] * by_attitude[k, 1, a] + by[1, 2] * by_attitude[k, 2, a]
        )
    for b in range(2):
        G[c, 2 * k + b] = by[1, 0] * by_xy[k, 0, b] + by[1, 1] * by_xy[k, 1, b] + by[1, 2] * by_xy[k, 2, b]


@compiled
def _solved(S: FloatArray, A: FloatArray, w: FloatArray) -> None:
    """Replace S (c, c) by its Cholesky factor L, A (c, u) by L^-1 A and w (c,) by L^-1 w."""
    for i in range(len(S)):
        for j in range(i + 1):
            total = S[i, j]
            for k in range(j):
                total -= S[i, k] * S[j, k]
            S[i, j] = math.sqrt(total) if i == j else total / S[j, j]
        for k in range(i):
            factor = S[i, k]
            w[i] -= factor * w[k]
            for a in range(A.shape[1]):
                A[i, a] -= factor * A[k, a]
        w[i] /= S[i, i]
        for a in range(A.shape[1]):
            A[i, a] /= S[i, i]


@compiled
def _add(p: int, at: Measured, A: FloatArray, w: FloatArray, sums: Sums) -> None:
    """Add A'A and -A'w of a point to the normal equations."""
    m, pair = at.photo.shape[1], 0
    for k in range(m):
        n = at.photo[p, k]
        for other in range(k, m):
            e = sums.slot[p, pair]
            pair += 1
            for c in range(len(w)):
                for a in range(_Q):
                    value = A[c, _Q * k + a]
                    for b in range(_Q):
                        sums.blocks[e, a, b] += value * A[c, _Q * other + b]
        for c in range(len(w)):
            for a in range(_Q):
                sums.rhs[n, a] -= A[c, _Q * k + a] * w[c]


@compiled
def add_conditions(at: Measured, measured: FloatArray, stations: Stations, sums: Sums) -> None:
    """Add the conditions of k points, linearised at their adjusted images `at`, with full weights.

    measured (k, m, 2) mm. g + A dx + G v = 0 has the normal equations A'(G Q G')^-1 A: `pass_points.add_full`.
    """
    points, m = at.photo.shape
    c = 2 * m - 3
    u, by_attitude, by_xy = np.empty((m, 3)), np.empty((m, 3, 3)), np.empty((m, 3, 2))
    B, by, room = np.empty((m - 1, 3)), np.empty((3, 2, 3)), np.empty((10, 3))
    A, G, S, w = np.empty((c, _Q * m)), np.empty((c, 2 * m)), np.empty((c, c)), np.empty(c)
    for p in range(points):
        A[:] = 0.0
        G[:] = 0.0
        for k in range(m):
            _ray(p, k, at, stations, u[k], by_attitude[k], by_xy[k])
        for k in range(m - 1):
            for i in range(3):
                B[k, i] = stations.position[at.photo[p, k + 1], i] - stations.position[at.photo[p, k], i]
        for row in range(c):
            first, size = (row, 2) if row < m - 1 else (row - m + 1, 3)
            if size == 2:
                w[row] = _coplanarity(B[first], u[first], u[first + 1], by, room)
            else:
                w[row] = _scale_restraint(B[first], B[first + 1], u[first : first + 3], by, room)
            for side in range(size):
                _enter(row, p, first + side, at, stations, by[side], by_attitude, by_xy, A, G)
        _weigh(p, at, measured, A, G, w, S)
        _solved(S, A, w)
        _add(p, at, A, w, sums)


@compiled
def _weigh(
    p: int, at: Measured, measured: FloatArray, A: FloatArray, G: FloatArray, w: FloatArray, S: FloatArray
) -> None:
    """Set S = G Q G', add what the images differ by to the misclosures w, and scale all to a diagonal of 1."""
    c, m = len(w), at.photo.shape[1]
    for row in range(c):
        for k in range(m):
            for b in range(2):
                w[row] += G[row, 2 * k + b] * (measured[p, k, b] - at.xy[p, k, b])
        for column in range(row + 1):
            total = 0.0
            for k in range(m):
                for b in range(2):
                    total += G[row, 2 * k + b] * G[column, 2 * k + b] / at.weight[p, k, b]
            S[row, column] = total
    for row in range(c):
        scale = 1.0 / math.sqrt(S[row, row])
        w[row] *= scale
        for a in range(A.shape[1]):
            A[row, a] *= scale
        for column in range(row + 1):
            S[row, column] *= scale
        for other in range(row, c):
            S[other, row] *= scale


@compiled
def _objective(p: int, at: Measured, stations: Stations, residual: FloatArray) -> float:
    """Return the weighted squares of a point, infinite where it is behind a camera."""
    total = 0.0
    for k in range(len(residual)):
        n = at.photo[p, k]
        S = 0.0
        for i in range(3):
            S += stations.M[n, 2, i] * (at.ground[p, i] - stations.position[n, i])
        total += residual[k, 0] ** 2 + residual[k, 1] ** 2 if S < 0.0 else np.inf
    return total if total < np.inf else np.inf


@compiled
def settle(
    at: Measured, stations: Stations, water: Water, known: Known, ridge: float, steps: int, limit: float,
    rounding: float, squares: FloatArray, left: FloatArray,
) -> None:  # fmt: skip
    """Take points of which nothing is known to the optimum of their images, in `at.ground`: `ground.settle_group`.

    Sets their weighted squares (k,), and by how much (k,) these were still to fall by the last step.
    """
    points, m = at.photo.shape
    A, B, residual = np.empty((m, 2, _Q)), np.empty((m, 2, 3)), np.empty((m, 2))
    room, N, b, L, inverse = np.empty((3, 3, 3)), np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    best, step = np.empty(3), np.empty(3)
    for p in range(points):
        least, gain, fall = np.inf, 0.0, 0.0
        step[:] = 0.0
        for _ in range(steps):
            _images(p, at, stations, water, room, A, B, residual)
            objective = _objective(p, at, stations, residual)
            worse = least < np.inf and not objective <= least * (1.0 + rounding) + rounding
            if worse:
                gain = 0.0
                for i in range(3):
                    step[i] *= 0.5
            else:
                _point_normals(A, B, residual, p, known, ridge, N, b)
                _inverted(N, L, inverse)
                least, fall = objective, 0.0
                for i in range(3):
                    best[i] = at.ground[p, i]
                    step[i] = inverse[i, 0] * b[0] + inverse[i, 1] * b[1] + inverse[i, 2] * b[2]
                    fall += b[i] * step[i]
                gain = fall
            for i in range(3):
                at.ground[p, i] = best[i] + step[i]
            if max(abs(step[0]), abs(step[1]), abs(step[2])) < limit:
                break
        squares[p] = max(least - gain, 0.0)
        left[p] = fall
