"""The fronts of a part of a sparse factor, one by one, by numpy and LAPACK; the twin of the compiled kernels."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from musatpy.adjustment.dense import Columns
from musatpy.adjustment.plans import FrontPlan, Plan
from musatpy.arrays import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """The own columns of some fronts: one after the other in memory (r, size), in the rows of the plan."""

    plan: Plan
    numbers: range
    memory: FloatArray

    @classmethod
    def of(cls, plan: Plan, numbers: range) -> Part:
        """Return zeros for some fronts of a plan."""
        rows = plan.fronts[numbers[-1]].columns.stop - plan.fronts[numbers[0]].columns.start
        return cls(plan=plan, numbers=numbers, memory=np.zeros((rows, plan.rows.shape[1])))

    def own(self, number: int) -> FloatArray:
        """Return the own columns of a front as rows (p, n)."""
        front, begin = self.plan.fronts[number], self.plan.fronts[self.numbers[0]].columns.start
        return self.memory[front.columns.start - begin : front.columns.stop - begin].reshape(front.own, -1)

    @cached_property
    def columns(self) -> list[Columns]:
        """Those of all fronts, for LAPACK."""
        return [Columns(self.own(number).T) for number in self.numbers]


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


@dataclass(frozen=True, kw_only=True, eq=False)
class PlainFronts:
    """The work at parts of a plan."""

    plan: Plan
    room: Room = field(default_factory=Room)

    def enter(self, part: Part, values: FloatArray) -> None:
        """Let the blocks (e, size, size) of a matrix enter the columns of a part."""
        plan, numbers = self.plan, part.numbers
        pairs = slice(plan.fronts[numbers[0]].pairs.start, plan.fronts[numbers[-1]].pairs.stop)
        entering, turned = values[plan.pairs[pairs]], plan.turned[pairs]
        entering[turned] = np.swapaxes(entering[turned], 1, 2)
        part.memory[plan.rows[pairs] - plan.fronts[numbers[0]].columns.start] = entering

    def eliminate(self, part: Part, update: FloatArray) -> int:
        """Factorise the fronts of a part, and add to the `update` that its root leaves.

        Returns the number of a front that is not positive definite, or -1.
        """
        numbers, updates = part.numbers, {part.numbers[-1]: update}
        for i, columns in zip(numbers, part.columns, strict=True):
            if i not in updates:
                updates[i] = self.room.zeros(self.plan.fronts[i])
            for child in self.plan.fronts[i].children:
                if child in updates:
                    self.add_update(child, updates[child], columns.array.T, updates[i])
                    self.room.give(updates.pop(child))
            if not columns.eliminate(updates[i].T):
                return i
        return -1

    def invert(self, part: Part, of_root: FloatArray, out: FloatArray) -> None:
        """Set the inverse of the root of a part, given that of its boundary, and the blocks `out` (e, size, size).

        Of those at the diagonal the upper halves.
        """
        plan, inverses = self.plan, {part.numbers[-1]: of_root}
        for i, columns in zip(reversed(part.numbers), reversed(part.columns), strict=True):
            front, Z = plan.fronts[i], inverses.pop(i)
            columns.invert(Z.T)
            blocks = Z[: front.own].reshape(-1, out.shape[1])[plan.rows[front.pairs] - front.columns.start]
            turned = plan.turned[front.pairs]
            blocks[turned] = np.swapaxes(blocks[turned], 1, 2)
            out[plan.pairs[front.pairs]] = blocks
            for child in front.children:
                if child in part.numbers:
                    inverses[child] = self.room.take(plan.fronts[child].size)
                    self.hand_down(child, Z, inverses[child])
            if Z is not of_root:
                self.room.give(Z)

    def add_update(self, child: int, update: FloatArray, own: FloatArray, left: FloatArray) -> None:
        """Add the `update` that a child leaves to the rows of its parent: `own`, then `left`; upper halves."""
        for number, (first, last, at) in enumerate(runs := self.plan.fronts[child].runs):
            rows, offset = (own, 0) if at < len(own) else (left, len(own))
            for start, end, to in runs[number:]:
                place = rows[at - offset : at - offset + last - first, to - offset : to - offset + end - start]
                place += update[first:last, start:end]

    def hand_down(self, child: int, above: FloatArray, inverse: FloatArray) -> None:
        """Set the inverse of the boundary of a child, behind its own unknowns, from that of its parent `above`.

        Upper halves.
        """
        p = self.plan.fronts[child].own
        for number, (first, last, at) in enumerate(runs := self.plan.fronts[child].runs):
            for start, end, to in runs[number:]:
                inverse[p + first : p + last, p + start : p + end] = above[
                    at : at + last - first, to : to + end - start
                ]

    def forward(self, part: Part, x: FloatArray) -> None:
        """Solve for the own unknowns of a part in the right sides x (u, r), and take them from the others."""
        for i, L in zip(part.numbers, part.columns, strict=True):
            front = self.plan.fronts[i]
            update = L.forward(x[front.eliminated])
            if len(update):
                x[front.boundary] -= update

    def backward(self, part: Part, x: FloatArray) -> None:
        """Solve for the own unknowns of a part in x (u, r), where the others are known."""
        for i, L in zip(reversed(part.numbers), reversed(part.columns), strict=True):
            front = self.plan.fronts[i]
            L.backward(x[front.eliminated], x[front.boundary])
