"""Points of IIA, one after the other: their conditions through full weights, and where they come to rest.

The numpy twins are `pass_points.conditions` and `pass_points.add_full`, `sightings.condition_rays`,
`geometry.coplanarity` and `geometry.collinearity.ray_partials`, `refraction.flat.refracted_ray`, and
`ground.settle_group`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from musatpy.adjustment.kernels.points import (
    Known,
    Measured,
    Pairs,
    Q,
    Stations,
    Sums,
    Water,
    point_normals,
    room_for,
    times,
)
from musatpy.adjustment.kernels.wet_rays import bend
from musatpy.arrays import FloatArray, IntArray
from musatpy.compiling import compiled, inlined


class Conditions(NamedTuple):
    """Room for the c conditions of a point with up to m rays, of which a point takes the first rows and columns."""

    xy: FloatArray  # (m, 2) adjusted images
    cofactor: FloatArray  # (m, 2) of the measured ones
    P: FloatArray  # (m, 3) where the rays start, a station or a water point
    u: FloatArray  # (m, 3) unit rays
    air: FloatArray  # (m, 3) the same before they enter the water
    water: FloatArray  # (m, 4) 1/cos I, way to the water, and along and across the normal what is left of a turn
    by_attitude: FloatArray  # (m, 3, 3) partials of the rays in air by omega, phi, kappa
    by_xy: FloatArray  # (m, 3, 2) and by images
    B: FloatArray  # (m - 1, 3) bases
    vectors: FloatArray  # (10, 3) of one condition
    by: FloatArray  # (6, 3) its partials by origin and direction of up to three rays
    A: FloatArray  # (c, 6 m) partials by stations
    G: FloatArray  # (c, 2 m) by images
    S: FloatArray  # (c, c) G Q G'
    w: FloatArray  # (c,) misclosures


_D, _BA, _E, _BY_A, _FIRST, _SECOND = 0, 1, 2, 3, 4, 7  # rows of the vectors of a condition


@inlined
def _room(start: IntArray, rows: IntArray) -> Conditions:
    """Return room for the conditions of any point of some rows."""
    m = 2
    for p in rows:
        m = max(m, start[p + 1] - start[p])
    c = 2 * m - 3
    return Conditions(
        np.empty((m, 2)), np.empty((m, 2)), np.empty((m, 3)), np.empty((m, 3)), np.empty((m, 3)), np.empty((m, 4)),
        np.empty((m, 3, 3)), np.empty((m, 3, 2)), np.empty((m - 1, 3)), np.empty((10, 3)), np.empty((6, 3)),
        np.empty((c, Q * m)), np.empty((c, 2 * m)), np.empty((c, c)), np.empty(c),
    )  # fmt: skip


@inlined
def _cross(a: FloatArray, i: int, b: FloatArray, j: int, out: FloatArray, k: int) -> None:
    """Set a row of `out` to the vector product of rows of a and b."""
    x = a[i, 1] * b[j, 2] - a[i, 2] * b[j, 1]
    y = a[i, 2] * b[j, 0] - a[i, 0] * b[j, 2]
    z = a[i, 0] * b[j, 1] - a[i, 1] * b[j, 0]
    out[k, 0], out[k, 1], out[k, 2] = x, y, z


@inlined
def _dot(a: FloatArray, i: int, b: FloatArray, j: int) -> float:
    return a[i, 0] * b[j, 0] + a[i, 1] * b[j, 1] + a[i, 2] * b[j, 2]


@inlined
def _ray(p: int, r: int, k: int, at: Measured, stations: Stations, water: Water, of: Conditions) -> None:
    """Set the adjusted image r of a point, its ray k, and the partials of this: `collinearity.ray_partials`."""
    n, w, height = at.photo[r], water.row[r], 0.0
    cosine, sine, f = stations.turn[n, 0], stations.turn[n, 1], stations.focal_length[n]
    g = at.point[p]
    v0 = at.ground[g, 0] - stations.position[n, 0]
    v1 = at.ground[g, 1] - stations.position[n, 1]
    v2 = at.ground[g, 2] - stations.position[n, 2]
    if w >= 0:
        _, _, _, height, _ = bend(w, water, v0, v1, v2, of.vectors[0])
        v0, v1, v2 = of.vectors[0, 0], of.vectors[0, 1], of.vectors[0, 2]
    scale = -f / (stations.M[n, 2, 0] * v0 + stations.M[n, 2, 1] * v1 + stations.M[n, 2, 2] * v2)
    x = scale * (stations.M[n, 0, 0] * v0 + stations.M[n, 0, 1] * v1 + stations.M[n, 0, 2] * v2)
    y = scale * (stations.M[n, 1, 0] * v0 + stations.M[n, 1, 1] * v1 + stations.M[n, 1, 2] * v2)
    of.cofactor[k, 0], of.cofactor[k, 1] = 1.0 / at.weight[r, 0], 1.0 / at.weight[r, 1]
    of.xy[k, 0], of.xy[k, 1] = x + stations.principal_point[n, 0], y + stations.principal_point[n, 1]
    length = math.sqrt(x * x + y * y + f * f)
    for i in range(3):
        of.P[k, i] = stations.position[n, i]
        of.u[k, i] = (stations.M[n, 0, i] * x + stations.M[n, 1, i] * y - stations.M[n, 2, i] * f) / length
        # of M' (x, y, -f) by omega, phi, kappa
        of_depth = cosine * stations.M[n, 0, i] - sine * stations.M[n, 1, i]
        of.by_attitude[k, i, 1] = (sine * y - cosine * x) * stations.M[n, 2, i] - f * of_depth
        of.by_attitude[k, i, 2] = x * stations.M[n, 1, i] - y * stations.M[n, 0, i]
        of.by_xy[k, i, 0], of.by_xy[k, i, 1] = stations.M[n, 0, i], stations.M[n, 1, i]
    east0, east1, east2 = stations.axes[n, 0, 0], stations.axes[n, 0, 1], stations.axes[n, 0, 2]
    of.by_attitude[k, 0, 0] = (east1 * of.u[k, 2] - east2 * of.u[k, 1]) * length
    of.by_attitude[k, 1, 0] = (east2 * of.u[k, 0] - east0 * of.u[k, 2]) * length
    of.by_attitude[k, 2, 0] = (east0 * of.u[k, 1] - east1 * of.u[k, 0]) * length
    _across(k, of.u, of.by_attitude, length)
    _across(k, of.u, of.by_xy, length)
    if w >= 0:
        _enter_water(w, k, height, water, of)


@inlined
def _enter_water(w: int, k: int, height: float, water: Water, of: Conditions) -> None:
    """Let ray k start where it enters the water, so far below its station: `flat.refracted_ray`."""
    n = water.refraction
    c = -(water.normal[w, 0] * of.u[k, 0] + water.normal[w, 1] * of.u[k, 1] + water.normal[w, 2] * of.u[k, 2])
    cos_theta = math.sqrt(1.0 - (1.0 - c * c) / (n * n))
    of.water[k, 0], of.water[k, 1] = 1.0 / c, height / c
    of.water[k, 2], of.water[k, 3] = c / (n * n * cos_theta), 1.0 / n
    for i in range(3):
        of.air[k, i] = of.u[k, i]
        of.P[k, i] += height / c * of.u[k, i]
        of.u[k, i] = of.u[k, i] / n + water.normal[w, i] * (c / n - cos_theta)


@inlined
def _back_into_air(w: int, k: int, side: int, water: Water, of: Conditions) -> None:
    """Replace partials by origin and direction of wet ray k by those by station and direction in air."""
    P, u = 2 * side, 2 * side + 1
    by_origin, by_normal = 0.0, 0.0
    for i in range(3):
        by_origin += of.by[P, i] * of.air[k, i]
        by_normal += of.by[u, i] * water.normal[w, i]
    for i in range(3):
        up = water.normal[w, i]
        of.by[P, i] += by_origin * of.water[k, 0] * up
        turned = of.by[u, i] * of.water[k, 3] + by_normal * (of.water[k, 2] - of.water[k, 3]) * up
        of.by[u, i] = of.by[P, i] * of.water[k, 1] + turned


@inlined
def _across(k: int, u: FloatArray, by: FloatArray, length: float) -> None:
    """Take of the partials of a vector of some length, rows k, those of its unit vector."""
    inverse = 1.0 / length
    for b in range(by.shape[2]):
        along = u[k, 0] * by[k, 0, b] + u[k, 1] * by[k, 1, b] + u[k, 2] * by[k, 2, b]
        for i in range(3):
            by[k, i, b] = (by[k, i, b] - u[k, i] * along) * inverse


@inlined
def _distance(base: int, ray: int, of_first: bool, of: Conditions, to: int) -> float:
    """Return k = (B x a).D/|D|^2 with D = u x w of a ray and the next, a the first or the second of them.

    Sets its partials by B, u, w from row `to` of the vectors on: `coplanarity._distance`.
    """
    V, a = of.vectors, ray if of_first else ray + 1
    _cross(of.u, ray, of.u, ray + 1, V, _D)
    _cross(of.B, base, of.u, a, V, _BA)
    D2 = _dot(V, _D, V, _D)
    k = _dot(V, _BA, V, _D) / D2
    for i in range(3):
        V[_E, i] = V[_BA, i] - 2.0 * k * V[_D, i]
    _cross(of.u, a, V, _D, V, to)
    _cross(of.u, ray + 1, V, _E, V, to + 1)
    _cross(V, _E, of.u, ray, V, to + 2)
    _cross(V, _D, of.B, base, V, _BY_A)
    for i in range(3):
        V[to + 1 if of_first else to + 2, i] += V[_BY_A, i]
        for j in range(3):
            V[to + j, i] /= D2
    return k


@inlined
def _coplanarity(ray: int, of: Conditions) -> float:
    """Return B.(u1 x u2) of a ray and the next, and set its partials: `coplanarity.coplanarity`."""
    _cross(of.u, ray, of.u, ray + 1, of.vectors, _D)
    _cross(of.u, ray + 1, of.B, ray, of.by, 1)
    _cross(of.B, ray, of.u, ray, of.by, 3)
    for i in range(3):
        of.by[0, i], of.by[2, i] = -of.vectors[_D, i], of.vectors[_D, i]
    return _dot(of.B, ray, of.vectors, _D)


@inlined
def _scale_restraint(ray: int, of: Conditions) -> float:
    """Return the scale restraint of a ray and the next two, and set its partials: `coplanarity.scale_restraint`."""
    value = _distance(ray, ray, True, of, _FIRST)
    value -= _distance(ray + 1, ray + 1, False, of, _SECOND)
    for i in range(3):
        first0, first1, first2 = of.vectors[_FIRST, i], of.vectors[_FIRST + 1, i], of.vectors[_FIRST + 2, i]
        second0, second1, second2 = of.vectors[_SECOND, i], of.vectors[_SECOND + 1, i], of.vectors[_SECOND + 2, i]
        of.by[0, i], of.by[1, i] = -first0, first1
        of.by[2, i], of.by[3, i] = first0 + second0, first2 - second1
        of.by[4, i], of.by[5, i] = -second0, -second2
    return value


@inlined
def _enter(c: int, n: int, k: int, side: int, stations: Stations, of: Conditions) -> None:
    """Set the partials of condition c by the station n and the image of ray k, one of its up to three rays."""
    P, u = 2 * side, 2 * side + 1
    for a in range(3):
        along, turned = 0.0, 0.0
        for i in range(3):
            along += of.by[P, i] * stations.axes[n, a, i]
            turned += of.by[u, i] * of.by_attitude[k, i, a]
        of.A[c, Q * k + a], of.A[c, Q * k + 3 + a] = along, turned
    for b in range(2):
        moved = 0.0
        for i in range(3):
            moved += of.by[u, i] * of.by_xy[k, i, b]
        of.G[c, 2 * k + b] = moved


@inlined
def _condition(
    row: int, first: int, m: int, at: Measured, stations: Stations, water: Water, of: Conditions
) -> None:
    """Set misclosure and partials of a condition of a point: those of coplanarity come first."""
    for a in range(Q * m):
        of.A[row, a] = 0.0
    for b in range(2 * m):
        of.G[row, b] = 0.0
    flat = row < m - 1
    ray = row if flat else row - m + 1
    of.w[row] = _coplanarity(ray, of) if flat else _scale_restraint(ray, of)
    for side in range(2 if flat else 3):
        w = water.row[first + ray + side]
        if w >= 0:
            _back_into_air(w, ray + side, side, water, of)
        _enter(row, at.photo[first + ray + side], ray + side, side, stations, of)


@inlined
def _rays_of(row: int, m: int) -> tuple[int, int]:
    """Return the first ray of a condition, and the one after its last."""
    return (row, row + 2) if row < m - 1 else (row - m + 1, row - m + 4)


@inlined
def _rays_up_to(row: int, m: int) -> int:
    """Return how many of the first rays the conditions up to one have: those of coplanarity come in their order."""
    return row + 2 if row < m - 1 else m


@inlined
def _weigh(first: int, m: int, at: Measured, of: Conditions) -> None:
    """Set S = G Q G', add what the images differ by to the misclosures w, and scale all to a diagonal of 1."""
    c = 2 * m - 3
    for row in range(c):
        low, high = _rays_of(row, m)
        for k in range(low, high):
            for b in range(2):
                of.w[row] += of.G[row, 2 * k + b] * (at.xy[first + k, b] - of.xy[k, b])
        for column in range(row + 1):
            total = 0.0
            of_column, end = _rays_of(column, m)
            for k in range(max(low, of_column), min(high, end)):
                for b in range(2):
                    total += of.G[row, 2 * k + b] * of.G[column, 2 * k + b] * of.cofactor[k, b]
            of.S[row, column] = total
    for row in range(c):
        scale = 1.0 / math.sqrt(of.S[row, row])
        of.w[row] *= scale
        low, high = _rays_of(row, m)
        for a in range(Q * low, Q * high):
            of.A[row, a] *= scale
        for column in range(row + 1):
            of.S[row, column] *= scale
        for other in range(row, c):
            of.S[other, row] *= scale


