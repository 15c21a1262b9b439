"""Observed positions and attitudes of exposure stations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds.kind import Kind, Rows
from musatpy.adjustment.network import BACK, ORDER, Network
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.model import Block, ObservationKind
from musatpy.units import DEGREE

COMPONENTS = ("east", "north", "up")
_ANGLES = ("X-tilt", "Y-tilt", "heading")


class StationKind(Kind):
    """Three observed unknowns of each photo."""

    first: int  # of the unknowns of a photo
    attribute: str  # weights of the network

    def deviation(self, network: Network, state: State) -> FloatArray:
        """Return adjusted minus given (n, 3)."""
        raise NotImplementedError

    def takes_part(self, network: Network) -> bool:
        """Return whether any station is observed."""
        return bool(getattr(network, self.attribute).any())

    def rows(self, network: Network, state: State) -> Rows:
        """Return the observations of all photos."""
        photo, component = np.divmod(np.arange(3 * network.photos), 3)
        start, position = photo * network.pattern.size, np.tile(np.arange(3), (len(photo), 1))
        turned = np.isin(photo, np.flatnonzero(network.turned))
        position[turned] = BACK
        stated = np.where(turned & (self.first == 0), np.take(ORDER, component), component)
        return Rows.of_unknowns(
            self.deviation(network, state).reshape(-1),
            getattr(network, self.attribute).reshape(-1),
            start + self.first + component,
            row=photo,
            component=stated,
            position=start[:, None] + position,
        )

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights (n, 3)."""
        weight: FloatArray = getattr(network, self.attribute)
        return weight

    def weighted(self, network: Network, block: Block, factor: FloatArray) -> Network:
        """Return the network with the weights times `factor` (n, 3)."""
        return replace(network, **{self.attribute: getattr(network, self.attribute) * factor})


class StationPosition(StationKind):
    """East, north, up along the axes at the given station."""

    observed = ObservationKind.STATION_POSITION
    first, attribute = 0, "position_weight"

    def deviation(self, network: Network, state: State) -> FloatArray:
        """Return adjusted minus given (n, 3) m."""
        return np.einsum("nij,nj->ni", network.axes, state.position - network.position)

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that a component is off by `size` m."""
        return (
            f"the observed station of photo {block.photos.ids[row]} is {size:.2f} m off in {COMPONENTS[component]}"
        )


class StationAttitude(StationKind):
    """X-tilt, Y-tilt, heading."""

    observed = ObservationKind.STATION_ATTITUDE
    first, attribute = 3, "attitude_weight"

    def deviation(self, network: Network, state: State) -> FloatArray:
        """Return adjusted minus given (n, 3) rad, within half a turn."""
        turn = state.attitude - network.attitude
        return turn - 2.0 * np.pi * np.rint(turn / (2.0 * np.pi))

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that an angle is off by `size` rad."""
        off = f"{size / DEGREE:.2f} degrees off in {_ANGLES[component]}"
        return f"the observed attitude of photo {block.photos.ids[row]} is {off}"


KINDS = (StationPosition(), StationAttitude())
