"""One MUSAT-IIA triangulation as a least squares problem: only stations (and levels of groups) are unknown."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from musatpy.adjustment.collinear import add_collinear, eliminate, reduced
from musatpy.adjustment.ground import settle
from musatpy.adjustment.iteration import Linearisation
from musatpy.adjustment.kernels import loops_of
from musatpy.adjustment.kinds import add_direct, direct_squares, largest_movements, state_after
from musatpy.adjustment.network import RAYS, Network, parts_of, together
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.pass_points import (
    diagonally_weighted,
    fully_weighted,
    measured_conditions,
    simple_variances,
)
from musatpy.adjustment.point_loops import Loops
from musatpy.adjustment.propagation import redundancy
from musatpy.adjustment.threads import side_by_side
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.model import Options, Weights

Scale = tuple[FloatArray, ...] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Triangulation:
    """The modified geodetic restraint of a network (ETL-0306 section 3, docs/theory.md).

    States that it sees have their points settled; `apply` settles those that it returns.
    """

    network: Network
    options: Options  # weights and limits
    fixed_scale: Scale = None  # the variances of equal weights, the same for the whole triangulation

    @cached_property
    def _loops(self) -> Loops:
        """Over the points that enter by elimination; pass points by full weights do as well (docs/theory.md)."""
        network = self.network
        groups = network.pass_groups if self.options.weights is Weights.FULL else ()
        return loops_of(network, (*groups, *network.control_groups))

    @cached_property
    def _redundancy(self) -> int:
        return redundancy(self.network)

    def linearise(self, state: State) -> Linearisation:
        """Return the reduced normal equations of stations and levels at `state`."""
        network = self.network
        normals = NormalEquations(network.pattern, network.border.size)
        left, _ = self._loops.eliminate(state, normals, [])
        scale: Scale = None
        if self.options.weights is Weights.FULL:
            parts = parts_of((group for group in left if not group.known), RAYS)
            for sums in side_by_side(partial(fully_weighted, network, state), parts, len(network.photo)):
                normals.add_sums(sums)
        else:
            scale = self.fixed_scale or simple_variances(network, state, self.options.weights)
            for group, variance in zip(network.pass_groups, scale, strict=True):
                conditions = measured_conditions(network, state, group)
                normals.add_sums(diagonally_weighted(network, group, conditions, variance))
        for group in together([group for group in left if group.known]):
            E = eliminate(network, state, group)
            add_collinear(network, group, E, reduced(network, group, E), normals)
        add_direct(network, state, normals)
        matrix, rhs = normals.finished()
        return Linearisation(
            matrix=matrix,
            rhs=rhs,
            objective=self.evaluate(state, scale),
            context=scale,
            redundancy=self._redundancy,
        )

    def evaluate(self, state: State, context: Scale) -> float:
        """Return the weighted sum of squares at `state`."""
        network = self.network
        total = direct_squares(network, state)
        for number, group in enumerate(network.pass_groups):
            if context is None:
                total += float(state.squares[group.point].sum())
            else:
                value = measured_conditions(network, state, group).value
                total += float(np.sum(np.square(value) / context[number]))
        for group in network.control_groups:
            total += float(state.squares[group.point].sum())
        return total if np.isfinite(total) else np.inf

    def apply(self, state: State, step: FloatArray, context: Scale) -> State:
        """Return the state after a step of stations and levels, its points settled again."""
        return self.settled(state_after(self.network, state, step))

    def settled(self, state: State) -> State:
        """Return the state with its points at their optimum."""
        return settle(self.network, state)

    def converged(self, step: FloatArray) -> bool:
        """Return whether the largest differential rotation and translation are below their limits."""
        _, rotation, _, translation = largest_movements(step, self.network)
        return rotation < self.options.rotation_limit and translation < self.options.translation_limit
