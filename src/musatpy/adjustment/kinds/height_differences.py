"""Measured height differences between two ground points, the second minus the first."""

from __future__ import annotations

import numpy as np

from musatpy.adjustment.kinds.measured import MeasuredKind
from musatpy.adjustment.network import Network
from musatpy.arrays import FloatArray
from musatpy.model import ObservationKind


class HeightDifference(MeasuredKind):
    """Height differences."""

    observed = ObservationKind.HEIGHT_DIFFERENCE
    value, noun, card = "difference", "height difference", "HDF"
    advice = "read the height difference card again: names, digits, sign"

    def model(self, network: Network, ends: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the differences (d,) in m, and their partials (d, 2, 3)."""
        height = network.frame.height(ends.reshape(-1, 3)).reshape(-1, 2) if len(ends) else np.zeros((0, 2))
        partials = np.zeros_like(ends)
        partials[:, :, 2] = [-1.0, 1.0]
        return height[:, 1] - height[:, 0], partials


KINDS = (HeightDifference(),)
