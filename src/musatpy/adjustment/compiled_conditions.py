"""Pass points of IIA that compiled kernels work at: those without a ray through waves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.compiled_points import CompiledRows, split
from musatpy.adjustment.ground import MAX_STEPS, RIDGE, ROUNDING, STEP_LIMIT
from musatpy.adjustment.kernels import compiled_points
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.sequence import Part
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from musatpy.adjustment.kernels import points

_TURN = 1e-12  # of a normal: a hundredth of a millimetre on the ground


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledPassPoints(CompiledRows):
    """The pass points of a network whose rays are straight or go through level water, and the `others`."""

    conditions: ModuleType
    others: tuple[PointGroup, ...]

    @classmethod
    def of(cls, network: Network) -> CompiledPassPoints | None:
        """Return the points of a network, None where numpy does all."""
        kernels = compiled_points(network.photos)
        if kernels is None:
            return None
        from musatpy.adjustment.kernels import conditions  # numba is there

        groups, others = split(network, network.pass_groups)
        return cls(kernels=kernels, conditions=conditions, network=network, groups=groups, others=others)

    def add_conditions(self, state: State, normals: NormalEquations, matrix: bool = True) -> None:
        """Add the conditions of the points with full weights, linearised at their adjusted images.

        Without `matrix` to the right sides only.
        """
        (at, stations, water), sequence = self.seen(state), self.sequence
        known = self.known(state, state.ground)

        def work(part: Part, sums: points.Sums) -> None:
            self.conditions.add_conditions(part.rows, at, stations, water, known, sequence.pairs, matrix, sums)

        self.add(normals, matrix, work)

    def settle(
        self, state: State, ground: FloatArray, squares: FloatArray, chosen: BoolArray | None = None
    ) -> float:
        """Take the points, or those `chosen` (p,), to their optimum: set `ground` (p, 3) and their `squares` (p,).

        Returns by how much the squares of all were still to fall by the last step.
        """
        at, stations = self.measured(ground), self.stations(state)
        known, left = self.known(state, ground), np.empty(len(self.sequence.point))

        def work(water: points.Water, part: Part) -> None:
            self.conditions.settle(
                part.rows, at, stations, water, known, RIDGE, MAX_STEPS, STEP_LIMIT, ROUNDING, ground, squares, left
            )

        first = self if chosen is None else self._part(chosen)
        moving, rounds, over = first, 0, self.water(state, ground)
        _, wet, _ = self.sequence.wet(self.network.refracted, self.network.point)
        while moving.groups and rounds < MAX_STEPS:
            moving.of_parts(partial(work, over))
            if not self.network.frame.curved:
                break
            before, over, rounds = over, self.water(state, ground), rounds + 1
            turned = np.zeros(self.network.points, dtype=bool)  # the water over them, which is no plane
            turned[wet[np.nonzero(np.abs(over.normal - before.normal) > _TURN)[0]]] = True
            moving = moving._part(turned)
        return float(left[first.rows].sum())

    def _part(self, chosen: BoolArray) -> CompiledPassPoints:
        """Return those of the points that are `chosen` (p,)."""
        parts = chain.from_iterable(group.some(chosen[group.point]) for group in self.groups)
        return replace(self, groups=tuple(parts))