@inlined
def _solve(m: int, matrix: bool, of: Conditions) -> None:
    """Replace S by its Cholesky factor L, A by L^-1 A and w by L^-1 w; without `matrix` w alone, by S^-1 w."""
    c = 2 * m - 3
    for i in range(c):
        for j in range(i + 1):
            total = of.S[i, j]
            for k in range(j):
                total -= of.S[i, k] * of.S[j, k]
            of.S[i, j] = math.sqrt(total) if i == j else total / of.S[j, j]
        for k in range(i):
            factor = of.S[i, k]
            of.w[i] -= factor * of.w[k]
            for a in range(Q * _rays_up_to(k, m) if matrix else 0):
                of.A[i, a] -= factor * of.A[k, a]
        inverse = 1.0 / of.S[i, i]
        of.w[i] *= inverse
        for a in range(Q * _rays_up_to(i, m) if matrix else 0):
            of.A[i, a] *= inverse
    for i in range(0 if matrix else c):
        row = c - 1 - i
        for k in range(row + 1, c):
            of.w[row] -= of.S[k, row] * of.w[k]
        of.w[row] /= of.S[row, row]


@inlined
def _add(p: int, m: int, at: Measured, of: Conditions, sums: Sums) -> None:
    """Add -A'w of a point to the right sides."""
    for k in range(m):
        n = at.photo[at.start[p] + k]
        for c in range(max(k - 1, 0), 2 * m - 3):
            for a in range(Q):
                sums.rhs[n, a] -= of.A[c, Q * k + a] * of.w[c]


