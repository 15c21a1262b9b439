"""The images of points made linear, one point after the other, each following the stations."""

from __future__ import annotations

from typing import NamedTuple

from musatpy.adjustment.kernels.points import (
    LEVELS,
    Known,
    Measured,
    Room,
    Stations,
    Water,
    point_normals,
    room_for,
    times,
    weigh,
)
from musatpy.adjustment.kernels.points import Q as SIZE
from musatpy.arrays import FloatArray, IntArray
from musatpy.compiling import compiled, inlined


class LinearImages(NamedTuple):
    """The m images of each of k points, in their units, along working axes."""

    residual: FloatArray  # (k, 2m) adjusted minus observed, after a step of the stations
    partials: FloatArray  # (k, 2m, m q) by the stations, the point following
    ground: FloatArray  # (k, 2m, 3) by the point
    inverse: FloatArray  # (k, 3, 3) of the normal equations of the point


@inlined
def _set(k: int, p: int, size: int, at: Measured, step: FloatArray, room: Room, out: LinearImages) -> None:
    """Set row k of `out` to the images of point p, its stations of `size` unknowns each."""
    first = at.start[p]
    m = at.start[p + 1] - first
    weigh(m, room)
    shift = times(room.inverse, room.rhs)
    for ray in range(m):
        for c in range(2):
            row, sigma = 2 * ray + c, 1.0 / at.root[first + ray, c]
            b0, b1, b2 = room.B[ray, c, 0], room.B[ray, c, 1], room.B[ray, c, 2]
            v = room.residual[ray, c] + b0 * shift[0] + b1 * shift[1] + b2 * shift[2]
            for other in range(m):
                n, y = at.photo[first + other], room.Y[other]
                p0 = b0 * y[0, 0] + b1 * y[0, 1] + b2 * y[0, 2]
                p1 = b0 * y[1, 0] + b1 * y[1, 1] + b2 * y[1, 2]
                for a in range(size):
                    value = room.A[ray, c, a] if other == ray else 0.0
                    value -= p0 * room.A[other, 0, a] + p1 * room.A[other, 1, a]
                    v += value * step[n, a]
                    out.partials[k, row, other * size + a] = value * sigma
            out.residual[k, row] = v * sigma
            out.ground[k, row, 0], out.ground[k, row, 1], out.ground[k, row, 2] = b0 * sigma, b1 * sigma, b2 * sigma
    for i in range(3):
        for j in range(3):
            out.inverse[k, i, j] = room.inverse[i, j]


@compiled
def linear_images(
    rows: IntArray, at: Measured, stations: Stations, water: Water, known: Known, ridge: float, step: FloatArray,
    out: LinearImages,
) -> None:  # fmt: skip
    """Set the images of points of as many rays, of which nothing is known, after a step (n, q) of the stations.

    `reliability.image_partials`, and the residuals of `blunders.checks`.
    """
    room = room_for(at.start, rows)
    for k in range(len(rows)):
        p = rows[k]
        point_normals(p, at, stations, water, known, ridge, True, room)
        if len(water.rise):
            _set(k, p, LEVELS, at, step, room, out)
        else:
            _set(k, p, SIZE, at, step, room, out)
