"""Known distances between two exposure stations."""

from musatpy.adjustment.kinds.measured import StraightLength
from musatpy.model import ObservationKind


class AirBase(StraightLength):
    """Air bases."""

    observed = ObservationKind.AIR_BASE
    noun, card = "air base", "BAS"
    advice = "read the air base card again: photos and digits"


KINDS = (AirBase(),)
