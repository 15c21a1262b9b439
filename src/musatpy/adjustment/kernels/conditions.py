"""Points of IIA, one after the other: their conditions through full weights, and where they come to rest.

The numpy twins are `pass_points.conditions` and `pass_points.add_full`, `geometry.coplanarity`, and
`ground.settle_group`.

Conditions are linearised at the adjusted images of a point, whose rays meet there. An image moves its ray, where
it meets the others, by the inverse of the partials of the image by the point; what this does to the conditions are
their partials G. They hold wherever stations are, as long as the images follow these: g(l(s), s) = 0, so that the
partials by the stations are -G A, A those of the images. Rays through water are no others than straight ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from musatpy.adjustment.kernels.points import (
    Known,
    Measured,
    Pairs,
    Q,
    Room,
    Stations,
    Sums,
    Water,
    add_pair,
    from_axes,
    images,
    point_normals,
    room_for,
    times,
)
from musatpy.arrays import FloatArray, IntArray
from musatpy.compiling import compiled, inlined

_Vector = tuple[float, float, float]


class Conditions(NamedTuple):
    """Room for the c conditions of a point with up to m rays, of which a point takes the first rows and columns."""

    u: FloatArray  # (m, 3) directions of the rays where they meet
    shift: FloatArray  # (2 m, 3) of the rays there, by their images
    G: FloatArray  # (c, 2 m) partials by images
    weight: FloatArray  # (c,)
    w: FloatArray  # (c,) misclosures in their weights


@compiled
def _room(m: int) -> Conditions:
    """Return room for the conditions of any point of up to m rays."""
    c = max(2 * m - 3, 1)
    return Conditions(np.empty((m, 3)), np.empty((2 * m, 3)), np.empty((c, 2 * m)), np.empty(c), np.empty(c))


@inlined
def _row(a: FloatArray, i: int) -> _Vector:
    return a[i, 0], a[i, 1], a[i, 2]


@inlined
def _cross(a: _Vector, b: _Vector) -> _Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _dot(a: _Vector, b: _Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _scaled(a: _Vector, scale: float) -> _Vector:
    return a[0] * scale, a[1] * scale, a[2] * scale


@inlined
def _ray(k: int, B: FloatArray, of: Conditions) -> None:
    """Set the direction of ray k of a point, along which its images do not change, and its shifts across.

    B (m, 2, 3): partials of the images by the point.
    """
    by_x, by_y = (B[k, 0, 0], B[k, 0, 1], B[k, 0, 2]), (B[k, 1, 0], B[k, 1, 1], B[k, 1, 2])
    u = _cross(by_x, by_y)
    scale = 1.0 / _dot(u, u)
    of.u[k, 0], of.u[k, 1], of.u[k, 2] = u
    of.shift[2 * k, 0], of.shift[2 * k, 1], of.shift[2 * k, 2] = _scaled(_cross(by_y, u), scale)
    of.shift[2 * k + 1, 0], of.shift[2 * k + 1, 1], of.shift[2 * k + 1, 2] = _scaled(_cross(u, by_x), scale)


@inlined
def _coplanarity(row: int, ray: int, of: Conditions) -> None:
    """Set the partials of the coplanarity of a ray and the next: how they come apart, `coplanarity.coplanarity`."""
    across = _cross(_row(of.u, ray), _row(of.u, ray + 1))
    for b in range(2):
        of.G[row, 2 * ray + b] = -_dot(across, _row(of.shift, 2 * ray + b))
        of.G[row, 2 * ray + 2 + b] = _dot(across, _row(of.shift, 2 * ray + 2 + b))


@inlined
def _slide(ray: int, along: int, of: Conditions) -> _Vector:
    """Return the vector whose product with a shift of a ray is how far along another one their meeting slides."""
    across = _cross(_row(of.u, ray), _row(of.u, along))
    return _scaled(_cross(across, _row(of.u, ray)), 1.0 / _dot(across, across))


@inlined
def _scale_restraint(row: int, ray: int, of: Conditions) -> None:
    """Set the partials of the scale restraint of a ray and the next two: `coplanarity.scale_restraint`."""
    by_first, by_last = _slide(ray, ray + 1, of), _slide(ray + 2, ray + 1, of)
    for b in range(2):
        middle = _row(of.shift, 2 * ray + 2 + b)
        of.G[row, 2 * ray + b] = _dot(by_first, _row(of.shift, 2 * ray + b))
        of.G[row, 2 * ray + 2 + b] = _dot(by_last, middle) - _dot(by_first, middle)
        of.G[row, 2 * ray + 4 + b] = -_dot(by_last, _row(of.shift, 2 * ray + 4 + b))


@inlined
def _weigh(m: int, residual: FloatArray, of: Conditions) -> None:
    """Replace G by L^-1 G, G G' = L W^-1 L', and set the weights W and w = W L^-1 G v, row after row.

    G is by images in their sigmas. Its rows become orthogonal. A coplanarity has no part of later rays.
    """
    for row in range(2 * m - 3):
        for before in range(row):
            along, end = 0.0, min(2 * before + 4, 2 * m)
            for a in range(end):
                along += of.G[row, a] * of.G[before, a]
            along *= of.weight[before]
            for a in range(end):
                of.G[row, a] -= along * of.G[before, a]
        square = 0.0
        for a in range(2 * m):
            square += of.G[row, a] * of.G[row, a]
        off = 0.0
        for k in range(m):
            off += of.G[row, 2 * k] * residual[k, 0] + of.G[row, 2 * k + 1] * residual[k, 1]
        of.weight[row] = 1.0 / square
        of.w[row] = off * of.weight[row]


@inlined
def _add(p: int, m: int, at: Measured, room: Room, of: Conditions, sums: Sums) -> None:
    """Add A'G'w of a point to the right sides."""
    for k in range(m):
        n, x, y = at.photo[at.start[p] + k], 0.0, 0.0
        for c in range(max(k - 1, 0), 2 * m - 3):
            x, y = x + of.G[c, 2 * k] * of.w[c], y + of.G[c, 2 * k + 1] * of.w[c]
        for a in range(Q):
            sums.rhs[n, a] -= room.A[k, 0, a] * x + room.A[k, 1, a] * y


@inlined
def _add_blocks(p: int, m: int, pairs: Pairs, room: Room, of: Conditions, sums: Sums) -> None:
    """Add A'G'W GA of a point to the normal matrix."""
    pair, G = pairs.start[p], of.G
    for k in range(m):
        for other in range(k, m):
            p00 = p01 = p10 = p11 = 0.0
            for c in range(max(other - 1, 0), 2 * m - 3):  # the coplanarities of the rays before have no part in it
                x, y = G[c, 2 * k] * of.weight[c], G[c, 2 * k + 1] * of.weight[c]
                p00, p01 = p00 + x * G[c, 2 * other], p01 + x * G[c, 2 * other + 1]
                p10, p11 = p10 + y * G[c, 2 * other], p11 + y * G[c, 2 * other + 1]
            add_pair(pairs.slot[pair], k, other, Q, p00, p01, p10, p11, room.A, sums)
            pair += 1


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
    of = _room(len(room.residual))
    for p in rows:
        m = at.start[p + 1] - at.start[p]
        images(p, at, stations, water, known, True, room)
        for row in range(2 * m - 3):
            for a in range(2 * m):
                of.G[row, a] = 0.0
        for k in range(m):
            _ray(k, room.B, of)
        for k in range(m - 1):
            _coplanarity(k, k, of)
        for k in range(m - 2):
            _scale_restraint(m - 1 + k, k, of)
        _weigh(m, room.residual, of)
        _add(p, m, at, room, of, sums)
        if matrix:
            _add_blocks(p, m, pairs, room, of, sums)


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
