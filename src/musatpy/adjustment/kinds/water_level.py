"""Tides: the corrections that photos or groups of photos share, observed as zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds.kind import OfWater, Rows
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.unknowns import LEVEL, State
from musatpy.adjustment.water_motions import level_motions, moved_levels
from musatpy.adjustment.water_surface import WaterKnowledge
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry.similarity import Similarity
from musatpy.model import Block, ObservationKind


class WaterLevel(OfWater):
    """The corrections stand in the border, or, where each photo has its own, with the unknowns of the photos."""

    observed = ObservationKind.WATER_LEVEL
    change = "a level still changes by {} m"

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return the names of the corrections in the border."""
        ids = [] if water.per_photo else water.ids.tolist()
        return [f"water level{f' of {name}' if name else ''}" for name in ids]

    def rows(self, network: Network, state: State) -> Rows:
        """Return the corrections as observed."""
        index = self._index(network)
        return Rows.of_unknowns(level_corrections(network, state), network.water.level_weight, index)

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights (c, 1)."""
        return network.water.level_weight[:, None]

    def weighted(self, network: Network, block: Block, factor: FloatArray) -> Network:
        """Return the network with the weights times `factor` (c, 1)."""
        weight = network.water.level_weight * factor[:, 0]
        return replace(network, water=replace(network.water, level_weight=weight))

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that a correction is `size` m."""
        name = network.water.ids[row]
        return f"the water level{f' {name}' if name else ''} is {size:.2f} m off its tide"

    def state_after(self, network: Network, step: FloatArray, state: State) -> State:
        """Return the state with the tides after a step (u,)."""
        water = network.water
        if not len(water.ids):
            return state
        if water.per_photo:
            return replace(state, tide=state.tide + step[self._index(network)])
        correction = step[self._index(network)][np.maximum(water.group, 0)]
        return replace(state, tide=state.tide + np.where(water.group >= 0, correction, 0.0))

    def transformed(self, network: Network, state: State, centre: FloatArray, move: Similarity) -> State:
        """Return the state with the planes of unknown tides moved."""
        if not len(network.water.ids):
            return state
        tide = moved_levels(network, centre, state.tilt, state.tide, move)
        return replace(state, tide=np.where(network.water.group >= 0, tide, state.tide))

    def put_motions(self, network: Network, state: State, centre: FloatArray, motions: FloatArray) -> None:
        """Put what the motions do to the levels into `motions` (u, 7)."""
        water = network.water
        level, belongs = np.zeros(len(water.ids)), water.group >= 0
        level[water.group[belongs]] = state.tide[belongs]
        known = belongs if water.per_photo else np.ones(len(water.ids), dtype=bool)
        moves = level_motions(network, centre, state.tilt, np.nan_to_num(level))
        motions[self._index(network)] = np.where(known[:, None], moves, 0.0)

    def of_images(self, network: Network, group: PointGroup, by_water: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return columns (k, m) and partials (k, m, 2, m): each image sees the water of its photo."""
        k, m = group.rays.shape
        if not network.border.count(self.observed):
            return self.everywhere(network, k), np.zeros((k, m, 2, 0))
        water = network.water.group[network.photo[group.rays]]
        images = np.zeros((k, m, 2, m))
        ray = np.arange(m)
        images[:, ray, :, ray] = np.moveaxis(by_water[..., 0] * (water >= 0)[..., None], 1, 0)
        return network.border.at(self.observed).start + np.maximum(water, 0), images

    def of_surface(self, network: Network, state: State, group: PointGroup) -> tuple[IntArray, FloatArray]:
        """Return columns (k, m) and partials (k, m): the mean over the photos."""
        if not network.border.count(self.observed):
            return super().of_surface(network, state, group)
        water = network.water.group[network.photo[group.rays]]
        return network.border.at(self.observed).start + np.maximum(water, 0), (water >= 0) / water.shape[1]

    def weight(self, network: Network) -> FloatArray:
        """Return the weights (c,)."""
        return network.water.level_weight

    def part_of(self, network: Network, values: FloatArray) -> FloatArray:
        """Return the part (c, ...) of values (u, ...) of all unknowns that belongs to the corrections."""
        return values[self._index(network)]

    def _index(self, network: Network) -> IntArray:
        """Return the numbers (c,) of the corrections among all unknowns."""
        if network.water.per_photo:
            return np.arange(network.photos) * network.pattern.size + LEVEL
        return network.pattern.order + network.border.numbers(self.observed)


KINDS = (WaterLevel(),)


def level_corrections(network: Network, state: State) -> FloatArray:
    """Return the corrections (c,) m that the tides of groups of photos have received."""
    water = network.water
    out = np.zeros(len(water.ids))
    belongs = water.group >= 0
    out[water.group[belongs]] = (state.tide - water.tide)[belongs]
    return out
