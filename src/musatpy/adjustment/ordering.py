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


def dissect_by_place(graph: Graph, place: FloatArray) -> list[Tree]:
    """Return the trees of a nested dissection of blocks at places (v, 3), by cuts in the plane of their extent."""
    middle = place - place.mean(axis=0)
    plane = np.linalg.eigh(middle.T @ middle)[1][:, :0:-1]
    turn = np.arange(_DIRECTIONS) * np.pi / _DIRECTIONS  # the axes of a square are any: its rows may lie between
    place = middle @ plane @ np.stack([np.cos(turn), np.sin(turn)])
    start = np.repeat(np.arange(len(place)), np.diff(graph.start))
    return list(_halved(graph, np.arange(len(place)), start, graph.neighbours, place))


def _halved(graph: Graph, blocks: IntArray, i: IntArray, j: IntArray, place: FloatArray) -> Iterator[Tree]:
    """Yield the trees of some blocks, whose neighbours among them are the pairs i, j (both ways)."""
    if len(blocks) <= _LEAF:
        yield from [Tree(own=blocks)] if len(blocks) else []
        return
    side = np.zeros(len(place), dtype=np.int8)
    side[blocks] = _sides(blocks, i, j, place)
    own = blocks[side[blocks] == 0]
    if len(own) == len(blocks):  # one place for all
        yield from dissect(graph, blocks)
        return
    parts = []
    for half in (-1, 1):
        inside = (side[i] == half) & (side[j] == half)
        parts += list(_halved(graph, blocks[side[blocks] == half], i[inside], j[inside], place))
    if len(own):
        yield Tree(own=own, parts=parts)
    else:
        yield from parts


def _sides(blocks: IntArray, i: IntArray, j: IntArray, place: FloatArray) -> IntArray:
    """Return the halves (b,) of blocks, -1 and 1, and 0 of those that separate them: all where no cut does.

    At a cut of an axis those of the lower side separate that have a neighbour beyond it: as many as have their
    place below it, less those whose farthest neighbour is below it too.
    """
    least = int(np.ceil(_LEAST_PART * len(blocks)))
    best, sides = np.inf, np.zeros(len(blocks), dtype=np.int64)
    reached = place.copy()
    if len(i):
        start = np.flatnonzero(np.diff(i, prepend=-1))  # the pairs are sorted by i
        reached[i[start]] = np.maximum(place[i[start]], np.maximum.reduceat(place[j], start))
    for axis in range(place.shape[1]):
        along, farthest = place[:, axis], reached[:, axis]
        ordered, reach = np.sort(along[blocks]), np.sort(farthest[blocks])
        cuts = np.arange(least, len(blocks) - least + 1)
        cuts = cuts[ordered[cuts - 1] < ordered[cuts]]  # equal places stay on one side
        if not len(cuts):
            continue
        width = cuts - np.searchsorted(reach, ordered[cuts])
        cost = (width + 1.0) / (cuts * (len(blocks) - cuts))  # narrow cuts, and halves alike
        least_cost = int(cost.argmin())
        if cost[least_cost] < best:
            best, cut = float(cost[least_cost]), ordered[cuts[least_cost]]
            lower = along[blocks] < cut
            sides = np.where(lower, np.where(farthest[blocks] >= cut, 0, -1), 1)
    return sides
