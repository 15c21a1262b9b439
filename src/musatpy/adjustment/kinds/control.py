"""Control points: their components are observed in the normal equations of the points themselves."""

from __future__ import annotations

from dataclasses import replace

from musatpy.adjustment.kinds.prior import Prior
from musatpy.adjustment.kinds.stations import COMPONENTS
from musatpy.adjustment.network import Network
from musatpy.arrays import FloatArray
from musatpy.model import Block, ObservationKind


class Control(Prior):
    """East, north, up of a control point."""

    observed = ObservationKind.CONTROL
    part = slice(0, 3)

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights (k, 3)."""
        return network.priors.weight[self.points(block)]

    def weighted(self, network: Network, block: Block, factor: FloatArray) -> Network:
        """Return the network with the weights times `factor` (k, 3)."""
        weight = network.priors.weight.copy()
        weight[self.points(block)] *= factor
        return replace(network, priors=replace(network.priors, weight=weight))

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that a component is off by `size` m."""
        point = block.points.ids[self.points(block)[row]]
        return f"control point {point} is {size:.2f} m off in {COMPONENTS[component]}"
