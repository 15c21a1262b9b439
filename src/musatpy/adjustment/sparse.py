"""Sparse symmetric systems of square blocks: Cholesky factor, solution and selected inverse.

Two blocks (photos) meet in the normal matrix where an observation has both. The matrix is factorised front by
front, from the leaves of a nested dissection to its root, each front a small dense matrix (the multifrontal method
of Duff and Reid, 1983), of which LAPACK works at the lower half. The elements of the inverse inside the pattern
follow from root to leaves without any others (Takahashi 1973). No matrix of the size of the system is ever formed.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError

from musatpy.adjustment.dense import Columns
from musatpy.adjustment.dissection import Front, Runs
from musatpy.adjustment.pattern import Pattern
from musatpy.adjustment.threads import side_by_side
from musatpy.arrays import FloatArray, IntArray, order_of

_LIGHT = 2  # unknowns of as much work as a ray: fronts wait for one another where they are small


@dataclass(frozen=True, kw_only=True, eq=False)
class SparseFactor:
    """Cholesky factor: the own columns of every front."""

    pattern: Pattern
    columns: list[Columns]

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Return N^-1 rhs, (v * size,) or (v * size, r)."""
        elimination, given = self.pattern.elimination, np.asarray(rhs, dtype=float)
        x = np.ascontiguousarray(given.reshape(len(given), -1)[elimination.order])
        fronts = list(zip(elimination.fronts, self.columns, strict=True))
        for front, L in fronts:
            x[front.boundary] -= L.forward(x[front.own])
        for front, L in reversed(fronts):
            L.backward(x[front.own], x[front.boundary])
        out = np.empty_like(given)
        out[elimination.order] = x.reshape(given.shape)
        return out

    def cofactors_of(self, blocks: IntArray, partials: FloatArray) -> FloatArray:
        """Return A N^-1 A' (k, o, o), A (k, o, b size) the partials of o functions of blocks (k, b).

        The blocks of a row meet one another. These are products of columns of L^-1 A', zero but for the fronts from
        those of their blocks to the root, which of blocks that meet lie on one way.
        """
        fronts = self.pattern.elimination.fronts
        rows = np.argsort(self.pattern.elimination.order)[self.pattern.rows(blocks)]
        lowest = np.searchsorted([front.own.start for front in fronts], rows.min(axis=1), side="right") - 1
        order, out = order_of(lowest), np.zeros((*partials.shape[:2], partials.shape[1]))
        for some in np.split(order, np.flatnonzero(np.diff(lowest[order])) + 1) if len(order) else ():
            x = np.zeros((self.pattern.order, len(some), partials.shape[1]))  # of what is not touched there is none
            x[rows[some], np.arange(len(some))[:, None]] = np.swapaxes(partials[some], 1, 2)
            columns, number = x.reshape(len(x), -1), int(lowest[some[0]])
            while number >= 0:
                front, own = fronts[number], x[fronts[number].own]
                columns[front.boundary] -= self.columns[number].forward(columns[front.own])
                out[some] += own.transpose(1, 2, 0) @ own.transpose(1, 0, 2)
                number = front.parent
        return out

    def selected_inverse(self) -> FloatArray:
        """Return the blocks (e, size, size) of N^-1 of all pairs of the pattern."""
        elimination, size = self.pattern.elimination, self.pattern.size
        out = np.empty((len(self.pattern.pairs), size, size))
        inverses: dict[int, FloatArray] = {}  # upper halves, of fronts that know that of their boundaries

        def invert(numbers: range) -> None:
            for i in reversed(numbers):
                front = elimination.fronts[i]
                Z = inverses.pop(i) if front.parent >= 0 else np.empty((front.shape[0], front.shape[0]))
                self.columns[i].invert(Z.T)
                blocks = Z[: front.shape[0]].reshape(-1, size)[front.rows]
                blocks[front.turned] = np.swapaxes(blocks[front.turned], 1, 2)
                out[front.pairs] = blocks
                for child, runs in front.children.items():
                    inverses[child] = _handed_down(Z, runs, elimination.fronts[child])

        for stage in reversed(elimination.stages):
            deque(side_by_side(invert, stage, self.pattern.order // _LIGHT), maxlen=0)
        i, j = np.triu_indices(size, 1)
        out[self.pattern.diagonal[:, None], j, i] = out[self.pattern.diagonal[:, None], i, j]
        return out


def factorise(pattern: Pattern, values: FloatArray) -> SparseFactor:
    """Return the factor of the matrix with blocks `values` (e, size, size), the same whatever the threads.

    Raises `LinAlgError` where it is not positive definite.
    """
    elimination = pattern.elimination
    columns: dict[int, Columns] = {}
    updates: dict[int, FloatArray] = {}  # upper halves of what fronts leave

    def eliminate(numbers: range) -> None:
        for i in numbers:
            front, (p, left) = elimination.fronts[i], elimination.fronts[i].shape
            own, update, entering = np.zeros((p, p + left)), np.zeros((left, left)), values[front.pairs]
            entering[front.turned] = np.swapaxes(entering[front.turned], 1, 2)
            own.reshape(-1, pattern.size)[front.rows] = entering
            for child, runs in front.children.items():
                _add_update(updates.pop(child), runs, own, update)
            columns[i] = Columns(own.T)
            if not columns[i].eliminate(update.T):
                raise LinAlgError("the matrix is not positive definite")
            updates[i] = update

    for stage in elimination.stages:
        deque(side_by_side(eliminate, stage, pattern.order // _LIGHT), maxlen=0)
    return SparseFactor(pattern=pattern, columns=[columns[i] for i in range(len(columns))])


def _add_update(update: FloatArray, runs: Runs, own: FloatArray, left: FloatArray) -> None:
    """Add what a child leaves to the rows of its parent: to its own, and to those that it leaves."""
    for number, (first, last, at) in enumerate(runs):
        rows, offset = (own, 0) if at < len(own) else (left, len(own))
        for start, end, to in runs[number:]:
            place = rows[at - offset : at - offset + last - first, to - offset : to - offset + end - start]
            place += update[first:last, start:end]


def _handed_down(above: FloatArray, runs: Runs, child: Front) -> FloatArray:
    """Return the inverse of a child, of which its parent knows that of the boundary."""
    p, left = child.shape
    inverse = np.empty((p + left, p + left))
    for number, (first, last, at) in enumerate(runs):
        for start, end, to in runs[number:]:
            known = above[at : at + last - first, to : to + end - start]
            inverse[p + first : p + last, p + start : p + end] = known
    return inverse
