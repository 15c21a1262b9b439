"""In which order sparse blocks are eliminated: nested dissection, and the dense fronts that follow.

Nested dissection takes out a set of blocks that separates two parts, and divides each part again (George 1973).
Blocks are cut by their places: across each of some directions, where the fewest blocks of one side meet the other.
Those without places have one each in the order of Cuthill and McKee, in which neighbours are near.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, order_of

_LEAF = 16  # blocks: a front of this size is cheaper than another cut
_DIRECTIONS = 4  # of cuts that are tried
_LEAST_PART = 0.15  # of the blocks on the smaller side of a cut
_SHARES = 8  # of the work, which a subtree has one of at most: fewer are left unequal, more leave much above them


Runs = list[tuple[int, int, int]]


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
class Elimination:
    """The order (u,) of elimination of unknowns, and its fronts, children before parents."""

    order: IntArray
    fronts: tuple[Front, ...]

    @classmethod
    def of(cls, count: int, size: int, pairs: IntArray, place: FloatArray | None) -> Elimination:
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
