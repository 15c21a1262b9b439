"""What is known of single ground points: observed in the normal equations of the points, which are eliminated."""

from __future__ import annotations

import numpy as np

from musatpy.adjustment.ground import prior_rows
from musatpy.adjustment.kinds.kind import Kind
from musatpy.adjustment.network import Network
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import Block


class Prior(Kind):
    """A kind whose table links to points."""

    direct = False
    part: slice  # of the four rows of `ground.Priors`

    def points(self, block: Block) -> IntArray:
        """Return the points (k,) of the table."""
        point: IntArray = getattr(block, self.observed.attribute).point
        return point

    def residuals(self, network: Network, block: Block, state: State) -> FloatArray:
        """Return adjusted minus known (k, components) in m, 0 for points that take no part."""
        point = self.points(block)
        deviation = np.zeros((len(point), 4))
        known = np.isfinite(state.ground[point]).all(axis=1)
        deviation[known] = prior_rows(network, state, point[known], state.ground[point[known]]).deviation
        return -deviation[:, self.part]
