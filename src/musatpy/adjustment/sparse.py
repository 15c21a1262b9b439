"""Sparse symmetric systems of square blocks: Cholesky factor, solution and selected inverse.

Two blocks (photos) meet in the normal matrix where an observation has both. The matrix is factorised front by
front, from the leaves of a nested dissection to its root, each front a small dense matrix (the multifrontal method
of Duff and Reid, 1983), of which LAPACK works at the lower half. The elements of the inverse inside the pattern
follow from root to leaves without any others (Takahashi 1973). No matrix of the size of the system is ever formed.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import blas, lapack

from musatpy.adjustment.ordering import Front, Graph, dissect, dissect_by_place, fronts_of
from musatpy.adjustment.threads import side_by_side
from musatpy.arrays import FloatArray, IntArray

_SHARES = 8  # of the work, which a subtree has one of at most: fewer are left unequal, more leave much above them


@dataclass(frozen=True, kw_only=True, eq=False)
class Runs:
    """How values (k, ...) with repeated rows are added up: sorted by row, and summed run by run."""

    order: IntArray  # (k,)
    rows: IntArray  # the different rows, ascending
    start: IntArray  # first of each in the order

    @classmethod
    def of(cls, rows: IntArray) -> Runs:
        """Return the runs of rows (k,)."""
        order = np.argsort(rows, kind="stable")
        different, start = np.unique(rows[order], return_index=True)
        return cls(order=order, rows=different, start=start)

    def sums(self, values: FloatArray) -> FloatArray:
        """Return the sums of values (k, ...) by row."""
        return np.add.reduceat(values[self.order], self.start, axis=0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pattern:
    """The blocks (i, j), i <= j, of a symmetric matrix of v x v blocks of `size` unknowns, diagonal included."""

    count: int  # v
    size: int
    pairs: IntArray  # (e, 2), ascending by i and j, every (i, i) among them
    place: FloatArray | None = None  # (v, 3) of the blocks, where who meets whom goes by places

    @classmethod
    def of(cls, count: int, size: int, cliques: Iterable[IntArray], place: FloatArray | None = None) -> Pattern:
        """Return the pattern in which the blocks of each row of the arrays `cliques` (k, m) meet one another."""
        keys = [np.arange(count) * (count + 1)]
        for clique in cliques:
            i, j = np.triu_indices(clique.shape[1], 1)
            low, high = np.minimum(clique[:, i], clique[:, j]), np.maximum(clique[:, i], clique[:, j])
            keys.append(np.unique(low * count + high))
        key = np.unique(np.concatenate(keys))
        return cls(count=count, size=size, pairs=np.stack(np.divmod(key, count), axis=1), place=place)

    @property
    def order(self) -> int:
        """Number of unknowns, rows of the matrix: v times size."""
        return self.count * self.size

    def rows(self, blocks: IntArray) -> IntArray:
        """Return the numbers (k, m size) of the unknowns of blocks (k, m)."""
        return (blocks[:, :, None] * self.size + np.arange(self.size)).reshape(len(blocks), -1)

    @cached_property
    def keys(self) -> IntArray:
        """(e,) ascending numbers of the pairs."""
        return self.pairs[:, 0] * self.count + self.pairs[:, 1]

    @cached_property
    def diagonal(self) -> IntArray:
        """(v,) rows of `pairs` of the blocks (i, i)."""
        return self.find(np.arange(self.count), np.arange(self.count))

    def find(self, i: IntArray, j: IntArray) -> IntArray:
        """Return the rows of `pairs` of blocks (i, j), i <= j. Every one must be there."""
        return np.searchsorted(self.keys, i * self.count + j)

    @cached_property
    def firsts(self) -> Runs:
        """How what pairs have adds to their first blocks: all of them, as each meets itself."""
        return Runs.of(self.pairs[:, 0])

    @cached_property
    def seconds(self) -> Runs:
        """How what pairs of two blocks have adds to the second ones; what those of one have is left."""
        apart = np.flatnonzero(self.pairs[:, 0] != self.pairs[:, 1])
        runs = Runs.of(self.pairs[apart, 1])
        return replace(runs, order=apart[runs.order])

    @cached_property
    def _runs(self) -> dict[tuple[int, bytes], tuple[Runs, Runs]]:
        return {}

    def runs(self, photo: IntArray) -> tuple[Runs, Runs]:
        """Return how points with photos (k, m) add to their pairs, in the order of `triu_indices`, and to photos.

        Every iteration adds the same points again: what was sorted once is kept.
        """
        key = (photo.shape[1], photo.tobytes())
        if key not in self._runs:
            i, j = np.triu_indices(photo.shape[1])
            pairs = self.find(photo[:, i], photo[:, j]).reshape(-1)
            self._runs[key] = (Runs.of(pairs), Runs.of(photo.reshape(-1)))
        return self._runs[key]

    def slots(self, photo: IntArray) -> IntArray:
        """Return the rows of `pairs` of points with photos (k, m): (k, m (m + 1)/2), ordered as `triu_indices`."""
        i, j = np.triu_indices(photo.shape[1])
        return self.find(photo[:, i], photo[:, j])

    @cached_property
    def graph(self) -> Graph:
        """Who meets whom."""
        off = self.pairs[self.pairs[:, 0] != self.pairs[:, 1]]
        ends = np.concatenate([off, off[:, ::-1]])
        ends = ends[np.lexsort((ends[:, 1], ends[:, 0]))]
        start = np.searchsorted(ends[:, 0], np.arange(self.count + 1))
        return Graph(start=start, neighbours=ends[:, 1])

    @cached_property
    def fronts(self) -> tuple[Front, ...]:
        """The fronts in the order of elimination, children before parents."""
        if self.place is None:
            return fronts_of(self.graph, dissect(self.graph, np.arange(self.count)))
        return fronts_of(self.graph, dissect_by_place(self.graph, self.place))

    @cached_property
    def plan(self) -> tuple[FrontPlan, ...]:
        """What every front takes from where, and where its unknowns are in the order of elimination."""
        return tuple(_plans(self))

    @cached_property
    def shares(self) -> tuple[list[range], list[int]]:
        """Subtrees of the fronts that threads can work at side by side, and the fronts above them."""
        work = np.array([plan.own * (plan.blocks * self.size) ** 2 for plan in self.plan], dtype=float)
        first = np.arange(len(self.plan))  # front of each subtree: it is numbered before its root
        for i, plan in enumerate(self.plan):
            for child, _ in plan.children:
                first[i] = min(first[i], first[child])
                work[i] += work[child]
        largest = work[[plan.parent < 0 for plan in self.plan]].sum() / _SHARES
        roots = [
            i
            for i, plan in enumerate(self.plan)
            if work[i] <= largest and (plan.parent < 0 or work[plan.parent] > largest)
        ]
        return [range(int(first[i]), i + 1) for i in roots], np.flatnonzero(work > largest).tolist()

    @cached_property
    def eliminated(self) -> IntArray:
        """(v size,) the unknowns in the order of their elimination."""
        return _expand(np.concatenate([front.own for front in self.fronts]), self.size)

    @cached_property
    def rank(self) -> IntArray:
        """(v size,) the places of the unknowns in the order of their elimination."""
        return np.argsort(self.eliminated)


@dataclass(frozen=True, kw_only=True, eq=False)
class FrontPlan:
    """A front of some blocks, and which entries of the matrix enter it; `own` is the count of its own unknowns.

    entries (r,) rows of the pairs, at block rows and columns of the lower half, `turned` those on the other side.
    Of each child its number, and the runs of its boundary in the unknowns of this front: first and last there, and
    where they begin here. start: of the own unknowns in the order of elimination, boundary: the others in it.
    """

    own: int
    blocks: int
    entries: IntArray
    row: IntArray
    column: IntArray
    turned: IntArray
    children: tuple[tuple[int, tuple[tuple[int, int, int], ...]], ...]
    parent: int
    start: int
    boundary: IntArray


def _plans(pattern: Pattern) -> Iterator[FrontPlan]:
    size, fronts = pattern.size, pattern.fronts
    owner, rank = np.empty((2, pattern.count), dtype=np.int64)
    for number, front in enumerate(fronts):
        owner[front.own] = number
    rank[np.concatenate([front.own for front in fronts])] = np.arange(pattern.count)
    where = np.minimum(owner[pattern.pairs[:, 0]], owner[pattern.pairs[:, 1]])
    order = np.argsort(where, kind="stable")
    cut = np.searchsorted(where[order], np.arange(len(fronts) + 1))
    place, start = np.empty(pattern.count, dtype=np.int64), 0
    for number, front in enumerate(fronts):
        place[front.blocks] = np.arange(len(front.blocks))
        entries = order[cut[number] : cut[number + 1]]
        i, j = place[pattern.pairs[entries]].T
        own = len(front.own)
        children = ((child, _runs(place[fronts[child].boundary], own, size)) for child in front.children)
        yield FrontPlan(
            own=len(front.own) * size,
            blocks=len(front.blocks),
            entries=entries,
            row=np.maximum(i, j),
            column=np.minimum(i, j),
            turned=np.flatnonzero(i > j),
            children=tuple(children),
            parent=front.parent,
            start=start,
            boundary=_expand(rank[front.boundary], size),
        )
        start += len(front.own) * size


def _runs(place: IntArray, own: int, size: int) -> tuple[tuple[int, int, int], ...]:
    """Return the runs of places that follow one another: first, last, and the first place, in unknowns.

    None has places before and behind `own`.
    """
    places, runs = place.tolist(), []
    first = 0
    for last in range(1, len(places) + 1):
        if last == len(places) or places[last] != places[last - 1] + 1 or places[last] == own:
            runs.append((first * size, last * size, places[first] * size))
            first = last
    return tuple(runs)


class NotPositiveDefiniteError(Exception):
    """A pivot that is not positive: `blocks` are those of the front where it turned up."""

    def __init__(self, blocks: IntArray) -> None:
        super().__init__("the matrix is not positive definite")
        self.blocks = blocks


@dataclass(frozen=True, kw_only=True, eq=False)
class SparseFactor:
    """Cholesky factor, front by front: L11 of the own unknowns, zero above its diagonal, L21 of the boundary's."""

    pattern: Pattern
    own: tuple[FloatArray, ...]
    below: tuple[FloatArray, ...]

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Return N^-1 rhs, (v * size,) or (v * size, r)."""
        pattern = self.pattern
        x = np.asarray(rhs, dtype=float)[pattern.eliminated]
        fronts = list(zip(pattern.plan, self.own, self.below, strict=True))
        for plan, L11, L21 in fronts:
            own = slice(plan.start, plan.start + plan.own)
            x[own] = lapack.dtrtrs(L11, x[own], lower=1)[0]
            if len(L21):
                x[plan.boundary] -= L21 @ x[own]
        for plan, L11, L21 in fronts[::-1]:
            own = slice(plan.start, plan.start + plan.own)
            if len(L21):
                x[own] -= L21.T @ x[plan.boundary]
            x[own] = lapack.dtrtrs(L11, x[own], lower=1, trans=1)[0]
        out = np.empty_like(x)
        out[pattern.eliminated] = x
        return out

    def inverse_of(self, blocks: IntArray) -> FloatArray:
        """Return the elements (k, b size, b size) of N^-1 of blocks (k, b); those of a row meet one another.

        They are products of columns of L^-1, zero but for the fronts from that of their block to the root, which of
        blocks that meet lie on one way.
        """
        pattern, rows = self.pattern, self.pattern.rank[self.pattern.rows(blocks)]
        x, one = np.zeros((pattern.order, rows.shape[1])), np.arange(rows.shape[1])
        out = np.zeros((*rows.shape, rows.shape[1]))
        for place, inverse in zip(rows, out, strict=True):
            x[place, one] = 1.0
            front = bisect_right(pattern.plan, place.min(), key=lambda plan: plan.start) - 1
            while front >= 0:
                plan, L21 = pattern.plan[front], self.below[front]
                own = slice(plan.start, plan.start + plan.own)
                columns = lapack.dtrtrs(self.own[front], x[own], lower=1)[0]
                x[plan.boundary] -= L21 @ columns
                x[own] = 0.0
                inverse += columns.T @ columns
                front = plan.parent
        return out

    def selected_inverse(self) -> FloatArray:
        """Return the blocks (e, size, size) of N^-1 of all pairs of the pattern."""
        pattern, size = self.pattern, self.pattern.size
        out = np.empty((len(pattern.pairs), size, size))
        whole: dict[int, FloatArray] = {}  # inverse of the fronts whose children still need it
        waiting = [len(plan.children) for plan in pattern.plan]

        def invert(fronts: range | list[int]) -> None:
            for i in reversed(fronts):
                plan = pattern.plan[i]
                Z = self._inverse(i, None if plan.parent < 0 else whole[plan.parent])
                if plan.parent >= 0:
                    waiting[plan.parent] -= 1
                    if waiting[plan.parent] == 0:
                        del whole[plan.parent]
                if plan.children:
                    whole[i] = Z
                blocks = Z.reshape(plan.blocks, size, plan.blocks, size)[plan.row, :, plan.column, :]
                out[plan.entries] = np.swapaxes(blocks, 1, 2)  # of the upper half, as pairs are
                out[plan.entries[plan.turned]] = blocks[plan.turned]

        subtrees, top = pattern.shares
        invert(top)
        deque(side_by_side(invert, subtrees, pattern.order), maxlen=0)
        return out

    def _inverse(self, i: int, above: FloatArray | None) -> FloatArray:
        """Return the inverse (b size, b size) of front i, given that of its parent."""
        plan, L21 = self.pattern.plan[i], self.below[i]
        inverse = lapack.dtrtri(self.own[i], lower=1)[0]
        if above is None or not len(L21):
            return np.asarray(inverse.T @ inverse)
        p = plan.own
        Z = np.empty((p + len(L21), p + len(L21)))
        runs = dict(self.pattern.plan[plan.parent].children)[i]
        for first, last, at in runs:
            for start, end, to in runs:
                Z[p + first : p + last, p + start : p + end] = above[at : at + last - first, to : to + end - start]
        G = L21 @ inverse
        Z[p:, :p] = -Z[p:, p:] @ G
        Z[:p, p:] = Z[p:, :p].T
        Z[:p, :p] = inverse.T @ inverse - G.T @ Z[p:, :p]
        return Z


def factorise(pattern: Pattern, values: FloatArray) -> SparseFactor:
    """Return the factor of the matrix with blocks `values` (e, size, size), the same whatever the threads.

    Raises `NotPositiveDefiniteError`.
    """
    diagonal: dict[int, FloatArray] = {}
    below: dict[int, FloatArray] = {}
    updates: dict[int, FloatArray] = {}

    def eliminate(fronts: range | list[int]) -> None:
        for i in fronts:
            own, left = _assembled(pattern.plan[i], pattern.size, values, updates)
            F, p = own.T, len(own)  # in the order of FORTRAN, its lower half
            diagonal[i], failed = lapack.dpotrf(F[:p], lower=1)
            if failed:
                raise NotPositiveDefiniteError(pattern.fronts[i].own)
            below[i] = np.zeros((0, p))
            if len(left):
                below[i] = blas.dtrsm(1.0, diagonal[i], F[p:], side=1, lower=1, trans_a=1)
                updates[i] = blas.dsyrk(-1.0, below[i], beta=1.0, c=left.T, lower=1, overwrite_c=1).T

    subtrees, top = pattern.shares
    deque(side_by_side(eliminate, subtrees, pattern.order), maxlen=0)
    eliminate(top)
    numbers = range(len(pattern.plan))
    return SparseFactor(
        pattern=pattern, own=tuple(diagonal[i] for i in numbers), below=tuple(below[i] for i in numbers)
    )


def _assembled(
    plan: FrontPlan, size: int, values: FloatArray, updates: dict[int, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return the upper half of a front, what its children leave added: own rows (p, n), others (n - p, n - p)."""
    p, n = plan.own, plan.blocks * size
    own, left = np.zeros((p, n)), np.zeros((n - p, n - p))
    entering = values[plan.entries]
    entering[plan.turned] = np.swapaxes(entering[plan.turned], 1, 2)
    own.reshape(p // size, size, plan.blocks, size)[plan.column, :, plan.row, :] = entering
    for child, runs in plan.children:
        if not runs:
            continue
        update = updates.pop(child)
        for number, (first, last, at) in enumerate(runs):
            rows, offset = (own, 0) if at < p else (left, p)
            for start, end, to in runs[number:]:
                place = rows[at - offset : at - offset + last - first, to - offset : to - offset + end - start]
                place += update[first:last, start:end]
    return own, left


def _expand(blocks: IntArray, size: int) -> IntArray:
    return (blocks[:, None] * size + np.arange(size)).reshape(-1)
