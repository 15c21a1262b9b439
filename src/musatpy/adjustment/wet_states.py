"""The states that points near the water can have, and the best of them: which of their rays are wet.

Of m rays those of lower tides dry first: state j of a point has those of its j lowest tides dry, and agrees with
where the point then stands if that is not below tide j, but below tide j + 1. Where state j - 1 takes the point
over tide j and state j takes it back under, the sum of squares has a minimum on that water line, at the kink of
its images.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.collinear import eliminate, local_normals
from musatpy.adjustment.ground import hold, settle_group
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import Cofactors, Factor
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_surface import water_heights
from musatpy.arrays import BoolArray, FloatArray, IntArray


def water_over(network: Network, state: State, group: PointGroup, X: FloatArray) -> FloatArray:
    """Return the heights (k, m) of the water over points X (k, 3) at the photos of their rays."""
    tide = state.tide[network.photo[group.rays]]
    return water_heights(network.slope(state.tilt), tide, np.repeat(X[:, None], tide.shape[1], axis=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Local:
    """The reduced normals of k points, each for itself, in the state that they have, and the cofactors of all."""

    matrix: FloatArray  # (k, u, u)
    rhs: FloatArray  # (k, u)
    cofactors: FloatArray  # (k, u, u)

    def part(self, rows: BoolArray | IntArray) -> Local:
        """Return some of the points."""
        return Local(matrix=self.matrix[rows], rhs=self.rhs[rows], cofactors=self.cofactors[rows])


def best_states(
    network: Network, present: Network, state: State, group: PointGroup, cofactors: Cofactors | Factor | None
) -> tuple[BoolArray, FloatArray]:
    """Return which rays (k, m) of the points of a group are wet, and the water line (k,) that they are on, or NaN.

    The least squares count, of the states that agree with where the points then stand, and of the water lines
    between states that do not. `network` is the measured one, `present` has the points in their states. Stations
    stay as they are; with `cofactors`, those of `present` at its minimum, they follow each point.
    """
    X = state.ground[group.point]
    tides = water_over(network, state, group, X)
    rank = np.argsort(np.argsort(tides, axis=1, kind="stable"), axis=1, kind="stable")
    k, m = tides.shape
    local = None if cofactors is None else _local(present, state, group, X, cofactors)
    squares, height = np.full((2 * m + 1, k), np.inf), np.zeros((m + 1, k))
    row = np.tile(np.arange(k), m + 1)
    tries = group.part(row)
    every_state, tries = network.apart(
        tries, network.xy[tries.rays], np.concatenate([rank >= j for j in range(m + 1)])
    )
    found = _tried(every_state, state, tries, X[row], None if local is None else local.part(row))
    squares[::2], height[:] = (values.reshape(m + 1, k) for values in found)
    tide = np.sort(tides, axis=1).T
    sunk, risen = height[1:] < tide, height[:-1] >= tide  # under tide j in state j, and over it in state j - 1
    squares[2::2][sunk] = squares[:-1:2][risen] = np.inf
    for j in range(m):
        kink = sunk[j] & risen[j]
        if kink.any():
            part = replace(group.part(kink), known=True)
            on_tide, part = network.apart(part, network.xy[part.rays], rank[kink] > j)
            held = on_tide.with_heights_held(tide[j, kink])
            of_part = None if local is None else local.part(kink)
            start = hold(held, part.point, X[kink])
            squares[2 * j + 1, kink], _ = _tried(held, state, part, start, of_part)
    squares[~np.isfinite(squares)] = np.inf
    best = np.where(
        np.isfinite(squares).any(axis=0), np.argmin(squares, axis=0), 2 * np.sum(tide <= height[0], axis=0)
    )
    on_line = best % 2 == 1
    dry = (best + 1) // 2  # so many rays; on a water line its own is, as good as wet
    level = np.where(on_line, np.take_along_axis(tide, np.minimum(best // 2, m - 1)[None], 0)[0], np.nan)
    return rank >= dry[:, None], level


def _local(
    network: Network, state: State, group: PointGroup, X: FloatArray, cofactors: Cofactors | Factor
) -> Local:
    E = eliminate(network, state, replace(group, known=True), X)
    matrix, rhs = local_normals(network, group, E)
    Q = cofactors.with_border(network.photo[group.rays], E.extras.index)
    return Local(matrix=matrix, rhs=rhs, cofactors=Q)


def _tried(
    network: Network, state: State, group: PointGroup, start: FloatArray, local: Local | None
) -> tuple[FloatArray, FloatArray]:
    """Return the weighted squares (k,) with the points of a group at their best in `network`, and their heights.

    With `local`, their present normals, after a step of the stations that they make with those of `network`: with
    N' = N + dN and the right side dr that is left of an adjustment at its minimum, the step is N'^-1 dr and the sum
    of squares falls by dr' N'^-1 dr; of N'^-1 only the part of the point is needed, (I + Q dN)^-1 Q.
    """
    X, squares = settle_group(network, state, group, start)
    height = network.frame.height(X)
    if local is None:
        return squares, height
    E = eliminate(network, state, replace(group, known=True), X)
    matrix, rhs = local_normals(network, group, E)
    Q, dr = local.cofactors, (rhs - local.rhs)[..., None]
    step = np.linalg.solve(np.eye(Q.shape[1]) + Q @ (matrix - local.matrix), Q @ dr)[..., 0]
    up = np.einsum("kij,kj->ki", E.normals.axes, network.frame.axes(X)[:, 2])
    return squares - np.sum(dr[..., 0] * step, axis=1), height - np.einsum("ki,kiu,ku->k", up, E.F, step)
