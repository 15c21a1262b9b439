"""Points of IIA, one after the other: their conditions through full weights, and where they come to rest.

The numpy twins are `pass_points.fully_weighted` and `ground.settle_group`.

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
from musatpy.adjustment.kernels.straight_rays import image_by_vector, to_point
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

    g - G A dx + G v = 0 has the normal equations A'G'(G Q G')^-1 G A: `pass_points.fully_weighted`.
    Without `matrix` the right sides only.
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
def _sink(p: int, at: Measured, water: Water, x: float, y: float, z: float) -> None:
    """Change the depths of a point below the water of its rays by its movement, and forget their tangents."""
    for r in range(at.start[p], at.start[p + 1]):
        w = water.row[r]
        if w >= 0:
            water.tangent[w] = np.nan
            water.depth[w] -= water.normal[w, 0] * x + water.normal[w, 1] * y + water.normal[w, 2] * z


@inlined
def _let_go(row: int, known: Known, x: float, y: float, z: float) -> None:
    """Take the movement of a point from what pulls it to where it is known to be."""
    for i in range(3):
        along = known.axes[row, i, 0] * x + known.axes[row, i, 1] * y + known.axes[row, i, 2] * z
        known.pull[row, i] -= known.weight[row, i] * along


@inlined
def _squares_of_known(row: int, known: Known) -> float:
    """Return the weighted squares of what is known of a point."""
    squares = 0.0
    for i in range(3):
        if known.weight[row, i] > 0.0:
            squares += known.pull[row, i] ** 2 / known.weight[row, i]
    return squares


@inlined
def _is_plain(p: int, at: Measured, water: Water, known: Known) -> bool:
    """Return whether a point has straight rays only, and nothing is known of it."""
    plain = known.row[p] < 0
    for r in range(at.start[p], at.start[p + 1]):
        plain &= water.row[r] < 0
    return plain


@inlined
def _plain_step(p: int, at: Measured, stations: Stations, ridge: float) -> tuple[float, float, float, float, float]:
    """Return the weighted squares of a plain point, its step and the fall of the squares by that.

    Those of `point_normals`, which is for all points; what stays in registers takes two thirds of the time.
    """
    n00 = n10 = n11 = n20 = n21 = n22 = b0 = b1 = b2 = squares = 0.0
    for r in range(at.start[p], at.start[p + 1]):
        v0, v1, v2, seen = to_point(r, p, at, stations)
        x, y, x0, x1, x2, y0, y1, y2 = image_by_vector(r, at, stations, v0, v1, v2)
        x, y = x * at.root[r, 0], y * at.root[r, 1]
        squares += x * x + y * y if seen else np.inf
        n00, n11, n22 = n00 + (x0 * x0 + y0 * y0), n11 + (x1 * x1 + y1 * y1), n22 + (x2 * x2 + y2 * y2)
        n10, n20, n21 = n10 + (x1 * x0 + y1 * y0), n20 + (x2 * x0 + y2 * y0), n21 + (x2 * x1 + y2 * y1)
        b0, b1, b2 = b0 - (x0 * x + y0 * y), b1 - (x1 * x + y1 * y), b2 - (x2 * x + y2 * y)
    more = ridge * max(n00, n11, n22)
    d0 = 1.0 / (n00 + more)
    l10, l20 = n10 * d0, n20 * d0
    d1 = 1.0 / (n11 + more - l10 * n10)
    rest = n21 - l20 * n10
    l21 = rest * d1
    d2 = 1.0 / (n22 + more - l20 * n20 - l21 * rest)
    c1 = b1 - l10 * b0
    z = (b2 - l20 * b0 - l21 * c1) * d2
    y = c1 * d1 - l21 * z
    x = b0 * d0 - l10 * y - l20 * z
    return squares if squares < np.inf else np.inf, x, y, z, b0 * x + b1 * y + b2 * z


@compiled
def settle(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, steps: int,
    limit: float, rounding: float, ground: FloatArray, squares: FloatArray, falls: FloatArray,
) -> None:  # fmt: skip
    """Take points to the optimum of their images and of what is known of them: `ground.settle_group`.

    Sets their ground, rows of (g, 3), their weighted squares, rows of (g,), and the falls (k, 2) of these by the
    last two steps, 0 where there was one. The water over them stays the plane that it is where they start:
    `water.depth` becomes that of where they come to, as `at.ground` does, and so does `known.pull` along the axes
    of the start.
    """
    room = room_for(at.start, rows)
    for p in rows:
        least, gain, fall, before, tried, g, row = np.inf, 0.0, 0.0, 0.0, 0, at.point[p], known.row[p]
        X0, X1, X2 = best0, best1, best2 = at.ground[p, 0], at.ground[p, 1], at.ground[p, 2]
        x, y, z, plain = 0.0, 0.0, 0.0, _is_plain(p, at, water, known)
        while tried < steps:
            half0, half1, half2 = 0.5 * x, 0.5 * y, 0.5 * z
            if plain:
                objective, x, y, z, down = _plain_step(p, at, stations, ridge)
            else:
                objective = point_normals(p, at, stations, water, known, ridge, False, room)
                x, y, z = times(room.inverse, room.rhs)
                down = room.rhs[0] * x + room.rhs[1] * y + room.rhs[2] * z
            if row >= 0:
                objective += _squares_of_known(row, known)
                x, y, z = from_axes(known.axes[row], x, y, z)
            if least < np.inf and not objective <= least * (1.0 + rounding) + rounding:
                x, y, z, gain = half0, half1, half2, 0.0
            else:
                least, before, fall, gain = objective, fall, down, down
                best0, best1, best2 = X0, X1, X2
            X0, X1, X2 = best0 + x, best1 + y, best2 + z
            if not plain:
                u0, u1, u2 = X0 - at.ground[p, 0], X1 - at.ground[p, 1], X2 - at.ground[p, 2]
                _sink(p, at, water, u0, u1, u2)
                if row >= 0:
                    _let_go(row, known, u0, u1, u2)
            at.ground[p, 0], at.ground[p, 1], at.ground[p, 2] = X0, X1, X2
            tried = steps if max(abs(x), abs(y), abs(z)) < limit else tried + 1
        ground[g, 0], ground[g, 1], ground[g, 2] = X0, X1, X2
        squares[g] = max(least - gain, 0.0)
        falls[p, 0], falls[p, 1] = before, fall
