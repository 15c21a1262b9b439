"""The states that points near the water can have, and the best of them: which of their rays are wet.

Rays of lower tides dry first: state j of a point has those of its j lowest tides dry, and agrees with where the
point then stands if that is not below tide j, but below tide j + 1. Where each point has one tide, its rays dry
together. Where state j - 1 takes the point over tide j and state j takes it back under, the sum of squares has a
minimum on that water line, at the kink of its images.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from musatpy.adjustment.lone_points import LocalNormals, LonePoints
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
class Present:
    """The normals of k points in the states that they have, and the cofactors (k, u, u) of all their unknowns."""

    normals: LocalNormals
    cofactors: FloatArray

    def following(self, row: IntArray, other: LocalNormals) -> tuple[FloatArray, FloatArray]:
        """Return by how much squares fall and heights rise (t,) where stations follow points `row` (t,) to others.

        With N' = N + dN and the right side dr that is left of an adjustment at its minimum, the step is N'^-1 dr,
        and the sum of squares falls by dr' N'^-1 dr; of N'^-1 only the part of the point is needed,
        (I + Q dN)^-1 Q.
        """
        Q, dr = self.cofactors[row], (other.rhs - self.normals.rhs[row])[..., None]
        change = np.eye(Q.shape[1]) + Q @ (other.matrix - self.normals.matrix[row])
        step = np.linalg.solve(change, Q @ dr)[..., 0]
        return np.sum(dr[..., 0] * step, axis=1), np.sum(other.rise * step, axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class States:
    """The states of k points with m rays and T tides, with the points at rest in each, at stations as they are."""

    lone: LonePoints
    network: Network
    row: IntArray  # (k,) of the group of `lone`
    rank: IntArray  # (k, m) of the tides of rays
    tide: FloatArray  # (k, T) ascending
    start: FloatArray  # (k, 3) where the points are
    X: FloatArray  # (k, T + 1, 3)
    squares: FloatArray  # (k, T + 1)

    @classmethod
    def of(cls, network: Network, state: State, group: PointGroup) -> States:
        """Return those of the points of a group; `network` is the measured one."""
        start, points = state.ground[group.point], LonePoints(network=network, state=state, group=group)
        tides = water_over(network, state, group, start)
        rank, tide = np.zeros(tides.shape, dtype=int), tides[:, :1]
        if (tides != tide).any():
            rank = np.argsort(np.argsort(tides, axis=1, kind="stable"), axis=1, kind="stable")
            tide = np.sort(tides, axis=1)
        k, T = tide.shape
        row, number = np.repeat(np.arange(k), T + 1), np.tile(np.arange(T + 1), k)
        X, squares = points.settled(row, rank[row] >= number[:, None], start[row])
        return cls(
            lone=points,
            network=network,
            row=np.arange(k),
            rank=rank,
            tide=tide,
            start=start,
            X=X.reshape(k, T + 1, 3),
            squares=squares.reshape(k, T + 1),
        )

    def part(self, chosen: BoolArray) -> States:
        """Return those of some of the points."""
        arrays = {one.name: getattr(self, one.name)[chosen] for one in fields(self)[2:]}
        return replace(self, **arrays)

    def present(
        self, group: PointGroup, wet: BoolArray, level: FloatArray, cofactors: Cofactors | Factor
    ) -> Present:
        """Return the normals of the points, those of `group`, as rays are `wet` (k, m) and points held.

        `cofactors` are those of the adjustment that has them so, at its minimum.
        """
        normals = self.lone.normals(self.row, wet, self.start, level)
        Q = cofactors.with_border(self.network.photo[group.rays], normals.columns)
        return Present(normals=normals, cofactors=Q)

    def best(self, present: Present | None = None) -> tuple[BoolArray, FloatArray]:
        """Return which rays (k, m) of the points are wet, and the water line (k,) that they are on, or NaN.

        The least squares count, of the states that agree with where the points then stand, and of the water lines
        between states that do not. Stations stay as they are; with `present` they follow each point.
        """
        (k, T), frame = self.tide.shape, self.network.frame
        squares, height = np.full((k, 2 * T + 1), np.inf), frame.height(self.X)
        squares[:, ::2] = self.squares
        if present is not None:
            row, number = np.repeat(np.arange(k), T + 1), np.tile(np.arange(T + 1), k)
            fall, rise = self._following(present, row, self.rank[row] >= number[:, None], self.X.reshape(-1, 3))
            squares[:, ::2] -= fall.reshape(k, -1)
            height = height + rise.reshape(k, -1)
        # under tide j in state j, and over it in state j - 1
        sunk, risen = height[:, 1:] < self.tide, height[:, :-1] >= self.tide
        squares[:, 2::2][sunk] = squares[:, :-1:2][risen] = np.inf
        row, number = np.nonzero(sunk & risen)
        if len(row):
            wet, level = self.rank[row] > number[:, None], self.tide[row, number]
            X, on_line = self.lone.settled(self.row[row], wet, self.start[row], level)
            if present is not None:
                on_line -= self._following(present, row, wet, X, level)[0]
            squares[row, 2 * number + 1] = on_line
        squares[~np.isfinite(squares)] = np.inf
        some = np.isfinite(squares).any(axis=1)
        best = np.where(some, np.argmin(squares, axis=1), 2 * np.sum(self.tide <= height[:, :1], axis=1))
        dry = (best + 1) // 2  # so many tides; on a water line its own is, as good as wet
        line = self.tide[np.arange(k), np.minimum(best // 2, T - 1)]
        return self.rank >= dry[:, None], np.where(best % 2 == 1, line, np.nan)

    def _following(
        self, present: Present, row: IntArray, wet: BoolArray, X: FloatArray, level: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        level = np.full(len(row), np.nan) if level is None else level
        return present.following(row, self.lone.normals(self.row[row], wet, X, level))
