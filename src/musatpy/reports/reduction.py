"""How raw plates were reduced: options, residuals of the marks, every step with its parameters, what was left out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.model import (
    Atmosphere,
    Curvature,
    DistortionSide,
    Polynomials,
    Quantity,
    Reduced,
    ReducedPlate,
    ReductionOptions,
    ReductionStep,
    Refused,
    Transformation,
)
from musatpy.reports.editing import edited
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table
from musatpy.reports.text import labelled, wrapped
from musatpy.statistics import Statistics
from musatpy.units import ARC_SECOND, MICROMETRE

TRANSFORMATION = {
    Transformation.SIMILARITY: "one scale",
    Transformation.AFFINE: "two scales and a shear",
    Transformation.PROJECTIVE: "eight parameters",
    Transformation.DISTANCES: "by calibrated distances between marks, a scale along each axis",
    Transformation.NONE: "the readings are in the fiducial system",
}
SIDE = {
    DistortionSide.MEASURED: "ideal = measured - distortion(measured)",
    DistortionSide.IDEAL: "measured = ideal + distortion(ideal)",
}
POLYNOMIALS = {
    Polynomials.DISTORTION: "the distortion: measured minus ideal place",
    Polynomials.CORRECTION: "the correction: ideal minus measured place",
}
ATMOSPHERE = {
    Atmosphere.NONE: "no correction of refraction in the air",
    Atmosphere.ARDC: "closed formula for the ARDC model",
    Atmosphere.US1976: "U.S. Standard Atmosphere 1976",
}
REFUSED = {Refused.STOP: "the run", Refused.GO_ON: "on without them"}
DISPLACING = ("reseau", "lens", "refraction", "curvature")

_TITLE = "Plate Reduction"
# Of a value and of its sigma by unit, with the factor to what is printed.
_EDITS = {
    "rad": ("F18.3", "F10.3", "arc sec", 1.0 / ARC_SECOND),
    "mm": ("F18.5", "F10.5", "mm", 1.0),
    "m": ("F18.3", "F10.3", "m", 1.0),
    "mm/unit": ("F18.9", "F15.9", "mm/unit", 1.0),
    "": ("F18.12", "F15.12", "", 1.0),
}


def sections(statistics: Statistics) -> list[Section]:
    """Return what the reduction did; nothing where the plates came refined."""
    reduced = statistics.solution.reduced
    if reduced is None:
        return []
    options = reduced.given.reduction or ReductionOptions()
    found = [Section(title=_TITLE, lines=labelled(_options(options)), new_page=True)]
    found += _tables(reduced)
    notes = list(_notes(reduced))
    if notes:
        found.append(Section(title=f"{_TITLE}: Notes", lines=wrapped(notes)))
    left = list(_left_out(reduced))
    if left:
        found.append(Section(title=f"{_TITLE}: Photos Left Out", lines=wrapped(left)))
    return found


def _options(options: ReductionOptions) -> dict[str, str]:
    lines = {
        "Fiducial transformation": f"{options.transformation}  {TRANSFORMATION[options.transformation]}",
        "Limit of residuals": _given("F12.2", options.residual_limit / MICROMETRE, "um"),
        "Side of the lens distortion": f"{options.side}  {SIDE[options.side]}",
        "Coefficients of distortion": f"{options.polynomials}  {POLYNOMIALS[options.polynomials]}",
        "Atmosphere": f"{options.atmosphere}  {ATMOSPHERE[options.atmosphere]}",
        "Earth curvature": "corrected" if options.curvature is Curvature.YES else "not corrected",
        "Mean height of the ground": _given("F12.2", options.ground_height, "m"),
        "Plates that are refused": f"{options.refused}  {REFUSED[options.refused]}",
    }
    return lines


def _given(edit: str, value: float, unit: str) -> str:
    return "none" if np.isnan(value) else f"{edited(edit, [value])[0].strip()} {unit}"


def _tables(reduced: Reduced) -> Iterator[Section]:
    """Yield the tables that have rows: plates, residuals, parameters, repeated readings."""
    marks = [(plate, row) for plate in reduced.plates for row in range(len(plate.marks))]
    distances = [(plate, row) for plate in reduced.plates for row in range(len(plate.ends))]
    parameters = list(_parameters(reduced))
    spreads = [(plate.photo, spread) for plate in reduced.plates for spread in plate.spreads]
    for title, columns, rows in (
        ("Plates", PLATES, reduced.plates),
        ("Residuals Of Fiducial Marks", MARKS, marks),
        ("Residuals Of Distances Between Marks", DISTANCES, distances),
        ("Steps And Parameters", PARAMETERS, parameters),
        ("Repeated Readings", SPREADS, spreads),
    ):
        if rows:
            table = Table(columns)
            lines = table.lines(rows)
            if columns is PLATES:
                lines = [*lines, "", *_largest(reduced)]
            yield Section(title=f"{_TITLE}: {title}", head=table.head(), lines=lines)


def _moved(name: str):  # type: ignore[no-untyped-def]
    pass
