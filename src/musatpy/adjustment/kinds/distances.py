"""Measured distances between two ground points, along the straight line."""

from __future__ import annotations

from musatpy.adjustment.kinds.measured import MeasuredKind, straight_length
from musatpy.adjustment.network import Network
from musatpy.arrays import FloatArray
from musatpy.model import ObservationKind


class Distance(MeasuredKind):
    """Distances."""

    observed = ObservationKind.DISTANCE
    value, noun, card = "length", "distance", "DIS"
    advice = "read the distance card again: names and digits"

    def model(self, network: Network, ends: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the lengths (d,) in m, and their partials (d, 2, 3)."""
        return straight_length(ends, axes)


KINDS = (Distance(),)