@inlined
def _add_blocks(p: int, m: int, pairs: Pairs, of: Conditions, sums: Sums) -> None:
    """Add A'A of a point to the normal matrix."""
    pair, count = pairs.start[p], 2 * m - 3
    for k in range(m):
        for other in range(k, m):
            e = pairs.slot[pair] - sums.first
            pair += 1
            for a in range(Q):
                s0 = s1 = s2 = s3 = s4 = s5 = 0.0
                for c in range(max(other - 1, 0), count):
                    value = of.A[c, Q * k + a]
                    s0, s1 = s0 + value * of.A[c, Q * other], s1 + value * of.A[c, Q * other + 1]
                    s2, s3 = s2 + value * of.A[c, Q * other + 2], s3 + value * of.A[c, Q * other + 3]
                    s4, s5 = s4 + value * of.A[c, Q * other + 4], s5 + value * of.A[c, Q * other + 5]
                sums.blocks[e, a, 0] += s0
                sums.blocks[e, a, 1] += s1
                sums.blocks[e, a, 2] += s2
                sums.blocks[e, a, 3] += s3
                sums.blocks[e, a, 4] += s4
                sums.blocks[e, a, 5] += s5


@compiled
def add_conditions(
    rows: IntArray, at: Measured, stations: Stations, water: Water, pairs: Pairs, matrix: bool, sums: Sums
) -> None:
    """Add the conditions of points, linearised at their adjusted images, with full weights.

    g + A dx + G v = 0 has the normal equations A'(G Q G')^-1 A: `pass_points.add_full`; without `matrix` the right
    sides only.
    """
    of = _room(at.start, rows)
    for p in rows:
        first, m = at.start[p], at.start[p + 1] - at.start[p]
        for k in range(m):
            _ray(p, first + k, k, at, stations, water, of)
        for k in range(m - 1):
            for i in range(3):
                of.B[k, i] = of.P[k + 1, i] - of.P[k, i]
        for row in range(2 * m - 3):
            _condition(row, first, m, at, stations, water, of)
        _weigh(first, m, at, of)
        _solve(m, matrix, of)
        _add(p, m, at, of, sums)
        if matrix:
            _add_blocks(p, m, pairs, of, sums)


