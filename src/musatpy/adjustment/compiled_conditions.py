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
from musatpy.arrays import FloatArray

if TYPE_CHECKING:
    from musatpy.adjustment.kernels import points


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
        at, stations, sequence = self.measured(state.ground), self.stations(state), self.sequence
        water, known = self.water(state, state.ground), self.known(state, state.ground)

        def work(part: Part, sums: points.Sums) -> None:
            self.conditions.add_conditions(part.rows, at, stations, water, known, sequence.pairs, matrix, sums)

        self.add(normals, matrix, work)

    def settle(self, state: State, ground: FloatArray, squares: FloatArray) -> float:
        """Take the points to their optimum: set `ground` (p, 3) and their `squares` (p,).

        Returns by how much the squares of all were still to fall by the last step.
        """
        at, stations = self.measured(ground), self.stations(state)
        known, left = self.known(state, ground), np.empty(len(self.sequence.point))

        def work(water: points.Water, part: Part) -> None:
            self.conditions.settle(
                part.rows, at, stations, water, known, RIDGE, MAX_STEPS, STEP_LIMIT, ROUNDING, ground, squares, left
            )

        moving, rounds = self, 0
        while moving.groups and rounds < MAX_STEPS:
            before, rounds = ground.copy(), rounds + 1
            moving.of_parts(partial(work, self.water(state, ground)))
            moving = moving._under_other_water(before, ground)
        return float(left[self.rows].sum())

    def _under_other_water(self, before: FloatArray, ground: FloatArray) -> CompiledPassPoints:
        """Return the points with wet rays that have moved from `before` (p, 3).

        The water is no plane, and its normals are others there.
        """
        refracted = self.network.refracted
        moved = np.abs(ground - before).max(axis=1) >= STEP_LIMIT
        wet = [group.some(moved[group.point] & refracted[group.rays].any(axis=1)) for group in self.groups]
        return replace(self, groups=tuple(chain.from_iterable(wet)))
