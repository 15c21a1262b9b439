"""How a sparse factor goes from front to front: what enters each, what it hands on, and which threads can share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from musatpy.adjustment.ordering import Front
from musatpy.arrays import BoolArray, IntArray, order_of

Runs = list[tuple[int, int, int]]

_SHARES = 8  # of the work, which a subtree has one of at most: fewer are left unequal, more leave much above them


@dataclass(frozen=True, kw_only=True, eq=False)
class FrontPlan:
    """A front of `size` unknowns, of which the first `own` are eliminated there.

    pairs: those of the plan that enter it; columns: its own columns in the rows of the plan; eliminated: its own
    unknowns in the order of elimination, boundary: the others in it. Runs of the boundary in the unknowns of the
    parent: first and last here, and where they begin there.
    """

    own: int
    size: int
    pairs: slice
    columns: slice
    eliminated: slice
    boundary: IntArray
    runs: Runs
    children: tuple[int, ...]
    parent: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """The fronts of a pattern, and where its blocks are in their own columns.

    Front by front, of every own unknown the unknowns of the front, in rows of `size`: the lower half of the matrix.
    """

    fronts: tuple[FrontPlan, ...]
    shared: bool  # threads share the work at it
    pairs: IntArray  # (e,) rows of the pairs, front by front
    turned: BoolArray  # (e,) whether the second block of the pair is eliminated before the first
    rows: IntArray  # (e, size) where the rows of each block are, of those turned its columns

    @classmethod
    def of(cls, fronts: tuple[Front, ...], pairs: IntArray, size: int, *, shared: bool) -> Plan:
        """Return the plan of fronts for pairs of blocks (e, 2), which have so many unknowns each."""
        count = sum(len(front.own) for front in fronts)
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

        i, j = rank[pairs.T]
        order = order_of(owner[np.minimum(i, j)])
        i, j = i[order], j[order]
        column, row = np.minimum(i, j), np.maximum(i, j)
        front = owner[column]
        columns = _bounds(own * size * blocks)
        rows = columns[front] + place(front, column) * size * blocks[front] + place(front, row)
        entering, eliminated, cut = _bounds(np.bincount(front)), _bounds(own) * size, _bounds(others)
        runs = _runs(place(parent[child], boundary), own[parent[child]], cut, size)
        plans = tuple(
            FrontPlan(
                own=int(own[k]) * size,
                size=int(blocks[k]) * size,
                pairs=slice(entering[k], entering[k + 1]),
                columns=slice(columns[k], columns[k + 1]),
                eliminated=slice(eliminated[k], eliminated[k + 1]),
                boundary=expand(boundary[cut[k] : cut[k + 1]], size),
                runs=runs[k],
                children=front.children,
                parent=front.parent,
            )
            for k, front in enumerate(fronts)
        )
        return cls(
            fronts=plans,
            shared=shared,
            pairs=order,
            turned=i > j,
            rows=rows[:, None] + blocks[front, None] * np.arange(size),
        )

    @cached_property
    def stages(self) -> list[list[range]]:
        """Fronts that threads work at side by side, stage by stage: subtrees, then those above them by height.

        Where they do not share the work, whole trees.
        """
        work = np.array([front.own * front.size**2 for front in self.fronts], dtype=float)
        first = np.arange(len(work))  # front of each subtree: it is numbered before its root
        for i, front in enumerate(self.fronts):
            for child in front.children:
                first[i] = min(first[i], first[child])
                work[i] += work[child]
        every = work[[front.parent < 0 for front in self.fronts]].sum()
        largest = every / _SHARES if self.shared else every
        stages: list[list[range]] = [[]]
        height = np.zeros(len(work), dtype=int)
        for i, front in enumerate(self.fronts):
            if work[i] > largest:
                height[i] = 1 + max((height[child] for child in front.children), default=0)
                stages += [[]] if height[i] == len(stages) else []
                stages[height[i]].append(range(i, i + 1))
            elif front.parent < 0 or work[front.parent] > largest:
                stages[0].append(range(int(first[i]), i + 1))
        return stages


def _bounds(sizes: IntArray) -> IntArray:
    """Return where things of these sizes begin one after the other, and the end."""
    return np.concatenate([[0], np.cumsum(sizes)])


def _runs(place: IntArray, own: IntArray, cut: IntArray, size: int) -> list[Runs]:
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


def expand(blocks: IntArray, size: int) -> IntArray:
    """Return the numbers of the unknowns of blocks."""
    return (blocks[:, None] * size + np.arange(size)).reshape(-1)
