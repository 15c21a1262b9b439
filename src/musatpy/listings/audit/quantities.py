"""What can be compared of two runs: a number or an id, under a key that says what it means, not where it stood."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.listings.audit.structures import Printed, run_name

_FULL_CIRCLE = 360.0 * 3600.0  # arc seconds


@dataclass(frozen=True)
class Key:
    """What a number is: the report, whose, and which."""

    report: str  # "ground point analysis"
    refracted: bool | None
    item: str  # component, frame, point
    statistic: str

    @property
    def heading(self) -> str:
        """The report with its run."""
        return f"{self.report}{run_name(self.refracted)}"


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
