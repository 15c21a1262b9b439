"""What is known of single ground points: observed in the normal equations of the points, which are eliminated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.adjustment.ground import prior_rows
from musatpy.adjustment.kinds.kind import Kind
from musatpy.adjustment.network import Network
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray, IntArray, finite_rows
from musatpy.model import Block


class Prior(Kind):
    """A kind whose table links to points."""

    direct = False
    part: slice  # of the four rows of `ground.Priors`
    weight: str  # attribute of `GroundPriors`

    def points(self, block: Block) -> IntArray:
        """Return the points (k,) of the table."""
        point: IntArray = getattr(block, self.observed.attribute).point
        return point

    def residuals(self, network: Network, block: Block, state: State) -> FloatArray:
        """Return adjusted minus known (k, components) in m, 0 for points that take no part."""
        point = self.points(block)
        deviation = np.zeros((len(point), 4))
        known = finite_rows(state.ground[point])
        deviation[known] = prior_rows(network, state, point[known], state.ground[point[known]]).deviation
        return -deviation[:, self.part]

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights (k, components)."""
        point = self.points(block)
        weight: FloatArray = getattr(network.priors, self.weight)[point]
        return weight.reshape(len(point), len(self.observed.components))

    def weighted(self, network: Network, block: Block, factor: FloatArray) -> Network:
        """Return the network with the weights times `factor` (k, components)."""
        weight = getattr(network.priors, self.weight).copy()
        weight[self.points(block)] *= factor.reshape(len(factor), *weight.shape[1:])
        return replace(network, priors=replace(network.priors, **{self.weight: weight}))
