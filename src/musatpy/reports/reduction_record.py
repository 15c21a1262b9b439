"""The part of the record that says what raw plates were reduced from, how, and with which residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from musatpy.model import ReductionOptions
from musatpy.reports import job_record
from musatpy.reports.fields import Each, Field, Group, Rows, same
from musatpy.statistics import Statistics

if TYPE_CHECKING:
    from musatpy.model.reduction import Quantity, Reduced, ReducedPlate, ReductionStep, Spread

READINGS: Rows[Reduced, Reduced] = Rows(
    "readings",
    "one row per reading of a point",
    same,
    (
        Field("photo", "string", "photo id", lambda r: r.given.photos.ids[r.given.plates.photo]),
        Field("point", "string", "point id", lambda r: r.given.points.ids[r.given.plates.point]),
        Field("xy", "2 number", "reading", lambda r: r.given.plates.xy, "unit", exact=True),
        Field("sigma", "2 number?", "of the reading, as given", lambda r: r.given.plates.sigma, "unit"),
    ),
    of_images=True,
)
_MARKS: Rows[ReducedPlate, ReducedPlate] = Rows(
    "marks",
    "one row per measured mark",
    same,
    (
        Field("mark", "string", "mark id", lambda p: p.marks, heading="Mark", edit="A4", is_id=True),
        Field(
            "residual",
            "2 number?",
            "transformed minus calibrated",
            lambda p: p.residuals,
            "mm",
            heading=("Resid. x\num", "Resid. y\num"),
            edit="F10.2",
        ),
        Field(
            "normalized",
            "2 number?",
            "residual over its own sigma",
            edit="F9.2",
            heading=("Over own\nsigma x", "\nsigma y"),
        ),
    ),
)
_DISTANCES: Rows[ReducedPlate, ReducedPlate] = Rows(
    "distances",
    "one row per distance, where the transformation goes by distances",
    same,
    (
        Field("marks", "2 string", "mark ids", lambda p: p.ends, heading=("Mark", "Mark"), edit="A4", is_id=True),
        Field(
            "residual",
            "number?",
            "scaled minus calibrated",
            lambda p: p.distance_residuals,
            "mm",
            heading="Residual\num",
            edit="F10.2",
        ),
    ),
)
_PARAMETERS: Each[ReductionStep, Quantity] = Each(
    "parameters",
    "one row per parameter",
    lambda step: step.parameters,
    (
        Field("parameter", "string", "name; of the lens those of the distortion", lambda q: q.name),
        Field("value", "number?", "in its unit"),
        Field("sigma", "number?", "standard deviation, null where given"),
        Field("unit", "string", "unit; empty of coefficients", choices=("", "count", "mm", "m", "rad", "mm/unit")),
    ),
)
_STEPS: Each[ReducedPlate, ReductionStep] = Each(
    "steps",
    "one row per step taken, in their order",
    lambda p: p.steps,
    (
        Field("step", "string", "name of the step", lambda step: step.name,
              choices=("comparator", "fiducials", "reseau", "lens", "refraction", "curvature")),
        Field("largest", "number?", "largest displacement, null of a step that changes the system", unit="mm"),
        _PARAMETERS,
    ),
)  # fmt: skip
_SPREADS: Each[ReducedPlate, Spread] = Each(
    "spreads",
    "one row per kind of repeated readings",
    lambda p: p.spreads,
    (
        Field(
            "of",
            "string",
            "what was read",
            lambda s: s.what,
            choices=("marks", "points", "crosses"),
            heading="Of",
            edit="A7",
            is_id=True,
        ),
        Field("freedom", "integer", "readings less targets", heading="Freedom", edit="I7"),
        Field(
            "sigma",
            "2 number?",
            "of one reading, by coordinate",
            lambda s: np.array(s.pooled),
            "unit",
            heading=("Sigma u\nunit", "Sigma v\nunit"),
            edit="F9.5",
        ),
        Field(
            "probability",
            "2 number?",
            "of so large a spread by chance",
            lambda s: np.array(s.probability),
            heading=("Probability\nu", "Probability\nv"),
            edit="F11.4",
        ),
        Field(
            "unlikely",
            "boolean",
            "a probability is below 0.05",
            heading="Test",
            edit="A4",
            words={True: "*", False: ""},
        ),
        Field(
            "largest",
            "number?",
            "deviation from a mean",
            unit="unit",
            heading="Largest\ndeviation",
            edit="F9.5",
        ),
        Field("beyond", "* string", "targets with readings beyond the limit"),
    ),
)
REDUCED_PLATES: Each[Reduced, ReducedPlate] = Each(
    "plates",
    "one row per raw plate, as the program reduced it",
    lambda r: r.plates,
    (
        Field("photo", "string", "photo id", heading="Photo", edit="A8", is_id=True),
        Field("refusal", "string?", "why the plate is refused and the photo left out; null: it is not",
              lambda p: p.refusal or None),
        Field("reason", "string?",
              "the same in one word: MISSING, SWAPPED, MIRRORED, MISPLACED, DEGENERATE, LIMIT, HEIGHTS, LOST",
              lambda p: p.reason or None, heading="Refused", edit="A10"),
        Field("sigma0", "number?", "of the fiducial transformation, null without redundancy", heading="Sigma0",
              edit="F7.3"),
        Field("freedom", "integer", "its degrees of freedom", heading="Freedom", edit="I7"),
        Field("rms", "2 number?", "of the residuals of the marks", unit="mm", heading=("RMS x\num", "RMS y\num"),
              edit="F8.2"),
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
REDUCTION: Group[Statistics, Reduced] = Group(
    "reduction",
    "what the reduction of raw plates did, null where plates came refined; `plates` above has the refined "
    "coordinates",
    lambda s: s.solution.reduced,
    (
        job_record.part("reduction", "options", lambda r: r.given.reduction or ReductionOptions()),
        READINGS,
        REDUCED_PLATES,
    ),
    optional=True,
)
