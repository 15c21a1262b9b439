"""Points by collinearity, one after the other: images, partials, elimination and sums in one pass.

The numpy twins are `sightings.images`, `ground.point_normals`, `collinear.eliminate` and `collinear.reduced`, and of
single rays `refraction.flat.incidence` and `geometry.collinearity`, whose equations these loops follow. Points have
no unknowns but their own three and those of their stations; what has more goes by the twins.
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
    dM: FloatArray  # (n, 3, 3, 3) by omega, phi, kappa
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
    index: float


class Known(NamedTuple):
    """What is known of k points along axes of their own; of k points of which nothing is known, arrays of no rows."""

    axes: FloatArray  # (k, 3, 3)
    free: BoolArray  # (k, 3) the component may move
    weight: FloatArray  # (k, 3) 1/m2
    pull: FloatArray  # (k, 3) 1/m, weights times known minus current


class Sums(NamedTuple):
    """Normal equations of stations, to which points are added, and the blocks of the pairs of rays of a point."""

    slot: IntArray  # (k, m (m + 1) / 2) rows of the blocks, in the order of `numpy.triu_indices`
    blocks: FloatArray  # (e, q, q)
    rhs: FloatArray  # (n, q)


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
def _bend(
    gap: FloatArray, up: FloatArray, depth: float, n: float, v: FloatArray, by_camera: FloatArray, by_ground: FloatArray
) -> None:
    """Set v (3,) from camera to water point, and its partials (3, 3), of a wet ray: `refraction.flat.incidence`."""
    fall = -(up[0] * gap[0] + up[1] * gap[1] + up[2] * gap[2])
    e0, e1, e2 = gap[0] + up[0] * fall, gap[1] + up[1] * fall, gap[2] + up[2] * fall
    D = math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
    if D > 0.0:
        e0, e1, e2 = e0 / D, e1 / D, e2 / D
    e = (e0, e1, e2)
    h = depth
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
    for i in range(3):
        v[i] = e[i] * H * t - up[i] * H
        for j in range(3):
            unit = 1.0 if i == j else 0.0
            K = kappa * e[i] * e[j] + ratio * (unit - up[i] * up[j] - e[i] * e[j])
            by_camera[i, j] = -K + (e[i] * Q_H - up[i]) * up[j]
            by_ground[i, j] = K - e[i] * Q_h * up[j]


@compiled
def _vector(
    p: int, k: int, at: Measured, stations: Stations, water: Water, gap: FloatArray, v: FloatArray,
    by_camera: FloatArray, by_ground: FloatArray,
) -> bool:  # fmt: skip
    """Set the vector from a station to its target, and where the ray is wet its partials; return whether it is."""
    n = at.photo[p, k]
    for i in range(3):
        gap[i] = at.ground[p, i] - stations.position[n, i]
        v[i] = gap[i]
    if not (len(water.wet) and water.wet[p, k]):
        return False
    _bend(gap, water.normal[p, k], water.depth[p, k], water.index, v, by_camera, by_ground)
    return True


@compiled
def _turned(row: FloatArray, by: FloatArray, factor: float, out: FloatArray) -> None:
    """Set out (3,) to factor times the row (3,) times a matrix (3, 3)."""
    for i in range(3):
        out[i] = factor * (row[0] * by[0, i] + row[1] * by[1, i] + row[2] * by[2, i])


@compiled
def _image(
    p: int, k: int, at: Measured, stations: Stations, water: Water, v: FloatArray, room: FloatArray,
    A: FloatArray, B: FloatArray, residual: FloatArray,
) -> None:  # fmt: skip
    """Set the weighted residual (2,) of an image, and its partials by station, A (2, 6), and by ground, B (2, 3).

    `sightings.images`, `geometry.collinearity.image_partials`.
    """
    n = at.photo[p, k]
    M, f = stations.M[n], stations.focal_length[n]
    gap, by_camera, by_ground = room[0], room[1:4], room[4:7]
    wet = _vector(p, k, at, stations, water, gap, v, by_camera, by_ground)
    U = M[0, 0] * v[0] + M[0, 1] * v[1] + M[0, 2] * v[2]
    V = M[1, 0] * v[0] + M[1, 1] * v[1] + M[1, 2] * v[2]
    S = M[2, 0] * v[0] + M[2, 1] * v[1] + M[2, 2] * v[2]
    scale = -f / S
    by_v, bent = room[7], room[8]
    for c in range(2):
        image = U if c == 0 else V
        root = math.sqrt(at.weight[p, k, c])
        ratio, factor = image / S, scale * root
        residual[c] = (scale * image + stations.principal_point[n, c] - at.xy[p, k, c]) * root
        for i in range(3):
            by_v[i] = factor * (M[c, i] - ratio * M[2, i])
        if wet:
            _turned(by_v, by_ground, 1.0, B[c])
            _turned(by_v, by_camera, 1.0, bent)
        else:
            for i in range(3):
                B[c, i], bent[i] = by_v[i], -by_v[i]
        for a in range(3):
            axis, dM = stations.axes[n, a], stations.dM[n, a]
            A[c, a] = bent[0] * axis[0] + bent[1] * axis[1] + bent[2] * axis[2]
            of_image = dM[c, 0] * v[0] + dM[c, 1] * v[1] + dM[c, 2] * v[2]
            of_depth = dM[2, 0] * v[0] + dM[2, 1] * v[1] + dM[2, 2] * v[2]
            A[c, 3 + a] = factor * (of_image - ratio * of_depth)


@compiled
def _along_known(B: FloatArray, axes: FloatArray, free: BoolArray, turned: FloatArray) -> None:
    """Turn partials B (m, 2, 3) by a point to its axes, zero by what is held: `ground.point_normals`."""
    for k in range(len(B)):
        for c in range(2):
            for i in range(3):
                turned[i] = B[k, c, 0] * axes[i, 0] + B[k, c, 1] * axes[i, 1] + B[k, c, 2] * axes[i, 2]
            for i in range(3):
                B[k, c, i] = turned[i] if free[i] else 0.0


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
    A: FloatArray, B: FloatArray, residual: FloatArray, p: int, known: Known, ridge: float, N: FloatArray, b: FloatArray
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
    A: FloatArray, residual: FloatArray, W: FloatArray, p: int, photo: IntArray, sums: Sums, out: Eliminated
) -> None:
    """Add a point to the reduced normal equations of its stations: `collinear.reduced`."""
    m, pair = len(photo), 0
    shift, F = out.shift[p], out.by_station[p]
    for k in range(m):
        n = photo[k]
        for a in range(_Q):
            of_point = W[k, a, 0] * shift[0] + W[k, a, 1] * shift[1] + W[k, a, 2] * shift[2]
            sums.rhs[n, a] -= A[k, 0, a] * residual[k, 0] + A[k, 1, a] * residual[k, 1] + of_point
        for other in range(k, m):
            block = sums.blocks[sums.slot[p, pair]]
            pair += 1
            for a in range(_Q):
                for b in range(_Q):
                    block[a, b] -= W[k, a, 0] * F[0, other, b] + W[k, a, 1] * F[1, other, b] + W[k, a, 2] * F[2, other, b]
            if other == k:
                for a in range(_Q):
                    for b in range(_Q):
                        block[a, b] += A[k, 0, a] * A[k, 0, b] + A[k, 1, a] * A[k, 1, b]


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
    W, room, v = np.empty((m, _Q, 3)), np.empty((9, 3)), np.empty(3)
    N, b, L, inverse = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    gain = 0.0
    for p in range(points):
        for k in range(m):
            _image(p, k, at, stations, water, v, room, A[k], B[k], residual[k])
        if len(known.free):
            _along_known(B, known.axes[p], known.free[p], v)
        _point_normals(A, B, residual, p, known, ridge, N, b)
        _inverted(N, L, inverse)
        for i in range(3):
            out.shift[p, i] = inverse[i, 0] * b[0] + inverse[i, 1] * b[1] + inverse[i, 2] * b[2]
            gain += b[i] * out.shift[p, i]
        for k in range(m):
            for a in range(_Q):
                for i in range(3):
                    W[k, a, i] = A[k, 0, a] * B[k, 0, i] + A[k, 1, a] * B[k, 1, i]
                for i in range(3):
                    out.by_station[p, i, k, a] = (
                        inverse[i, 0] * W[k, a, 0] + inverse[i, 1] * W[k, a, 1] + inverse[i, 2] * W[k, a, 2]
                    )
        _add(A, residual, W, p, at.photo[p], sums, out)
    return gain


@compiled
def squares(at: Measured, stations: Stations, water: Water, out: FloatArray) -> None:
    """Set the weighted squares (k,) of the images of points, infinite behind a camera: `ground.point_squares`."""
    points, m = at.photo.shape
    gap, v, by_camera, by_ground = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    for p in range(points):
        total = 0.0
        for k in range(m):
            n = at.photo[p, k]
            M = stations.M[n]
            _vector(p, k, at, stations, water, gap, v, by_camera, by_ground)
            if not M[2, 0] * gap[0] + M[2, 1] * gap[1] + M[2, 2] * gap[2] < 0.0:
                total = np.inf
            S = M[2, 0] * v[0] + M[2, 1] * v[1] + M[2, 2] * v[2]
            for c in range(2):
                image = -stations.focal_length[n] * (M[c, 0] * v[0] + M[c, 1] * v[1] + M[c, 2] * v[2]) / S
                off = image + stations.principal_point[n, c] - at.xy[p, k, c]
                total += off * off * at.weight[p, k, c]
        out[p] = total if total < np.inf else np.inf
