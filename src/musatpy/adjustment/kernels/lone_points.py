"""What points say of their stations, each for itself.

The numpy twin is `lone_points.PlainLonePoints`.
"""

from __future__ import annotations

from musatpy.adjustment.kernels.points import (
    Known,
    Measured,
    Q,
    Stations,
    Water,
    point_normals,
    room_for,
    times,
    weigh,
)
from musatpy.arrays import FloatArray
from musatpy.compiling import compiled


@compiled
def set_normals(
    at: Measured, stations: Stations, water: Water, known: Known, ridge: float, up: FloatArray, matrix: FloatArray,
    rhs: FloatArray, rise: FloatArray,
) -> None:  # fmt: skip
    """Set the reduced normals (t, m q, m q) and (t, m q) of points, each by its own stations of six unknowns.

    `collinear.local_normals`: A'(I - B N_pp^-1 B')A, and how heights follow, -up' N_pp^-1 B'A (t, m q); up (t, 3).
    """
    room = room_for(at.start, at.point)
    for p in at.point:
        point_normals(p, at, stations, water, known, ridge, True, room)
        m, row, B, Y = at.start[p + 1] - at.start[p], known.row[p], room.B, room.Y
        weigh(m, room)
        x, y, z = times(room.inverse, room.rhs)
        room.vector[:] = up[p]
        if row >= 0:
            room.vector[0], room.vector[1], room.vector[2] = times(known.axes[row], up[p])
        for k in range(m):
            for a in range(Q):
                rhs[p, k * Q + a] = rise[p, k * Q + a] = 0.0
            for c in range(2):
                v = room.residual[k, c] + B[k, c, 0] * x + B[k, c, 1] * y + B[k, c, 2] * z
                upward = Y[k, c, 0] * room.vector[0] + Y[k, c, 1] * room.vector[1] + Y[k, c, 2] * room.vector[2]
                for a in range(Q):
                    rhs[p, k * Q + a] -= room.A[k, c, a] * v
                    rise[p, k * Q + a] -= room.A[k, c, a] * upward
            for other in range(m):
                for a in range(Q):
                    for b in range(Q):
                        matrix[p, k * Q + a, other * Q + b] = 0.0
                for c in range(2):
                    for d in range(2):
                        P = 1.0 if k == other and c == d else 0.0
                        P -= Y[k, c, 0] * B[other, d, 0] + Y[k, c, 1] * B[other, d, 1] + Y[k, c, 2] * B[other, d, 2]
                        for a in range(Q):
                            for b in range(Q):
                                matrix[p, k * Q + a, other * Q + b] += room.A[k, c, a] * P * room.A[other, d, b]
