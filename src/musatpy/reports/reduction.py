"""How raw plates were reduced: options, residuals of marks, every step with its parameters, what was left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from musatpy import model
from musatpy.fortran import decimals_of
from musatpy.model.reduction import SPREAD_LEVEL, Quantity, Reduced
from musatpy.reports import job_record
from musatpy.reports.editing import edited, number_text
from musatpy.reports.fields import Each, Field, FieldGroup, Rows, flag, identity, of_job
from musatpy.reports.pages import Section, labelled, wrapped
from musatpy.reports.table import Labels, Report, numbers_at
from musatpy.statistics import Statistics
from musatpy.units import ARC_SECOND, MICROMETRE

if TYPE_CHECKING:
    from musatpy.model.reduction import ReducedPlate, ReductionStep, Spread

TRANSFORMATION = {
    model.Transformation.SIMILARITY: "one scale",
    model.Transformation.AFFINE: "two scales and a shear",
    model.Transformation.PROJECTIVE: "eight parameters",
    model.Transformation.DISTANCES: "by calibrated distances between marks, a scale along each axis",
    model.Transformation.NONE: "the readings are in the fiducial system",
}
SIDE = {
    model.DistortionSide.MEASURED: "ideal = measured - distortion(measured)",
    model.DistortionSide.IDEAL: "measured = ideal + distortion(ideal)",
}
POLYNOMIALS = {
    model.Polynomials.DISTORTION: "those of the distortion: measured minus ideal place",
    model.Polynomials.CORRECTION: "those of the correction; below, those of the distortion",
}
ATMOSPHERE = {
    model.Atmosphere.NONE: "refraction in the air not corrected",
    model.Atmosphere.ARDC: "closed formula for the ARDC model",
    model.Atmosphere.US1976: "U.S. Standard Atmosphere 1976",
}
REFUSED = {model.Refused.STOP: "the run", model.Refused.GO_ON: "on without the photo"}


READINGS: Rows[Reduced, Reduced] = Rows(
    "readings",
    "one row per reading of a point",
    (
        Field("photo", "string", "photo id", lambda r: r.given.photos.ids[r.given.plates.photo]),
        Field("point", "string", "point id", lambda r: r.given.points.ids[r.given.plates.point]),
        Field("xy", "2 number", "reading", "given.plates.xy", unit="unit", exact=True),
        Field("sigma", "2 number?", "of the reading, as given", "given.plates.sigma", unit="unit"),
    ),
    of_images=True,
)
_MARKS: Rows[ReducedPlate, ReducedPlate] = Rows(
    "marks", "one row per measured mark", (
        Field("mark", "string", "mark id", "marks", "Mark", "A4", is_id=True),
        Field("residual", "2 number?", "transformed minus calibrated", "residuals",
              ("Resid. x\num", "Resid. y\num"), "F10.2"),
        Field("normalized", "2 number?", "residual over its own sigma", heading=("Over own\nsigma x", "\nsigma y"),
              edit="F9.2"),
    ),
)  # fmt: skip
_DISTANCES: Rows[ReducedPlate, ReducedPlate] = Rows(
    "distances", "one row per distance, where the transformation goes by distances", (
        Field("marks", "2 string", "mark ids", "ends", ("Mark", "Mark"), "A4", is_id=True),
        Field("residual", "number?", "scaled minus calibrated", "distance_residuals", "Residual\num", "F10.2"),
    ),
)  # fmt: skip
_PARAMETERS: Each[ReductionStep, Quantity] = Each(
    "parameters",
    "one row per parameter",
    of=lambda step: step.parameters,
    fields=(
        Field("parameter", "string", "name; of the lens those of the distortion", "name"),
        Field("value", "number?", "in its unit"),
        Field("sigma", "number?", "standard deviation, null where given"),
        Field("unit", "string", "unit; empty of coefficients", choices=("", "count", "mm", "m", "rad", "mm/unit")),
    ),
)
_STEPS: Each[ReducedPlate, ReductionStep] = Each(
    "steps", "one row per step taken, in their order", of=lambda p: p.steps, fields=(
        Field("step", "string", "name of the step", "name",
              choices=("comparator", "fiducials", "reseau", "lens", "refraction", "curvature")),
        Field("largest", "number?", "largest displacement, null of a step that changes the system", unit="mm"),
        _PARAMETERS,
    ),
)  # fmt: skip
_SPREADS: Each[ReducedPlate, Spread] = Each(
    "spreads", "one row per kind of repeated readings", of=lambda p: p.spreads, fields=(
        Field("of", "string", "what was read", "what", "Of", "A7", choices=("marks", "points", "crosses"),
              is_id=True),
        Field("freedom", "integer", "readings less targets", heading="Freedom", edit="I7"),
        Field("sigma", "2 number?", "of one reading, by coordinate", lambda s: np.array(s.pooled),
              ("Sigma u\nunit", "Sigma v\nunit"), "F9.5"),
        Field("probability", "2 number?", "of so large a spread by chance", lambda s: np.array(s.probability),
              ("Probability\nu", "Probability\nv"), "F11.4"),
        flag("unlikely", "a probability is below 0.05", "Test", "*"),
        Field("largest", "number?", "deviation from a mean", heading="Largest\ndeviation", edit="F9.5",
              unit="unit"),
        Field("beyond", "* string", "targets with readings beyond the limit"),
    ),
)  # fmt: skip
REDUCED_PLATES: Each[Reduced, ReducedPlate] = Each(
    "plates", "one row per raw plate, as the program reduced it", of=lambda r: r.plates, fields=(
        identity("photo"),
        Field("refusal", "string?", "why the plate is refused and the photo left out; null: it is not",
              lambda p: p.refusal or None),
        Field("reason", "string?",
              "the same in one word: MISSING, SWAPPED, MIRRORED, MISPLACED, DEGENERATE, LIMIT, HEIGHTS, LOST",
              lambda p: p.reason or None, "Refused", "A10"),
        Field("sigma0", "number?", "of the fiducial transformation, null without redundancy", heading="Sigma0",
              edit="F7.3"),
        Field("freedom", "integer", "its degrees of freedom", heading="Freedom", edit="I7"),
        Field("rms", "2 number?", "of the residuals of the marks", heading=("RMS x\num", "RMS y\num"), edit="F8.2"),
        _MARKS,
        _DISTANCES,
        Field("missing", "* string", "calibrated marks that were not measured", heading="Not\nmeasured", edit="I8",
              shown=lambda t: [len(marks) for marks in t["missing"]]),
        Field("suspects", "* string", "marks without any one of which the others keep the limit"),
        _STEPS,
        _SPREADS,
        Field("beyond_reseau", "* string", "points outside the measured crosses"),
        Field("beyond_table", "* string", "points outside the calibrated radii"),
    ),
)  # fmt: skip
REDUCTION: FieldGroup[Statistics, Reduced] = FieldGroup(
    "reduction",
    "what the reduction of raw plates did, null where plates came refined; `plates` above has the refined "
    "coordinates",
    of=lambda s: s.solution.reduced,
    fields=(
        job_record.part("reduction", "options", lambda r: r.given.reduction or model.ReductionOptions()),
        READINGS,
        REDUCED_PLATES,
    ),
    optional=True,
)


DISPLACING = {  # the steps within the fiducial system
    "reseau": "film deformation",
    "lens": "lens distortion",
    "refraction": "refraction in the air",
    "curvature": "earth curvature",
}

_TITLE = "Plate Reduction"
_NAN = float("nan")
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


def sections(statistics: Statistics) -> list[Section]:
    """Return the pages of the reduction; nothing where the plates came refined."""
    reduced = statistics.solution.reduced
    if reduced is None:
        return []
    options = reduced.given.reduction or model.ReductionOptions()
    tables = [
        *(report.section(reduced) for report in (PLATES, MARKS, DISTANCES)),
        PARAMETERS.section(list(_parameters(reduced))),
        SPREADS.section(reduced),
    ]
    left_out = [
        f"Photo {plate.photo}: {plate.reason}: {plate.refusal}." for plate in reduced.plates if plate.refusal
    ]
    texts = {"Notes": list(_notes(reduced)), "Photos Left Out": left_out}
    return [
        Section(title=_TITLE, lines=labelled(_options(options) | _largest(reduced)), new_page=True),
        *(section for section in tables if section.lines),
        *(Section(title=f"{_TITLE}: {title}", lines=wrapped(text)) for title, text in texts.items() if text),
    ]


brief = None  # left out


def _options(options: model.ReductionOptions) -> dict[str, str]:
    return {
        "Fiducial transformation": f"{options.transformation}  {TRANSFORMATION[options.transformation]}",
        "Limit of residuals of marks": _limit(options.residual_limit / MICROMETRE),
        "Side of the lens distortion": f"{options.side}  {SIDE[options.side]}",
        "Coefficients of the lens distortion": f"{options.polynomials}  {POLYNOMIALS[options.polynomials]}",
        "Atmosphere": f"{options.atmosphere}  {ATMOSPHERE[options.atmosphere]}",
        "Earth curvature": "corrected" if options.curvature is model.Curvature.YES else "not corrected",
        "Mean height of the ground": _given(options.ground_height, "m"),
        "A plate that is refused": f"{options.refused}  {REFUSED[options.refused]}",
    }


def _given(value: float, unit: str) -> str:
    return "none" if np.isnan(value) else f"{number_text('F12.2', value)} {unit}"


def _limit(um: float) -> str:
    """Return the limit of residuals with all of its digits: the smallest is none that prints as zero."""
    if np.isnan(um):
        return "none"
    decimals = decimals_of(um, 2)
    return f"{number_text(f'F30.{decimals}' if decimals <= _LONGEST else 'E30.11', um)} um"


def _largest(reduced: Reduced) -> dict[str, str]:
    """Return the largest displacement of the job by each step that displaces."""
    largest = {what: reduced.largest(name) for name, what in DISPLACING.items()}
    return {
        f"Largest displacement, {what}": f"{_given(found[1] / MICROMETRE, 'um')} on photo {found[0]}"
        for what, found in largest.items()
        if found is not None
    }


def _parameters(reduced: Reduced) -> Iterator[tuple[str, ...]]:
    """Yield photo, step, parameter, value, sigma, unit; a step as on an earlier photo only refers to that."""
    seen: dict[tuple[str, tuple[Quantity, ...]], str] = {}
    for plate in reduced.plates:
        for step in plate.steps:
            given = tuple(replace(quantity, sigma=0.0) for quantity in step.parameters)  # NaN is no number
            first = seen.setdefault((step.name, given), plate.photo)
            if first != plate.photo:
                yield plate.photo, step.name, f"as on photo {first}", "", "", ""
                continue
            for quantity in step.parameters:
                yield plate.photo, step.name, quantity.name, *_printed(quantity, coefficient=step.name == "lens")


def _printed(quantity: Quantity, *, coefficient: bool) -> tuple[str, str, str]:
    value, sigma, unit, size = _EDITS[quantity.unit]
    if coefficient and quantity.unit == "":
        value = _COEFFICIENT
    return edited(value, [quantity.value])[0], edited(sigma, [quantity.sigma / size])[0], unit


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
    if any(spread.unlikely for plate in reduced.plates for spread in plate.spreads):
        yield (
            f"*  So large a spread has a probability below {SPREAD_LEVEL:.2f} if one reading has the standard "
            "deviation given."
        )


def _moved(heading: str, name: str) -> Field[Reduced]:
    """Return the column of the largest displacement of each plate by a step."""
    return of_job(heading, "F9.2", lambda r: [_NAN if p.refusal else p.largest(name) for p in r.plates])


def _table(title: str, nested: str, *columns: Field[Reduced] | str) -> Report[Reduced]:
    """Return the table of the plates, or of what is `nested` in each of them in the record."""
    return Report(f"{_TITLE}: {title}", REDUCED_PLATES, ("photo", *columns), nested=nested)


PLATES = _table(
    "Plates",
    "",
    of_job("Marks", "I5", lambda r: [plate.used for plate in r.plates]),
    "missing rms sigma0 freedom",
    _moved("Largest:\nfilm um", "reseau"),
    _moved("\nlens um", "lens"),
    _moved("\nrefr. um", "refraction"),
    _moved("\ncurv. um", "curvature"),
    "reason",
)
MARKS = _table("Residuals Of Fiducial Marks: Transformed Minus Calibrated", "marks", "mark residual normalized")
DISTANCES = _table("Residuals Of Distances Between Marks", "distances", "marks residual")
PARAMETERS: Report[Sequence[tuple[str, ...]]] = Report(
    title=f"{_TITLE}: Steps And Parameters",
    columns=(
        of_job("Photo", "A8", partial(map, itemgetter(0))),
        of_job("Step", "A10", partial(map, itemgetter(1))),
        of_job("Parameter", "A24", partial(map, itemgetter(2))),
        of_job("             Value", "A18", partial(map, itemgetter(3))),
        of_job("        Sigma", "A13", partial(map, itemgetter(4))),
        of_job("Unit", "A14", partial(map, itemgetter(5))),
    ),
)
SPREADS = _table("Repeated Readings", "spreads", "of freedom sigma probability largest unlikely")


OPTIONS = Labels(
    _TITLE,
    lambda r: {
        "Limit of residuals of marks": numbers_at(r, "reduction.options.residual_limit", unit=MICROMETRE),
        "Mean height of the ground": numbers_at(r, "reduction.options.ground_height"),
    },
)
STATED = (OPTIONS, PLATES, MARKS, DISTANCES, PARAMETERS, SPREADS)
