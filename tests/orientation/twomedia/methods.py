"""The methods by their names, and how many points of a geometry are control in each."""

from musatpy.orientation.twomedia.combined import COMBINED
from musatpy.orientation.twomedia.pair import PAIR_INDEPENDENT, PAIR_SUCCESSIVE
from musatpy.orientation.twomedia.sights import Method
from musatpy.orientation.twomedia.single import SINGLE_FERMAT, SINGLE_RAY
from musatpy.orientation.twomedia.triplet import TRIPLET

METHODS: dict[str, Method] = {
    method.name: method
    for method in (SINGLE_RAY, SINGLE_FERMAT, PAIR_INDEPENDENT, PAIR_SUCCESSIVE, COMBINED, TRIPLET)
}


def control_of(method: Method) -> int:
    """Return the number of control points that a method is tried with."""
    return {"SINGLE-RAY": 20, "SINGLE-FERMAT": 20, "COMBINED": 5}.get(method.name, 0)
