"""How raw plates were reduced: options, residuals of marks, every step with its parameters, what was left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from musatpy.fortran import decimals_of
from musatpy.model import (
    Atmosphere,
    Curvature,
    DistortionSide,
    Polynomials,
    ReductionOptions,
    Refused,
    Transformation,
)
from musatpy.model.reduced import SPREAD_LEVEL, Quantity, Reduced, ReducedPlate, Spread
from musatpy.reports.editing import edited
from musatpy.reports.origin import Mapped, Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key
from musatpy.reports.text import labelled, wrapped
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
    Polynomials.DISTORTION: "those of the distortion: measured minus ideal place",
    Polynomials.CORRECTION: "those of the correction; below, those of the distortion",
}
ATMOSPHERE = {
    Atmosphere.NONE: "refraction in the air not corrected",
    Atmosphere.ARDC: "closed formula for the ARDC model",
    Atmosphere.US1976: "U.S. Standard Atmosphere 1976",
}
REFUSED = {Refused.STOP: "the run", Refused.GO_ON: "on without the photo"}
DISPLACING = {  # the steps within the fiducial system
    "reseau": "film deformation",
    "lens": "lens distortion",
    "refraction": "refraction in the air",
    "curvature": "earth curvature",
}

Row = TypeVar("Row")

_TITLE = "Plate Reduction"
_NAN = float("nan")


@dataclass(frozen=True, kw_only=True)
class _Row:
    """A row of the tables of marks, distances and spreads: what it is of, and its numbers."""

    photo: str
    names: tuple[str, ...]
    values: tuple[float, ...]


# Of a value and of its sigma by unit, with what one of the printed unit is; angles print in D M S.
_EDITS = {
    "rad": ("S18.3", "F13.3", "D M S, arc sec", ARC_SECOND),
    "mm": ("F18.5", "F13.5", "mm", 1.0),
    "m": ("F18.3", "F13.3", "m", 1.0),
    "mm/unit": ("F18.9", "F13.9", "mm/unit", 1.0),
    "count": ("I18", "F13.3", "", 1.0),
    "": ("F18.10", "F13.10", "", 1.0),
}
_LONGEST = 12  # decimals of a limit: one that needs more has an exponent
_COEFFICIENT = "E18.9"  # of a lens: by powers of mm


def sections(reduced: Reduced) -> list[Section]:
    """Return what the reduction did."""
    options = reduced.given.reduction or ReductionOptions()
    found = [Section(title=_TITLE, lines=labelled(_options(options) | _largest(reduced)), new_page=True)]
    found += _section(PLATES, reduced.plates)
    found += _section(MARKS, list(_marks(reduced)))
    found += _section(DISTANCES, list(_distances(reduced)))
    found += _section(PARAMETERS, list(_parameters(reduced)))
    found += _section(SPREADS, list(_spreads(reduced)))
    for title, sentences in (("Notes", list(_notes(reduced))), ("Photos Left Out", _left_out(reduced))):
        if sentences:
            found.append(Section(title=f"{_TITLE}: {title}", lines=wrapped(sentences)))
    return found


def _section(report: Report[Sequence[Row]], rows: Sequence[Row]) -> list[Section]:
    """Return a table of rows; nothing of none."""
    return [report.section(rows)] if rows else []


def _options(options: ReductionOptions) -> dict[str, str]:
    return {
        "Fiducial transformation": f"{options.transformation}  {TRANSFORMATION[options.transformation]}",
        "Limit of residuals of marks": _limit(options.residual_limit / MICROMETRE),
        "Side of the lens distortion": f"{options.side}  {SIDE[options.side]}",
        "Coefficients of the lens distortion": f"{options.polynomials}  {POLYNOMIALS[options.polynomials]}",
        "Atmosphere": f"{options.atmosphere}  {ATMOSPHERE[options.atmosphere]}",
        "Earth curvature": "corrected" if options.curvature is Curvature.YES else "not corrected",
        "Mean height of the ground": _given(options.ground_height, "m"),
        "A plate that is refused": f"{options.refused}  {REFUSED[options.refused]}",
    }


def _given(value: float, unit: str) -> str:
    return "none" if np.isnan(value) else f"{edited('F12.2', [value])[0].strip()} {unit}"


def _limit(um: float) -> str:
    """Return the limit of residuals with all of its digits: the smallest is none that prints as zero."""
    if np.isnan(um):
        return "none"
    decimals = decimals_of(um, 2)
    return f"{edited(f'F30.{decimals}' if decimals <= _LONGEST else 'E30.11', [um])[0].strip()} um"


def _largest(reduced: Reduced) -> dict[str, str]:
    """Return the largest displacement of the job by each step that displaces."""
    lines = {}
    for name, what in DISPLACING.items():
        largest = reduced.largest(name)
        if largest is not None:
            photo, moved = largest
            lines[f"Largest displacement, {what}"] = f"{_given(moved / MICROMETRE, 'um')} on photo {photo}"
    return lines


def _marks(reduced: Reduced) -> Iterator[_Row]:
    for plate in reduced.plates:
        values = np.hstack([plate.residuals / MICROMETRE, plate.normalized])
        for name, row in zip(plate.marks.tolist(), values.tolist(), strict=True):
            yield _Row(photo=plate.photo, names=(name,), values=tuple(row))


def _distances(reduced: Reduced) -> Iterator[_Row]:
    for plate in reduced.plates:
        residuals = (plate.distance_residuals / MICROMETRE).tolist()
        for ends, residual in zip(plate.ends.tolist(), residuals, strict=True):
            yield _Row(photo=plate.photo, names=tuple(ends), values=(residual,))


def _parameters(reduced: Reduced) -> Iterator[tuple[str, ...]]:
    """Yield photo, step, parameter, value, sigma, unit; a step as on an earlier photo only refers to that."""
    seen: dict[tuple[str, tuple[Quantity, ...]], str] = {}
    for plate in reduced.plates:
        for step in plate.steps:
            first = seen.setdefault((step.name, _comparable(step.parameters)), plate.photo)
            if first != plate.photo:
                yield plate.photo, step.name, f"as on photo {first}", "", "", ""
                continue
            for one in step.parameters:
                yield plate.photo, step.name, one.name, *_printed(one, coefficient=step.name == "lens")


def _comparable(parameters: tuple[Quantity, ...]) -> tuple[Quantity, ...]:
    """Return parameters that are equal where they print alike: given ones, NaN being no number."""
    return tuple(Quantity(name=one.name, value=one.value, unit=one.unit, sigma=0.0) for one in parameters)


def _printed(one: Quantity, *, coefficient: bool) -> tuple[str, str, str]:
    value, sigma, unit, size = _EDITS[one.unit]
    if coefficient and one.unit == "":
        value = _COEFFICIENT
    return edited(value, [one.value])[0], edited(sigma, [one.sigma / size])[0], unit


def _spreads(reduced: Reduced) -> Iterator[tuple[str, Spread]]:
    for plate in reduced.plates:
        for spread in plate.spreads:
            yield plate.photo, spread


def _notes(reduced: Reduced) -> Iterator[str]:
    """Yield what an operator should know of plates and was not asked about."""
    for plate in reduced.plates:
        for names, what in (
            (plate.missing, "calibrated marks not measured"),
            (plate.suspects, "marks without any one of which the others keep the limit"),
            (plate.beyond_reseau, "points outside the measured crosses, corrected as in the nearest cell"),
            (plate.beyond_table, "points outside the calibrated radii of the lens, corrected as its table goes on"),
            *((spread.beyond, f"{spread.what} with readings beyond the limit") for spread in plate.spreads),
        ):
            if names:
                yield f"Photo {plate.photo}: {what}: {', '.join(names)}."
    if any(spread.unlikely for _, spread in _spreads(reduced)):
        yield (
            f"*  So large a spread has a probability below {SPREAD_LEVEL:.2f} if one reading has the standard "
            "deviation given."
        )


def _left_out(reduced: Reduced) -> list[str]:
    return [f"Photo {plate.photo}: {plate.reason}: {plate.refusal}." for plate in reduced.plates if plate.refusal]


def _um(value: Callable[[ReducedPlate], float]) -> Callable[[Sequence[ReducedPlate]], list[float]]:
    return lambda plates: [value(plate) / MICROMETRE for plate in plates]


def _moved(name: str) -> Callable[[Sequence[ReducedPlate]], list[float]]:
    return _um(lambda plate: _NAN if plate.refusal else plate.largest(name))


def _value(place: int) -> Callable[[Sequence[_Row]], list[float]]:
    return lambda rows: [row.values[place] for row in rows]


def _word(place: int) -> Callable[[Sequence[tuple[str, ...]]], list[str]]:
    return lambda rows: [row[place] for row in rows]


def _of_spread(
    value: Callable[[Spread], float | str],
) -> Callable[[Sequence[tuple[str, Spread]]], list[float | str]]:
    return lambda rows: [value(spread) for _, spread in rows]


PLATES: Report[Sequence[ReducedPlate]] = Report(
    title=f"{_TITLE}: Plates",
    path="reduction.plates",
    columns=(
        key("Photo", "A8", "photo", lambda plates: [plate.photo for plate in plates]),
        Column("Marks", "I5", lambda plates: [plate.used for plate in plates]),
        Column(
            "Not\nmeasured",
            "I8",
            lambda plates: [len(plate.missing) for plate in plates],
            Origin(count=True, field="missing"),
        ),
        Column("RMS x\num", "F8.2", _um(lambda plate: plate.rms[0]), "rms[0]"),
        Column("RMS y\num", "F8.2", _um(lambda plate: plate.rms[1]), "rms[1]"),
        Column("Sigma0", "F7.3", lambda plates: [plate.sigma0 for plate in plates], "sigma0"),
        Column("Freedom", "I7", lambda plates: [plate.freedom for plate in plates], "freedom"),
        Column("Largest:\nfilm um", "F9.2", _moved("reseau")),
        Column("\nlens um", "F9.2", _moved("lens")),
        Column("\nrefr. um", "F9.2", _moved("refraction")),
        Column("\ncurv. um", "F9.2", _moved("curvature")),
        Column("Refused", "A10", lambda plates: [plate.reason for plate in plates], "reason"),
    ),
)
MARKS: Report[Sequence[_Row]] = Report(
    title=f"{_TITLE}: Residuals Of Fiducial Marks: Transformed Minus Calibrated",
    path="reduction.plates",
    nested="marks",
    columns=(
        key("Photo", "A8", "photo", lambda rows: [row.photo for row in rows]),
        key("Mark", "A4", "mark", lambda rows: [row.names[0] for row in rows]),
        Column("Resid. x\num", "F10.2", _value(0), "residual[0]"),
        Column("Resid. y\num", "F10.2", _value(1), "residual[1]"),
        Column("Over own\nsigma x", "F9.2", _value(2), "normalized[0]"),
        Column("\nsigma y", "F9.2", _value(3), "normalized[1]"),
    ),
)
DISTANCES: Report[Sequence[_Row]] = Report(
    title=f"{_TITLE}: Residuals Of Distances Between Marks",
    path="reduction.plates",
    nested="distances",
    columns=(
        key("Photo", "A8", "photo", lambda rows: [row.photo for row in rows]),
        key("Mark", "A4", "marks[0]", lambda rows: [row.names[0] for row in rows]),
        key("Mark", "A4", "marks[1]", lambda rows: [row.names[1] for row in rows]),
        Column("Residual\num", "F10.2", _value(0), "residual"),
    ),
)
PARAMETERS: Report[Sequence[tuple[str, ...]]] = Report(
    title=f"{_TITLE}: Steps And Parameters",
    columns=(
        Column("Photo", "A8", _word(0)),
        Column("Step", "A10", _word(1)),
        Column("Parameter", "A24", _word(2)),
        Column("             Value", "A18", _word(3)),
        Column("        Sigma", "A13", _word(4)),
        Column("Unit", "A14", _word(5)),
    ),
)
SPREADS: Report[Sequence[tuple[str, Spread]]] = Report(
    title=f"{_TITLE}: Repeated Readings",
    path="reduction.plates",
    nested="spreads",
    columns=(
        key("Photo", "A8", "photo", lambda rows: [photo for photo, _ in rows]),
        key("Of", "A7", "of", _of_spread(lambda spread: spread.what)),
        Column("Freedom", "I7", _of_spread(lambda spread: spread.freedom), "freedom"),
        Column("Sigma u\nunit", "F9.5", _of_spread(lambda spread: spread.pooled[0]), "sigma[0]"),
        Column("Sigma v\nunit", "F9.5", _of_spread(lambda spread: spread.pooled[1]), "sigma[1]"),
        Column("Probability\nu", "F11.4", _of_spread(lambda spread: spread.probability[0]), "probability[0]"),
        Column("Probability\nv", "F11.4", _of_spread(lambda spread: spread.probability[1]), "probability[1]"),
        Column("Largest\ndeviation", "F9.5", _of_spread(lambda spread: spread.largest), "largest"),
        Column(
            "Test",
            "A4",
            _of_spread(lambda spread: "*" if spread.unlikely else ""),
            Origin(field="unlikely", true="*"),
        ),
    ),
)
OPTIONS = Mapped(
    title=_TITLE,
    layout="labels",
    columns={
        "Limit of residuals of marks": Origin(field="reduction.options.residual_limit", unit="um"),
        "Mean height of the ground": Origin(field="reduction.options.ground_height"),
    },
)
STATED: tuple[Report[Any] | Mapped, ...] = (OPTIONS, PLATES, MARKS, DISTANCES, PARAMETERS, SPREADS)
