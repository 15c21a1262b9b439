"""What was observed of single photos in three components: antenna positions, attitudes of an inertial unit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.iteration import State
from musatpy.adjustment.kinds.kind import Rows
from musatpy.adjustment.kinds.measured import MeasuredKind
from musatpy.adjustment.network import Network
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import Block, ObservationKind, Program


@dataclass(frozen=True, kw_only=True, eq=False)
class Deviations:
    """d vectors as adjusted minus observed, with their partials by the station and by X further parameters.

    Those by a station are along its axes, then by omega, phi, kappa; `column` counts the parameters in the border.
    """

    residual: FloatArray  # (d, 3)
    by_station: FloatArray  # (d, 3, 6)
    column: IntArray  # (d, X), which may repeat in a row
    by_parameters: FloatArray  # (d, 3, X)


class PhotoVector(MeasuredKind):
    """A kind whose table has a `photo` (d,); its ties have values and weights (d, 3). MUSAT-IIIA adjusts them."""

    def deviations(self, network: Network, state: State) -> Deviations:
        """Return the observations that take part, in components that are independent of each other."""
        raise NotImplementedError

    def applies(self, block: Block) -> bool:
        """Return whether the program of a block uses the table."""
        return block.options.program is Program.IIIA

    def rows(self, network: Network, state: State) -> Rows:
        """Return the components of all vectors, one after the other."""
        of, part = network.measured[self.observed], self.deviations(network, state)
        d, X = part.column.shape
        station = of.photo.reshape(d, 1) * network.pattern.size + np.arange(6)
        index = np.concatenate([station, network.pattern.order + part.column], axis=1)
        partials = np.concatenate([part.by_station, part.by_parameters], axis=2)
        return Rows(
            row=np.repeat(of.row, 3),
            component=np.tile(np.arange(3), d),
            residual=part.residual.reshape(-1),
            weight=of.weight.reshape(-1),
            index=np.repeat(index, 3, axis=0),
            partials=partials.reshape(3 * d, 6 + X),
            position=np.repeat(station[:, :3], 3, axis=0),
        )

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights (rows, 3) of the table."""
        of, out = network.measured[self.observed], np.zeros((self._table(block).count, 3))
        out[of.row] = of.weight.reshape(-1, 3)  # that of no rows has no components
        return out

    def weighted(self, network: Network, block: Block, factor: FloatArray) -> Network:
        """Return the network with the weights of the table times `factor` (rows, 3)."""
        of = network.measured[self.observed]
        changed = replace(of, weight=of.weight * factor[of.row])
        return replace(network, measured={**network.measured, self.observed: changed})

    def columns(self, network: Network, kind: ObservationKind, number: IntArray) -> IntArray:
        """Return the columns of the border of parameters of a kind by their numbers, -1 for none: column 0 then."""
        return np.where(number >= 0, network.border.at(kind).start + number, 0)
