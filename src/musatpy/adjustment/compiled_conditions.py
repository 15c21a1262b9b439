"""Pass points of IIA that compiled kernels work at: those with dry rays alone."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.compiled_points import CompiledRows
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
    """The pass points of a network with straight rays, and the others, with a `wet` ray."""

    conditions: ModuleType
    wet: tuple[PointGroup, ...]

    @classmethod
    def of(cls, network: Network) -> CompiledPassPoints | None:
        """Return the points of a network, None where numpy does all."""
        kernels = compiled_points(network.photos)
        if kernels is None:
            return None
        from musatpy.adjustment.kernels import conditions  # numba is there

        wet = [np.asarray(network.refracted[group.rays].any(axis=1)) for group in network.pass_groups]
        parts = list(zip(network.pass_groups, wet, strict=True))
        return cls(
            kernels=kernels,
            conditions=conditions,
            network=network,
            groups=tuple(group.part(~of_group) for group, of_group in parts if not of_group.all()),
            wet=tuple(group.part(of_group) for group, of_group in parts if of_group.any()),
        )

    def add_conditions(self, state: State, normals: NormalEquations, matrix: bool = True) -> None:
        """Add the conditions of the points with full weights, linearised at their adjusted images.

        Without `matrix` to the right sides only.
        """
        at, stations, sequence = self.measured(state.ground), self.stations(state), self.sequence

        def work(part: Part, sums: points.Sums) -> None:
            self.conditions.add_conditions(part.rows, at, stations, sequence.pairs, matrix, sums)

        self.add(normals, matrix, work)

    def settle(self, state: State, ground: FloatArray, squares: FloatArray) -> float:
        """Take the points to their optimum: set `ground` (p, 3) and their `squares` (p,).

        Returns by how much the squares of all were still to fall by the last step.
        """
        at, stations, rows = self.measured(ground), self.stations(state), self.rows
        water, known, left = (
            self.water(state, ground),
            self.known(state, ground),
            np.empty(len(self.sequence.point)),
        )
        self.of_parts(
            lambda part: self.conditions.settle(
                part.rows, at, stations, water, known, RIDGE, MAX_STEPS, STEP_LIMIT, ROUNDING, squares, left
            )
        )
        return float(left[rows].sum())
