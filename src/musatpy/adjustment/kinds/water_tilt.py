"""The tilt of the water surface: its slopes towards east and north."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds.kind import Parameter
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_motions import slope_motions, turned_slopes
from musatpy.adjustment.water_surface import WaterKnowledge
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry.similarity import Similarity
from musatpy.model import Block, ObservationKind
from musatpy.units import ARC_SECOND


class WaterTilt(Parameter):
    """The two slopes, in rad."""

    observed = ObservationKind.WATER_TILT
    part = slice(1, 3)
    change, unit, digits = "the water still tilts by {} arc seconds", ARC_SECOND, 3

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return the names of the slopes."""
        return ("tilt of the water east", "tilt of the water north") if water.tilt_unknown else ()

    def values(self, network: Network, state: State) -> tuple[FloatArray, FloatArray]:
        """Return the slopes at `state`, and as given."""
        return state.tilt, network.water.tilt

    def weight(self, network: Network) -> FloatArray:
        """Return the weights of the slopes."""
        return np.full(network.border.count(self.observed), network.water.tilt_weight)

    def with_values(self, network: Network, state: State, values: FloatArray) -> State:
        """Return the state with other slopes."""
        return replace(state, tilt=values)

    def transformed(self, network: Network, state: State, centre: FloatArray, move: Similarity) -> State:
        """Return the state with unknown slopes turned."""
        known = not network.border.count(self.observed)
        return state if known else replace(state, tilt=turned_slopes(state.tilt, move.rotation))

    def put_motions(self, network: Network, state: State, centre: FloatArray, motions: FloatArray) -> None:
        """Put what the motions do to the slopes into `motions` (u, 7)."""
        if network.border.count(self.observed):
            self.part_of(network, motions)[:] = slope_motions(state.tilt)

    def of_surface(self, network: Network, state: State, group: PointGroup) -> tuple[IntArray, FloatArray]:
        """Return columns (k, 2) and partials (k, 2): the surface turns about the middle of the stations."""
        index = self.everywhere(network, len(group.point))
        return index, (state.ground[group.point] @ network.tilt_axes.T)[:, : index.shape[1]]

    def limit(self, rotation: float, translation: float) -> float:
        """Return the limit of a change."""
        return rotation


KINDS = (WaterTilt(),)
