"""What an adjustment made linear leaves of the images of points, and how far others check them, point by point.

Nothing else is known of the points.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from musatpy.adjustment.kernels.points import (
    LEVELS,
    Known,
    Measured,
    Pairs,
    Room,
    Stations,
    Water,
    point_normals,
    room_for,
    times,
    weigh,
)
from musatpy.adjustment.kernels.points import Q as SIZE
from musatpy.adjustment.kernels.spreading import Images, of_stations, room_for_images
from musatpy.adjustment.kernels.wet_rays import bend
from musatpy.arrays import FloatArray, IntArray
from musatpy.compiling import compiled, inlined
from musatpy.refraction.compiled_flat import slopes

UNCHECKED = 1e-4  # pivots of the redundancy of images, below which they are not checked


class Columns(NamedTuple):
    """What C errors of one unit, each common to many images, do to these; and sums over points, to be added to.

    They are those of focal length and principal point, x and y, of each camera; and, last, where it counts, of the
    index of the water.
    """

    camera: IntArray  # (n,) of the photos
    with_index: bool
    weight: FloatArray  # (C,) c'Pc
    pull: FloatArray  # (C,) c'Pv
    coupling: FloatArray  # (C, n, q) c'PA by the stations, the points following


@inlined
def _follow(p: int, m: int, size: int, at: Measured, step: FloatArray, room: Room) -> float:
    """Set the weighted residuals of a point to those after a step (n, q) of its stations; return their squares."""
    x, y, z = times(room.inverse, room.rhs)
    for k in range(m):
        n = at.photo[at.start[p] + k]
        for c in range(2):
            change = 0.0
            for a in range(size):
                change += room.A[k, c, a] * step[n, a]
            room.residual[k, c] += change
            x, y, z = x - room.Y[k, c, 0] * change, y - room.Y[k, c, 1] * change, z - room.Y[k, c, 2] * change
    squares = 0.0
    for k in range(m):
        for c in range(2):
            v = room.residual[k, c] + room.B[k, c, 0] * x + room.B[k, c, 1] * y + room.B[k, c, 2] * z
            room.residual[k, c] = v
            squares += v * v
    return squares


@inlined
def _by_index(k: int, r: int, p: int, at: Measured, stations: Stations, water: Water, of: FloatArray) -> None:
    """Set of (m, 4, 2), its last column, to what the index adds to wet image r, ray k of its point.

    `sightings.index_partials`: the partials by v of `geometry.collinearity`, along the ray on the water.
    """
    n, M, X, P = at.photo[r], stations.M, at.ground, stations.position
    v0, v1, v2 = X[p, 0] - P[n, 0], X[p, 1] - P[n, 1], X[p, 2] - P[n, 2]
    v0, v1, v2, e0, e1, e2, H, t = bend(water.row[r], water, v0, v1, v2)
    _, _, _, _, longer = slopes(t, H, water.depth[water.row[r]], water.refraction)
    depth = M[n, 2, 0] * v0 + M[n, 2, 1] * v1 + M[n, 2, 2] * v2
    deeper = (M[n, 2, 0] * e0 + M[n, 2, 1] * e1 + M[n, 2, 2] * e2) / depth
    for axis in range(2):
        image = M[n, axis, 0] * v0 + M[n, axis, 1] * v1 + M[n, axis, 2] * v2
        across = M[n, axis, 0] * e0 + M[n, axis, 1] * e1 + M[n, axis, 2] * e2
        of[k, 3, axis] = stations.focal_length[n] / depth * (across - image * deeper) * longer * at.root[r, axis]


@inlined
def _set_errors(
    p: int, m: int, at: Measured, stations: Stations, water: Water, with_index: bool, room: Room, of: FloatArray
) -> None:
    """Set of (m, 4, 2) to what errors of one unit add to images of a point: `common_errors._errors_of_images`."""
    for k in range(m):
        r = at.start[p] + k
        n = at.photo[r]
        for axis in range(2):
            root = at.root[r, axis]
            image = room.residual[k, axis] + (at.xy[r, axis] - stations.principal_point[n, axis]) * root
            of[k, 0, axis] = -image / stations.focal_length[n]
            of[k, 1, axis] = -root if axis == 0 else 0.0
            of[k, 2, axis] = -root if axis == 1 else 0.0
            of[k, 3, axis] = 0.0
        if with_index and water.row[r] >= 0:
            _by_index(k, r, p, at, stations, water, of)


@inlined
def _add_column(
    c: int, p: int, m: int, size: int, at: Measured, of: FloatArray, room: Room, columns: Columns
) -> None:
    """Add the images of a point, with what errors of one unit add to them, to the sums of column c."""
    first, camera, error, seen = at.start[p], c // 3, c % 3, False
    if columns.with_index and c == len(columns.weight) - 1:
        camera, error = -1, 3
    x = y = z = 0.0
    for k in range(m):
        if camera < 0 or columns.camera[at.photo[first + k]] == camera:
            seen = True
            for axis in range(2):
                value = of[k, error, axis]
                x += room.B[k, axis, 0] * value
                y += room.B[k, axis, 1] * value
                z += room.B[k, axis, 2] * value
    for k in range(m if seen else 0):
        n = at.photo[first + k]
        for axis in range(2):
            value = of[k, error, axis] if camera < 0 or columns.camera[n] == camera else 0.0
            left = value - (room.Y[k, axis, 0] * x + room.Y[k, axis, 1] * y + room.Y[k, axis, 2] * z)
            columns.weight[c] += value * left
            columns.pull[c] += value * room.residual[k, axis]
            for a in range(size):
                columns.coupling[c, n, a] += room.A[k, axis, a] * left


@compiled
def left_over(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, step: FloatArray,
    columns: Columns, squares: FloatArray,
) -> None:  # fmt: skip
    """Set the weighted squares of the images of points, rows of (g,), after a step (n, q) of the stations.

    And add to the sums of columns: c'Pc - c'PB N_pp^-1 B'Pc, c'Pv, and c'P (A - B N_pp^-1 B'PA).
    `checks.PointChecks`, `common_errors.CommonErrors`.
    """
    room = room_for(at.start, rows)
    of = np.empty((len(room.Y), 4, 2))
    for p in rows:
        m = at.start[p + 1] - at.start[p]
        point_normals(p, at, stations, water, known, ridge, True, room)
        weigh(m, room)
        _set_errors(p, m, at, stations, water, columns.with_index, room, of)
        size = LEVELS if len(water.rise) else SIZE
        squares[at.point[p]] = _follow(p, m, size, at, step, room)
        for c in range(len(columns.weight)):
            _add_column(c, p, m, size, at, of, room, columns)


@inlined
def _set_row(row: int, room: Room, of: Images, M: FloatArray) -> None:
    """Set a row of the lower half of M = 1 - W C W, W = 1 - B Y'; N (3, 3) is Y' C Y."""
    k, c, B, D, N = row // 2, row % 2, room.B, of.D, room.N
    b0, b1, b2 = B[k, c, 0], B[k, c, 1], B[k, c, 2]
    d0, d1, d2 = D[k, c, 0], D[k, c, 1], D[k, c, 2]
    f0 = d0 - b0 * N[0, 0] - b1 * N[1, 0] - b2 * N[2, 0]
    f1 = d1 - b0 * N[0, 1] - b1 * N[1, 1] - b2 * N[2, 1]
    f2 = d2 - b0 * N[0, 2] - b1 * N[1, 2] - b2 * N[2, 2]
    for column in range(row + 1):
        i, a = column // 2, column % 2
        value = b0 * D[i, a, 0] + b1 * D[i, a, 1] + b2 * D[i, a, 2] - of.C[i, a, k, c]
        M[row, column] = value + f0 * B[i, a, 0] + f1 * B[i, a, 1] + f2 * B[i, a, 2]
    M[row, row] += 1.0


@inlined
def _together(
    p: int, m: int, size: int, pairs: Pairs, Q: FloatArray, room: Room, of: Images, M: FloatArray
) -> float:
    """Return what `together` sets of a point after a step, its stations of `size` unknowns each.

    Row by row of M = L L', v' M^-1 v is the square of L^-1 v.
    """
    of_stations(p, m, size, pairs, Q, room, of)
    for i in range(3):
        for j in range(3):
            room.N[i, j] = 0.0
            for k in range(m):
                room.N[i, j] += room.Y[k, 0, i] * of.D[k, 0, j] + room.Y[k, 1, i] * of.D[k, 1, j]
    total = 0.0
    for row in range(2 * m):
        _set_row(row, room, of, M)
        left = room.residual[row // 2, row % 2]
        for column in range(row + 1):
            value = M[row, column]
            for inner in range(column):
                value -= M[row, inner] * M[column, inner]
            if column < row:
                M[row, column] = value / M[column, column]
                left -= M[row, column] * M[column, -1]
            elif value < UNCHECKED:
                return np.inf
            else:
                M[row, row] = math.sqrt(value)
        M[row, -1] = left / M[row, row]
        total += M[row, -1] ** 2
    return total


@compiled
def together(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, step: FloatArray,
    pairs: Pairs, Q: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Set the squares, rows of out (g,), that all images of points explain together, after a step (n, q).

    r' R^-1 r of `checks.dropped`, all weighted: R = W - W C W with the projection W = 1 - B N_pp^-1 B' and
    C = A Q A'. W leaves r as it is, so that it is r' M^-1 r with M = 1 - W C W, which is regular. Infinite where M
    hardly is: there nothing checks the images. Q (e, q, q) is of the stations.
    """
    room = room_for(at.start, rows)
    of, M = room_for_images(len(room.Y)), np.empty((2 * len(room.Y), 2 * len(room.Y) + 1))
    for p in rows:
        m = at.start[p + 1] - at.start[p]
        point_normals(p, at, stations, water, known, ridge, True, room)
        weigh(m, room)
        if len(water.rise):
            _follow(p, m, LEVELS, at, step, room)
            out[at.point[p]] = _together(p, m, LEVELS, pairs, Q, room, of, M)
        else:
            _follow(p, m, SIZE, at, step, room)
            out[at.point[p]] = _together(p, m, SIZE, pairs, Q, room, of, M)
