"""Headings of printed columns: the units that they name; those of vectors, which the system of a job chooses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from musatpy.model import CoordinateSystem
from musatpy.units import ARC_SECOND, DEGREE, GON, HECTOPASCAL, MICROMETRE

# What headings call a unit -> that unit in units of the record, which has mm on the plate and rad.
PRINTED = {"um": MICROMETRE, "arc sec": ARC_SECOND, "degrees": DEGREE, "gon": GON, "hPa": HECTOPASCAL}
SEXAGESIMAL = "D  M  S"  # how headings of degrees, minutes and seconds begin
_RECORDED = {"um": "mm", "arc sec": "rad", "degrees": "rad", "gon": "rad", "hPa": "Pa"}
_UNITS = frozenset({*_RECORDED.values(), "m", "s", "m/s", "unit", "mm/unit", "deg", "sigmas"})
_METRIC = (CoordinateSystem.LOCAL, CoordinateSystem.GEOCENTRIC, "MODEL")


def printed_unit(heading: str) -> float:
    """Return what one of the unit that a heading ends with is in units of the record."""
    last = heading.split("\n")[-1]
    return PRINTED.get(last) or PRINTED.get(last.rpartition(" ")[2], 1.0)


def named(heading: str) -> tuple[str, str]:
    """Return a heading in one line, and the unit that its numbers are printed in: `East`, `m`; empty: none."""
    *words, last = heading.split("\n")
    name, _, inside = last.rpartition(" ")
    if words and last.startswith(SEXAGESIMAL):
        return " ".join(words).strip(), SEXAGESIMAL
    if words and _RECORDED.get(last, last) in _UNITS:
        return " ".join(words).strip(), last
    if inside in _RECORDED:  # `RMS x um`
        return " ".join([*words, name]).strip(), inside
    return " ".join((*words, last)).strip(), ""


def with_unit(heading: str) -> str:
    """Return a heading in one line, with the unit of the record in brackets: `East (m)`."""
    words, unit = named(heading)
    unit = "rad" if unit == SEXAGESIMAL else _RECORDED.get(unit, unit)
    return f"{words} ({unit})" if unit else words


@dataclass(frozen=True)
class Headings:
    """Headings and edit descriptors of the components of a vector, and those in some coordinate systems."""

    usual: Sequence[str]
    edits: Sequence[str]
    other: Sequence[str]
    other_edits: Sequence[str]
    systems: tuple[str, ...]  # in which the others stand

    def of(self, system: str) -> tuple[Sequence[str], Sequence[str]]:
        """Return headings and edit descriptors in a job of a system."""
        return (self.other, self.other_edits) if system in self.systems else (self.usual, self.edits)


def position(decimals: int) -> Headings:
    """Return the headings of positions (n, 3) in the system of the job, metres with `decimals`."""
    return Headings(
        ("Latitude\nD  M  S    ", "Longitude\nD  M  S    ", "Elevation\nm"),
        ("S16.5", "S16.5", f"F11.{decimals}"),
        ("X\nm", "Y\nm", "Z\nm"),
        (f"F15.{decimals}",) * 3,
        _METRIC,
    )


def along_axes(label: str = "", edit: str = "F9.3", unit: str = "\nm") -> Headings:
    """Return the headings, behind a label, of what is along east, north, up; X, Y, Z in local jobs."""
    enu, xyz = ([f"{label}{name}{unit}" for name in names] for names in (("East", "North", "Up"), "XYZ"))
    return Headings(enu, (edit,) * 3, xyz, (edit,) * 3, (CoordinateSystem.LOCAL,))


ATTITUDES_AS_ANGLES = [f"{name}\nD  M  S   " for name in ("X-Tilt", "Y-Tilt", "Heading")]
ATTITUDE_SIGMAS = [f"Sigma {name}\narc sec" for name in ("X-T", "Y-T", "Hdg")]
