"""Points taken to their optimum for given stations by compiled kernels: those without a ray through waves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.compiled_points import CompiledRows, split
from musatpy.adjustment.ground import MAX_STEPS, RIDGE, ROUNDING, STEP_LIMIT, hold
from musatpy.adjustment.kernels import compiled_points
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.sequence import Part
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from musatpy.adjustment.kernels import points

LIMITS = (RIDGE, MAX_STEPS, STEP_LIMIT, ROUNDING)  # of the kernel
TURN = 1e-12  # of a normal, or of the vertical: a hundredth of a millimetre on the ground


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledSettling(CompiledRows):
    """The eliminated points of a network whose rays are straight or go through level water, and the `others`."""

    conditions: ModuleType
    others: tuple[PointGroup, ...]

    @classmethod
    def of(cls, network: Network) -> CompiledSettling | None:
        """Return the points of a network, None where numpy does all."""
        kernels = compiled_points(network.photos)
        if kernels is None:
            return None
        from musatpy.adjustment.kernels import conditions  # numba is there

        groups, others = split(network, (*network.pass_groups, *network.control_groups))
        return cls(kernels=kernels, conditions=conditions, network=network, groups=groups, others=others)

    def settle(self, state: State, ground: FloatArray, squares: FloatArray) -> None:
        """Take the points to their optimum: set `ground` (p, 3) and their `squares` (p,).

        The water over points, and what is known of them, are taken as planes: where these turn, points go on from
        there.
        """
        at, stations, falls = self.measured(ground), self.stations(state), np.empty((len(self.sequence.point), 2))

        def work(water: points.Water, known: points.Known, part: Part) -> None:
            self.conditions.settle(part.rows, at, stations, water, known, *LIMITS, ground, squares, falls)

        moving, rounds = self, 0
        over, known = self.water(state, ground), self.known(state, ground)
        while moving.groups and rounds < MAX_STEPS:
            moving.of_parts(partial(work, over, known))
            self._hold(ground, at)
            if not self.network.frame.curved:
                break
            before, over, rounds = (over, known), self.water(state, ground), rounds + 1
            known = self.known(state, ground)
            moving = moving._part(self._turned(before, (over, known)))

    def _hold(self, ground: FloatArray, at: points.Measured) -> None:
        """Put held components of points back exactly."""
        rows = self.known_rows
        point = self.sequence.point[rows]
        ground[point] = at.ground[rows] = hold(self.network, point, ground[point])

    def _turned(
        self, before: tuple[points.Water, points.Known], after: tuple[points.Water, points.Known]
    ) -> BoolArray:
        """Return which points (p,) have water over them, or a vertical, that is not as it was."""
        _, wet, _ = self.sequence.wet(self.network.refracted, self.network.point)
        known, turned = self.sequence.point[self.known_rows], np.zeros(self.network.points, dtype=bool)
        (water, of_points), (water_after, of_points_after) = before, after
        turned[wet[np.nonzero(np.abs(water_after.normal - water.normal) > TURN)[0]]] = True
        turned[known[np.nonzero(np.abs(of_points_after.axes - of_points.axes) > TURN)[0]]] = True
        return turned

    def _part(self, chosen: BoolArray) -> CompiledSettling:
        """Return those of the points that are `chosen` (p,)."""
        parts = chain.from_iterable(group.some(chosen[group.point]) for group in self.groups)
        return replace(self, groups=tuple(parts))
