"""How errors spread to points and their images, one after the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from musatpy.adjustment.compiled.compiler import called, compiled, inlined
from musatpy.adjustment.compiled.elimination import Known, Pairs, Room, point_normals, room_for, weigh
from musatpy.adjustment.compiled.rays import Measured, Stations, Water
from musatpy.arrays import FloatArray, IntArray


class Images(NamedTuple):
    """Room for what up to m images of one point have of the errors of their stations."""

    C: FloatArray  # (m, 2, m, 2) cofactors, of pairs as `triu_indices` has them
    D: FloatArray  # (m, 2, 3) those with the position


@compiled
def room_for_images(m: int) -> Images:
    """Return room for those of a point with up to m rays."""
    return Images(np.empty((m, 2, m, 2)), np.empty((m, 2, 3)))


class Spread(NamedTuple):
    """How errors spread to k points and their r images."""

    axes: FloatArray  # (k, 3, 3) along which the points are told
    point: FloatArray  # (k, 3, 3) cofactors of the points
    image: FloatArray  # (r, 2) cofactors of the adjusted images
    covariance: FloatArray  # (r, 2, 3) of the positions and the adjusted images
    diagonal: FloatArray  # (n, q) of the normal equations before points are eliminated, to which is added


@called
def _of_stations(p: int, m: int, water: Water, pairs: Pairs, Q: FloatArray, room: Room, of: Images) -> None:
    """Set C = A Q A', cofactors of its images by their stations, and D = C Y."""
    pair, size, A, Y = pairs.start[p], len(water.unknowns), room.A, room.Y
    for k in range(m):
        for c in range(2):
            for i in range(3):
                of.D[k, c, i] = 0.0
    for k in range(m):
        for other in range(k, m):
            e = pairs.slot[pair]
            pair += 1
            c00 = c01 = c10 = c11 = 0.0
            for b in range(size):
                x = y = 0.0
                for a in range(size):
                    x += A[k, 0, a] * Q[e, a, b]
                    y += A[k, 1, a] * Q[e, a, b]
                c00, c01 = c00 + x * A[other, 0, b], c01 + x * A[other, 1, b]
                c10, c11 = c10 + y * A[other, 0, b], c11 + y * A[other, 1, b]
            for i in range(3):
                of.D[k, 0, i] += c00 * Y[other, 0, i] + c01 * Y[other, 1, i]
                of.D[k, 1, i] += c10 * Y[other, 0, i] + c11 * Y[other, 1, i]
            of.C[k, 0, other, 0], of.C[k, 0, other, 1] = c00, c01
            of.C[k, 1, other, 0], of.C[k, 1, other, 1] = c10, c11
            if other != k:
                for i in range(3):
                    of.D[other, 0, i] += c00 * Y[k, 0, i] + c10 * Y[k, 1, i]
                    of.D[other, 1, i] += c01 * Y[k, 0, i] + c11 * Y[k, 1, i]


@inlined
def _image(k: int, c: int, room: Room, of: Images) -> float:
    """Return the weighted cofactor of an image whose point has N; set `room.vector` to that with the position."""
    total = of.C[k, c, k, c]
    for i in range(3):
        by_station, by_point = of.D[k, c, i], 0.0
        for j in range(3):
            by_point += room.B[k, c, j] * room.N[j, i]
        total += room.B[k, c, i] * (by_point - 2.0 * by_station)
        room.vector[i] = by_point - by_station
    return total


@called
def _set_point(p: int, m: int, room: Room, of: Images, out: Spread) -> None:
    """Set N to the cofactors of a point along working axes, N_pp^-1 + Y' D, and those along its own."""
    for i in range(3):
        for j in range(3):
            total = room.inverse[i, j]
            for k in range(m):
                total += of.D[k, 0, i] * room.Y[k, 0, j] + of.D[k, 1, i] * room.Y[k, 1, j]
            room.N[i, j] = total
    for i in range(3):
        for j in range(3):
            total = 0.0
            for a in range(3):
                for b in range(3):
                    total += out.axes[p, i, a] * room.N[a, b] * out.axes[p, j, b]
            out.point[p, i, j] = total


@called
def _set_images(p: int, m: int, at: Measured, water: Water, room: Room, of: Images, out: Spread) -> None:
    """Set the cofactors of the images of a point, and of these with its position."""
    for k in range(m):
        r = at.start[p] + k
        n = at.photo[r]
        for a in range(len(water.unknowns)):
            out.diagonal[n, a] += room.A[k, 0, a] * room.A[k, 0, a] + room.A[k, 1, a] * room.A[k, 1, a]
        for c in range(2):
            root = 1.0 / at.root[r, c]
            out.image[r, c] = _image(k, c, room, of) * root * root
            x, y, z = room.vector[0] * root, room.vector[1] * root, room.vector[2] * root
            for i in range(3):
                out.covariance[r, c, i] = out.axes[p, i, 0] * x + out.axes[p, i, 1] * y + out.axes[p, i, 2] * z


@compiled
def spread(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, pairs: Pairs,
    Q: FloatArray, out: Spread,
) -> None:  # fmt: skip
    """Set the cofactors of points of which nothing is known, and of their images; Q (e, q, q) is of the stations.

    `propagation.point_covariances`, Q_xx = N_pp^-1 + F Q_ss F', and `reliability.images`: with partials A by the
    stations, B by the point and F = Y'A, (A - B F) Q_ss (A - B F)' + B N_pp^-1 B' = C - 2 D B' + B Q_xx B', where
    C = A Q_ss A' and D = C Y.
    """
    room = room_for(at.start, rows)
    of = room_for_images(len(room.Y))
    for p in rows:
        m = at.start[p + 1] - at.start[p]
        point_normals(p, at, stations, water, known, ridge, True, room)
        weigh(m, room)
        _of_stations(p, m, water, pairs, Q, room, of)
        _set_point(p, m, room, of, out)
        _set_images(p, m, at, water, room, of, out)
