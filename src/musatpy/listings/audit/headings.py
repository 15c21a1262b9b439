"""Headings of the columns of our tables that the audit uses: put right under noise, noted where they are lost."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache

from musatpy.listings.audit.notes import Notes
from musatpy.listings.audit.scan import Line
from musatpy.listings.audit.spelling import canonical, respelt


class Title(StrEnum):
    """How the titles of the tables begin that the audit uses."""

    INITIAL_POSITIONS = "Input: Exposure Stations, Initial Positions"
    GIVEN_ATTITUDES = "Input: Exposure Stations, Given Attitudes"
    GIVEN_CONTROL = "Input: Control"
    GIVEN_PLATES = "Input: Plate Measurements"
    POSITIONS = "Adjusted Exposure Stations: Positions"
    ATTITUDES = "Adjusted Exposure Stations: Attitudes"
    POINTS = "Adjusted Ground Points"
    CONTROL = "Control Residuals"
    CHECKS = "Check Points"
    DEPTHS = "Depths Of Bathymetric Points"
    JOB = "Plate Residuals Of The Job"
    RESIDUALS = "Residuals Of Plate Measurements"
    SOUNDINGS = "Comparison With Soundings"


TURNS = ("X-Tilt", "Y-Tilt", "Heading", "Omega", "Phi", "Kappa", "Azimuth", "Tilt", "Swing")
PLACES = ("Latitude", "Longitude", "Elevation", "Height", "X", "Y", "Z", "E", "N", "h", "H")
OWN_SIGMAS = ("East", "North", "Up", "X-T", "Y-T", "Hdg")  # of the adjustment, in whatever words the answer is
MATRIX_AXES = ("First axis", "Second axis", "Third axis")
DIFFERENCES = ("East", "North", "Up", "X", "Y", "Z")
SIGMAS = tuple(f"Sigma {name}" for name in (*OWN_SIGMAS, "X", "Y", "Z", "E", "N", "h", "H", "Lat", "Long"))
TURN_SIGMAS = tuple(f"Sigma {name}" for name in TURNS)
DEPTH_COLUMNS = (
    *("Photos", "Incidence", "Water level"),
    *("Depth, no refr.", "Depth, predicted", "Depth, refraction", "Sigma", "Height", "Residual"),
)
SAMPLE_COLUMNS = ("Size", "Sum", "Mean", "RMS", "Deviation", "Median", "NMAD", "Maximum")

_COORDINATES = (*PLACES, *SIGMAS)
_ANGLES = (*TURNS, *MATRIX_AXES, *SIGMAS, *TURN_SIGMAS)


@dataclass(frozen=True)
class Audited:
    """A table of ours that the audit uses."""

    title: Title
    key: tuple[str, ...]  # the columns that name its rows
    report: str = ""  # what a comparison with another run calls it; nothing where it is not compared
    compared: tuple[str, ...] = ()  # columns of numbers
    others: tuple[str, ...] = ()  # headings of coordinates and attitudes in the words of systems

    @property
    def stated(self) -> bool:
        """True where coordinates and attitudes are in the words of the answer."""
        return self.report.startswith("adjusted")


AUDITED = (
    Audited(Title.INITIAL_POSITIONS, ("Photo",), others=_COORDINATES),
    Audited(Title.GIVEN_ATTITUDES, ("Photo", "Row"), others=(*_ANGLES, "Sigma")),
    Audited(Title.GIVEN_CONTROL, ("Point",), others=_COORDINATES),
    Audited(Title.GIVEN_PLATES, ("Photo", "Point")),
    Audited(Title.POSITIONS, ("Photo",), "adjusted stations", _COORDINATES),
    Audited(Title.ATTITUDES, ("Photo", "Row"), "adjusted stations", _ANGLES, ("Sigma",)),
    Audited(Title.POINTS, ("Point",), "adjusted points", _COORDINATES),
    Audited(Title.CONTROL, ("Point",), "control residuals", DIFFERENCES, SIGMAS),
    Audited(Title.CHECKS, ("Point",), "check points", (*DIFFERENCES, *SIGMAS)),
    Audited(Title.DEPTHS, ("Point",), "depths", DEPTH_COLUMNS),
    Audited(Title.JOB, ("Points",), "plate residuals of the job", ("Number", "RMS x", "RMS y")),
    Audited(
        Title.RESIDUALS, ("Photo", "Point"), "plate measurements", ("Resid. x", "Resid. y", "Refr. x", "Refr. y")
    ),
    Audited(Title.SOUNDINGS, ("Sample",), "differences from soundings", SAMPLE_COLUMNS),
)
KEYS = {table.title: table.key for table in AUDITED}


@cache
def audited_tables() -> dict[str, Audited]:
    """Return the tables that the audit uses by their whole titles."""
    from musatpy.reports.statements import table_titles  # a listing is read before it is known to be ours

    return {title: table for title in table_titles() for table in AUDITED if title.startswith(table.title)}


def names_of(parts: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return the upper lines of the headings; both lines, or a number, where it takes these to tell two apart."""
    upper = [texts[0] if texts else "" for texts in parts]
    twice = {name for name, count in Counter(upper).items() if count > 1}
    whole = [" ".join(texts) if name in twice else name for name, texts in zip(upper, parts, strict=True)]
    return tuple(
        f"{name} {whole[:n].count(name) + 1}" if name in whole[:n] else name for n, name in enumerate(whole)
    )


@cache
def known_headings(title: str) -> tuple[str, ...]:
    """Return all headings that there may be in a table that the audit uses."""
    from musatpy.reports.statements import headings  # a listing is read before it is known to be ours

    stated = [
        name
        for heads in headings(title)
        for name in names_of([[line.strip() for line in head.split("\n") if line.strip()] for head in heads])
    ]
    table = audited_tables()[title]
    return tuple(dict.fromkeys([*stated, *table.key, *table.compared, *table.others]))


def put_right(title: str, line: Line, headings: tuple[str, ...], notes: Notes) -> tuple[str, ...]:
    """Return the headings of a table, noise in those that its report has noted; one that it has not is noted too.

    Those of other reports are returned as they are.
    """
    if title not in audited_tables():
        return headings
    return tuple(_headings(title, line, headings, known_headings(title), notes))


def _headings(
    title: str, line: Line, headings: tuple[str, ...], known: tuple[str, ...], notes: Notes
) -> Iterator[str]:
    for heading in headings:
        read = _known(heading, known)
        if read is None:
            notes.lost(line, f"a column of '{title}' without a legible heading: '{heading}'")
        elif read != heading:
            notes.repairs.extend(respelt(line.number, heading, read))
        yield heading if read is None else read


def _known(heading: str, known: tuple[str, ...]) -> str | None:
    """Return the heading that another one is under noise; None where that is none, or two that only case parts."""
    for plain in (heading, re.sub(r"^[\W_]+|[\W_]+$", "", heading)):
        if plain in known:
            return plain
    alike = [name for name in known if canonical(name) == canonical(heading)]
    return alike[0] if len(alike) == 1 else None
