"""Unknown parameters of waves on the water."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds.kind import OfWater, Rows
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.sea import AZIMUTH, CREST, HEIGHT, LENGTH, Sea, wave_names
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water import WaterKnowledge
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import Block, ObservationKind
from musatpy.units import DEGREE

_ARM = 100.0  # m, of the turn of a wave: about a length


class Wave(OfWater):
    """Height, length, azimuth, crest of each wave: those that are unknown, (w,) of (k, 4)."""

    observed = ObservationKind.WAVE
    searched = False  # no card of one photo or point is to blame
    change = "{} still changes by {}"

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return the names of the unknown parameters."""
        return () if sea is None else wave_names(sea)

    def rows(self, network: Network, state: State) -> Rows:
        """Return the parameters as observed."""
        unknown = _unknown(network)
        wave, parameter = np.nonzero(unknown)
        given = state.waves if network.sea is None else network.sea.waves
        residual = (state.waves - given)[unknown] if len(wave) else np.zeros(0)
        index = self.numbers(network)
        return Rows.of_unknowns(residual, wave_weights(network), index, row=wave, component=parameter)

    def moved(self, network: Network, step: FloatArray, state: State) -> State:
        """Return the state with the parameters after a step (u,)."""
        part = self.part_of(network, step)
        if not len(part):
            return state
        waves = state.waves.copy()
        waves[_unknown(network)] += part
        return replace(state, waves=waves)

    def put_motions(self, network: Network, state: State, height: float, motions: FloatArray) -> None:
        """Put into `motions` (u, 7): crests go along, azimuths turn, all grows.

        About the origin of the waves, which is taken for the centre: the block need not be named more exactly.
        """
        unknown = _unknown(network)
        if not unknown.any():
            return
        trough_to_crest, length, azimuth, crest = state.waves.T
        of_waves = np.zeros((len(state.waves), 4, motions.shape[1]))
        of_waves[:, CREST, 0], of_waves[:, CREST, 1] = np.sin(azimuth), np.cos(azimuth)
        of_waves[:, AZIMUTH, 5] = -1.0  # clockwise
        of_waves[:, HEIGHT, 6], of_waves[:, LENGTH, 6], of_waves[:, CREST, 6] = trough_to_crest, length, crest
        self.part_of(network, motions)[:] = of_waves[unknown]

    def of_images(self, network: Network, group: PointGroup, by_water: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return columns (k, w) and partials (k, m, 2, w)."""
        index = self.everywhere(network, len(by_water))
        return index, by_water[..., 4:][..., : index.shape[1]]

    def counted(self, network: Network) -> int:
        """Return the number of unknown parameters."""
        return network.border.count(self.observed)

    def movement(self, network: Network, step: FloatArray) -> tuple[float, str]:
        """Return the largest change in m, that of an azimuth by how far it moves a crest line `_ARM` off."""
        size = np.abs(self.part_of(network, step))
        turns = np.nonzero(_unknown(network))[1] == AZIMUTH
        size = np.where(turns, _ARM * size, size)
        if not size.any():
            return 0.0, ""
        row = int(size.argmax())
        change = f"{size[row] / _ARM / DEGREE:.2g} degrees" if turns[row] else f"{size[row]:.2g} m"
        return float(size[row]), self.change.format(network.border.columns[self.observed][row], change)


def wave_weights(network: Network) -> FloatArray:
    """Return the weights (w,) of what is known beforehand of the unknown parameters of the waves."""
    unknown = _unknown(network)
    if network.sea is None or network.sea.sea.sigma is None or not len(unknown):
        return np.zeros(0)
    if not network.sea.sea.observed:
        return np.zeros(np.count_nonzero(unknown))
    return 1.0 / np.square(network.sea.sea.sigma[unknown])


def _unknown(network: Network) -> BoolArray:
    """Return (k, 4) which parameters stand in the border; (0, 4) where all are known."""
    if network.sea is None or not network.border.count(ObservationKind.WAVE):
        return np.zeros((0, 4), dtype=bool)
    return network.sea.sea.unknown