@inlined
def _sink(p: int, at: Measured, water: Water, change: FloatArray) -> None:
    """Change the depths of a point below the water of its rays by its movement (3,)."""
    for r in range(at.start[p], at.start[p + 1]):
        w = water.row[r]
        if w >= 0:
            for i in range(3):
                water.depth[w] -= water.normal[w, i] * change[i]


@compiled
def settle(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, steps: int,
    limit: float, rounding: float, squares: FloatArray, left: FloatArray,
) -> None:  # fmt: skip
    """Take points of which nothing is known to the optimum of their images, in `at.ground`: `ground.settle_group`.

    Sets their weighted squares, rows of (g,), and by how much (k,) these were still to fall by the last step. The
    water over them stays the plane that it is where they start: `water.depth` becomes that of where they come to.
    """
    room, best, step, change = room_for(at.start, rows), np.empty(3), np.empty(3), np.empty(3)
    for p in rows:
        least, gain, fall, tried, g = np.inf, 0.0, 0.0, 0, at.point[p]
        step[0], step[1], step[2] = 0.0, 0.0, 0.0
        while tried < steps:
            objective = point_normals(p, at, stations, water, known, ridge, False, room)
            x, y, z = times(room.inverse, room.rhs)
            worse = least < np.inf and not objective <= least * (1.0 + rounding) + rounding
            if worse:
                x, y, z, gain = 0.5 * step[0], 0.5 * step[1], 0.5 * step[2], 0.0
            else:
                least, fall = objective, room.rhs[0] * x + room.rhs[1] * y + room.rhs[2] * z
                gain = fall
            step[0], step[1], step[2] = x, y, z
            for i in range(3):
                best[i] = best[i] if worse else at.ground[g, i]
                change[i] = best[i] + step[i] - at.ground[g, i]
                at.ground[g, i] = best[i] + step[i]
            _sink(p, at, water, change)
            tried = steps if max(abs(x), abs(y), abs(z)) < limit else tried + 1
        squares[g] = max(least - gain, 0.0)
        left[p] = fall
