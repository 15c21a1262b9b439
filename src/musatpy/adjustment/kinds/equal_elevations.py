"""Points of equal elevation: observed at the level of their group, which is unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds.kind import Unknown
from musatpy.adjustment.kinds.prior import Prior
from musatpy.adjustment.network import Network
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_surface import WaterKnowledge
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray
from musatpy.geometry.similarity import Similarity
from musatpy.model import Block, ObservationKind


class EqualElevation(Prior, Unknown):
    """Members of the groups, and the levels of these: members stand in the normal equations of the points."""

    observed = ObservationKind.EQUAL_ELEVATION
    part, weight = slice(3, 4), "group_weight"
    change = "a level still changes by {} m"

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return the names of the levels."""
        return [f"level of group {name}" for name in block.equal_elevations.ids.tolist()]

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that a point is off by `size` m."""
        point = block.points.ids[self.points(block)[row]]
        return f"point {point} is {size:.2f} m off its equal elevation"

    def state_after(self, network: Network, step: FloatArray, state: State) -> State:
        """Return the state with the levels after a step (u,)."""
        return replace(state, levels=state.levels + self.part_of(network, step))

    def transformed(self, network: Network, state: State, centre: FloatArray, move: Similarity) -> State:
        """Return the state with the levels lifted, and grown apart from the height of the centre."""
        height = float(network.frame.height(centre))
        return replace(state, levels=height + move.scale * (state.levels - height) + move.shift[2])

    def put_motions(self, network: Network, state: State, centre: FloatArray, motions: FloatArray) -> None:
        """Put what the motions do to the levels into `motions` (u, 7)."""
        has_points = np.isfinite(state.levels)  # that of a group without any is no unknown
        part = self.part_of(network, motions)
        part[:, 2] = has_points
        part[:, 6] = np.where(has_points, state.levels - float(network.frame.height(centre)), 0.0)


KINDS = (EqualElevation(),)
