"""Points by collinearity, one after the other: images, partials, elimination and sums in one pass.

The numpy twins are `sightings.images`, `ground.point_normals`, `collinear.eliminate` and `collinear.reduced`, and
of single rays `refraction.flat.incidence` and `geometry.collinearity`, whose equations these loops follow. Points
have no unknowns but their own three and those of their stations; what has more goes by the twins.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from musatpy.adjustment.kernels.compiling import compiled
from musatpy.arrays import BoolArray, FloatArray, IntArray

_MAX_STEPS = 60
_Q = 6  # unknowns of a station in its images


class Stations(NamedTuple):
    """n photos where they are."""

    position: FloatArray  # (n, 3) working
    M: FloatArray  # (n, 3, 3) working axes to photo
    M_partials: FloatArray  # (n, 3, 3, 3) by omega, phi, kappa
    axes: FloatArray  # (n, 3, 3) along which positions are corrected
    focal_length: FloatArray  # (n,) mm
    principal_point: FloatArray  # (n, 2) mm


class Measured(NamedTuple):
    """k points with m images each."""

    photo: IntArray  # (k, m)
    xy: FloatArray  # (k, m, 2) mm
    weight: FloatArray  # (k, m, 2) 1/mm2
    ground: FloatArray  # (k, 3) working


class Water(NamedTuple):
    """Level water over k points with m rays; of k points without any, arrays of no rows."""

    wet: BoolArray  # (k, m) rays that it refracts
    normal: FloatArray  # (k, m, 3)
    depth: FloatArray  # (k, m) m, of the points
    refraction: float  # index of the water


class Known(NamedTuple):
    """What is known of k points along axes of their own; where that is nothing, arrays of no rows."""

    axes: FloatArray  # (k, 3, 3)
    free: BoolArray  # (k, 3) the component may move
    weight: FloatArray  # (k, 3) 1/m2
    pull: FloatArray  # (k, 3) 1/m, weights times known minus current


def dry_water() -> Water:
    """Return the water of points that have none."""
    return Water(np.zeros((0, 0), dtype=bool), np.zeros((0, 0, 3)), np.zeros((0, 0)), 1.0)


def nothing_known() -> Known:
    """Return what is known of points of which nothing is."""
    return Known(np.zeros((0, 3, 3)), np.zeros((0, 3), dtype=bool), np.zeros((0, 3)), np.zeros((0, 3)))


class Sums(NamedTuple):
    """Normal equations of stations, to which points are added, and the blocks of the pairs of rays of a point."""

    slot: IntArray  # (k, m (m + 1) / 2) rows of the blocks, in the order of `numpy.triu_indices`
    blocks: FloatArray  # (e, q, q)
    rhs: FloatArray  # (n, q)


class Inverse(NamedTuple):
    """Elements of the inverse of the normal equations of stations, those of `Sums`."""

    slot: IntArray  # (k, m (m + 1) / 2)
    blocks: FloatArray  # (e, q, q)


class Spread(NamedTuple):
    """How errors spread to k points and their images."""

    point: FloatArray  # (k, 3, 3) cofactors of the points, working axes
    image: FloatArray  # (k, m, 2) cofactors of the adjusted images
    covariance: FloatArray  # (k, m, 2, 3) of the positions and the adjusted images
    diagonal: FloatArray  # (n, q) of the normal equations before points are eliminated, to which is added


class Eliminated(NamedTuple):
    """How k points follow a step of their stations: dX = shift - by_station ds, along their axes."""

    shift: FloatArray  # (k, 3)
    by_station: FloatArray  # (k, 3, m, q)


@compiled
def _air_tangent(H: float, h: float, D: float, n: float) -> float:
    """Return tan(I) of a ray to the water: `refraction.flat.air_tangent`, ETL-0306 (4.10)."""
    n2 = n * n
    t = D / (H + h / n)
    for _ in range(_MAX_STEPS):
        g2 = 1.0 / (n2 + (n2 - 1.0) * t * t)
        g = math.sqrt(g2)
        step = (D - t * (H + h * g)) / (H + h * n2 * g2 * g)
        t += step
        if not abs(step) > 4e-16 * abs(t) + 1e-300:
            break
        if not abs(step) > 1e-8 * abs(t):
            g2 = 1.0 / (n2 + (n2 - 1.0) * t * t)
            g = math.sqrt(g2)
            t += (D - t * (H + h * g)) / (H + h * n2 * g2 * g)
            break
    return t


@compiled
def _bend(p: int, k: int, water: Water, gap: FloatArray, v: FloatArray, by: FloatArray) -> None:
    """Set v (3,) from camera to water point, and its partials by (2, 3, 3) camera and ground, of a wet ray.

    `refraction.flat.incidence`; gap (3,) is the vector to the point.
    """
    up0, up1, up2 = water.normal[p, k, 0], water.normal[p, k, 1], water.normal[p, k, 2]
    n, h = water.refraction, water.depth[p, k]
    fall = -(up0 * gap[0] + up1 * gap[1] + up2 * gap[2])
    e0, e1, e2 = gap[0] + up0 * fall, gap[1] + up1 * fall, gap[2] + up2 * fall
    D = math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
    if D > 0.0:
        e0, e1, e2 = e0 / D, e1 / D, e2 / D
    H = fall - h
    t = _air_tangent(H, h, D, n)
    g = 1.0 / math.sqrt(n * n + (n * n - 1.0) * t * t)
    air = 1.0 / (1.0 + t * t)
    air3 = air * math.sqrt(air)
    water2 = 1.0 / (1.0 + t * g * t * g)
    water3 = water2 * math.sqrt(water2)
    spread = h * air3 + n * water3 * H
    kappa = n * water3 * H / spread
    Q_H = t * air3 * h / spread
    Q_h = -n * t * g * water3 * H / spread
    ratio = H / (H + h * g)
    up, e = (up0, up1, up2), (e0, e1, e2)
    for i in range(3):
        v[i] = e[i] * H * t - up[i] * H
        for j in range(3):
            K = (kappa - ratio) * e[i] * e[j] - ratio * up[i] * up[j] + (ratio if i == j else 0.0)
            by[0, i, j] = -K + (e[i] * Q_H - up[i]) * up[j]
            by[1, i, j] = K - e[i] * Q_h * up[j]


@compiled
def _vector(
    p: int, k: int, at: Measured, stations: Stations, water: Water, gap: FloatArray, v: FloatArray, by: FloatArray
) -> bool:
    """Set the vectors from a station to a point and to what its ray goes to in air, the point where it is dry.

    Return whether the ray is wet; `by` has its partials then.
    """
    n = at.photo[p, k]
    for i in range(3):
        gap[i] = at.ground[p, i] - stations.position[n, i]
        v[i] = gap[i]
    if len(water.wet) and water.wet[p, k]:
        _bend(p, k, water, gap, v, by)
        return True
    return False


@compiled
def _through(rows: FloatArray, k: int, c: int, by: FloatArray) -> None:
    """Set the row (3,) at k and c to its product with a matrix (3, 3)."""
    x, y, z = rows[k, c, 0], rows[k, c, 1], rows[k, c, 2]
    for i in range(3):
        rows[k, c, i] = x * by[0, i] + y * by[1, i] + z * by[2, i]


@compiled
def _images(
    p: int, at: Measured, stations: Stations, water: Water, room: FloatArray, A: FloatArray, B: FloatArray,
    residual: FloatArray,
) -> None:  # fmt: skip
    """Set the weighted residuals (m, 2) of a point, and partials by stations A (m, 2, 6), by ground B (m, 2, 3).

    `sightings.images`, `geometry.collinearity.image_partials`. `room` (3, 3, 3) is room for one ray.
    """
    M, dM, axes = stations.M, stations.M_partials, stations.axes
    gap, v, by = room[2, 0], room[2, 1], room[:2]
    for k in range(at.photo.shape[1]):
        n = at.photo[p, k]
        wet = _vector(p, k, at, stations, water, gap, v, by)
        S = M[n, 2, 0] * v[0] + M[n, 2, 1] * v[1] + M[n, 2, 2] * v[2]
        scale = -stations.focal_length[n] / S
        for c in range(2):
            image = M[n, c, 0] * v[0] + M[n, c, 1] * v[1] + M[n, c, 2] * v[2]
            root, ratio = math.sqrt(at.weight[p, k, c]), image / S
            factor = scale * root
            residual[k, c] = (scale * image + stations.principal_point[n, c] - at.xy[p, k, c]) * root
            for i in range(3):
                B[k, c, i] = factor * (M[n, c, i] - ratio * M[n, 2, i])
                A[k, c, i] = -B[k, c, i]
                of_image = dM[n, i, c, 0] * v[0] + dM[n, i, c, 1] * v[1] + dM[n, i, c, 2] * v[2]
                of_depth = dM[n, i, 2, 0] * v[0] + dM[n, i, 2, 1] * v[1] + dM[n, i, 2, 2] * v[2]
                A[k, c, 3 + i] = factor * (of_image - ratio * of_depth)
            if wet:
                for i in range(3):
                    A[k, c, i] = B[k, c, i]
                _through(A, k, c, by[0])
                _through(B, k, c, by[1])
            x, y, z = A[k, c, 0], A[k, c, 1], A[k, c, 2]
            for i in range(3):
                A[k, c, i] = x * axes[n, i, 0] + y * axes[n, i, 1] + z * axes[n, i, 2]


@compiled
def _along_known(p: int, known: Known, B: FloatArray) -> None:
    """Turn partials B (m, 2, 3) by a point to its axes, zero by what is held: `ground.point_normals`."""
    for k in range(len(B)):
        for c in range(2):
            x, y, z = B[k, c, 0], B[k, c, 1], B[k, c, 2]
            for i in range(3):
                along = x * known.axes[p, i, 0] + y * known.axes[p, i, 1] + z * known.axes[p, i, 2]
                B[k, c, i] = along if known.free[p, i] else 0.0


@compiled
def _inverted(N: FloatArray, L: FloatArray, out: FloatArray) -> None:
    """Set `out` to the inverse of a positive matrix N (3, 3), by its Cholesky factor."""
    L[0, 0] = 1.0 / math.sqrt(N[0, 0])
    a, b = N[1, 0] * L[0, 0], N[2, 0] * L[0, 0]
    L[1, 1] = 1.0 / math.sqrt(N[1, 1] - a * a)
    c = (N[2, 1] - a * b) * L[1, 1]
    L[2, 2] = 1.0 / math.sqrt(N[2, 2] - b * b - c * c)
    L[1, 0] = -a * L[0, 0] * L[1, 1]
    L[2, 1] = -c * L[1, 1] * L[2, 2]
    L[2, 0] = -(b * L[0, 0] + c * L[1, 0]) * L[2, 2]
    for i in range(3):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, 3):
                total += L[k, i] * L[k, j]
            out[i, j] = total
            out[j, i] = total


@compiled
def _point_normals(
    A: FloatArray,
    B: FloatArray,
    residual: FloatArray,
    p: int,
    known: Known,
    ridge: float,
    N: FloatArray,
    b: FloatArray,
) -> None:
    """Set the normal equations N (3, 3), b (3,) of a point: `ground.point_normals`."""
    N[:] = 0.0
    b[:] = 0.0
    for k in range(len(B)):
        for c in range(2):
            for i in range(3):
                b[i] -= B[k, c, i] * residual[k, c]
                for j in range(i + 1):
                    N[i, j] += B[k, c, i] * B[k, c, j]
    if len(known.free):
        for i in range(3):
            N[i, i] += known.weight[p, i] if known.free[p, i] else known.weight[p, i] + 1.0
            b[i] += known.pull[p, i]
    largest = max(N[0, 0], N[1, 1], N[2, 2])
    for i in range(3):
        N[i, i] += ridge * largest


@compiled
def _add(
    p: int, photo: IntArray, A: FloatArray, residual: FloatArray, W: FloatArray, F: FloatArray, sums: Sums,
    out: Eliminated,
) -> None:  # fmt: skip
    """Add a point to the reduced normal equations of its stations: `collinear.reduced`."""
    m, pair = photo.shape[1], 0
    blocks = sums.blocks
    x, y, z = out.shift[p, 0], out.shift[p, 1], out.shift[p, 2]
    for k in range(m):
        n = photo[p, k]
        for a in range(_Q):
            of_point = W[k, a, 0] * x + W[k, a, 1] * y + W[k, a, 2] * z
            sums.rhs[n, a] -= A[k, 0, a] * residual[k, 0] + A[k, 1, a] * residual[k, 1] + of_point
        for other in range(k, m):
            e = sums.slot[p, pair]
            pair += 1
            for a in range(_Q):
                w0, w1, w2 = W[k, a, 0], W[k, a, 1], W[k, a, 2]
                for b in range(_Q):
                    blocks[e, a, b] -= w0 * F[other, 0, b] + w1 * F[other, 1, b] + w2 * F[other, 2, b]
        e = sums.slot[p, pair - m + k]
        for a in range(_Q):
            for b in range(_Q):
                blocks[e, a, b] += A[k, 0, a] * A[k, 0, b] + A[k, 1, a] * A[k, 1, b]


@compiled
def eliminate(
    at: Measured, stations: Stations, water: Water, known: Known, ridge: float, sums: Sums, out: Eliminated
) -> float:
    """Add k points to the normal equations of their stations, set how they follow, and return r' N_pp^-1 r of all.

    `collinear.eliminate` and `collinear.reduced`: N_ss - N_sp N_pp^-1 N_ps, point after point. `ridge`: what the
    diagonals of N_pp have beyond what is observed, of their largest.
    """
    points, m = at.photo.shape
    A, B, residual = np.empty((m, 2, _Q)), np.empty((m, 2, 3)), np.empty((m, 2))
    W, F, room = np.empty((m, _Q, 3)), np.empty((m, 3, _Q)), np.empty((3, 3, 3))
    N, b, L, inverse = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    gain = 0.0
    for p in range(points):
        _images(p, at, stations, water, room, A, B, residual)
        if len(known.free):
            _along_known(p, known, B)
        _point_normals(A, B, residual, p, known, ridge, N, b)
        _inverted(N, L, inverse)
        for i in range(3):
            out.shift[p, i] = inverse[i, 0] * b[0] + inverse[i, 1] * b[1] + inverse[i, 2] * b[2]
            gain += b[i] * out.shift[p, i]
        _crossed(m, A, B, W)
        _followed(m, W, inverse, F)
        for k in range(m):
            for i in range(3):
                for a in range(_Q):
                    out.by_station[p, i, k, a] = F[k, i, a]
        _add(p, at.photo, A, residual, W, F, sums, out)
    return gain


@compiled
def _followed(m: int, W: FloatArray, inverse: FloatArray, F: FloatArray) -> None:
    """Set F (m, 3, 6) = N_pp^-1 N_ps of a point: `collinear.eliminate`."""
    for k in range(m):
        for i in range(3):
            for a in range(_Q):
                F[k, i, a] = inverse[i, 0] * W[k, a, 0] + inverse[i, 1] * W[k, a, 1] + inverse[i, 2] * W[k, a, 2]


@compiled
def _crossed(m: int, A: FloatArray, B: FloatArray, W: FloatArray) -> None:
    """Set W (m, 6, 3) = N_sp of a point."""
    for k in range(m):
        for a in range(_Q):
            for i in range(3):
                W[k, a, i] = A[k, 0, a] * B[k, 0, i] + A[k, 1, a] * B[k, 1, i]


@compiled
def _of_stations(p: int, m: int, F: FloatArray, inverse: Inverse, G: FloatArray) -> None:
    """Set G (m, 3, 6) = F Q_ss of the stations of a point."""
    G[:] = 0.0
    pair, Q = 0, inverse.blocks
    for k in range(m):
        for other in range(k, m):
            e = inverse.slot[p, pair]
            pair += 1
            for i in range(3):
                for a in range(_Q):
                    for b in range(_Q):
                        G[other, i, b] += F[k, i, a] * Q[e, a, b]
                        if other > k:
                            G[k, i, a] += F[other, i, b] * Q[e, a, b]


@compiled
def spread(at: Measured, stations: Stations, water: Water, ridge: float, inverse: Inverse, out: Spread) -> None:
    """Set the cofactors of points of which nothing is known, and of their images.

    `propagation.point_covariances`, Q_xx = N_pp^-1 + F Q_ss F', and `reliability.images`: with partials a by the
    stations and b by the point, (a - b F) Q_ss (a - b F)' + b N_pp^-1 b' = a Q a' - 2 a Q F' b' + b Q_xx b'.
    """
    points, m = at.photo.shape
    A, B, residual = np.empty((m, 2, _Q)), np.empty((m, 2, 3)), np.empty((m, 2))
    W, F, G, room = np.empty((m, _Q, 3)), np.empty((m, 3, _Q)), np.empty((m, 3, _Q)), np.empty((3, 3, 3))
    N, b, L, of_point = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    nothing = Known(np.empty((0, 3, 3)), np.empty((0, 3), np.bool_), np.empty((0, 3)), np.empty((0, 3)))
    for p in range(points):
        _images(p, at, stations, water, room, A, B, residual)
        _point_normals(A, B, residual, p, nothing, ridge, N, b)
        _inverted(N, L, of_point)
        _crossed(m, A, B, W)
        _followed(m, W, of_point, F)
        _of_stations(p, m, F, inverse, G)
        for k in range(m):
            for i in range(3):
                for j in range(3):
                    for a in range(_Q):
                        of_point[i, j] += G[k, i, a] * F[k, j, a]
        out.point[p] = of_point
        _set_images(p, at, A, B, G, inverse, out)


@compiled
def _set_images(
    p: int, at: Measured, A: FloatArray, B: FloatArray, G: FloatArray, inverse: Inverse, out: Spread
) -> None:
    """Set the cofactors of the images of a point, and of these with its position."""
    m, pair = at.photo.shape[1], 0
    for k in range(m):
        n, e = at.photo[p, k], inverse.slot[p, pair]
        pair += m - k
        for c in range(2):
            total = 0.0
            for a in range(_Q):
                out.diagonal[n, a] += A[k, c, a] * A[k, c, a]
                for b in range(_Q):
                    total += A[k, c, a] * inverse.blocks[e, a, b] * A[k, c, b]
            for i in range(3):
                by_station, by_point = 0.0, 0.0
                for a in range(_Q):
                    by_station += A[k, c, a] * G[k, i, a]
                for j in range(3):
                    by_point += B[k, c, j] * out.point[p, j, i]
                total += B[k, c, i] * (by_point - 2.0 * by_station)
                out.covariance[p, k, c, i] = (by_point - by_station) / math.sqrt(at.weight[p, k, c])
            out.image[p, k, c] = total / at.weight[p, k, c]


@compiled
def squares(at: Measured, stations: Stations, water: Water, out: FloatArray) -> None:
    """Set the weighted squares (k,) of the images of points, infinite behind a camera: `ground.point_squares`."""
    points, m = at.photo.shape
    gap, v, by, M = np.empty(3), np.empty(3), np.empty((2, 3, 3)), stations.M
    for p in range(points):
        total = 0.0
        for k in range(m):
            n = at.photo[p, k]
            _vector(p, k, at, stations, water, gap, v, by)
            if not M[n, 2, 0] * gap[0] + M[n, 2, 1] * gap[1] + M[n, 2, 2] * gap[2] < 0.0:
                total = np.inf
            scale = -stations.focal_length[n] / (M[n, 2, 0] * v[0] + M[n, 2, 1] * v[1] + M[n, 2, 2] * v[2])
            for c in range(2):
                image = scale * (M[n, c, 0] * v[0] + M[n, c, 1] * v[1] + M[n, c, 2] * v[2])
                off = image + stations.principal_point[n, c] - at.xy[p, k, c]
                total += off * off * at.weight[p, k, c]
        out[p] = total if total < np.inf else np.inf
