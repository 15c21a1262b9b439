"""Sparse symmetric systems of square blocks: Cholesky factor, solution and selected inverse.

Two blocks (photos) meet in the normal matrix where an observation has both. The matrix is factorised front by
front, from the leaves of a nested dissection to its root, each front a small dense matrix (the multifrontal method
of Duff and Reid, 1983), of which LAPACK works at the lower half. The elements of the inverse inside the pattern
follow from root to leaves without any others (Takahashi 1973). No matrix of the size of the system is ever formed.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.dense import Columns
from musatpy.adjustment.ordering import Front, Graph, dissect, dissect_by_place, fronts_of
from musatpy.adjustment.threads import side_by_side
from musatpy.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from musatpy.adjustment.compiled_fronts import CompiledSubtrees

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
    def plan(self) -> Plan:
        """What every front takes from where."""
        return Plan.of(self)

    @cached_property
    def compiled(self) -> CompiledSubtrees | None:
        """The fronts as compiled kernels have them, None where numpy does all."""
        from musatpy.adjustment.compiled_fronts import CompiledSubtrees  # which is made of patterns

        return CompiledSubtrees.of(self)

    @cached_property
    def eliminated(self) -> IntArray:
        """(v size,) the unknowns in the order of their elimination."""
        return _expand(np.concatenate([front.own for front in self.fronts]), self.size)


@dataclass(frozen=True, kw_only=True, eq=False)
class FrontPlan:
    """A front of `size` unknowns, of which the first `own` are eliminated there.

    pairs: those of the plan that enter it; columns: its own columns in the rows of the plan; eliminated: its own
    unknowns in the order of elimination, boundary: the others in it. Of each child its number, and the runs of its
    boundary in the unknowns of this front: first and last there, and where they begin here.
    """

    own: int
    size: int
    pairs: slice
    columns: slice
    eliminated: slice
    boundary: IntArray
    children: list[tuple[int, list[tuple[int, int, int]]]]
    parent: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """The fronts of a pattern, and where its blocks are in their own columns.

    Front by front, of every own unknown the unknowns of the front, in rows of `size`: the lower half of the matrix.
    """

    fronts: tuple[FrontPlan, ...]
    pairs: IntArray  # (e,) rows of the pairs, front by front
    turned: IntArray  # of those whose first block is eliminated after the second
    rows: IntArray  # (e, size) where the rows of each block are, of those turned its columns

    @classmethod
    def of(cls, pattern: Pattern) -> Plan:
        """Return the plan of a pattern."""
        size, count, fronts = pattern.size, pattern.count, pattern.fronts
        own, others = np.array([(len(front.own), len(front.boundary)) for front in fronts]).T
        parent = np.array([front.parent for front in fronts])
        blocks, number = own + others, np.arange(len(fronts))
        rank, owner = np.empty(count, dtype=np.int64), np.repeat(number, own)
        rank[np.concatenate([front.own for front in fronts])] = np.arange(count)
        boundary, child = rank[np.concatenate([front.boundary for front in fronts])], np.repeat(number, others)
        # a front has its blocks in the order of their elimination
        keys = np.sort(np.concatenate([owner * count + np.arange(count), child * count + boundary]))
        begin = _bounds(blocks)

        def place(front: IntArray, block: IntArray) -> IntArray:
            return np.searchsorted(keys, front * count + block) - begin[front]

        i, j = rank[pattern.pairs.T]
        order = np.argsort(owner[np.minimum(i, j)], kind="stable")
        i, j = i[order], j[order]
        column, row = np.minimum(i, j), np.maximum(i, j)
        front = owner[column]
        columns = _bounds(own * size * blocks)
        rows = columns[front] + place(front, column) * size * blocks[front] + place(front, row)
        pairs, eliminated, cut = _bounds(np.bincount(front)), _bounds(own) * size, _bounds(others)
        runs = _runs(place(parent[child], boundary), own[parent[child]], cut, size)
        plans = tuple(
            FrontPlan(
                own=int(own[k]) * size,
                size=int(blocks[k]) * size,
                pairs=slice(pairs[k], pairs[k + 1]),
                columns=slice(columns[k], columns[k + 1]),
                eliminated=slice(eliminated[k], eliminated[k + 1]),
                boundary=_expand(boundary[cut[k] : cut[k + 1]], size),
                children=[(child, runs[child]) for child in front.children],
                parent=front.parent,
            )
            for k, front in enumerate(fronts)
        )
        return cls(
            fronts=plans,
            pairs=order,
            turned=np.flatnonzero(i > j),
            rows=rows[:, None] + blocks[front, None] * np.arange(size),
        )

    def entered(self, part: range, entering: FloatArray) -> tuple[FloatArray, list[Columns]]:
        """Return the own columns of some fronts, where blocks (e, size, size) of the plan have entered.

        They are the rows of the first array.
        """
        of = self.fronts[part.start : part.stop]
        begin, size = of[0].columns.start, entering.shape[1]
        pairs = slice(of[0].pairs.start, of[-1].pairs.stop)
        store = np.zeros((of[-1].columns.stop - begin, size))
        store[self.rows[pairs] - begin] = entering[pairs]
        own = (store[front.columns.start - begin : front.columns.stop - begin] for front in of)
        return store, [Columns(rows.reshape(front.own, front.size).T) for rows, front in zip(own, of, strict=True)]

    @cached_property
    def stages(self) -> list[list[range]]:
        """Fronts that threads work at side by side, stage by stage: subtrees, then those above them by height."""
        work = np.array([front.own * front.size**2 for front in self.fronts], dtype=float)
        first = np.arange(len(work))  # front of each subtree: it is numbered before its root
        for i, front in enumerate(self.fronts):
            for child, _ in front.children:
                first[i] = min(first[i], first[child])
                work[i] += work[child]
        largest = work[[front.parent < 0 for front in self.fronts]].sum() / _SHARES
        stages: list[list[range]] = [[]]
        height = np.zeros(len(work), dtype=int)
        for i, front in enumerate(self.fronts):
            if work[i] > largest:
                height[i] = 1 + max((height[child] for child, _ in front.children), default=0)
                stages += [[]] if height[i] == len(stages) else []
                stages[height[i]].append(range(i, i + 1))
            elif front.parent < 0 or work[front.parent] > largest:
                stages[0].append(range(int(first[i]), i + 1))
        return stages


def _bounds(sizes: IntArray) -> IntArray:
    """Return where things of these sizes begin one after the other, and the end."""
    return np.concatenate([[0], np.cumsum(sizes)])


def _runs(place: IntArray, own: IntArray, cut: IntArray, size: int) -> list[list[tuple[int, int, int]]]:
    """Return the runs of places that follow one another, from cut to cut: first, last, first place, in unknowns.

    None has places before and behind `own`.
    """
    new = (np.diff(place, prepend=-2) != 1) | (place == own)
    new[cut[:-1][cut[:-1] < len(place)]] = True
    first = np.flatnonzero(new)
    last, of = np.append(first[1:], len(place)), np.searchsorted(cut, first, side="right") - 1
    table = (np.stack([first - cut[of], last - cut[of], place[first]], axis=1) * size).tolist()
    bounds = np.searchsorted(of, np.arange(len(cut)))
    return [[tuple(run) for run in table[start:end]] for start, end in pairwise(bounds.tolist())]


class Room:
    """Square matrices, of any contents, in memory that is used again: fresh pages cost as much as small fronts.

    Threads may share it.
    """

    _STEP = 48  # rows, by which sizes are rounded up
    _MOST = 480  # rows that are worth keeping: more are few, and most of the memory

    def __init__(self) -> None:
        self._free: dict[int, list[FloatArray]] = defaultdict(list)

    def take(self, n: int) -> FloatArray:
        """Return a matrix (n, n)."""
        rows = -(-n // self._STEP) * self._STEP if n <= self._MOST else n
        try:
            memory = self._free[rows].pop()
        except IndexError:
            memory = np.empty(rows * rows)
        return memory[: n * n].reshape(n, n)

    def zeros(self, front: FrontPlan) -> FloatArray:
        """Return zeros for what a front leaves (n - p, n - p)."""
        left = self.take(front.size - front.own)
        left.fill(0.0)
        return left

    def give(self, matrix: FloatArray) -> None:
        """Take back a matrix that nobody looks at any more."""
        memory = matrix.base
        if len(matrix) <= self._MOST and isinstance(memory, np.ndarray):
            self._free[math.isqrt(len(memory))].append(memory)


class NotPositiveDefiniteError(Exception):
    """A pivot that is not positive: `blocks` are those of the front where it turned up."""

    def __init__(self, blocks: IntArray) -> None:
        super().__init__("the matrix is not positive definite")
        self.blocks = blocks


@dataclass(frozen=True, kw_only=True, eq=False)
class SparseFactor:
    """Cholesky factor: the own columns of the fronts, and the memory that those of each part of the stages have."""

    pattern: Pattern
    columns: tuple[Columns, ...]
    stores: dict[range, FloatArray]

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Return N^-1 rhs, (v * size,) or (v * size, r)."""
        pattern, given = self.pattern, np.asarray(rhs, dtype=float)
        x = given.reshape(len(given), -1)[pattern.eliminated]
        fronts = list(zip(pattern.plan.fronts, self.columns, strict=True))
        for front, L in fronts:
            update = L.forward(x[front.eliminated])
            if len(update):
                x[front.boundary] -= update
        for front, L in reversed(fronts):
            L.backward(x[front.eliminated], x[front.boundary])
        out = np.empty_like(given)
        out[pattern.eliminated] = x.reshape(given.shape)
        return out

    def selected_inverse(self) -> FloatArray:
        """Return the blocks (e, size, size) of N^-1 of all pairs of the pattern."""
        plan, size = self.pattern.plan, self.pattern.size
        blocks = np.empty((len(plan.pairs), size, size))
        inverses: dict[int, FloatArray] = {}  # of fronts that have that of their boundary from their parent
        room, compiled = Room(), self.pattern.compiled

        def invert(part: range) -> None:
            if compiled is not None and len(part) > 1:
                root = plan.fronts[part[-1]]
                Z = inverses.pop(part[-1]) if root.parent >= 0 else room.take(root.size)
                compiled.invert(part, self.stores[part], Z, blocks)
                return
            for i in reversed(part):
                front = plan.fronts[i]
                Z = inverses.pop(i) if front.parent >= 0 else room.take(front.size)
                self.columns[i].invert(Z.T)
                for child, runs in front.children:
                    inverses[child] = room.take(plan.fronts[child].size)
                    _hand_down(Z, runs, inverses[child], plan.fronts[child].own)
                rows = plan.rows[front.pairs] - front.columns.start
                np.take(Z[: front.own].reshape(-1, size), rows, axis=0, out=blocks[front.pairs])
                room.give(Z)

        for stage in reversed(plan.stages):
            deque(side_by_side(invert, stage, self.pattern.order), maxlen=0)
        return self._of_pairs(blocks)

    def _of_pairs(self, blocks: FloatArray) -> FloatArray:
        """Return blocks in the order of the plan, lower halves at the diagonal, in that of the pairs."""
        plan, diagonal = self.pattern.plan, self.pattern.diagonal
        blocks[plan.turned] = np.swapaxes(blocks[plan.turned], 1, 2)
        out = np.empty_like(blocks)
        out[plan.pairs] = blocks
        i, j = np.triu_indices(self.pattern.size, 1)
        out[diagonal[:, None], j, i] = out[diagonal[:, None], i, j]
        return out


