"""The fronts of a part of a sparse factor by compiled kernels: in one call, during which other threads run."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.dense import ROUTINES
from musatpy.adjustment.plain_fronts import Part
from musatpy.adjustment.plans import Plan
from musatpy.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from musatpy.adjustment.kernels import subtrees


@dataclass(frozen=True, kw_only=True, eq=False)
class Tables:
    """The fronts of a plan as kernels have them.

    With how much room a thread needs for what fronts leave to each other, for their inverses, and the most unknowns
    that a front has besides its own. Rooms that are free are kept by their sizes: fresh memory costs as much as
    small fronts.
    """

    fronts: subtrees.Fronts
    left: int
    inverse: int
    others: int
    rooms: dict[int, list[FloatArray]] = field(default_factory=lambda: defaultdict(list), repr=False)

    def runs_of(self, child: int) -> IntArray:
        """Return the runs (r, 3) of the boundary of a front in its parent."""
        return self.fronts.runs[self.fronts.run[child] : self.fronts.run[child + 1]]


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledFronts:
    """The work at parts of a plan, as `PlainFronts` does it."""

    tables: Tables

    def enter(self, part: Part, values: FloatArray) -> None:
        """Let the blocks (e, size, size) of a matrix enter the columns of a part."""
        from musatpy.adjustment.kernels import subtrees

        numbers = part.numbers
        subtrees.enter(numbers.start, numbers.stop, self.tables.fronts, np.ascontiguousarray(values), part.memory)

    def eliminate(self, part: Part, update: FloatArray) -> int:
        """Factorise the fronts of a part, and add to the `update` that its root leaves.

        Returns the number of a front that is not positive definite, or -1.
        """
        from musatpy.adjustment.kernels import subtrees

        numbers, memory, room = part.numbers, part.memory.reshape(-1), self._room(self.tables.left)
        failed = subtrees.eliminate(
            numbers.start, numbers.stop, self.tables.fronts, memory, room, update, _lapack()
        )
        self._give(room)
        return int(failed)

    def invert(self, part: Part, of_root: FloatArray, out: FloatArray) -> None:
        """Set the inverse of the root of a part, given that of its boundary, and the blocks `out` (e, size, size).

        Of those at the diagonal the upper halves.
        """
        from musatpy.adjustment.kernels import subtrees

        numbers, memory, room = part.numbers, part.memory.reshape(-1), self._room(self.tables.inverse)
        subtrees.invert(numbers.start, numbers.stop, self.tables.fronts, memory, room, of_root, out, _lapack())
        self._give(room)

    def add_update(self, child: int, update: FloatArray, own: FloatArray, left: FloatArray) -> None:
        """Add the `update` that a child leaves to the rows of its parent: `own`, then `left`; upper halves."""
        from musatpy.adjustment.kernels import subtrees

        subtrees.add_update(update, self.tables.runs_of(child), own, left)

    def hand_down(self, child: int, above: FloatArray, inverse: FloatArray) -> None:
        """Set the inverse of the boundary of a child, behind its own unknowns, from that of its parent `above`.

        Upper halves.
        """
        from musatpy.adjustment.kernels import subtrees

        subtrees.hand_down(above, self.tables.runs_of(child), inverse, self.tables.fronts.own[child])

    def forward(self, part: Part, x: FloatArray) -> None:
        """Solve for the own unknowns of a part in the right sides x (u, r), and take them from the others."""
        from musatpy.adjustment.kernels import subtrees

        numbers, memory, room = part.numbers, part.memory.reshape(-1), np.empty(self.tables.others * x.shape[1])
        subtrees.forward(numbers.start, numbers.stop, self.tables.fronts, memory, room, x, _lapack())

    def backward(self, part: Part, x: FloatArray) -> None:
        """Solve for the own unknowns of a part in x (u, r), where the others are known."""
        from musatpy.adjustment.kernels import subtrees

        numbers, memory, room = part.numbers, part.memory.reshape(-1), np.empty(self.tables.others * x.shape[1])
        subtrees.backward(numbers.start, numbers.stop, self.tables.fronts, memory, room, x, _lapack())

    def _room(self, elements: int) -> FloatArray:
        try:
            return self.tables.rooms[elements].pop()
        except IndexError:
            return np.empty(elements)

    def _give(self, room: FloatArray) -> None:
        self.tables.rooms[len(room)].append(room)


def tables_of(plan: Plan) -> Tables:
    """Return the tables of a plan."""
    from musatpy.adjustment.kernels.subtrees import Fronts  # numba is there

    own, size, parent, start, columns, pairs = np.array(
        [(f.own, f.size, f.parent, f.eliminated.start, f.columns.start, f.pairs.start) for f in plan.fronts]
    ).T.copy()
    eldest = np.zeros(len(own), dtype=bool)
    eldest[[child for front in plan.fronts for child in front.children[:1]]] = True
    level, others = _levels(plan), size - own
    left, most_left = _places(level, np.square(others))
    inverse, most_inverse = _places(level, np.square(size))
    product = int((own * others).max())
    fronts = Fronts(
        own=own,
        size=size,
        parent=parent,
        leaf=np.array([not front.children for front in plan.fronts]),
        eldest=eldest,
        start=start,
        boundary=np.concatenate([front.boundary for front in plan.fronts]),
        other=np.cumsum([0, *others]),
        columns=columns,
        runs=np.array([*chain.from_iterable(f.runs for f in plan.fronts)], dtype=np.int64).reshape(-1, 3),
        run=np.cumsum([0, *(len(front.runs) for front in plan.fronts)]),
        pairs=np.append(pairs, len(plan.pairs)),
        order=plan.pairs,
        turned=plan.turned,
        rows=plan.rows,
        left=left,
        inverse=product + inverse,
    )
    return Tables(fronts=fronts, left=most_left, inverse=product + most_inverse, others=int(others.max()))


def _lapack() -> subtrees.Lapack:
    from musatpy.adjustment.kernels.subtrees import Lapack

    letters = np.frombuffer(b"LRNT", dtype=np.uint8).copy()
    factors, numbers = np.array([-1.0, 0.0, 1.0]), np.zeros(6, dtype=np.int64)
    return Lapack(routines=ROUTINES, letters=letters, factors=factors, numbers=numbers)


def _levels(plan: Plan) -> IntArray:
    """Return how far each front is below the root of its part."""
    level = np.zeros(len(plan.fronts), dtype=np.int64)
    for part in plan.stages[0]:
        for i in reversed(part[:-1]):
            level[i] = level[plan.fronts[i].parent] + 1
    return level


def _places(level: IntArray, elements: IntArray) -> tuple[IntArray, int]:
    """Return where in the room of a part there is place for so many elements of each front, and all of it.

    There is one of each level at a time; roots have theirs elsewhere.
    """
    most = np.zeros(level.max() + 1, dtype=np.int64)
    np.maximum.at(most, level, np.where(level > 0, elements, 0))
    ends = np.cumsum(most)
    return (ends - most)[level], int(ends[-1])
