"""The subtrees of a sparse factor by compiled kernels: each is one call, during which other threads run."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.dense import ROUTINES
from musatpy.adjustment.kernels import compiled_points
from musatpy.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from musatpy.adjustment.kernels import subtrees
    from musatpy.adjustment.sparse import Pattern, Plan


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledSubtrees:
    """The fronts of a plan as kernels have them, and how much room each thread needs for what a subtree leaves."""

    fronts: subtrees.Fronts
    left: int
    inverse: int

    @classmethod
    def of(cls, pattern: Pattern) -> CompiledSubtrees | None:
        """Return those of a pattern, None where numpy does all."""
        if compiled_points(pattern.count) is None:
            return None
        from musatpy.adjustment.kernels.subtrees import Fronts  # numba is there

        plan = pattern.plan
        own, size, parent, columns, pairs = np.array(
            [(f.own, f.size, f.parent, f.columns.start, f.pairs.start) for f in plan.fronts]
        ).T.copy()
        runs: list[list[tuple[int, int, int]]] = [[] for _ in plan.fronts]
        eldest = np.zeros(len(runs), dtype=bool)
        for front in plan.fronts:
            for child, of_child in front.children:
                runs[child] = of_child
            eldest[[child for child, _ in front.children[:1]]] = True
        level = _levels(plan)
        others = size - own
        left, most_left = _room(level, np.square(others))
        inverse, most_inverse = _room(level, np.square(size))
        work = int((own * others)[level >= 0].max(initial=0))  # L21, before the inverses
        fronts = Fronts(
            own=own,
            size=size,
            parent=parent,
            leaf=np.array([not front.children for front in plan.fronts]),
            eldest=eldest,
            columns=columns,
            runs=np.array([*chain.from_iterable(runs)], dtype=np.int64).reshape(-1, 3),
            run=np.cumsum([0, *(len(some) for some in runs)]),
            pairs=np.append(pairs, len(plan.pairs)),
            rows=plan.rows,
            left=left,
            inverse=work + inverse,
        )
        return cls(fronts=fronts, left=most_left, inverse=work + most_inverse)

    def eliminate(self, part: range, store: FloatArray, update: FloatArray) -> int:
        """Factorise a subtree, and set the upper half of the `update` that its root leaves.

        Returns the number of a front that is not positive definite, or -1.
        """
        from musatpy.adjustment.kernels import subtrees

        room = np.empty(self.left)
        return int(
            subtrees.eliminate(part.start, part.stop, self.fronts, store.reshape(-1), room, update, _lapack())
        )

    def invert(self, part: range, store: FloatArray, of_root: FloatArray, blocks: FloatArray) -> None:
        """Set the blocks (e, size, size) of the inverse of a subtree, given that of the boundary of its root."""
        from musatpy.adjustment.kernels import subtrees

        room, flat = np.empty(self.inverse), store.reshape(-1)
        subtrees.invert(part.start, part.stop, self.fronts, flat, room, of_root, blocks, _lapack())


def _lapack() -> subtrees.Lapack:
    from musatpy.adjustment.kernels.subtrees import Lapack

    letters = np.frombuffer(b"LRNT", dtype=np.uint8).copy()
    factors, numbers = np.array([-1.0, 0.0, 1.0]), np.zeros(4, dtype=np.int64)
    return Lapack(routines=ROUTINES, letters=letters, factors=factors, numbers=numbers)


def _levels(plan: Plan) -> IntArray:
    """Return how far each front is below the root of its subtree, -1 of those above the subtrees."""
    level = np.full(len(plan.fronts), -1)
    for part in plan.stages[0]:
        for i in reversed(part):
            level[i] = 0 if i == part[-1] else level[plan.fronts[i].parent] + 1
    return level


def _room(level: IntArray, elements: IntArray) -> tuple[IntArray, int]:
    """Return where in the room of a subtree there is place for so many elements of each front, and all of it.

    There is one of each level at a time.
    """
    most = np.zeros(level.max() + 2, dtype=np.int64)
    np.maximum.at(most, level + 1, np.where(level > 0, elements, 0))  # roots have theirs elsewhere
    bounds = np.cumsum(most)
    return bounds[level], int(bounds[-1])
