"""The tilt of the water surface: its slopes towards east and north."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds.kind import OfWater, Rows
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.sea import Sea
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water import WaterKnowledge
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import Block, ObservationKind
from musatpy.units import ARC_SECOND


class WaterTilt(OfWater):
    """The two slopes, in rad."""

    observed = ObservationKind.WATER_TILT
    searched = False  # no card of one photo or point is to blame
    change, unit, digits = "the water still tilts by {} arc seconds", ARC_SECOND, 3

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return the names of the slopes."""
        return ("tilt of the water east", "tilt of the water north") if water.tilt_unknown else ()

    def rows(self, network: Network, state: State) -> Rows:
        """Return the slopes as observed."""
        index = self.numbers(network)
        way = np.arange(len(index))
        residual = (state.tilt - network.water.tilt)[: len(index)]
        weight = np.full(len(index), network.water.tilt_weight)
        return Rows.of_unknowns(residual, weight, index, row=np.zeros_like(way), component=way)

    def moved(self, network: Network, step: FloatArray, state: State) -> State:
        """Return the state with the slopes after a step (u,)."""
        part = self.part_of(network, step)
        return replace(state, tilt=state.tilt + part) if len(part) else state

    def transformed(self, network: Network, state: State, move: FloatArray, height: float) -> State:
        """Return the state with unknown slopes turned."""
        known = not network.border.count(self.observed)
        return state if known else replace(state, tilt=state.tilt + np.array([-move[4], move[3]]))

    def put_motions(self, network: Network, state: State, height: float, motions: FloatArray) -> None:
        """Put what the motions do to the slopes into `motions` (u, 7)."""
        part = self.part_of(network, motions)
        part[:1, 4] = -1.0  # about north: the east goes down
        part[1:, 3] = 1.0  # about east: the north goes up

    def of_images(self, network: Network, group: PointGroup, by_water: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return columns (k, 2) and partials (k, m, 2, 2)."""
        index = self.everywhere(network, len(by_water))
        return index, by_water[..., 1:3][..., : index.shape[1]]

    def of_surface(self, network: Network, state: State, group: PointGroup) -> tuple[IntArray, FloatArray]:
        """Return columns (k, 2) and partials (k, 2): the surface turns about the middle of the stations."""
        index = self.everywhere(network, len(group.point))
        return index, (state.ground[group.point] @ network.tilt_axes.T)[:, : index.shape[1]]

    def counted(self, network: Network) -> int:
        """Return the number of slopes with a sigma."""
        return network.border.count(self.observed) * (network.water.tilt_weight > 0.0)

    def limit(self, rotation: float, translation: float) -> float:
        """Return the limit of a change."""
        return rotation
