"""Headings of the columns of our tables that the audit uses: put right under noise, noted where they are lost."""

from __future__ import annotations

import re
from collections.abc import Iterator

from musatpy.legacy.layout import Line
from musatpy.legacy.notes import Notes
from musatpy.legacy.spelling import canonical, respelt

TURNS = ("X-Tilt", "Y-Tilt", "Heading", "Omega", "Phi", "Kappa", "Azimuth", "Tilt", "Swing")
PLACES = ("Latitude", "Longitude", "Elevation", "Height", "X", "Y", "Z", "E", "N", "h", "H")
OWN_SIGMAS = ("East", "North", "Up", "X-T", "Y-T", "Hdg")  # of the adjustment, in whatever words the answer is
MATRIX_AXES = ("First axis", "Second axis", "Third axis")
DIFFERENCES = ("East", "North", "Up", "X", "Y", "Z")
SIGMAS = tuple(f"Sigma {name}" for name in (*OWN_SIGMAS, "X", "Y", "Z", "E", "N", "h", "H", "Lat", "Long"))
TESTS = tuple(f"Test {name}" for name in DIFFERENCES)
TURN_SIGMAS = tuple(f"Sigma {name}" for name in TURNS)
DEPTHS = (
    *("Photos", "Incidence", "Water level"),
    *("Depth, no refr.", "Depth, predicted", "Depth, refraction", "Sigma", "Height", "Residual"),
)

_STATIONS = ("Photo", "Camera", *PLACES, *SIGMAS)
_ATTITUDES = ("Photo", "Row", *TURNS, *MATRIX_AXES, "Sigma", *SIGMAS, *TURN_SIGMAS)
_MEASURED = ("Photo", "Point", "x", "y", "Sigma x", "Sigma y", "Bath", "Trig")
# By the titles of the tables that the audit uses.
COLUMNS = {
    "Input: Exposure Stations, Initial Positions": _STATIONS,
    "Input: Exposure Stations, Given Attitudes": _ATTITUDES,
    "Input: Control": ("Point", "Kind", "Fixed", "Bath", *PLACES, *SIGMAS),
    "Input: Plate Measurements": tuple(name.replace("Sigma", "sigma") for name in _MEASURED),
    "Adjusted Exposure Stations: Positions": _STATIONS,
    "Adjusted Exposure Stations: Attitudes": _ATTITUDES,
    "Adjusted Ground Points": ("Point", "Bath", "Status", "Rays", *PLACES, *SIGMAS),
    "Control Residuals: Adjusted Minus Given, With The Sigmas Given": (
        *("Point", "Kind", "Fixed", "Fails"),
        *(*DIFFERENCES, *SIGMAS, *TESTS),
    ),
    "Check Points: Adjusted Minus Given, With The Sigmas Of The Adjusted Position": (
        *("Point", *DIFFERENCES),
        *SIGMAS,
    ),
    "Depths Of Bathymetric Points": ("Point", *DEPTHS, "Ctrl"),
    "Plate Residuals Of The Job": ("Points", "Number", "RMS x", "RMS y"),
    "Residuals Of Plate Measurements: Adjusted Minus Measured": (
        *_MEASURED,
        *("Resid. x", "Resid. y", "Refr. x", "Refr. y", "Large"),
    ),
}


def put_right(title: str, line: Line, headings: tuple[str, ...], notes: Notes) -> tuple[str, ...]:
    """Return the headings of a table, noise in those that its report has noted; one that it has not is noted too.

    Those of other reports are returned as they are.
    """
    known = COLUMNS.get(title)
    return headings if known is None else tuple(_headings(title, line, headings, known, notes))


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
    found = [one for one in known if canonical(one) == canonical(heading)]
    return found[0] if len(found) == 1 else None
