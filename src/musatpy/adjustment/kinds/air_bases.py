"""Known distances between two exposure stations."""

from __future__ import annotations

from musatpy.adjustment.kinds.measured import MeasuredKind, straight_length
from musatpy.adjustment.network import Network
from musatpy.arrays import FloatArray
from musatpy.model import ObservationKind


class AirBase(MeasuredKind):
    """Air bases."""

    observed = ObservationKind.AIR_BASE
    value, noun, card = "length", "air base", "BAS"
    advice = "read the air base card again: photos and digits"

    def model(self, network: Network, ends: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the lengths (d,) in m, and their partials (d, 2, 3)."""
        return straight_length(ends, axes)


KINDS = (AirBase(),)
