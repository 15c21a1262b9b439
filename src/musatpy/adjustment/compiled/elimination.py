"""Points by collinearity, one after the other: images, partials, elimination and sums in one pass.

The numpy twins are `sightings.images`, `ground.point_normals`, `collinear.eliminate` and `collinear.reduced`, and
of single images `geometry.collinearity`, whose equations these loops follow. Points have no unknowns but their own
three and those of their stations: six or, with a water level of each, seven. What has more goes by the twins.

Every function works at some `rows` of points; where sums of several of them are added up is for who calls them, so
that threads can share the work.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.compiled.compiler import called, compiled, inlined
from musatpy.adjustment.compiled.rays import Measured, Stations, Water, bend, image_off, through_water, to_point
from musatpy.arrays import BoolArray, FloatArray, IntArray

Q = 6  # unknowns of a station in its images; those with a level of its own have one more


class Known(NamedTuple):
    """What is known of h points along axes of their own."""

    row: IntArray  # (k,) of the point among those, -1 where nothing is
    axes: FloatArray  # (h, 3, 3)
    free: BoolArray  # (h, 3) the component may move
    weight: FloatArray  # (h, 3) 1/m2
    pull: FloatArray  # (h, 3) 1/m, weights times known minus current


class Pairs(NamedTuple):
    """The blocks of the pairs of rays of k points: of p `start[p]` to `start[p + 1]`, as `triu_indices` has."""

    start: IntArray  # (k + 1,)
    slot: NDArray[np.int32]  # rows of the blocks of the pattern


class Sums(NamedTuple):
    """Normal equations of stations, to which points are added: the blocks from row `first` of the pattern on."""

    first: int
    blocks: FloatArray  # (e, q, q)
    rhs: FloatArray  # (n, q)


class Eliminated(NamedTuple):
    """What is left of the elimination of k points: dX = shift - N_pp^-1 N_ps ds, along their axes."""

    shift: FloatArray  # (k, 3)
    inverse: FloatArray  # (k, 3, 3) N_pp^-1


class Room(NamedTuple):
    """Room for one point with up to m rays."""

    A: FloatArray  # (m, 2, 7) weighted images by stations
    B: FloatArray  # (m, 2, 3) by the point
    residual: FloatArray  # (m, 2)
    Y: FloatArray  # (m, 2, 3) B N_pp^-1
    N: FloatArray  # (3, 3) N_pp
    inverse: FloatArray  # (3, 3)
    rhs: FloatArray  # (3,)
    vector: FloatArray  # (3,) from a station to what a wet ray goes to in air


@compiled
def room_for(start: IntArray, rows: IntArray) -> Room:
    """Return room for any point of some rows."""
    m = 1
    for p in rows:
        m = max(m, start[p + 1] - start[p])
    return Room(
        np.empty((m, 2, Q + 1)), np.empty((m, 2, 3)), np.empty((m, 2)),
        np.empty((m, 2, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3),
    )  # fmt: skip


@compiled
def find_pairs(start: IntArray, photo: IntArray, first: IntArray, second: IntArray, pairs: Pairs) -> None:
    """Set the rows of the pairs of the rays of points: `Pattern.find`.

    first (n + 1,): where the pairs of each photo with those after it begin, second (e,): their second photos.
    """
    at = 0
    for p in range(len(start) - 1):
        pairs.start[p] = at
        for k in range(start[p], start[p + 1]):
            for other in range(k, start[p + 1]):
                low, high = first[photo[k]], first[photo[k] + 1] - 1
                while low < high:
                    middle = (low + high) // 2
                    if second[middle] < photo[other]:
                        low = middle + 1
                    else:
                        high = middle
                pairs.slot[at] = low
                at += 1
    pairs.start[len(start) - 1] = at


@inlined
def _through(rows: FloatArray, by: FloatArray, out: FloatArray) -> None:
    """Set the rows out (2, 3) to the product of others with a matrix (3, 3)."""
    for c in range(2):
        x, y, z = rows[c, 0], rows[c, 1], rows[c, 2]
        for i in range(3):
            out[c, i] = x * by[0, i] + y * by[1, i] + z * by[2, i]


@inlined
def _along_known(axes: FloatArray, free: BoolArray, B: FloatArray) -> None:
    """Turn partials B (2, 3) by a point to its axes, zero by what is held: `ground.point_normals`."""
    _through(B, axes.T, B)
    for c in range(2):
        for i in range(3):
            if not free[i]:
                B[c, i] = 0.0


@inlined
def _image(r: int, k: int, at: Measured, stations: Stations, by_station: bool, room: Room) -> None:
    """Set the weighted residual of image r, ray k of its point, and its partials, `room.vector` what it goes to.

    `sightings.images`, `geometry.collinearity.image_partials`, with the derivatives of the rotation M by its angles
    in closed form: by omega of M v that of v x east, and so on.
    """
    n = at.photo[r]
    cosine, sine = stations.turn[n, 0], stations.turn[n, 1]
    v0, v1, v2 = room.vector[0], room.vector[1], room.vector[2]
    x = stations.M[n, 0, 0] * v0 + stations.M[n, 0, 1] * v1 + stations.M[n, 0, 2] * v2
    y = stations.M[n, 1, 0] * v0 + stations.M[n, 1, 1] * v1 + stations.M[n, 1, 2] * v2
    depth = stations.M[n, 2, 0] * v0 + stations.M[n, 2, 1] * v1 + stations.M[n, 2, 2] * v2
    inverse = 1.0 / depth
    scale, of_depth = -stations.focal_length[n] * inverse, cosine * x - sine * y
    turned0 = v1 * stations.axes[n, 0, 2] - v2 * stations.axes[n, 0, 1]  # v x east, about which omega turns
    turned1 = v2 * stations.axes[n, 0, 0] - v0 * stations.axes[n, 0, 2]
    turned2 = v0 * stations.axes[n, 0, 1] - v1 * stations.axes[n, 0, 0]
    for c in range(2):
        image = x if c == 0 else y
        root, ratio = at.root[r, c], image * inverse
        factor = scale * root
        room.residual[k, c] = (scale * image + stations.principal_point[n, c] - at.xy[r, c]) * root
        b0 = factor * (stations.M[n, c, 0] - ratio * stations.M[n, 2, 0])
        b1 = factor * (stations.M[n, c, 1] - ratio * stations.M[n, 2, 1])
        b2 = factor * (stations.M[n, c, 2] - ratio * stations.M[n, 2, 2])
        room.B[k, c, 0], room.B[k, c, 1], room.B[k, c, 2] = b0, b1, b2
        if by_station:
            room.A[k, c, 3] = b0 * turned0 + b1 * turned1 + b2 * turned2
            room.A[k, c, 4] = factor * ((sine if c else -cosine) * depth - ratio * of_depth)
            room.A[k, c, 5] = -factor * x if c else factor * y
            for i in range(3):
                along = b0 * stations.axes[n, i, 0] + b1 * stations.axes[n, i, 1] + b2 * stations.axes[n, i, 2]
                room.A[k, c, i] = -along


@called
def images(
    p: int, at: Measured, stations: Stations, water: Water, known: Known, by_station: bool, room: Room
) -> bool:
    """Set the weighted residuals and partials of the images of a point; return whether all cameras see it.

    The partials by the point are along the axes of what is known of it, zero by what is held.
    """
    seen, row = True, known.row[p]
    for r in range(at.start[p], at.start[p + 1]):
        n, k, w = at.photo[r], r - at.start[p], water.row[r]
        v0, v1, v2, in_front = to_point(r, p, at, stations)
        seen &= in_front
        if w >= 0:
            v0, v1, v2, e0, e1, e2, H, t = bend(w, water, v0, v1, v2)
        room.vector[0], room.vector[1], room.vector[2] = v0, v1, v2
        _image(r, k, at, stations, by_station, room)
        if w >= 0:
            through_water(w, water, e0, e1, e2, H, t, room.B[k], room.A[k], by_station)
            if by_station:
                _through(room.A[k], stations.axes[n].T, room.A[k])
        elif by_station and len(water.unknowns) > Q:
            room.A[k, 0, Q] = room.A[k, 1, Q] = 0.0
        if row >= 0:
            _along_known(known.axes[row], known.free[row], room.B[k])
    return seen


@inlined
def _inverted(N: FloatArray, out: FloatArray) -> None:
    """Set `out` to the inverse of a positive matrix N (3, 3), whose lower half counts, by its factors L D L'."""
    d0 = 1.0 / N[0, 0]
    l10, l20 = N[1, 0] * d0, N[2, 0] * d0
    d1 = 1.0 / (N[1, 1] - l10 * N[1, 0])
    rest = N[2, 1] - l20 * N[1, 0]
    l21 = rest * d1
    d2 = 1.0 / (N[2, 2] - l20 * N[2, 0] - l21 * rest)
    corner = l10 * l21 - l20  # of the inverse of L
    out[0, 0], out[1, 1], out[2, 2] = d0 + l10 * l10 * d1 + corner * corner * d2, d1 + l21 * l21 * d2, d2
    out[0, 1] = out[1, 0] = -l10 * d1 - corner * l21 * d2
    out[0, 2] = out[2, 0] = corner * d2
    out[1, 2] = out[2, 1] = -l21 * d2


