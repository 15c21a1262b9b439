"""Residuals of every plate measurement, photo by photo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.model import ObservationKind
from musatpy.records import json_files
from musatpy.reports.fields import IMAGE_DIGITS, Field, Rows, identity, of_job, unrecorded
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.reports.values import Json, Values, names
from musatpy.statistics import LARGE_RESIDUAL, Statistics

PLATES = Rows[Statistics, Statistics](
    "plates", "one row per plate measurement", (
        identity("photo", lambda s: s.block.photos.ids[s.block.plates.photo]),
        identity("point", lambda s: s.block.points.ids[s.block.plates.point]),
        Field("xy", "2 number", "measured", "block.plates.xy", ("x\nmm", "y\nmm"), "F10.4", exact=True),
        Field("sigma", "2 number", "a priori", "block.plate_sigmas", ("Sigma x\num", "Sigma y\num"), "F8.2"),
        Field("triangulated", "boolean", "took part in the solution", "solution.plates.triangulated", "Trig", "A4",
              words={True: "", False: "N"}),
        Field("residual", "2 number?", "adjusted minus measured", "solution.plates.residual",
              ("Resid. x\num", "Resid. y\num"), "F9.2"),
        Field("refraction", "2 number?", "adjusted straight image minus adjusted refracted image; 0 on land",
              "solution.plates.correction", ("Refr. x\num", "Refr. y\num"), "F9.2", blank=True),
    ),
    of_images=True,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Observed:
    """Some of the observations of a solution."""

    statistics: Statistics
    rows: IntArray

    def of_kinds(self, of: IntArray, values: Callable[[ObservationKind, IntArray], Sequence[Json]]) -> list[Json]:
        """Return what `values` has for the observations of each kind, by their numbers `of` that it depends on.

        It is asked but once for each of these numbers: most have several observations.
        """
        kinds, of = self.statistics.observed.kind[self.rows], of[self.rows]
        out = np.empty(len(kinds), dtype=object)
        for kind in np.unique(kinds).tolist():
            rows = np.flatnonzero(kinds == kind)
            numbers, which = np.unique(of[rows], return_inverse=True)
            found = values(ObservationKind(kind), numbers)
            out[rows] = np.fromiter(found, dtype=object, count=len(numbers))[which]
        return list(out.tolist())


def _observed(statistics: Statistics, *, besides_images: bool = False) -> _Observed | None:
    observed = statistics.solution.observed
    if observed is None:
        return None
    is_image = observed.kind == ObservationKind.PLATE
    return _Observed(statistics, np.flatnonzero(~(is_image & besides_images)))


def _kinds(some: _Observed) -> TextArray:
    kinds, which = np.unique(some.statistics.observed.kind[some.rows], return_inverse=True)
    return np.array(names(ObservationKind, kinds.tolist()), dtype=np.str_)[which]


def _owners(some: _Observed) -> list[list[str]]:
    of = some.statistics.observed.row
    return some.of_kinds(of, lambda kind, rows: kind.owners(some.statistics.solution, rows))


def _components(some: _Observed) -> list[str]:
    of = some.statistics.observed.component
    return some.of_kinds(of, lambda kind, numbers: [kind.components[number] for number in numbers.tolist()])


def _kinds_of(t: Values) -> list[ObservationKind]:
    return [ObservationKind[kind.upper()] for kind in t["kind"]]


def _units(t: Values) -> FloatArray:
    """Return what the printed unit of each observation (n,) is in units of the record."""
    return np.array([kind.factor for kind in _kinds_of(t)])


def _owner_texts(t: Values) -> list[str]:
    """Return the ids of each observation, side by side; of a solution without those of all others."""
    if t.source is None:
        owners = t["of"]
    else:
        links = zip(_kinds_of(t), t.source.observed.row[t.rows].reshape(-1, 1), strict=True)
        owners = [kind.owners(t.source.solution, row)[0] for kind, row in links]
    return [" ".join(f"{name:<8}" for name in names) if len(names) > 1 else "".join(names) for names in owners]


CORRELATED = " Each test of control with covariances (CTC) is of an error in one component alone (Baarda: P v)."
UNIT = unrecorded("Unit", "A4", lambda t: [kind.unit for kind in _kinds_of(t)])
OBSERVATIONS = Rows[Statistics, _Observed](
    "observations",
    "one row per scalar observation of the solution; residuals and errors in the unit of what was observed: plate "
    "mm, length m, angle rad",
    of=_observed,
    fields=(
        Field("kind", "string",
              "plate, control, station_position, station_attitude, equal_elevation, air_base, water_level, "
              "water_tilt, water_index, distance or height_difference", _kinds, "Kind", "A8", is_id=True,
              words={kind.name.lower(): kind.label for kind in ObservationKind}),
        Field("of", "* string", "ids of the photo, the point, or both", _owners, "Photo, point", "A17", is_id=True,
              shown=_owner_texts),
        Field("component", "string", "x, y, East, North, Up, X-Tilt, ...", _components, "Comp.", "A7", is_id=True),
        Field("residual", "number", "adjusted minus observed", lambda o: o.statistics.observed.residual[o.rows],
              "Residual", "F10.3", shown=lambda t: t["residual"] / _units(t)),
        Field("sigma", "number", "a priori", lambda o: o.statistics.observed.sigma[o.rows], "Sigma", "F9.3",
              shown=lambda t: t["sigma"] / _units(t)),
        Field("redundancy", "number",
              "redundancy number; they add up to the degrees of freedom where no control has covariances",
              lambda o: o.statistics.observed.redundancy[o.rows], "Redund.", "F7.3"),
        Field("standardised", "number?",
              "residual over its own a priori sigma; null where nothing checks the " "observation",
              lambda o: o.statistics.standardised[o.rows], "Stand.\nresidual", "F8.2"),
        Field("test", "number?", "the same with sigma0 from all other observations: Student's t",
              lambda o: np.where(np.isfinite(o.statistics.test), o.statistics.test, np.nan)[o.rows], "Test\nvalue",
              "F8.2"),
        Field("normal_test", "number?",
              "the larger of `standardised` and of residual, own sigma and sigma0 from all others (Pope's tau), "
              "the latter turned to a normal variable: what the verdict goes by",
              lambda o: o.statistics.normal_tests[o.rows], "Normal test", "F11.2"),
        Field("estimated_error", "number?",
              "of the observation if all others are right: minus residual over redundancy number",
              lambda o: o.statistics.estimated_error[o.rows], "Estimated error", "F15.3",
              shown=lambda t: t["estimated_error"] / _units(t)),
        Field("detectable", "number?", "smallest detectable error", lambda o: o.statistics.detectable[o.rows],
              "Detectable\nerror", "F10.3", shown=lambda t: t["detectable"] / _units(t)),
        Field("effect", "3 number?", "of that error on the own position, east, north, up; null for the water",
              lambda o: o.statistics.effect[o.rows], "Effect\nm", "F8.3",
              shown=lambda t: np.linalg.norm(t["effect"], axis=1)),
    ),
    of_images=True,
)  # fmt: skip
# As files have them: those of images stand in the table of plates.
BESIDES_IMAGES = replace(
    OBSERVATIONS,
    text=f"{OBSERVATIONS.text}; those of images are in `plates`",
    of=partial(_observed, besides_images=True),
)


def _of_plates(field: Field[_Observed]) -> Field[Statistics]:
    """Return a field of observations as one of the plates: two for each image, NaN of what was not observed."""

    def values(statistics: Statistics) -> FloatArray:
        some, number = _observed(statistics), len(statistics.block.plates.photo)
        sizes = (3,) if field.kind.startswith("3 ") else ()
        spread = np.full((number, 2, *sizes), np.nan)
        if some is not None:
            observed = some.statistics.observed
            of_plate = observed.kind == ObservationKind.PLATE
            spread[observed.row[of_plate], observed.component[of_plate]] = field.of(some)[of_plate]
        return spread

    kind = f"2x{field.kind}" if field.kind.startswith("3 ") else f"2 {field.kind}"
    unit = "mm" if field.name == "detectable" else field.unit
    kind = kind if kind.endswith("?") else f"{kind}?"
    text = f"of x and y, null where they took no part: {field.text}"
    return Field(field.name, kind, text, values, unit=unit, seldom=True, significant=IMAGE_DIGITS)


TESTED_PLATES = replace(
    PLATES,
    fields=(
        *PLATES.fields,
        *(_of_plates(field) for field in OBSERVATIONS.fields if field.name in json_files.FIELDS),
    ),
)


def _refraction(t: Values) -> FloatArray:
    """Return the refraction (n, 2) of images of submerged points, NaN of others: a listing leaves them blank."""
    if t.source is None:
        return np.asarray(t["refraction"])
    block = t.source.block
    return np.where(block.points.bathymetric[block.plates.point][t.rows, None], t["refraction"], np.nan)


RESIDUALS = Report(
    "Residuals Of Plate Measurements: Adjusted Minus Measured",
    PLATES,
    (
        "photo point xy residual sigma",
        PLATES.column("refraction", shown=_refraction),
        of_job("Bath", "A4", lambda s: s.block.points.letters[s.block.plates.point[s.plate_order]]),
        "triangulated",
        unrecorded(
            "Large",
            "A5",
            lambda t: np.where((np.abs(t["residual"]) > LARGE_RESIDUAL * t["sigma"]).any(axis=1), "*", ""),
        ),
    ),
    which=lambda t: t.source.plate_order if t.source else np.arange(t.count),
)


STATED = (RESIDUALS,)
brief = None  # left out


def sections(statistics: Statistics) -> list[Section]:
    """Return all residuals, with a blank line between photos."""
    if not len(statistics.block.plates.photo):
        return []
    section = RESIDUALS.section(statistics)
    photos = statistics.block.plates.photo[statistics.plate_order].tolist()
    lines: list[str] = []
    for photo, previous, line in zip(photos, [photos[0], *photos], section.lines, strict=False):
        if photo != previous:
            lines.append("")
        lines.append(line)
    note = f"*  Residual larger than {LARGE_RESIDUAL:.0f} sigmas of its measurement."
    return [replace(section, lines=[*lines, "", note], new_page=True)]
