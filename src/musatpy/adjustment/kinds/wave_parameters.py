"""Unknown parameters of waves on the water."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds.kind import Parameter, Rows
from musatpy.adjustment.network import Network
from musatpy.adjustment.sea import AZIMUTH, CREST, HEIGHT, LENGTH, Sea, wave_names
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_surface import WaterKnowledge
from musatpy.arrays import BoolArray, FloatArray
from musatpy.model import Block, ObservationKind
from musatpy.units import DEGREE

_ARM = 100.0  # m, of the turn of a wave: about a length


class Wave(Parameter):
    """Height, length, azimuth, crest of each wave: those that are unknown, (w,) of (k, 4)."""

    observed = ObservationKind.WAVE
    part = slice(4, None)
    change = "{} still changes by {}"

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return the names of the unknown parameters."""
        return () if sea is None else wave_names(sea)

    def rows(self, network: Network, state: State) -> Rows:
        """Return the parameters as observed."""
        wave, parameter = np.nonzero(_unknown(network))
        return replace(super().rows(network, state), row=wave, component=parameter)

    def values(self, network: Network, state: State) -> tuple[FloatArray, FloatArray]:
        """Return the unknown parameters at `state`, and as given."""
        given = state.waves if network.sea is None else network.sea.waves
        return state.waves[_unknown(network)], given[_unknown(network)]

    def weight(self, network: Network) -> FloatArray:
        """Return the weights of what is known beforehand of the unknown parameters."""
        unknown = _unknown(network)
        if network.sea is None or network.sea.sea.sigma is None or not len(unknown):
            return np.zeros(0)
        if not network.sea.sea.observed:
            return np.zeros(np.count_nonzero(unknown))
        return 1.0 / np.square(network.sea.sea.sigma[unknown])

    def with_values(self, network: Network, state: State, values: FloatArray) -> State:
        """Return the state with other parameters."""
        waves = state.waves.copy()
        waves[_unknown(network)] = values
        return replace(state, waves=waves)

    def put_motions(self, network: Network, state: State, centre: FloatArray, motions: FloatArray) -> None:
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


KINDS = (Wave(),)


def _unknown(network: Network) -> BoolArray:
    """Return (k, 4) which parameters stand in the border; (0, 4) where all are known."""
    if network.sea is None or not network.border.count(ObservationKind.WAVE):
        return np.zeros((0, 4), dtype=bool)
    return network.sea.sea.unknown
