"""Sparse symmetric systems of square blocks: their pattern, elimination, Cholesky factor and selected inverse.

Two blocks (photos) meet in the normal matrix where an observation has both. They are eliminated in the order of
nested dissection: it takes out a set of blocks that separates two parts, and divides each part again (George 1973).
Blocks are cut by their places: across each of some directions, where the fewest blocks of one side meet the other.
Those without places have one each in the order of Cuthill and McKee, in which neighbours are near.

The matrix is factorised front by front, from the leaves of the dissection to its root, each front a small dense
matrix (the multifrontal method of Duff and Reid, 1983). The elements of the inverse inside the pattern follow from
root to leaves without any others (Takahashi 1973). No matrix of the size of the system is ever formed. Products are
those of numpy, which lets other threads run meanwhile, and so does LAPACK.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg.lapack import dtrtri

from musatpy.adjustment.kernels import side_by_side
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model.tables import order_of

_LEAF = 16  # blocks: a front of this size is cheaper than another cut
_DIRECTIONS = 4  # of cuts that are tried
_LEAST_PART = 0.15  # of the blocks on the smaller side of a cut
_SHARES = 8  # of the work, which a subtree has one of at most: fewer are left unequal, more leave much above them
_LIGHT = 2  # unknowns of as much work as a ray: fronts wait for one another where they are small
Runs = list[tuple[int, int, int]]


@cache
def upper_triangle(size: int) -> tuple[IntArray, IntArray]:
    """Return `np.triu_indices`, once for every size: of few points the sums take no longer than these."""
    return np.triu_indices(size)


@dataclass(frozen=True, kw_only=True, eq=False)
class SumsByRow:
    """How values (k, ...) with repeated rows are added up: sorted by row, and summed run by run."""

    order: IntArray  # (k,)
    rows: IntArray  # the different rows, ascending
    start: IntArray  # first of each in the order

    @classmethod
    def of(cls, rows: IntArray) -> SumsByRow:
        """Return the runs of rows (k,)."""
        order = order_of(rows)
        different, start = np.unique(rows[order], return_index=True)
        return cls(order=order, rows=different, start=start)

    def sums(self, values: FloatArray) -> FloatArray:
        """Return the sums of values (k, ...) by row."""
        return np.add.reduceat(values.take(self.order, axis=0), self.start, axis=0)


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
            clique = clique[np.append(True, (clique[1:] != clique[:-1]).any(axis=1))[: len(clique)]]
            low, high = np.minimum(clique[:, i], clique[:, j]), np.maximum(clique[:, i], clique[:, j])
            keys.append((low * count + high).reshape(-1))
        key = np.sort(np.concatenate(keys))  # which is several times as fast as the hashing of `np.unique`
        key = key[np.append(True, key[1:] != key[:-1])]
        pairs = np.stack(np.divmod(key, count), axis=1)
        return cls(count=count, size=size, pairs=pairs, place=place)

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
    def firsts(self) -> SumsByRow:
        """How what pairs have adds to their first blocks: all of them, as each meets itself."""
        return SumsByRow.of(self.pairs[:, 0])

    @cached_property
    def seconds(self) -> SumsByRow:
        """How what pairs of two blocks have adds to the second ones; what those of one have is left."""
        apart = np.flatnonzero(self.pairs[:, 0] != self.pairs[:, 1])
        runs = SumsByRow.of(self.pairs[apart, 1])
        return replace(runs, order=apart[runs.order])

    @cached_property
    def _runs(self) -> dict[tuple[int, bytes], tuple[SumsByRow, SumsByRow]]:
        return {}

    def runs(self, photo: IntArray) -> tuple[SumsByRow, SumsByRow]:
        """Return how points with photos (k, m) add to their pairs, in the order of `triu_indices`, and to photos.

        Every iteration adds the same points again: what was sorted once is kept.
        """
        key = (photo.shape[1], photo.tobytes())
        if key not in self._runs:
            i, j = upper_triangle(photo.shape[1])
            pairs = self.find(photo[:, i], photo[:, j]).reshape(-1)
            self._runs[key] = (SumsByRow.of(pairs), SumsByRow.of(photo.reshape(-1)))
        return self._runs[key]

    @cached_property
    def elimination(self) -> EliminationTree:
        """The order of elimination of the unknowns, and its fronts."""
        return EliminationTree.of(self.count, self.size, self.pairs, self.place)


@dataclass(frozen=True, kw_only=True, eq=False)
class Front:
    """One dense front: its own unknowns are eliminated, those of its boundary go on to the parent.

    Unknowns are numbered in the order of their elimination; in the front they stand in this order.
    """

    own: slice
    boundary: IntArray  # (b,)
    parent: int  # -1 for a root
    # children, and which runs of their boundaries follow one another here: first, last, and where in the front
    children: dict[int, Runs]
    pairs: IntArray  # (e,) rows of the pairs of blocks that enter here
    turned: BoolArray  # (e,) the second block of the pair is eliminated first
    # (e, size) rows of each block, of those turned its columns, in the upper half of the matrix: of its
    # own unknowns, (p, n) cut into pieces of one block
    rows: IntArray

    @property
    def shape(self) -> tuple[int, int]:
        """How many unknowns the front eliminates, and how many it leaves."""
        return self.own.stop - self.own.start, len(self.boundary)


@dataclass(frozen=True, kw_only=True, eq=False)
class EliminationTree:
    """The order (u,) of elimination of unknowns, and its fronts, children before parents."""

    order: IntArray
    fronts: tuple[Front, ...]

    @classmethod
    def of(cls, count: int, size: int, pairs: IntArray, place: FloatArray | None) -> EliminationTree:
        """Return the elimination of blocks of unknowns that meet in pairs (e, 2), at places (v, 3) or none."""
        i, j = pairs[pairs[:, 0] != pairs[:, 1]].T
        i, j = np.concatenate([i, j]), np.concatenate([j, i])
        order = order_of(i)
        tree = _Tree()
        tree.divide(np.arange(count), i[order], j[order], _directions(count, pairs, place))
        return cls(order=unknowns(np.concatenate(tree.own), size), fronts=_fronts(tree, size, pairs))

    @cached_property
    def stages(self) -> list[list[range]]:
        """Fronts that threads work at side by side, stage by stage: subtrees, then those above them by height."""
        work = [float(own * (own + left) ** 2) for own, left in (front.shape for front in self.fronts)]
        largest, first, height = sum(work) / _SHARES, list(range(len(work))), [0] * len(work)
        for i, front in enumerate(self.fronts):
            work[i] += sum(work[child] for child in front.children)
            first[i] = min((first[child] for child in front.children), default=i)  # of the subtree that it ends
            if work[i] > largest:
                height[i] = 1 + max((height[child] for child in front.children), default=0)
        stages: list[list[range]] = [[] for _ in range(max(height) + 1)]
        for i, front in enumerate(self.fronts):
            if height[i]:
                stages[height[i]].append(range(i, i + 1))
            elif front.parent < 0 or height[front.parent]:
                stages[0].append(range(first[i], i + 1))
        return stages


def unknowns(blocks: IntArray, size: int) -> IntArray:
    """Return the unknowns (b size,) of blocks (b,)."""
    return (blocks[:, None] * size + np.arange(size)).reshape(-1)


class _Tree:
    """The blocks of fronts, and their children, as they are found."""

    def __init__(self) -> None:
        self.own: list[IntArray] = []
        self.children: list[tuple[int, ...]] = []

    def divide(self, blocks: IntArray, i: IntArray, j: IntArray, place: FloatArray) -> tuple[int, ...]:
        """Add the fronts of some blocks (b,), which have places (a, b); return those at the top.

        Their neighbours among them are the pairs i, j of their numbers here, both ways and ascending by i.
        """
        own, children = blocks, tuple[int, ...]()
        if len(blocks) > _LEAF:
            side, number = _sides(i, j, place), np.empty(len(blocks), dtype=np.int64)
            own = blocks[side == 0]
            for half in (-1, 1):
                mine, inside = np.flatnonzero(side == half), (side[i] == half) & (side[j] == half)
                number[mine] = np.arange(len(mine))
                children += self.divide(blocks[mine], number[i[inside]], number[j[inside]], place[:, mine])
        if not len(own):
            return children
        self.own.append(own)
        self.children.append(children)
        return (len(self.own) - 1,)


def _directions(count: int, pairs: IntArray, place: FloatArray | None) -> FloatArray:
    """Return places (a, v) along the directions of cuts, in the plane of their extent."""
    if place is not None:
        middle = place - place.mean(axis=0)
        plane = np.linalg.eigh(middle.T @ middle)[1][:, :0:-1]
        turn = np.arange(_DIRECTIONS) * np.pi / _DIRECTIONS  # the axes of a square are any
        return np.stack([np.cos(turn), np.sin(turn)], axis=1) @ (middle @ plane).T
    if count <= _LEAF:
        return np.zeros((1, count))
    from scipy.sparse import coo_array, csgraph  # they load slowly, and few blocks have no places

    meet = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count)).tocsr()
    along = np.empty((1, count))
    along[0, csgraph.reverse_cuthill_mckee(meet + meet.T, symmetric_mode=True)] = np.arange(count)
    return along


def _sides(i: IntArray, j: IntArray, place: FloatArray) -> IntArray:
    """Return the halves (b,) of blocks, -1 and 1, and 0 of those that separate them.

    At a cut those of the lower side separate that have a neighbour beyond it: as many as have their place below it,
    less those whose farthest neighbour is below it too.
    """
    count = place.shape[1]
    rank = np.argsort(np.argsort(place, kind="stable"))
    farthest = rank.copy()
    if len(i):
        start = np.flatnonzero(np.diff(i, prepend=-1))
        farthest[:, i[start]] = np.maximum(rank[:, i[start]], np.maximum.reduceat(rank[:, j], start, axis=1))
    least = int(np.ceil(_LEAST_PART * count))
    cuts = np.arange(least, count - least + 1)
    within = np.stack([np.searchsorted(np.sort(of_axis), cuts) for of_axis in farthest])
    cost = (cuts - within + 1.0) / (cuts * (count - cuts))  # narrow cuts, and halves alike
    axis, best = np.unravel_index(cost.argmin(), cost.shape)
    low, separates = rank[axis] < cuts[best], farthest[axis] >= cuts[best]
    return np.where(low, np.where(separates, 0, -1), 1)


def _fronts(tree: _Tree, size: int, pairs: IntArray) -> tuple[Front, ...]:
    """Return the fronts of a tree, with what enters them."""
    order, bounds = np.concatenate(tree.own), np.cumsum([0, *map(len, tree.own)])
    rank, parent = np.empty_like(order), {child: i for i, some in enumerate(tree.children) for child in some}
    rank[order] = np.arange(len(order))
    low, high = np.sort(rank[pairs], axis=1).T
    turned, owner = rank[pairs[:, 0]] > low, np.searchsorted(bounds, low, side="right") - 1
    by_front = order_of(owner)
    cut = np.searchsorted(owner[by_front], np.arange(len(bounds)))
    fronts: list[Front] = []
    boundaries: list[IntArray] = []  # blocks
    for number, (first, last) in enumerate(pairwise(bounds.tolist())):
        mine, children = by_front[cut[number] : cut[number + 1]], tree.children[number]
        met = np.unique(np.concatenate([high[mine], *(boundaries[child] for child in children)]))
        boundaries.append(met[met >= last])
        blocks = np.concatenate([np.arange(first, last), boundaries[-1]])
        places = {child: np.searchsorted(blocks, boundaries[child]) for child in children}
        column = unknowns(np.searchsorted(blocks, low[mine]), size).reshape(-1, size)
        fronts.append(
            Front(
                own=slice(first * size, last * size),
                boundary=unknowns(boundaries[-1], size),
                parent=parent.get(number, -1),
                children={child: _runs(place, last - first, size) for child, place in places.items()},
                pairs=mine,
                turned=turned[mine],
                rows=column * len(blocks) + np.searchsorted(blocks, high[mine])[:, None],
            )
        )
    return tuple(fronts)


def _runs(place: IntArray, own: int, size: int) -> Runs:
    """Return the runs of places of blocks that follow one another; none goes from own to other ones."""
    first = np.flatnonzero((np.diff(place, prepend=-2) != 1) | (place == own))
    last = np.append(first[1:], len(place))[: len(first)]
    return [tuple(run) for run in (np.stack([first, last, place[first]], axis=1) * size).tolist()]


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