def _hand_down(above: FloatArray, runs: list[tuple[int, int, int]], Z: FloatArray, p: int) -> None:
    """Set the inverse of the boundary of a front, in Z (n, n) behind its p own unknowns, from that of its parent.

    The boundary has the `runs` there; upper halves.
    """
    for number, (first, last, at) in enumerate(runs):
        for start, end, to in runs[number:]:
            Z[p + first : p + last, p + start : p + end] = above[at : at + last - first, to : to + end - start]


def factorise(pattern: Pattern, values: FloatArray) -> SparseFactor:
    """Return the factor of the matrix with blocks `values` (e, size, size), the same whatever the threads.

    Raises `NotPositiveDefiniteError`.
    """
    plan = pattern.plan
    entering = values[plan.pairs]
    entering[plan.turned] = np.swapaxes(entering[plan.turned], 1, 2)
    columns: dict[int, Columns] = {}
    stores: dict[range, FloatArray] = {}
    updates: dict[int, FloatArray] = {}
    room, compiled = Room(), pattern.compiled

    def eliminate(part: range) -> None:
        stores[part], own = plan.entered(part, entering)
        columns.update(zip(part, own, strict=True))
        if compiled is not None and len(part) > 1:
            updates[part[-1]] = room.zeros(plan.fronts[part[-1]])
            failed = compiled.eliminate(part, stores[part], updates[part[-1]])
            if failed >= 0:
                raise NotPositiveDefiniteError(pattern.fronts[failed].own)
            return
        for i in part:
            updates[i] = room.zeros(plan.fronts[i])
            for child, runs in plan.fronts[i].children:
                _add_update(updates[child], runs, columns[i].array.T, updates[i])
                room.give(updates.pop(child))
            if not columns[i].eliminate(updates[i].T):
                raise NotPositiveDefiniteError(pattern.fronts[i].own)

    for stage in plan.stages:
        deque(side_by_side(eliminate, stage, pattern.order), maxlen=0)
    return SparseFactor(pattern=pattern, columns=tuple(columns[i] for i in range(len(plan.fronts))), stores=stores)


def _add_update(update: FloatArray, runs: list[tuple[int, int, int]], own: FloatArray, left: FloatArray) -> None:
    """Add what a child leaves, whose boundary has the `runs` in a front, to its rows: `own`, then `left`.

    Upper halves.
    """
    p = len(own)
    for number, (first, last, at) in enumerate(runs):
        rows, offset = (own, 0) if at < p else (left, p)
        for start, end, to in runs[number:]:
            place = rows[at - offset : at - offset + last - first, to - offset : to - offset + end - start]
            place += update[first:last, start:end]


def _expand(blocks: IntArray, size: int) -> IntArray:
    return (blocks[:, None] * size + np.arange(size)).reshape(-1)
