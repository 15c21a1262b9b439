"""Pass points of IIA that compiled kernels work at: those without a ray through waves."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

from musatpy.adjustment.compiled_points import CompiledRows, split
from musatpy.adjustment.kernels import compiled_points
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.sequence import Part
from musatpy.adjustment.unknowns import State

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
        (at, stations, water), sequence = self.seen(state), self.sequence
        known = self.known(state, state.ground)

        def work(part: Part, sums: points.Sums) -> None:
            self.conditions.add_conditions(part.rows, at, stations, water, known, sequence.pairs, matrix, sums)

        self.add(normals, matrix, work)
