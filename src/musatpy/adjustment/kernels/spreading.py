"""How errors spread to points and their images, one after the other."""

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
    cross,
    point_normals,
    room_for,
)
from musatpy.adjustment.kernels.points import Q as SIZE
from musatpy.arrays import FloatArray, IntArray
from musatpy.compiling import compiled, inlined


class Spread(NamedTuple):
    """How errors spread to k points and their r images."""

    rays: IntArray  # (r,) rows of the images
    axes: FloatArray  # (k, 3, 3) along which the points are told
    point: FloatArray  # (k, 3, 3) cofactors of the points
    image: FloatArray  # (d, 2) cofactors of the adjusted images
    covariance: FloatArray  # (d, 2, 3) of the positions and the adjusted images
    diagonal: FloatArray  # (n, q) of the normal equations before points are eliminated, to which is added


@inlined
def _of_stations(p: int, m: int, size: int, pairs: Pairs, Q: FloatArray, F: FloatArray, G: FloatArray) -> None:
    """Set G (m, 3, size) = F Q_ss of the stations of a point."""
    pair = pairs.start[p]
    for k in range(m):
        for i in range(3):
            for a in range(size):
                G[k, i, a] = 0.0
    for k in range(m):
        for other in range(k, m):
            e = pairs.slot[pair]
            pair += 1
            for i in range(3):
                for a in range(size):
                    f, total = F[k, i, a], 0.0
                    for b in range(size):
                        G[other, i, b] += f * Q[e, a, b]
                        total += Q[e, a, b] * F[other, i, b]
                    G[k, i, a] += total if other > k else 0.0


@inlined
def _set_point(p: int, m: int, size: int, G: FloatArray, room: Room, out: Spread) -> None:
    """Set N to the cofactors of a point along working axes, and those along its own."""
    for i in range(3):
        for j in range(3):
            total = room.inverse[i, j]
            for k in range(m):
                for a in range(size):
                    total += G[k, i, a] * room.F[k, j, a]
            room.N[i, j] = total
    for i in range(3):
        for j in range(3):
            total = 0.0
            for a in range(3):
                for b in range(3):
                    total += out.axes[p, i, a] * room.N[a, b] * out.axes[p, j, b]
            out.point[p, i, j] = total


@inlined
def _set_images(
    p: int, m: int, size: int, at: Measured, pairs: Pairs, Q: FloatArray, G: FloatArray, room: Room, out: Spread
) -> None:
    """Set the cofactors of the images of a point, and of these with its position."""
    pair = pairs.start[p]
    for k in range(m):
        r, e = at.start[p] + k, pairs.slot[pair]
        n = at.photo[r]
        pair += m - k
        for c in range(2):
            total, root = 0.0, 1.0 / math.sqrt(at.weight[r, c])
            for a in range(size):
                out.diagonal[n, a] += room.A[k, c, a] * room.A[k, c, a]
                of_row = 0.0
                for b in range(size):
                    of_row += Q[e, a, b] * room.A[k, c, b]
                total += room.A[k, c, a] * of_row
            for i in range(3):
                by_station, by_point = 0.0, 0.0
                for a in range(size):
                    by_station += room.A[k, c, a] * G[k, i, a]
                for j in range(3):
                    by_point += room.B[k, c, j] * room.N[j, i]
                total += room.B[k, c, i] * (by_point - 2.0 * by_station)
                room.vector[i] = (by_point - by_station) * root
            row = out.rays[r]
            out.image[row, c] = total * root * root
            for i in range(3):
                out.covariance[row, c, i] = (
                    out.axes[p, i, 0] * room.vector[0]
                    + out.axes[p, i, 1] * room.vector[1]
                    + out.axes[p, i, 2] * room.vector[2]
                )


@inlined
def _set(
    p: int, size: int, at: Measured, pairs: Pairs, Q: FloatArray, G: FloatArray, room: Room, out: Spread
) -> None:
    """Set the cofactors of a point and of its images, its stations of `size` unknowns each."""
    m = at.start[p + 1] - at.start[p]
    cross(m, size, room)
    _of_stations(p, m, size, pairs, Q, room.F, G)
    _set_point(p, m, size, G, room, out)
    _set_images(p, m, size, at, pairs, Q, G, room, out)


@compiled
def spread(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, pairs: Pairs,
    Q: FloatArray, out: Spread,
) -> None:  # fmt: skip
    """Set the cofactors of points of which nothing is known, and of their images; Q (e, q, q) is of the stations.

    `propagation.point_covariances`, Q_xx = N_pp^-1 + F Q_ss F', and `reliability.images`: with partials a by the
    stations and b by the point, (a - b F) Q_ss (a - b F)' + b N_pp^-1 b' = a Q a' - 2 a Q F' b' + b Q_xx b'.
    """
    room = room_for(at.start, rows)
    G = np.empty_like(room.F)
    for p in rows:
        point_normals(p, at, stations, water, known, ridge, True, room)
        if len(water.rise):
            _set(p, LEVELS, at, pairs, Q, G, room, out)
        else:
            _set(p, SIZE, at, pairs, Q, G, room, out)