@called
def point_normals(
    p: int, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, by_station: bool, room: Room
) -> float:
    """Set the normal equations N (3, 3), rhs (3,) of a point and N^-1; return the weighted squares of its images.

    Infinite where it is behind a camera. `ground.point_normals`; `ridge`: what the diagonal has beyond what is
    observed, of its largest. The images have partials by their stations only where asked for.
    """
    row = known.row[p]
    squares = 0.0 if images(p, at, stations, water, known, by_station, room) else np.inf
    n00 = n10 = n11 = n20 = n21 = n22 = b0 = b1 = b2 = 0.0
    for k in range(at.start[p + 1] - at.start[p]):
        for c in range(2):
            x, y, z, v = room.B[k, c, 0], room.B[k, c, 1], room.B[k, c, 2], room.residual[k, c]
            n00, n11, n22 = n00 + x * x, n11 + y * y, n22 + z * z
            n10, n20, n21 = n10 + y * x, n20 + z * x, n21 + z * y
            b0, b1, b2 = b0 - x * v, b1 - y * v, b2 - z * v
            squares += v * v
    room.N[0, 0], room.N[1, 1], room.N[2, 2] = n00, n11, n22
    room.N[1, 0], room.N[2, 0], room.N[2, 1] = n10, n20, n21
    room.rhs[0], room.rhs[1], room.rhs[2] = b0, b1, b2
    if row >= 0:
        for i in range(3):
            room.N[i, i] += known.weight[row, i] if known.free[row, i] else known.weight[row, i] + 1.0
            room.rhs[i] += known.pull[row, i]
    largest = max(room.N[0, 0], room.N[1, 1], room.N[2, 2])
    for i in range(3):
        room.N[i, i] += ridge * largest
    _inverted(room.N, room.inverse)
    return squares if squares < np.inf else np.inf


