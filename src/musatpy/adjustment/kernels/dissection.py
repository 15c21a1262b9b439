"""Nested dissection of blocks by their places, and what their fronts leave, in one call each.

The twins are `ordering.dissect_by_place` and `ordering.fronts_of`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.compiling import compiled


class Graph(NamedTuple):
    """Who meets whom of v blocks: neighbours of i are `neighbours[start[i]:start[i + 1]]`."""

    start: IntArray  # (v + 1,)
    neighbours: IntArray


class Parts(NamedTuple):
    """The parts of v blocks, each somewhere in `blocks` and in `along`, and what is worked with."""

    label: IntArray  # (v,) of the part that each block is in, of its own once it separates others
    blocks: IntArray  # (v,) ascending in each part
    along: IntArray  # (a, v) blocks by their places along axes
    side: IntArray  # (v,) 0 below a cut, 1 above, 2 where it separates these
    rank: IntArray  # (v, a) of each block among those of its part
    reach: IntArray  # (a, v) how many of a part have their farthest neighbour, or themselves, at each rank


@compiled
def _best_cut(
    low: int, high: int, graph: Graph, place: FloatArray, share: float, parts: Parts
) -> tuple[int, float]:
    """Return the axis and the place of the cut of a part where the fewest blocks separate it, -1 where none does.

    `ordering._sides`.
    """
    count, axes = high - low, len(place)
    farthest = np.empty(axes, dtype=np.int64)
    for a in range(axes):
        for k in range(count):
            parts.rank[parts.along[a, low + k], a] = k
            parts.reach[a, k] = 0
    for block in parts.blocks[low:high]:
        farthest[:] = parts.rank[block]
        for n in range(graph.start[block], graph.start[block + 1]):
            other = graph.neighbours[n]
            if parts.label[other] == parts.label[block]:
                for a in range(axes):
                    farthest[a] = max(farthest[a], parts.rank[other, a])
        for a in range(axes):
            parts.reach[a, farthest[a]] += 1
    least = int(np.ceil(share * count))
    axis, at, lowest = -1, 0.0, np.inf
    for a in range(axes):
        beyond = 0
        for cut in range(1, count - least + 1):
            beyond += parts.reach[a, cut - 1]
            if cut < least:
                continue
            cost = (cut - beyond + 1.0) / (cut * (count - cut))
            above = place[a, parts.along[a, low + cut]]
            if cost < lowest and place[a, parts.along[a, low + cut - 1]] != above:  # equal places stay on one side
                axis, at, lowest = a, above, cost
    return axis, at


@compiled
def _divide(
    low: int, high: int, graph: Graph, place: FloatArray, cut: float, parts: Parts, room: IntArray
) -> tuple[int, int]:
    """Divide a part by a cut: blocks below it first, then those above, then those that separate them.

    Returns where the second and the third begin. All stay in their order.
    """
    size = np.zeros(3, dtype=np.int64)
    for block in parts.blocks[low:high]:
        side = 1 if place[block] >= cut else 0
        for n in range(graph.start[block], graph.start[block + 1]):
            other = graph.neighbours[n]
            if side == 0 and parts.label[other] == parts.label[block] and place[other] >= cut:
                side = 2
        parts.side[block] = side
        size[side] += 1
    for row in range(len(parts.along) + 1):
        of = parts.blocks[low:high] if row == len(parts.along) else parts.along[row, low:high]
        at = np.array([0, size[0], size[0] + size[1]])
        for block in of:
            room[at[parts.side[block]]] = block
            at[parts.side[block]] += 1
        of[:] = room[: high - low]
    return low + size[0], low + size[0] + size[1]


@compiled
def dissect(
    graph: Graph, place: FloatArray, along: IntArray, leaf: int, share: float
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the blocks in the order of their elimination, where each front begins there, and its parent, or -1.

    Places (a, v) are along axes, where the blocks are in the order `along` (a, v). There is no order where all
    blocks of a part have one place.
    """
    count = place.shape[1]
    order, room, placed = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64), 0
    parts = Parts(
        label=np.zeros(count, dtype=np.int64),
        blocks=np.arange(count),
        along=along,
        side=np.empty(count, dtype=np.int64),
        rank=np.empty((count, len(place)), dtype=np.int64),
        reach=np.empty(place.shape, dtype=np.int64),
    )
    first, parent, labels = [0], [0][:0], 0
    todo = [(0, count, -1)]  # parts, and what separates parts that come before: from which front on these begin
    while todo:
        low, high, children = todo.pop()
        if children < 0 and high - low > leaf:
            axis, cut = _best_cut(low, high, graph, place, share, parts)
            if axis < 0:
                return order[:0], np.array(first), np.array(parent)
            middle, end = _divide(low, high, graph, place[axis], cut, parts, room)
            for k in range(low, end):
                parts.label[parts.blocks[k]] = labels + (1 if k < middle else 2)
            for k in range(end, high):
                parts.label[parts.blocks[k]] = -1 - parts.blocks[k]
            labels += 2
            todo.append((end, high, len(parent)))
            todo.append((middle, end, -1))
            todo.append((low, middle, -1))
        elif high > low:
            order[placed : placed + high - low] = parts.blocks[low:high]
            placed += high - low
            for child in range(children if children >= 0 else len(parent), len(parent)):
                if parent[child] < 0:
                    parent[child] = len(parent)
            first.append(placed)
            parent.append(-1)
    return order, np.array(first), np.array(parent)


@compiled
def boundaries(graph: Graph, order: IntArray, first: IntArray, parent: IntArray) -> tuple[IntArray, IntArray]:
    """Return the boundaries of fronts one after the other, ascending by elimination, and where each begins."""
    fronts = len(parent)
    rank, met = np.empty(len(order), dtype=np.int64), np.full(len(order), -1)
    rank[order] = np.arange(len(order))
    eldest, next_one = np.full(fronts, -1), np.full(fronts, -1)
    for child in range(fronts - 1, -1, -1):
        if parent[child] >= 0:
            next_one[child] = eldest[parent[child]]
            eldest[parent[child]] = child
    out, bounds = [0][:0], np.zeros(fronts + 1, dtype=np.int64)
    for front in range(fronts):
        end = first[front + 1]
        for block in order[first[front] : end]:
            for n in range(graph.start[block], graph.start[block + 1]):
                other = rank[graph.neighbours[n]]
                if other >= end and met[other] != front:
                    met[other] = front
                    out.append(other)
        child = eldest[front]
        while child >= 0:
            for k in range(bounds[child], bounds[child + 1]):
                other = out[k]
                if other >= end and met[other] != front:
                    met[other] = front
                    out.append(other)
            child = next_one[child]
        own = np.array(out[bounds[front] :])
        own.sort()
        for k in range(len(own)):
            out[bounds[front] + k] = own[k]
        bounds[front + 1] = len(out)
    return order[np.array(out)], bounds
