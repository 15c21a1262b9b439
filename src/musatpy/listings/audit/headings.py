"""Headings of the columns of our tables that the audit uses: put right under noise, noted where they are lost."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
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


# The columns that name the rows of the tables that are compared with other runs, or counted.
KEYS: Mapping[Title, tuple[str, ...]] = {
    **dict.fromkeys((Title.INITIAL_POSITIONS, Title.POSITIONS), ("Photo",)),
    Title.ATTITUDES: ("Photo", "Row"),
    **dict.fromkeys((Title.POINTS, Title.CONTROL, Title.CHECKS, Title.DEPTHS), ("Point",)),
    Title.JOB: ("Points",),
    **dict.fromkeys((Title.GIVEN_PLATES, Title.RESIDUALS), ("Photo", "Point")),
}
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

_COORDINATES = (*PLACES, *SIGMAS)
_ANGLES = ("Row", *TURNS, *MATRIX_AXES, "Sigma", *SIGMAS, *TURN_SIGMAS)
# The tables that the audit uses, with the headings of coordinates and attitudes in the words of systems.
AUDITED: Mapping[str, tuple[str, ...]] = {
    Title.INITIAL_POSITIONS: _COORDINATES,
    Title.GIVEN_ATTITUDES: _ANGLES,
    Title.GIVEN_CONTROL: _COORDINATES,
    Title.GIVEN_PLATES: (),
    Title.POSITIONS: _COORDINATES,
    Title.ATTITUDES: _ANGLES,
    Title.POINTS: _COORDINATES,
    f"{Title.CONTROL}: Adjusted Minus Given, With The Sigmas Given": SIGMAS,
    f"{Title.CHECKS}: Adjusted Minus Given, With The Sigmas Of The Adjusted Position": SIGMAS,
    Title.DEPTHS: (),
    Title.JOB: (),
    f"{Title.RESIDUALS}: Adjusted Minus Measured": (),
}


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
    return tuple(dict.fromkeys([*stated, *AUDITED[title]]))


def put_right(title: str, line: Line, headings: tuple[str, ...], notes: Notes) -> tuple[str, ...]:
    """Return the headings of a table, noise in those that its report has noted; one that it has not is noted too.

    Those of other reports are returned as they are.
    """
    if title not in AUDITED:
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