@inlined
def times(N: FloatArray, b: FloatArray) -> tuple[float, float, float]:
    """Return the product of a matrix (3, 3) and a vector (3,)."""
    return (
        N[0, 0] * b[0] + N[0, 1] * b[1] + N[0, 2] * b[2],
        N[1, 0] * b[0] + N[1, 1] * b[1] + N[1, 2] * b[2],
        N[2, 0] * b[0] + N[2, 1] * b[1] + N[2, 2] * b[2],
    )


@inlined
def from_axes(axes: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a vector along axes (3, 3) in those of the work."""
    return (
        axes[0, 0] * x + axes[1, 0] * y + axes[2, 0] * z,
        axes[0, 1] * x + axes[1, 1] * y + axes[2, 1] * z,
        axes[0, 2] * x + axes[1, 2] * y + axes[2, 2] * z,
    )


@inlined
def weigh(m: int, room: Room) -> None:
    """Set Y (m, 2, 3) = B N_pp^-1 of a point."""
    for k in range(m):
        for c in range(2):
            x, y, z = room.B[k, c, 0], room.B[k, c, 1], room.B[k, c, 2]
            for i in range(3):
                room.Y[k, c, i] = x * room.inverse[0, i] + y * room.inverse[1, i] + z * room.inverse[2, i]


@inlined
def _add_pair(
    e: int, k: int, other: int, size: int, p00: float, p01: float, p10: float, p11: float, A: FloatArray, sums: Sums
) -> None:
    """Add A'PA of two rays to block e of the normal matrix; P (2, 2) weighs images of one by those of the other."""
    for a in range(size):
        x, y = A[k, 0, a] * p00 + A[k, 1, a] * p10, A[k, 0, a] * p01 + A[k, 1, a] * p11
        for b in range(size):
            sums.blocks[e - sums.first, a, b] += x * A[other, 0, b] + y * A[other, 1, b]


@called
def _add_blocks(p: int, m: int, water: Water, pairs: Pairs, room: Room, sums: Sums) -> None:
    """Add a point to the reduced normal matrix of its stations, A'(I - Y B')A: `collinear.reduced`."""
    B, Y, size = room.B, room.Y, len(water.unknowns)
    pair = pairs.start[p]
    for k in range(m):
        for other in range(k, m):
            unit = 1.0 if other == k else 0.0
            p00 = unit - Y[k, 0, 0] * B[other, 0, 0] - Y[k, 0, 1] * B[other, 0, 1] - Y[k, 0, 2] * B[other, 0, 2]
            p01 = -Y[k, 0, 0] * B[other, 1, 0] - Y[k, 0, 1] * B[other, 1, 1] - Y[k, 0, 2] * B[other, 1, 2]
            p10 = -Y[k, 1, 0] * B[other, 0, 0] - Y[k, 1, 1] * B[other, 0, 1] - Y[k, 1, 2] * B[other, 0, 2]
            p11 = unit - Y[k, 1, 0] * B[other, 1, 0] - Y[k, 1, 1] * B[other, 1, 1] - Y[k, 1, 2] * B[other, 1, 2]
            _add_pair(pairs.slot[pair], k, other, size, p00, p01, p10, p11, room.A, sums)
            pair += 1


@called
def _add_right_sides(
    p: int, m: int, at: Measured, water: Water, room: Room, sums: Sums, x: float, y: float, z: float
) -> None:
    """Add a point, whose shift is (x, y, z), to the right sides of its stations."""
    for k in range(m):
        n = at.photo[at.start[p] + k]
        v0, v1 = room.residual[k, 0], room.residual[k, 1]
        v0 += room.B[k, 0, 0] * x + room.B[k, 0, 1] * y + room.B[k, 0, 2] * z
        v1 += room.B[k, 1, 0] * x + room.B[k, 1, 1] * y + room.B[k, 1, 2] * z
        for a in range(len(water.unknowns)):
            sums.rhs[n, a] -= room.A[k, 0, a] * v0 + room.A[k, 1, a] * v1


@compiled
def eliminate(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, pairs: Pairs,
    sums: Sums, out: Eliminated,
) -> float:  # fmt: skip
    """Add points to the normal equations of their stations, set how they follow, and return r' N_pp^-1 r of all.

    `collinear.eliminate` and `collinear.reduced`: N_ss - N_sp N_pp^-1 N_ps, point after point.
    """
    room, gain = room_for(at.start, rows), 0.0
    for p in rows:
        point_normals(p, at, stations, water, known, ridge, True, room)
        x, y, z = times(room.inverse, room.rhs)
        gain += x * room.rhs[0] + y * room.rhs[1] + z * room.rhs[2]
        out.shift[p, 0], out.shift[p, 1], out.shift[p, 2] = x, y, z
        for i in range(3):
            for j in range(3):
                out.inverse[p, i, j] = room.inverse[i, j]
        m = at.start[p + 1] - at.start[p]
        weigh(m, room)
        _add_right_sides(p, m, at, water, room, sums, x, y, z)
        _add_blocks(p, m, water, pairs, room, sums)
    return gain


@compiled
def follow(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, of: Eliminated, step: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Set where points are, rows of out (g, 3), after a step (n, q) of their stations: `collinear.GroupFollow`."""
    room = room_for(at.start, rows)
    for p in rows:
        for i in range(3):
            room.rhs[i] = 0.0
        row = known.row[p]
        images(p, at, stations, water, known, True, room)
        for r in range(at.start[p], at.start[p + 1]):
            n, k = at.photo[r], r - at.start[p]
            for c in range(2):
                change = 0.0
                for a in range(len(water.unknowns)):
                    change += room.A[k, c, a] * step[n, a]
                for i in range(3):
                    room.rhs[i] += room.B[k, c, i] * change
        x, y, z = of.shift[p, 0], of.shift[p, 1], of.shift[p, 2]
        for i in range(3):
            x -= of.inverse[p, 0, i] * room.rhs[i]
            y -= of.inverse[p, 1, i] * room.rhs[i]
            z -= of.inverse[p, 2, i] * room.rhs[i]
        g = at.point[p]
        if row >= 0:
            x, y, z = from_axes(known.axes[row], x, y, z)
        out[g, 0], out[g, 1], out[g, 2] = at.ground[p, 0] + x, at.ground[p, 1] + y, at.ground[p, 2] + z


@compiled
def steps(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, shift: FloatArray,
    squares: FloatArray, falls: FloatArray,
) -> None:  # fmt: skip
    """Set the steps (k, 3) of points to their best, and by how much their squares (k,) fall: `ground.settle_group`.

    The squares are those of the images, infinite behind a camera.
    """
    room = room_for(at.start, rows)
    for p in rows:
        squares[p] = point_normals(p, at, stations, water, known, ridge, False, room)
        x, y, z = times(room.inverse, room.rhs)
        falls[p] = x * room.rhs[0] + y * room.rhs[1] + z * room.rhs[2]
        if known.row[p] >= 0:
            x, y, z = from_axes(known.axes[known.row[p]], x, y, z)
        shift[p, 0], shift[p, 1], shift[p, 2] = x, y, z


@compiled
def residuals(
    rows: IntArray, at: Measured, stations: Stations, water: Water, out: FloatArray, squares: FloatArray
) -> None:
    """Set the residuals (r, 2) mm of the images of points, and their weighted squares (k,).

    These are infinite behind a camera. `sightings.residuals` and `ground.point_squares`.
    """
    for p in rows:
        total = 0.0
        for r in range(at.start[p], at.start[p + 1]):
            v0, v1, v2, seen = to_point(r, p, at, stations)
            if water.row[r] >= 0:
                v0, v1, v2, _, _, _, _, _ = bend(water.row[r], water, v0, v1, v2)
            x, y = image_off(r, at, stations, v0, v1, v2)
            out[r, 0], out[r, 1] = x, y
            x, y = x * at.root[r, 0], y * at.root[r, 1]
            total += x * x + y * y
            if not seen:
                total = np.inf
        squares[p] = total if total < np.inf else np.inf
