"""Points of IIA, one after the other: their conditions through full weights, and where they come to rest.

The numpy twins are `pass_points.add_full` and `ground.settle_group`.

With images in their sigmas and B their partials by the point, the conditions have G B = 0, as they hold wherever a
point is, and are as many as 2m images leave of three coordinates. So G'(G G')^-1 G = I - B(B'B)^-1 B': both take
from images what a point explains (docs/theory.md, Weights). With columns of B made orthonormal it is I - B B'.
"""

from __future__ import annotations

import math

import numpy as np

from musatpy.adjustment.kernels.points import (
    Known,
    Measured,
    Pairs,
    Q,
    Stations,
    Sums,
    Water,
    add_blocks,
    add_right_sides,
    from_axes,
    images,
    point_normals,
    room_for,
    times,
)
from musatpy.arrays import FloatArray, IntArray
from musatpy.compiling import compiled, inlined


@inlined
def _orthonormal(m: int, B: FloatArray) -> None:
    """Make the columns of partials B (m, 2, 3) by a point orthonormal: the modified Gram-Schmidt process."""
    for i in range(3):
        square = 0.0
        for k in range(m):
            square += B[k, 0, i] * B[k, 0, i] + B[k, 1, i] * B[k, 1, i]
        scale = 1.0 / math.sqrt(square)
        for k in range(m):
            B[k, 0, i], B[k, 1, i] = B[k, 0, i] * scale, B[k, 1, i] * scale
        for j in range(i + 1, 3):
            along = 0.0
            for k in range(m):
                along += B[k, 0, i] * B[k, 0, j] + B[k, 1, i] * B[k, 1, j]
            for k in range(m):
                B[k, 0, j], B[k, 1, j] = B[k, 0, j] - along * B[k, 0, i], B[k, 1, j] - along * B[k, 1, i]


@compiled
def add_conditions(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, pairs: Pairs, matrix: bool,
    sums: Sums,
) -> None:  # fmt: skip
    """Add the conditions of points of which nothing is known, at their adjusted images, with full weights.

    g - G A dx + G v = 0 has the normal equations A'G'(G Q G')^-1 G A: `pass_points.add_full`; without `matrix` the
    right sides only.
    """
    room = room_for(at.start, rows)
    for p in rows:
        m, x, y, z = at.start[p + 1] - at.start[p], 0.0, 0.0, 0.0
        images(p, at, stations, water, known, True, room)
        _orthonormal(m, room.B)
        for k in range(m):
            for c in range(2):
                v = room.residual[k, c]
                x, y, z = x - room.B[k, c, 0] * v, y - room.B[k, c, 1] * v, z - room.B[k, c, 2] * v
        add_right_sides(p, m, Q, at, room, sums, x, y, z)
        if matrix:
            add_blocks(p, m, Q, pairs, room.B, room.B, room.A, sums)


@inlined
def _sink(p: int, at: Measured, water: Water, change: FloatArray) -> None:
    """Change the depths of a point below the water of its rays by its movement (3,), and forget their tangents."""
    for r in range(at.start[p], at.start[p + 1]):
        w = water.row[r]
        if w >= 0:
            water.tangent[w] = np.nan
            for i in range(3):
                water.depth[w] -= water.normal[w, i] * change[i]


@inlined
def _let_go(row: int, known: Known, change: FloatArray) -> None:
    """Take the movement (3,) of a point from what pulls it to where it is known to be."""
    for i in range(3):
        along = known.axes[row, i, 0] * change[0] + known.axes[row, i, 1] * change[1]
        known.pull[row, i] -= known.weight[row, i] * (along + known.axes[row, i, 2] * change[2])


@inlined
def _squares_of_known(row: int, known: Known) -> float:
    """Return the weighted squares of what is known of a point."""
    squares = 0.0
    for i in range(3):
        if known.weight[row, i] > 0.0:
            squares += known.pull[row, i] ** 2 / known.weight[row, i]
    return squares


@compiled
def settle(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, steps: int,
    limit: float, rounding: float, share: float, ground: FloatArray, squares: FloatArray, left: FloatArray,
) -> None:  # fmt: skip
    """Take points to the optimum of their images and of what is known of them: `ground.settle_group`.

    Sets their ground, rows of (g, 3), their weighted squares, rows of (g,), and by how much (k,) these are still to
    fall: what `share` leaves of the fall of a first step, later ones as much of their fall as that is of the one
    before. The water over them stays the plane that it is where they start: `water.depth` becomes that of where
    they come to, as `at.ground` does, and so does `known.pull` along the axes of the start.
    """
    room, best, step, change = room_for(at.start, rows), np.empty(3), np.empty(3), np.empty(3)
    for p in rows:
        least, gain, fall, before, tried, g, row = np.inf, 0.0, 0.0, 0.0, 0, at.point[p], known.row[p]
        step[0], step[1], step[2] = 0.0, 0.0, 0.0
        while tried < steps:
            objective = point_normals(p, at, stations, water, known, ridge, False, room)
            if row >= 0:
                objective += _squares_of_known(row, known)
            x, y, z = times(room.inverse, room.rhs)
            worse = least < np.inf and not objective <= least * (1.0 + rounding) + rounding
            if worse:
                x, y, z, gain = 0.5 * step[0], 0.5 * step[1], 0.5 * step[2], 0.0
            else:
                least, before, fall = objective, fall, room.rhs[0] * x + room.rhs[1] * y + room.rhs[2] * z
                gain = fall
                if row >= 0:
                    x, y, z = from_axes(known.axes[row], x, y, z)
            step[0], step[1], step[2] = x, y, z
            for i in range(3):
                best[i] = best[i] if worse else at.ground[p, i]
                change[i] = best[i] + step[i] - at.ground[p, i]
                at.ground[p, i] = best[i] + step[i]
            _sink(p, at, water, change)
            if row >= 0:
                _let_go(row, known, change)
            tried = steps if max(abs(x), abs(y), abs(z)) < limit else tried + 1
        for i in range(3):
            ground[g, i] = at.ground[p, i]
        squares[g] = max(least - gain, 0.0)
        left[p] = fall * (min(fall / before, 1.0) if before > 0.0 else share)
