"""The refractive index of the water."""

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

_LIMIT = 1e-6  # of steps: a hundredth of what its sigma can be


class WaterIndex(OfWater):
    """The index, relative to air."""

    observed = ObservationKind.WATER_INDEX
    searched = False  # no card of one photo or point is to blame
    change, digits = "the refractive index still changes by {}", 6

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return its name where it is unknown."""
        return ("refractive index",) if water.index_unknown else ()

    def rows(self, network: Network, state: State) -> Rows:
        """Return the index as observed."""
        index = self.numbers(network)
        residual = np.full(len(index), state.index - network.water.index)
        return Rows.of_unknowns(residual, np.full(len(index), network.water.index_weight), index)

    def moved(self, network: Network, step: FloatArray, state: State) -> State:
        """Return the state with the index after a step (u,)."""
        part = self.part_of(network, step)
        return replace(state, index=state.index + float(part[0])) if len(part) else state

    def of_images(self, network: Network, group: PointGroup, by_water: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return columns (k, 1) and partials (k, m, 2, 1)."""
        index = self.everywhere(network, len(by_water))
        return index, by_water[..., 3:4][..., : index.shape[1]]

    def counted(self, network: Network) -> int:
        """Return 1 where the index has a sigma."""
        return network.border.count(self.observed) * (network.water.index_weight > 0.0)

    def limit(self, rotation: float, translation: float) -> float:
        """Return the limit of a change."""
        return _LIMIT
