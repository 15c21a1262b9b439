"""What an adjustment made linear leaves of the images of points, and how far others check them, point by point.

Nothing else is known of the points.
"""

from __future__ import annotations

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
from musatpy.adjustment.kernels.spreading import Images, of_stations
from musatpy.arrays import FloatArray, IntArray
from musatpy.compiling import compiled, inlined


class Columns(NamedTuple):
    """What C errors of one unit, each common to many images, add to these; and sums over points, to be added to."""

    images: FloatArray  # (C, m, 2) mm
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
def _add_column(
    c: int, p: int, m: int, size: int, at: Measured, rays: IntArray, room: Room, columns: Columns
) -> None:
    """Add the images of a point to the sums of column c."""
    first = at.start[p]
    x = y = z = 0.0
    for k in range(m):
        for axis in range(2):
            value = columns.images[c, rays[first + k], axis] * at.root[first + k, axis]
            x += room.B[k, axis, 0] * value
            y += room.B[k, axis, 1] * value
            z += room.B[k, axis, 2] * value
    for k in range(m):
        n = at.photo[first + k]
        for axis in range(2):
            value = columns.images[c, rays[first + k], axis] * at.root[first + k, axis]
            left = value - (room.Y[k, axis, 0] * x + room.Y[k, axis, 1] * y + room.Y[k, axis, 2] * z)
            columns.weight[c] += value * left
            columns.pull[c] += value * room.residual[k, axis]
            for a in range(size):
                columns.coupling[c, n, a] += room.A[k, axis, a] * left


@compiled
def left_over(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, step: FloatArray,
    rays: IntArray, columns: Columns, squares: FloatArray,
) -> None:  # fmt: skip
    """Set the weighted squares of the images of points, rows of (g,), after a step (n, q) of the stations.

    And add to the sums of columns: c'Pc - c'PB N_pp^-1 B'Pc, c'Pv, and c'P (A - B N_pp^-1 B'PA); the measurements
    are `rays` (r,). `linear_model.PointChecks`, `hypotheses._of_columns`.
    """
    room = room_for(at.start, rows)
    for p in rows:
        m = at.start[p + 1] - at.start[p]
        point_normals(p, at, stations, water, known, ridge, True, room)
        weigh(m, room)
        size = LEVELS if len(water.rise) else SIZE
        squares[at.point[p]] = _follow(p, m, size, at, step, room)
        for c in range(len(columns.images)):
            _add_column(c, p, m, size, at, rays, room, columns)


@inlined
def _leverage(p: int, m: int, size: int, pairs: Pairs, Q: FloatArray, room: Room, of: Images) -> float:
    """Return what `leverages` sets of a point, its stations of `size` unknowns each."""
    of_stations(p, m, size, pairs, Q, room, of)
    total = 0.0
    for k in range(m):
        for c in range(2):
            total += of.C[k, c]
            for i in range(3):
                total -= of.D[k, c, i] * room.B[k, c, i]
    return total


@compiled
def leverages(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, pairs: Pairs,
    Q: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Set the traces, rows of out (g,), of the cofactors that the images of points have of their stations.

    With a = A - B N_pp^-1 B'A, all of them weighted, a Q a' has the trace of A Q A' (1 - B N_pp^-1 B'): that is
    a projection. Q (e, q, q) is of the stations.
    """
    room = room_for(at.start, rows)
    of = Images(np.empty(room.residual.shape), np.empty(room.Y.shape))
    for p in rows:
        m = at.start[p + 1] - at.start[p]
        point_normals(p, at, stations, water, known, ridge, True, room)
        weigh(m, room)
        if len(water.rise):
            out[at.point[p]] = _leverage(p, m, LEVELS, pairs, Q, room, of)
        else:
            out[at.point[p]] = _leverage(p, m, SIZE, pairs, Q, room, of)
