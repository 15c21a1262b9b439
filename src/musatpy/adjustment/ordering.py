"""In which order sparse blocks are eliminated: nested dissection of their graph, and the fronts that follow.

Nested dissection splits the graph of blocks by a set of blocks that separates two parts, and each part again.
Blocks that have places are split by these: across each axis, where the fewest blocks of one side meet the other;
those without places by levels of distance in the graph.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray

_LEAF = 16  # blocks: a front of this size is cheaper than another split
_DIRECTIONS = 4  # of cuts that are tried
_LEAST_PART = 0.15  # of the blocks on the smaller side of a cut by positions


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


@dataclass
class Tree:
    """A set of blocks to eliminate after those of its parts."""

    own: IntArray
    parts: list[Tree] = field(default_factory=list)


def dissect(graph: Graph, blocks: IntArray) -> list[Tree]:
    """Return the trees of a nested dissection of `blocks`, one for each connected component."""
    trees, inside = [], np.zeros(len(graph.start) - 1, dtype=bool)
    inside[blocks] = True
    left = inside.copy()
    while left.any():
        component = np.concatenate(_levels(graph, int(left.argmax()), inside))
        left[component] = False
        trees.append(_split(graph, component))
    return trees


def _split(graph: Graph, component: IntArray) -> Tree:
    if len(component) <= _LEAF:
        return Tree(own=np.sort(component))
    inside = np.zeros(len(graph.start) - 1, dtype=bool)
    inside[component] = True
    # twice to the farthest block: the levels of a long component are then its narrow cross sections
    levels = _levels(graph, int(component[0]), inside)
    for _ in range(2):
        levels = _levels(graph, int(levels[-1][0]), inside)
    if len(levels) < 3:
        return Tree(own=np.sort(component))
    sizes = np.cumsum([len(level) for level in levels])
    middle = int(np.clip(np.searchsorted(sizes, len(component) // 2), 1, len(levels) - 2))
    separator = levels[middle]
    before = dissect(graph, np.concatenate(levels[:middle]))
    after = dissect(graph, np.concatenate(levels[middle + 1 :]))
    return Tree(own=np.sort(separator), parts=before + after)


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


def fronts_of(graph: Graph, trees: list[Tree]) -> tuple[Front, ...]:
    """Return the fronts of the trees in postorder, with their boundaries."""
    nodes: list[tuple[Tree, list[int]]] = []

    def number(tree: Tree) -> int:
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
    eliminated = np.concatenate([tree.own for tree, _ in nodes])
    boundaries: list[IntArray] = []  # as ranks
    parents = np.full(len(nodes), -1)
    for index, (tree, children) in enumerate(nodes):
        met = np.concatenate([rank[graph.around(tree.own)], *(boundaries[child] for child in children)])
        boundaries.append(np.unique(met[met > rank[tree.own[-1]]]))
        parents[children] = index
    return tuple(
        Front(own=tree.own, boundary=eliminated[boundary], children=tuple(children), parent=parent)
        for (tree, children), boundary, parent in zip(nodes, boundaries, parents.tolist(), strict=True)
    )


def dissect_by_place(graph: Graph, place: FloatArray) -> list[Tree]:
    """Return the trees of a nested dissection of blocks at places (v, 3), by cuts in the plane of their extent."""
    along = _along_axes(place)
    start = np.repeat(np.arange(len(place)), np.diff(graph.start))
    return list(_halved(graph, np.arange(len(place)), start, graph.neighbours, along))


def fronts_by_kernels(graph: Graph, place: FloatArray) -> tuple[Front, ...]:
    """Return the fronts of the same dissection, by compiled kernels."""
    from musatpy.adjustment.kernels import dissection  # numba is there

    of_kernels, along = dissection.Graph(graph.start, graph.neighbours), _along_axes(place)
    order, first, parent = dissection.dissect(of_kernels, along, np.argsort(along), _LEAF, _LEAST_PART)
    if not len(order):  # blocks of one place stand in the way
        return fronts_of(graph, dissect_by_place(graph, place))
    boundary, begin = dissection.boundaries(of_kernels, order, first, parent)
    children: list[list[int]] = [[] for _ in parent]
    for child, front in enumerate(parent.tolist()):
        if front >= 0:
            children[front].append(child)
    own, boundaries = np.split(order, first[1:-1]), np.split(boundary, begin[1:-1])
    return tuple(
        Front(own=mine, boundary=others, children=tuple(some), parent=front)
        for mine, others, some, front in zip(own, boundaries, children, parent.tolist(), strict=True)
    )


def _along_axes(place: FloatArray) -> FloatArray:
    """Return places (v, 3) along the axes (a, v) that cuts are tried across."""
    middle = place - place.mean(axis=0)
    plane = np.linalg.eigh(middle.T @ middle)[1][:, :0:-1]
    turn = np.arange(_DIRECTIONS) * np.pi / _DIRECTIONS  # the axes of a square are any: its rows may lie between
    return np.stack([np.cos(turn), np.sin(turn)], axis=1) @ (middle @ plane).T


def _halved(graph: Graph, blocks: IntArray, i: IntArray, j: IntArray, place: FloatArray) -> Iterator[Tree]:
    """Yield the trees of some blocks (b,), which have places (a, b) along axes.

    Their neighbours among them are the pairs i, j of their numbers here (both ways), ascending by i.
    """
    if len(blocks) <= _LEAF:
        yield from [Tree(own=blocks)] if len(blocks) else []
        return
    side = _sides(i, j, place)
    own = blocks[side == 0]
    if len(own) == len(blocks):  # one place for all
        yield from dissect(graph, blocks)
        return
    of_pair = np.where(side[i] == side[j], side[i], 0)
    parts: list[Tree] = []
    for half in (-1, 1):
        mine = np.flatnonzero(side == half)
        number, inside = np.empty(len(side), dtype=np.int64), np.flatnonzero(of_pair == half)
        number[mine] = np.arange(len(mine))
        parts += _halved(graph, blocks[mine], number[i[inside]], number[j[inside]], place[:, mine])
    if len(own):
        yield Tree(own=own, parts=parts)
    else:
        yield from parts


def _sides(i: IntArray, j: IntArray, place: FloatArray) -> IntArray:
    """Return the halves (b,) of blocks, -1 and 1, and 0 of those that separate them: all where no cut does.

    At a cut of an axis those of the lower side separate that have a neighbour beyond it: as many as have their
    place below it, less those whose farthest neighbour is below it too.
    """
    count = place.shape[1]
    least = int(np.ceil(_LEAST_PART * count))
    farthest = place.copy()
    if len(i):
        start = np.flatnonzero(np.diff(i, prepend=-1))
        neighbour = np.maximum.reduceat(place[:, j], start, axis=1)
        farthest[:, i[start]] = np.maximum(place[:, i[start]], neighbour)
    ordered, reach = np.sort(place), np.sort(farthest)
    cuts = np.arange(least, count - least + 1)
    beyond = [np.searchsorted(of_axis, at[cuts]) for of_axis, at in zip(reach, ordered, strict=True)]
    cost = (cuts - beyond + 1.0) / (cuts * (count - cuts))  # narrow cuts, and halves alike
    cost[ordered[:, cuts - 1] == ordered[:, cuts]] = np.inf  # equal places stay on one side
    axis, best = np.unravel_index(cost.argmin(), cost.shape)
    if np.isinf(cost[axis, best]):
        return np.zeros(count, dtype=np.int64)
    cut = ordered[axis, cuts[best]]
    return np.where(place[axis] < cut, np.where(farthest[axis] >= cut, np.int8(0), np.int8(-1)), np.int8(1))
