"""How the adjustment went: iterations, passes of the water point correction, and a summary of the solution."""

from __future__ import annotations

from collections.abc import Sequence

from musatpy.model import Iteration, WaterPass
from musatpy.reports import analyses, answer
from musatpy.reports.editing import number_text
from musatpy.reports.fields import Each, Field
from musatpy.reports.headline import SOLUTION
from musatpy.reports.pages import Section, by_kind, labelled, wrapped
from musatpy.reports.table import Content, Labels, Report, Texts, numbers_at, sentences_at, unless_zero
from musatpy.reports.values import at
from musatpy.statistics import Statistics
from musatpy.units import ARC_SECOND


def _iterations(statistics: Statistics) -> list[tuple[Iteration, str, str]]:
    """Return the iterations with the photos of their largest rotation and translation."""
    ids = statistics.block.photos.ids
    return [(i, str(ids[i.rotation_photo]), str(ids[i.translation_photo])) for i in statistics.solution.iterations]


ITERATIONS = Each[Statistics, tuple[Iteration, str, str]](
    "iterations", "one row per iteration", of=_iterations, fields=(
        Field("pass", "integer", "0 the first triangulation, 1.. the passes with refraction",
              lambda i: i[0].outer_pass, "Pass", "I4", is_id=True),
        Field("number", "integer", "iteration within the pass", lambda i: i[0].number, "Iteration", "I9",
              is_id=True),
        Field("rotation", "number?", "largest differential rotation", lambda i: i[0].rotation,
              "Largest rotation\narc sec", "F14.4"),
        Field("rotation_photo", "string", "its photo", lambda i: i[1], "Photo", "A8",
              shown=lambda t: unless_zero(t["rotation_photo"], "F14.4", t["rotation"] / ARC_SECOND)),
        Field("translation", "number?", "largest differential translation", lambda i: i[0].translation,
              "Largest translation\nm", "F14.5"),
        Field("translation_photo", "string", "its photo", lambda i: i[2], "Photo", "A8",
              shown=lambda t: unless_zero(t["translation_photo"], "F14.5", t["translation"])),
        Field("sum_of_squares", "number?", "weighted, after the step", lambda i: i[0].sum_of_squares,
              "Sum of squares", "F16.2"),
        Field("damping", "number?", "of the step control, 0 for a full step", lambda i: i[0].damping, "Damping",
              "E10.2"),
    ),
)  # fmt: skip


PASSES = Each[Statistics, tuple[WaterPass, str]](
    "water_passes", "one row per pass of the water point correction",
    of=lambda s: [(p, str(s.block.points.ids[p.point])) for p in s.solution.passes], fields=(
        Field("number", "integer", "pass", lambda p: p[0].number, "Pass", "I4", is_id=True),
        Field("movement", "number?", "largest movement of a submerged point since the pass before",
              lambda p: p[0].movement, "Largest movement\nm", "F14.5"),
        Field("point", "string", "its point", lambda p: p[1], "Point", "A8",
              shown=lambda t: unless_zero(t["point"], "F14.5", t["movement"])),
        Field("rms_movement", "number?", "of all submerged points", lambda p: p[0].rms_movement, "RMS movement\nm",
              "F14.5"),
        Field("rms_residual", "number?", "of the plate residuals of submerged points", lambda p: p[0].rms_residual,
              "RMS residual of\nsubmerged points um", "F10.2"),
    ),
)  # fmt: skip


# The name of what moved most is left out where the movement prints as zero: which one it is, is then rounding error
# of the machine, and a listing must not depend on that.
ITERATION_TABLE = Report("Iterations", ITERATIONS)
PASS_TABLE = Report(
    "Passes Of The Water Point Correction: ", PASSES, pattern=r"Passes Of The Water Point Correction: \d+"
)
LISTED_WARNINGS = 10  # of a kind; the record has them all
PLATE_RESIDUALS = Report(
    "Plate Residuals Of The Job",
    analyses.PLATE_STATISTICS,
    "kinds total_count total_rms",
    expand=("kinds", "total_count", "total_rms"),
)


_EDITS = {  # of what is no whole number
    "Weighted sum of squares": "F18.4",
    "Sigma0 (standard deviation of unit weight)": "F12.6",
    "Sigma0, errors of known water allowed for": "F12.6",
}


def _numbers(content: Content) -> dict[str, Sequence[float | None]]:
    """Return the numbers of the summary by their labels, as a record has them."""
    labels: dict[str, Sequence[float | None]] = {}
    for noun in ("Observations", "Unknowns"):
        counts = at(content, f"solution.{noun.lower()}") or {}
        labels |= {f"{noun}, {kind}": [count] for kind, count in counts.items()}
        labels[f"{noun}, all"] = [sum(count for count in counts.values() if isinstance(count, int | float))]
    labels["Degrees of freedom"] = numbers_at(content, "solution.degrees_of_freedom")
    for label, name in zip(_EDITS, ("sum_of_squares", "sigma0", "unit_sigma"), strict=True):
        labels[label] = numbers_at(content, f"solution.{name}")
    return labels


SUMMARY = Labels("Solution Summary", _numbers)
STATED = (
    ITERATION_TABLE,
    PASS_TABLE,
    SUMMARY,
    Texts(answer.ALL_REASONS, lambda r: sentences_at(r, "verdict.reasons", "verdict.notes"), "verdict"),
    PLATE_RESIDUALS,
    Texts("Warnings", lambda r: sentences_at(r, "solution.warnings"), "solution"),
)


def sections(statistics: Statistics) -> list[Section]:
    """Return iterations and passes, the summary, the plate residuals of the whole job, and warnings."""
    solution, passes = statistics.solution, len(statistics.solution.passes)
    start = f"Two starts were made. The iterations are those from {solution.start}." if solution.start else ""
    kinds = by_kind(solution.warnings, shown=LISTED_WARNINGS)
    return [
        ITERATION_TABLE.section(statistics, start, new_page=True),
        *([PASS_TABLE.section(statistics, title=f"{PASS_TABLE.title}{passes}")] if passes else []),
        Section(title=SUMMARY.title, lines=_summary(statistics)),
        *answer.all_reasons(statistics),
        PLATE_RESIDUALS.section(statistics),
        *([Section(title="Warnings", lines=[line for kind in kinds for line in kind])] if kinds else []),
    ]


def _summary(statistics: Statistics) -> list[str]:
    solution = statistics.solution
    verdict = "CONVERGED" if solution.converged else f"NOT CONVERGED: {solution.reason}"
    values = {name: value for name, (value,) in SOLUTION.raw(statistics).items()}
    lines = {}
    for label, (number,) in _numbers({"solution": values}).items():
        *_, considered = _EDITS
        is_said = label != considered or solution.considered is not None
        if number is not None and is_said and (number or not label.startswith(("Observations, ", "Unknowns, "))):
            lines[label] = number_text(_EDITS[label], number) if label in _EDITS else str(int(number))
    return [*wrapped([verdict]), "", *labelled(lines)]
