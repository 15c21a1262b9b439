"""Sparse symmetric systems of square blocks: ordering, Cholesky factor, solution and selected inverse.

Two blocks (photos) meet in the normal matrix where an observation has both. Nested dissection splits the graph of
blocks by a set of blocks that separates two parts, and each part again; the matrix is factorised front by front,
from the leaves of that tree to its root, each front a small dense matrix (the multifrontal method of Duff and
Reid, 1983). The elements of the inverse inside the pattern follow from root to leaves without any others (Takahashi
1973). No matrix of the size of the system is ever formed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular

from musatpy.arrays import BoolArray, FloatArray, IntArray

_LEAF = 16  # blocks: a front of this size is cheaper than another split


@dataclass(frozen=True, kw_only=True, eq=False)
class Graph:
    """Neighbours of v blocks, without themselves: those of i are `neighbours[start[i]:start[i + 1]]`."""

    start: IntArray  # (v + 1,)
    neighbours: IntArray

    def around(self, blocks: IntArray) -> IntArray:
        """Return the neighbours of all of `blocks`, with repetitions."""
        first, last = self.start[blocks], self.start[blocks + 1]
        size = last - first
        if size.sum() == 0:
            return np.empty(0, dtype=np.int64)
        offset = np.repeat(first - np.concatenate([[0], np.cumsum(size)[:-1]]), size)
        return self.neighbours[offset + np.arange(size.sum())]


@dataclass(frozen=True, kw_only=True, eq=False)
class Front:
    """One dense front: its own blocks are eliminated, the boundary goes on to the parent. In elimination order."""

    own: IntArray  # blocks
    boundary: IntArray  # blocks of ancestors, ascending by elimination
    children: tuple[int, ...]
    parent: int  # -1 for a root

    @property
    def blocks(self) -> IntArray:
        """Own blocks and boundary."""
        return np.concatenate([self.own, self.boundary])


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

    @classmethod
    def of(cls, count: int, size: int, cliques: Iterable[IntArray]) -> Pattern:
        """Return the pattern in which the blocks of each row of the arrays `cliques` (k, m) meet one another."""
        keys = [np.arange(count) * (count + 1)]
        for clique in cliques:
            i, j = np.triu_indices(clique.shape[1], 1)
            low, high = np.minimum(clique[:, i], clique[:, j]), np.maximum(clique[:, i], clique[:, j])
            keys.append(np.unique(low * count + high))
        key = np.unique(np.concatenate(keys))
        return cls(count=count, size=size, pairs=np.stack(np.divmod(key, count), axis=1))

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
        return _symbolic(self.graph, dissect(self.graph, np.arange(self.count)))

    @cached_property
    def assembly(self) -> tuple[tuple[IntArray, IntArray, IntArray], ...]:
        """For every front: rows of `pairs` that enter there, and their block row and column in the front."""
        owner = np.empty(self.count, dtype=np.int64)
        for number, front in enumerate(self.fronts):
            owner[front.own] = number
        where = np.minimum(owner[self.pairs[:, 0]], owner[self.pairs[:, 1]])
        order = np.argsort(where, kind="stable")
        cut = np.searchsorted(where[order], np.arange(len(self.fronts) + 1))
        place = np.empty(self.count, dtype=np.int64)
        parts = []
        for number, front in enumerate(self.fronts):
            entries = order[cut[number] : cut[number + 1]]
            place[front.blocks] = np.arange(len(front.blocks))
            parts.append((entries, place[self.pairs[entries, 0]], place[self.pairs[entries, 1]]))
        return tuple(parts)


@dataclass
class _Tree:
    """A set of blocks to eliminate after those of its parts."""

    own: IntArray
    parts: list[_Tree] = field(default_factory=list)


def dissect(graph: Graph, blocks: IntArray) -> list[_Tree]:
    """Return the trees of a nested dissection of `blocks`, one for each connected component."""
    trees, inside = [], np.zeros(len(graph.start) - 1, dtype=bool)
    inside[blocks] = True
    left = inside.copy()
    while left.any():
        component = np.concatenate(_levels(graph, int(left.argmax()), inside))
        left[component] = False
        trees.append(_split(graph, component))
    return trees


def _split(graph: Graph, component: IntArray) -> _Tree:
    if len(component) <= _LEAF:
        return _Tree(own=np.sort(component))
    inside = np.zeros(len(graph.start) - 1, dtype=bool)
    inside[component] = True
    # twice to the farthest block: the levels of a long component are then its narrow cross sections
    levels = _levels(graph, int(component[0]), inside)
    for _ in range(2):
        levels = _levels(graph, int(levels[-1][0]), inside)
    if len(levels) < 3:
        return _Tree(own=np.sort(component))
    sizes = np.cumsum([len(level) for level in levels])
    middle = int(np.clip(np.searchsorted(sizes, len(component) // 2), 1, len(levels) - 2))
    separator = levels[middle]
    before = dissect(graph, np.concatenate(levels[:middle]))
    after = dissect(graph, np.concatenate(levels[middle + 1 :]))
    return _Tree(own=np.sort(separator), parts=before + after)


def _levels(graph: Graph, start: int, inside: BoolArray) -> list[IntArray]:
    """Return the blocks reached from `start` within `inside`, by their distance."""
    reached = ~inside
    reached[start] = True
    levels = [np.array([start])]
    while levels[-1].size:
        around = graph.around(levels[-1])
        around = np.unique(around[~reached[around]])
        reached[around] = True
        levels.append(around)
    return levels[:-1]


def _symbolic(graph: Graph, trees: list[_Tree]) -> tuple[Front, ...]:
    """Return the fronts of the trees in postorder, with their boundaries."""
    nodes: list[tuple[_Tree, list[int]]] = []

    def number(tree: _Tree) -> int:
        children = [number(part) for part in tree.parts]
        nodes.append((tree, children))
        return len(nodes) - 1

    for tree in trees:
        number(tree)
    rank = np.empty(len(graph.start) - 1, dtype=np.int64)
    counted = 0
    for tree, _ in nodes:
        rank[tree.own] = counted + np.arange(len(tree.own))
        counted += len(tree.own)
    boundaries: list[IntArray] = []
    parents = np.full(len(nodes), -1)
    for index, (tree, children) in enumerate(nodes):
        met = np.unique(np.concatenate([graph.around(tree.own), *(boundaries[child] for child in children)]))
        met = met[rank[met] > rank[tree.own[-1]]]
        boundaries.append(met[np.argsort(rank[met])])
        parents[children] = index
    return tuple(
        Front(own=tree.own, boundary=boundaries[i], children=tuple(children), parent=int(parents[i]))
        for i, (tree, children) in enumerate(nodes)
    )


class NotPositiveDefiniteError(Exception):
    """A pivot that is not positive: `blocks` are those of the front where it turned up."""

    def __init__(self, blocks: IntArray) -> None:
        super().__init__("the matrix is not positive definite")
        self.blocks = blocks


@dataclass(frozen=True, kw_only=True, eq=False)
class SparseFactor:
    """Cholesky factor, front by front: L11 of the own unknowns, L21 of the boundary's."""

    pattern: Pattern
    own: tuple[FloatArray, ...]
    below: tuple[FloatArray, ...]

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Return N^-1 rhs, (v * size,) or (v * size, r)."""
        x = np.array(rhs, dtype=float)
        size, fronts = self.pattern.size, self.pattern.fronts
        unknowns = [(_expand(front.own, size), _expand(front.boundary, size)) for front in fronts]
        for (own, boundary), L11, L21 in zip(unknowns, self.own, self.below, strict=True):
            x[own] = solve_triangular(L11, x[own], lower=True, check_finite=False)
            x[boundary] -= L21 @ x[own]
        for (own, boundary), L11, L21 in zip(unknowns[::-1], self.own[::-1], self.below[::-1], strict=True):
            x[own] -= L21.T @ x[boundary]
            x[own] = solve_triangular(L11, x[own], lower=True, trans=1, check_finite=False)
        return x

    def selected_inverse(self) -> FloatArray:
        """Return the blocks (e, size, size) of N^-1 of all pairs of the pattern."""
        pattern, size = self.pattern, self.pattern.size
        out = np.empty((len(pattern.pairs), size, size))
        whole: dict[int, FloatArray] = {}  # inverse of the fronts whose children still need it
        waiting = {i: len(front.children) for i, front in enumerate(pattern.fronts)}
        place = np.empty(pattern.count, dtype=np.int64)
        for i in range(len(pattern.fronts) - 1, -1, -1):
            front, L11, L21 = pattern.fronts[i], self.own[i], self.below[i]
            p = len(L11)
            Z = np.empty((p + len(L21), p + len(L21)))
            inverse = solve_triangular(L11, np.eye(p), lower=True, check_finite=False)
            if len(L21):
                parent = pattern.fronts[front.parent]
                place[parent.blocks] = np.arange(len(parent.blocks))
                rows = _expand(place[front.boundary], size)
                Z[p:, p:] = whole[front.parent][np.ix_(rows, rows)]
                G = L21 @ inverse
                Z[p:, :p] = -Z[p:, p:] @ G
                Z[:p, p:] = Z[p:, :p].T
                Z[:p, :p] = inverse.T @ inverse - G.T @ Z[p:, :p]
            else:
                Z[:] = inverse.T @ inverse
            if front.parent >= 0:
                waiting[front.parent] -= 1
                if waiting[front.parent] == 0:
                    del whole[front.parent]
            if front.children:
                whole[i] = Z
            entries, row, column = pattern.assembly[i]
            blocks = Z.reshape(len(Z) // size, size, len(Z) // size, size)
            out[entries] = blocks[row, :, column, :]
        return out


def factorise(pattern: Pattern, values: FloatArray) -> SparseFactor:
    """Return the factor of the matrix with blocks `values` (e, size, size).

    Raises `NotPositiveDefiniteError`.
    """
    size = pattern.size
    diagonal: list[FloatArray] = []
    below: list[FloatArray] = []
    updates: dict[int, FloatArray] = {}
    place = np.empty(pattern.count, dtype=np.int64)
    for i, front in enumerate(pattern.fronts):
        b = len(front.blocks)
        F = np.zeros((b * size, b * size))
        entries, row, column = pattern.assembly[i]
        blocks = F.reshape(b, size, b, size)
        blocks[row, :, column, :] = values[entries]
        blocks[column, :, row, :] = np.swapaxes(values[entries], 1, 2)
        place[front.blocks] = np.arange(b)
        for child in front.children:
            rows = _expand(place[pattern.fronts[child].boundary], size)
            F[np.ix_(rows, rows)] += updates.pop(child)
        p = len(front.own) * size
        try:
            L11 = cholesky(F[:p, :p], lower=True, check_finite=False)
        except LinAlgError as error:
            raise NotPositiveDefiniteError(front.own) from error
        L21 = solve_triangular(L11, F[:p, p:], lower=True, check_finite=False).T
        diagonal.append(L11)
        below.append(np.ascontiguousarray(L21))
        if len(L21):
            updates[i] = F[p:, p:] - L21 @ L21.T
    return SparseFactor(pattern=pattern, own=tuple(diagonal), below=tuple(below))


def _expand(blocks: IntArray, size: int) -> IntArray:
    return (blocks[:, None] * size + np.arange(size)).reshape(-1)
