"""Measured distances between two ground points, along the straight line."""

from musatpy.adjustment.kinds.measured import StraightLength
from musatpy.model import ObservationKind


class Distance(StraightLength):
    """Distances."""

    observed = ObservationKind.DISTANCE
    noun, card = "distance", "DIS"
    advice = "read the distance card again: names and digits"


KINDS = (Distance(),)
