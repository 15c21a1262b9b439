"""The part of the record that says what raw plates were reduced from, how, and with which residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from musatpy.model import ReductionOptions
from musatpy.reports.fields import Each, Field, Group, Rows, same
from musatpy.statistics import Statistics

if TYPE_CHECKING:
    from musatpy.model.reduced import Quantity, Reduced, ReducedPlate, ReductionStep, Spread

_OPTIONS: Group[Reduced, ReductionOptions] = Group(
    "options",
    "the reduction card",
    lambda r: r.given.reduction or ReductionOptions(),
    (
        Field(
            "transformation", "string", "fiducial transformation", lambda o: o.transformation,
            choices=("SIMILARITY", "AFFINE", "PROJECTIVE", "DISTANCES", "NONE"),
        ),
        Field(
            "residual_limit", "number?", "of marks, or of distances between them", lambda o: o.residual_limit, "mm",
        ),
        Field(
            "side", "string", "whose place the lens distortion is given for", lambda o: o.side,
            choices=("MEASURED", "IDEAL"),
        ),
        Field(
            "polynomials", "string", "what the coefficients on the cards give", lambda o: o.polynomials,
            choices=("DIST", "CORR"),
        ),
        Field(
            "atmosphere", "string", "standard atmosphere of the refraction", lambda o: o.atmosphere,
            choices=("NONE", "ARDC", "US1976"),
        ),
        Field(
            "curvature", "string", "correction of the earth's curvature", lambda o: o.curvature,
            choices=("NO", "YES"),
        ),
        Field("ground_height", "number?", "mean height of what the photos show", lambda o: o.ground_height, "m"),
        Field(
            "refused", "string", "what a refused plate does to the run", lambda o: o.refused, choices=("STOP", "GO")
        ),
    ),
)  # fmt: skip
READINGS: Rows[Reduced, Reduced] = Rows(
    "readings",
    "one row per reading of a point",
    same,
    (
        Field("photo", "string", "photo id", lambda r: r.given.photos.ids[r.given.plates.photo]),
        Field("point", "string", "point id", lambda r: r.given.points.ids[r.given.plates.point]),
        Field("xy", "2 number", "reading", lambda r: r.given.plates.xy, "unit"),
        Field("sigma", "2 number?", "of the reading, as given", lambda r: r.given.plates.sigma, "unit"),
    ),
)
_MARKS: Rows[ReducedPlate, ReducedPlate] = Rows(
    "marks",
    "one row per measured mark",
    same,
    (
        Field("mark", "string", "mark id", lambda p: p.marks),
        Field("residual", "2 number?", "transformed minus calibrated", lambda p: p.residuals, "mm"),
        Field("normalized", "2 number?", "residual over its own sigma", lambda p: p.normalized),
    ),
)
_DISTANCES: Rows[ReducedPlate, ReducedPlate] = Rows(
    "distances",
    "one row per distance, where the transformation goes by distances",
    same,
    (
        Field("marks", "2 string", "mark ids", lambda p: p.ends),
        Field("residual", "number?", "scaled minus calibrated", lambda p: p.distance_residuals, "mm"),
    ),
)
_PARAMETERS: Each[ReductionStep, Quantity] = Each(
    "parameters",
    "one row per parameter",
    lambda step: step.parameters,
    (
        Field("parameter", "string", "name; of the lens those of the distortion", lambda q: q.name),
        Field("value", "number?", "in its unit", lambda q: q.value),
        Field("sigma", "number?", "standard deviation, null where given", lambda q: q.sigma),
        Field(
            "unit", "string", "unit; empty of coefficients", lambda q: q.unit,
            choices=("", "count", "mm", "m", "rad", "mm/unit"),
        ),
    ),
)  # fmt: skip
_STEPS: Each[ReducedPlate, ReductionStep] = Each(
    "steps",
    "one row per step taken, in their order",
    lambda p: p.steps,
    (
        Field(
            "step", "string", "name of the step", lambda step: step.name,
            choices=("comparator", "fiducials", "reseau", "lens", "refraction", "curvature"),
        ),
        Field(
            "largest", "number?", "largest displacement, null of a step that changes the system",
            lambda step: step.largest, "mm",
        ),
        _PARAMETERS,
    ),
)  # fmt: skip
_SPREADS: Each[ReducedPlate, Spread] = Each(
    "spreads",
    "one row per kind of repeated readings",
    lambda p: p.spreads,
    (
        Field("of", "string", "what was read", lambda s: s.what, choices=("marks", "points", "crosses")),
        Field("freedom", "integer", "readings less targets", lambda s: s.freedom),
        Field("sigma", "2 number?", "of one reading, by coordinate", lambda s: np.array(s.pooled), "unit"),
        Field("probability", "2 number?", "of so large a spread by chance", lambda s: np.array(s.probability)),
        Field("unlikely", "boolean", "a probability is below 0.05", lambda s: s.unlikely),
        Field("largest", "number?", "deviation from a mean", lambda s: s.largest, "unit"),
        Field("beyond", "* string", "targets with readings beyond the limit", lambda s: s.beyond),
    ),
)
REDUCED_PLATES: Each[Reduced, ReducedPlate] = Each(
    "plates",
    "one row per raw plate, as the program reduced it",
    lambda r: r.plates,
    (
        Field("photo", "string", "photo id", lambda p: p.photo),
        Field(
            "refusal", "string?", "why the plate is refused and the photo left out; null: it is not",
            lambda p: p.refusal or None,
        ),
        Field(
            "reason", "string?",
            "the same in one word: MISSING, SWAPPED, MIRRORED, MISPLACED, DEGENERATE, LIMIT, HEIGHTS, LOST",
            lambda p: p.reason or None,
        ),
        Field("sigma0", "number?", "of the fiducial transformation, null without redundancy", lambda p: p.sigma0),
        Field("freedom", "integer", "its degrees of freedom", lambda p: p.freedom),
        Field("rms", "2 number?", "of the residuals of the marks", lambda p: p.rms, "mm"),
        _MARKS,
        _DISTANCES,
        Field("missing", "* string", "calibrated marks that were not measured", lambda p: p.missing),
        Field(
            "suspects", "* string", "marks without any one of which the others keep the limit", lambda p: p.suspects
        ),
        _STEPS,
        _SPREADS,
        Field("beyond_reseau", "* string", "points outside the measured crosses", lambda p: p.beyond_reseau),
        Field("beyond_table", "* string", "points outside the calibrated radii", lambda p: p.beyond_table),
    ),
)  # fmt: skip
REDUCTION: Group[Statistics, Reduced] = Group(
    "reduction",
    "what the reduction of raw plates did, null where plates came refined; `plates` above has the refined "
    "coordinates",
    lambda s: s.solution.reduced,
    (_OPTIONS, READINGS, REDUCED_PLATES),
    optional=True,
)
