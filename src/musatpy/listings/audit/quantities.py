"""What can be compared of two runs: a number or an id, under a key that says what it means, not where it stood."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.listings.audit.structures import Printed, run_name

_FULL_CIRCLE = 360.0 * 3600.0  # arc seconds
# In these words the adjustment has attitudes, and coordinates in each of its systems.
LOCAL_VERTICAL = "omega, phi, kappa in the local vertical"
NATIVE = {"GEOG": "geographic, ellipsoidal heights", "GEOC": "geocentric", "LOCL": "local"}
# Names of the same in other words.
SAME = {"Omega": "X-Tilt", "Phi": "Y-Tilt", "Kappa": "Heading", "Height": "Elevation"}


@dataclass(frozen=True)
class Key:
    """What a number is: the report, whose, and which."""

    report: str  # "ground point analysis"
    refracted: bool | None
    item: str  # component, frame, point
    statistic: str
    words: str = ""  # the system of a coordinate, what an attitude is of; nothing where there is no choice

    @property
    def heading(self) -> str:
        """The report with its run, and in which words."""
        return f"{self.report}{run_name(self.refracted)}" + (f": {self.words}" if self.words else "")


@dataclass(frozen=True)
class Quantity:
    """A number in arc seconds, metres or plate millimetres, or an id."""

    value: float | None  # None for ids
    unit: str
    text: str  # as printed; empty where it comes from a record
    half: float = 0.0

    @classmethod
    def printed(cls, cell: Printed, unit: str) -> Quantity:
        """Return a cell of a listing in the unit of its table."""
        return cls(cell.value, unit, cell.text, cell.half)


def within_half_circle(difference: float) -> float:
    """Return a difference of angles (arc seconds) the smaller way round."""
    return difference - _FULL_CIRCLE * round(difference / _FULL_CIRCLE)
