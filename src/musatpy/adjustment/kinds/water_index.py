"""The refractive index of the water."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds.kind import Parameter
from musatpy.adjustment.network import Network
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_surface import WaterKnowledge
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray
from musatpy.model import Block, ObservationKind

_LIMIT = 1e-6  # of steps: a hundredth of what its sigma can be


class WaterIndex(Parameter):
    """The index, relative to air."""

    observed = ObservationKind.WATER_INDEX
    part = slice(3, 4)
    change, digits = "the refractive index still changes by {}", 6

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return its name where it is unknown."""
        return ("refractive index",) if water.index_unknown else ()

    def values(self, network: Network, state: State) -> tuple[FloatArray, FloatArray]:
        """Return the index at `state`, and as given."""
        return np.array([state.index]), np.array([network.water.index])

    def weight(self, network: Network) -> FloatArray:
        """Return its weight."""
        return np.full(network.border.count(self.observed), network.water.index_weight)

    def with_values(self, network: Network, state: State, values: FloatArray) -> State:
        """Return the state with another index."""
        return replace(state, index=float(values[0]))

    def limit(self, rotation: float, translation: float) -> float:
        """Return the limit of a change."""
        return _LIMIT


KINDS = (WaterIndex(),)
