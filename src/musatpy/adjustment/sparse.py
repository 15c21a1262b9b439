"""Sparse symmetric systems of square blocks: Cholesky factor, solution and selected inverse.

Two blocks (photos) meet in the normal matrix where an observation has both. The matrix is factorised front by
front, from the leaves of a nested dissection to its root, each front a small dense matrix (the multifrontal method
of Duff and Reid, 1983). The elements of the inverse inside the pattern follow from root to leaves without any
others (Takahashi 1973). No matrix of the size of the system is ever formed. Products are those of numpy, which lets
other threads run meanwhile, and so does LAPACK: pieces of work go side by side, their results in order.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from scipy.linalg.lapack import dtrtri

from musatpy.adjustment.pattern import Front, Pattern, Runs
from musatpy.arrays import FloatArray

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

_LIGHT = 2  # unknowns of as much work as a ray: fronts wait for one another where they are small
_MOST = 4  # threads: memory grows with them, and the adding up is done by one
_FEWEST = 3000  # rays: handing work to threads takes longer than working at less


@dataclass(frozen=True, kw_only=True, eq=False)
class FrontFactor:
    """What is left of a front with p unknowns of its own, N11 = L L', and b of its boundary."""

    inverse: FloatArray  # (p, p) L^-1
    cross: FloatArray  # (p, b) L^-1 N12


@dataclass(frozen=True, kw_only=True, eq=False)
class SparseFactor:
    """Cholesky factor, front by front."""

    pattern: Pattern
    fronts: list[FrontFactor]

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Return N^-1 rhs, (v * size,) or (v * size, r)."""
        elimination, given = self.pattern.elimination, np.asarray(rhs, dtype=float)
        x = np.ascontiguousarray(given.reshape(len(given), -1)[elimination.order])
        fronts = list(zip(elimination.fronts, self.fronts, strict=True))
        for front, factor in fronts:
            x[front.own] = factor.inverse @ x[front.own]
            x[front.boundary] -= factor.cross.T @ x[front.own]
        for front, factor in reversed(fronts):
            x[front.own] = factor.inverse.T @ (x[front.own] - factor.cross @ x[front.boundary])
        out = np.empty_like(given)
        out[elimination.order] = x.reshape(given.shape)
        return out

    def selected_inverse(self) -> FloatArray:
        """Return the blocks (e, size, size) of N^-1 of all pairs of the pattern."""
        elimination, size = self.pattern.elimination, self.pattern.size
        out = np.empty((len(self.pattern.pairs), size, size))
        inverses: dict[int, FloatArray] = {}  # of fronts that know that of their boundaries

        def invert(numbers: range) -> None:
            for i in reversed(numbers):
                front, factor, p = elimination.fronts[i], self.fronts[i], elimination.fronts[i].shape[0]
                Z = inverses.pop(i) if front.parent >= 0 else np.empty((p, p))
                W = factor.inverse.T @ factor.cross
                Z[:p, p:] = -W @ Z[p:, p:]
                Z[p:, :p] = Z[:p, p:].T
                Z[:p, :p] = factor.inverse.T @ factor.inverse - Z[:p, p:] @ W.T
                blocks = Z[:p].reshape(-1, size)[front.rows]
                blocks[front.turned] = np.swapaxes(blocks[front.turned], 1, 2)
                out[front.pairs] = blocks
                for child, runs in front.children.items():
                    inverses[child] = _handed_down(Z, runs, elimination.fronts[child])

        for stage in reversed(elimination.stages):
            deque(side_by_side(invert, stage, self.pattern.order // _LIGHT), maxlen=0)
        return out


def factorise(pattern: Pattern, values: FloatArray) -> SparseFactor:
    """Return the factor of the matrix with blocks `values` (e, size, size), the same whatever the threads.

    Raises `LinAlgError` where it is not positive definite.
    """
    elimination = pattern.elimination
    factors: dict[int, FrontFactor] = {}
    taken: dict[int, FloatArray] = {}  # upper halves of what fronts take from those of their boundaries

    def eliminate(numbers: range) -> None:
        for i in numbers:
            front, (p, left) = elimination.fronts[i], elimination.fronts[i].shape
            own, entering = np.zeros((p, p + left)), values[front.pairs]
            entering[front.turned] = np.swapaxes(entering[front.turned], 1, 2)
            for child, runs in front.children.items():
                _add_rows(taken[child], runs, own, 0)
            np.negative(own, out=own)
            own.reshape(-1, pattern.size)[front.rows] += entering
            upper, _ = dtrtri(np.linalg.cholesky(own[:, :p].T).T, lower=0)
            cross = upper.T @ own[:, p:]
            factors[i] = FrontFactor(inverse=upper.T, cross=cross)
            taken[i] = cross.T @ cross
            for child, runs in front.children.items():
                _add_rows(taken.pop(child), runs, taken[i], p)

    for stage in elimination.stages:
        deque(side_by_side(eliminate, stage, pattern.order // _LIGHT), maxlen=0)
    return SparseFactor(pattern=pattern, fronts=[factors[i] for i in range(len(factors))])


def _add_rows(taken: FloatArray, runs: Runs, rows: FloatArray, offset: int) -> None:
    """Add what a child has taken to some rows of its parent, with their columns from the same `offset` on."""
    for number, (first, last, at) in enumerate(runs):
        if offset <= at < offset + len(rows):
            for start, end, to in runs[number:]:
                place = rows[at - offset : at - offset + last - first, to - offset : to - offset + end - start]
                place += taken[first:last, start:end]


def _handed_down(above: FloatArray, runs: Runs, child: Front) -> FloatArray:
    """Return the inverse of a child, of which its parent knows that of the boundary."""
    p, left = child.shape
    inverse = np.empty((p + left, p + left))
    for first, last, at in runs:
        for start, end, to in runs:
            known = above[at : at + last - first, to : to + end - start]
            inverse[p + first : p + last, p + start : p + end] = known
    return inverse


Piece = TypeVar("Piece")
Result = TypeVar("Result")
_here = threading.local()


def side_by_side(work: Callable[[Piece], Result], pieces: Sequence[Piece], rays: int) -> Iterable[Result]:
    """Yield the results of `work` in the order of `pieces`, so that sums do not depend on the threads.

    `rays` says how much work there is in all of them; a little is done without threads, and so is what a piece
    itself would share. A few pieces are worked at ahead of the one that is asked for, no more: results may be
    large. What `work` raises is raised here, when nothing runs any more.
    """
    alone = len(pieces) <= 1 or rays < _FEWEST or getattr(_here, "is_worker", False)
    threads = 1 if alone else min(_MOST, os.cpu_count() or 1)  # the system is asked, which takes 10 us
    if threads == 1:
        yield from map(work, pieces)
        return
    from concurrent.futures import wait  # small jobs do without

    pool, left = _pool(threads), iter(pieces)
    waiting = [pool.submit(work, piece) for piece in islice(left, threads + 2)]
    try:
        while waiting:
            yield waiting.pop(0).result()
            waiting += [pool.submit(work, piece) for piece in islice(left, 1)]
    finally:
        for future in waiting:
            future.cancel()
        wait(waiting)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Return the threads of this process, which wait from one call to the next: starting them takes time."""
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(threads, thread_name_prefix="musatpy", initializer=_set_out)


def _set_out() -> None:
    _here.is_worker = True  # which must not wait for others


os.register_at_fork(after_in_child=_pool.cache_clear)  # threads stay with the parent
