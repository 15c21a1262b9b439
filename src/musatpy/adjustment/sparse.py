"""Sparse symmetric systems of square blocks: Cholesky factor, solution and selected inverse.

Two blocks (photos) meet in the normal matrix where an observation has both. The matrix is factorised front by
front, from the leaves of a nested dissection to its root, each front a small dense matrix (the multifrontal method
of Duff and Reid, 1983), of which LAPACK works at the lower half. The elements of the inverse inside the pattern
follow from root to leaves without any others (Takahashi 1973). No matrix of the size of the system is ever formed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from musatpy.adjustment.compiled_fronts import CompiledFronts, Tables, tables_of
from musatpy.adjustment.dense import Columns
from musatpy.adjustment.kernels import compiled_points
from musatpy.adjustment.ordering import Front, Graph, dissect, dissect_by_place, fronts_by_kernels, fronts_of
from musatpy.adjustment.plain_fronts import Part, PlainFronts
from musatpy.adjustment.plans import Plan, expand
from musatpy.adjustment.threads import side_by_side, worth_sharing
from musatpy.arrays import FloatArray, IntArray, order_of

_FRONTS = 3  # times more blocks repay the loading of their kernels than of those of points
_ROWS = 8  # of blocks whose cofactors are asked for together: more take no less time, and more memory
_LIGHT = 4  # times more unknowns take a solution, and plain fronts, for threads to pay


@dataclass(frozen=True, kw_only=True, eq=False)
class Runs:
    """How values (k, ...) with repeated rows are added up: sorted by row, and summed run by run."""

    order: IntArray  # (k,)
    rows: IntArray  # the different rows, ascending
    start: IntArray  # first of each in the order

    @classmethod
    def of(cls, rows: IntArray) -> Runs:
        """Return the runs of rows (k,)."""
        order = order_of(rows)
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
    often: bool = False  # so many factors are asked for that smaller ones repay the loading of kernels

    @classmethod
    def of(
        cls,
        count: int,
        size: int,
        cliques: Iterable[IntArray],
        place: FloatArray | None = None,
        *,
        often: bool = False,
    ) -> Pattern:
        """Return the pattern in which the blocks of each row of the arrays `cliques` (k, m) meet one another."""
        keys = [np.arange(count) * (count + 1)]
        for clique in cliques:
            i, j = np.triu_indices(clique.shape[1], 1)
            low, high = np.minimum(clique[:, i], clique[:, j]), np.maximum(clique[:, i], clique[:, j])
            keys.append((low * count + high).reshape(-1))
        key = np.sort(np.concatenate(keys))  # which is several times as fast as the hashing of `np.unique`
        key = key[np.append(True, key[1:] != key[:-1])]
        pairs = np.stack(np.divmod(key, count), axis=1)
        return cls(count=count, size=size, pairs=pairs, place=place, often=often)

    @property
    def order(self) -> int:
        """Number of unknowns, rows of the matrix: v times size."""
        return self.count * self.size

    def rows(self, blocks: IntArray) -> IntArray:
        """Return the numbers (k, m size) of the unknowns of blocks (k, m)."""
        rows = blocks[:, :, None] * self.size + np.arange(self.size)
        return rows.reshape(len(blocks), blocks.shape[1] * self.size)

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
        i, j = self.pairs[self.pairs[:, 0] != self.pairs[:, 1]].T
        key = np.concatenate([i * self.count + j, j * self.count + i])
        key.sort()
        start = np.searchsorted(key, np.arange(self.count + 1) * self.count)
        return Graph(start=start, neighbours=key % self.count)

    @cached_property
    def fronts(self) -> tuple[Front, ...]:
        """The fronts in the order of elimination, children before parents."""
        if self.place is None:
            return fronts_of(self.graph, dissect(self.graph, np.arange(self.count)))
        if self._compiled:
            return fronts_by_kernels(self.graph, self.place)
        return fronts_of(self.graph, dissect_by_place(self.graph, self.place))

    @cached_property
    def plan(self) -> Plan:
        """What every front takes from where."""
        return Plan.of(self.fronts, self.pairs, self.size, shared=worth_sharing(self.work))

    @cached_property
    def _compiled(self) -> bool:
        """Whether kernels work at the fronts."""
        return compiled_points(self.count if self.often else self.count // _FRONTS) is not None

    @cached_property
    def _tables(self) -> Tables | None:
        return tables_of(self.plan) if self._compiled else None

    @property
    def work(self) -> int:
        """How much of it there is for threads, in rays; plain fronts wait for one another where they are small."""
        return self.order if self._compiled else self.order // _LIGHT

    def at_work(self) -> PlainFronts | CompiledFronts:
        """Return what works at the fronts."""
        return PlainFronts(plan=self.plan) if self._tables is None else CompiledFronts(tables=self._tables)

    @cached_property
    def eliminated(self) -> IntArray:
        """(v size,) the unknowns in the order of their elimination."""
        return expand(np.concatenate([front.own for front in self.fronts]), self.size)

    @cached_property
    def rank(self) -> IntArray:
        """(v size,) the places of the unknowns in the order of their elimination."""
        rank = np.empty(self.order, dtype=np.int64)
        rank[self.eliminated] = np.arange(self.order)
        return rank


class NotPositiveDefiniteError(Exception):
    """A pivot that is not positive: `blocks` are those of the front where it turned up."""

    def __init__(self, blocks: IntArray) -> None:
        super().__init__("the matrix is not positive definite")
        self.blocks = blocks


@dataclass(frozen=True, kw_only=True, eq=False)
class SparseFactor:
    """Cholesky factor, in the parts of the stages."""

    pattern: Pattern
    parts: dict[range, Part]

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Return N^-1 rhs, (v * size,) or (v * size, r)."""
        pattern, given = self.pattern, np.asarray(rhs, dtype=float)
        plan, fronts = pattern.plan, pattern.at_work()
        x = np.ascontiguousarray(given.reshape(len(given), -1)[pattern.eliminated])

        def forward(numbers: range) -> tuple[IntArray, FloatArray]:
            own = slice(plan.fronts[numbers[0]].eliminated.start, plan.fronts[numbers[-1]].eliminated.stop)
            of_part, boundary = np.zeros_like(x), plan.fronts[numbers[-1]].boundary
            of_part[own] = x[own]
            fronts.forward(self.parts[numbers], of_part)
            x[own] = of_part[own]
            return boundary, of_part[boundary]

        for stage in plan.stages:
            for boundary, update in side_by_side(forward, stage, pattern.work // _LIGHT):
                x[boundary] += update
        for stage in reversed(plan.stages):
            parts = [self.parts[numbers] for numbers in stage]
            deque(side_by_side(lambda part: fronts.backward(part, x), parts, pattern.work // _LIGHT), maxlen=0)
        out = np.empty_like(given)
        out[pattern.eliminated] = x.reshape(given.shape)
        return out

    def cofactors_of(self, blocks: IntArray, partials: FloatArray) -> FloatArray:
        """Return A N^-1 A' (k, o, o), A (k, o, b size) the partials of o functions of blocks (k, b).

        The blocks of a row meet one another. These are products of columns of L^-1 A', zero but for the fronts from
        those of their blocks to the root, which of blocks that meet lie on one way.
        """
        start = [front.eliminated.start for front in self.pattern.plan.fronts]
        rows = self.pattern.rank[self.pattern.rows(blocks)]
        lowest = np.searchsorted(start, rows.min(axis=1), side="right") - 1
        order = np.argsort(lowest, kind="stable")  # those whose ways meet stand together
        out = np.empty((*partials.shape[:2], partials.shape[1]))
        for some in np.split(order, range(_ROWS, len(order), _ROWS)) if len(order) else ():
            out[some] = self._cofactors_of(rows[some], partials[some], lowest[some].tolist())
        return out

    def _cofactors_of(self, rows: IntArray, partials: FloatArray, lowest: list[int]) -> FloatArray:
        """Return the same of places (k, u) in the order of elimination, from the `lowest` fronts of each on."""
        fronts, (k, o, _) = self.pattern.plan.fronts, partials.shape
        through: dict[int, list[int]] = {}  # fronts, of rows
        for number, i in enumerate(lowest):
            while i >= 0:
                through.setdefault(i, []).append(number)
                i = fronts[i].parent
        ways = sorted(through)
        place = np.empty(self.pattern.order, dtype=np.int64)  # in the columns, of the unknowns of these fronts
        size = 0
        for i in ways:
            place[fronts[i].eliminated], size = np.arange(size, size + fronts[i].own), size + fronts[i].own
        of_blocks, out = np.zeros((size, k, o)), np.zeros((k, o, o))
        of_blocks[place[rows], np.arange(k)[:, None]] = np.swapaxes(partials, 1, 2)
        x = of_blocks.reshape(size, -1)
        part_of = {i: part for part in self.parts.values() for i in part.numbers}
        for i in ways:
            front, first, last = fronts[i], through[i][0], through[i][-1] + 1
            own = x[place[front.eliminated], first * o : last * o]
            x[place[front.boundary], first * o : last * o] -= Columns(part_of[i].own(i).T).forward(own)
            of_rows = own.reshape(front.own, -1, o)
            out[first:last] += of_rows.transpose(1, 2, 0) @ of_rows.transpose(1, 0, 2)
        return out

    def selected_inverse(self) -> FloatArray:
        """Return the blocks (e, size, size) of N^-1 of all pairs of the pattern."""
        pattern, plan, fronts = self.pattern, self.pattern.plan, self.pattern.at_work()
        out = np.empty((len(plan.pairs), pattern.size, pattern.size))
        inverses: dict[int, FloatArray] = {}  # of roots of parts that have that of their boundary from their parent

        def invert(numbers: range) -> None:
            root = plan.fronts[numbers[-1]]
            Z = inverses.pop(numbers[-1]) if root.parent >= 0 else np.empty((root.size, root.size))
            fronts.invert(self.parts[numbers], Z, out)
            for child in root.children:
                if child not in numbers:
                    inverses[child] = np.empty((plan.fronts[child].size, plan.fronts[child].size))
                    fronts.hand_down(child, Z, inverses[child])

        for stage in reversed(plan.stages):
            deque(side_by_side(invert, stage, pattern.work), maxlen=0)
        i, j = np.triu_indices(pattern.size, 1)
        out[pattern.diagonal[:, None], j, i] = out[pattern.diagonal[:, None], i, j]
        return out


def factorise(pattern: Pattern, values: FloatArray) -> SparseFactor:
    """Return the factor of the matrix with blocks `values` (e, size, size), the same whatever the threads.

    Raises `NotPositiveDefiniteError`.
    """
    plan, fronts = pattern.plan, pattern.at_work()
    parts: dict[range, Part] = {}
    updates: dict[int, FloatArray] = {}  # of roots of parts

    def eliminate(numbers: range) -> None:
        part, root = Part.of(plan, numbers), plan.fronts[numbers[-1]]
        fronts.enter(part, values)
        update = np.zeros((root.size - root.own, root.size - root.own))
        for child in root.children:
            if child not in numbers:
                fronts.add_update(child, updates.pop(child), part.own(numbers[-1]), update)
        failed = fronts.eliminate(part, update)
        if failed >= 0:
            raise NotPositiveDefiniteError(pattern.fronts[failed].own)
        parts[numbers], updates[numbers[-1]] = part, update

    for stage in plan.stages:
        deque(side_by_side(eliminate, stage, pattern.work), maxlen=0)
    return SparseFactor(pattern=pattern, parts=parts)
