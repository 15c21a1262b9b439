"""How the adjustment went: every iteration, and every pass of the water point correction."""

from __future__ import annotations

from musatpy.model import Iteration, Solution, Verdict, WaterPass
from musatpy.model.findings import Reason
from musatpy.reports.fields import Each, Field, Group
from musatpy.reports.pages import Section
from musatpy.reports.table import Report, unless_zero
from musatpy.statistics import Statistics
from musatpy.units import ARC_SECOND

_GRADES = ("DOUBTFUL", "REJECTED", "FAILED")
VERDICT = Group[Statistics, Verdict](
    "verdict",
    "what the run is worth",
    of=lambda s: s.verdict,
    fields=(
        Field("grade", "string", "that of the worst reason; FAILED has not converged",
              choices=("ACCEPTED", *_GRADES)),
        Each[Verdict, Reason](
            "reasons",
            "one row per reason against the answer, the worst first",
            of=lambda v: v.reasons,
            fields=(
                Field("grade", "string", "that the reason alone would give", choices=_GRADES),
                Field("concern", "string", "what it is about: convergence, sigma0, control, ..."),
                Field("text", "string", "the reason"),
                Field("section", "string", "how the title of the section of the listing begins where it shows"),
            ),
        ),
        Field("notes", "* string", "worth knowing, and no doubt"),
    ),
)  # fmt: skip


def _solution(statistics: Statistics) -> Solution:
    return statistics.solution


SOLUTION = Group[Statistics, Solution](
    "solution",
    "the result in short",
    of=_solution,
    fields=(
        Field("converged", "boolean", "whether the limits were reached"),
        Field("reason", "string", "why not converged; empty when converged"),
        Field("warnings", "* string", "ill-determined unknowns and the like"),
        Field("sigma0", "number?", "standard deviation of unit weight, a posteriori"),
        Field("unit_sigma", "number?",
              "the same without what the errors of known water explain: it is tested, and scales the covariances"),
        Field("degrees_of_freedom", "integer", "observations minus unknowns"),
        Field("sum_of_squares", "number?", "weighted, of all residuals"),
        Field("observations", "map", "kind of observation -> number", lambda s: _counts(s.observations)),
        Field("unknowns", "map", "kind of unknown -> number", lambda s: _counts(s.unknowns)),
    ),
)  # fmt: skip


def _counts(counts: dict[str, int]) -> dict[str, int]:
    return {kind: int(count) for kind, count in counts.items()}


def _iterations(statistics: Statistics) -> list[tuple[Iteration, str, str]]:
    """Return the iterations with the photos of their largest rotation and translation."""
    ids = statistics.block.photos.ids
    return [(i, str(ids[i.rotation_photo]), str(ids[i.translation_photo])) for i in statistics.solution.iterations]


ITERATIONS = Each[Statistics, tuple[Iteration, str, str]](
    "iterations",
    "one row per iteration",
    of=_iterations,
    fields=(
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


def _passes(statistics: Statistics) -> list[tuple[WaterPass, str]]:
    """Return the passes with the points of their largest movements."""
    return [(p, str(statistics.block.points.ids[p.point])) for p in statistics.solution.passes]


PASSES = Each[Statistics, tuple[WaterPass, str]](
    "water_passes",
    "one row per pass of the water point correction",
    of=_passes,
    fields=(
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
STATED = (ITERATION_TABLE, PASS_TABLE)


def sections(statistics: Statistics) -> list[Section]:
    """Return the iterations, and the passes where there are any."""
    solution, passes = statistics.solution, len(statistics.solution.passes)
    start = f"Two starts were made. The iterations are those from {solution.start}." if solution.start else ""
    first = ITERATION_TABLE.section(statistics, start, new_page=True)
    return [first, PASS_TABLE.section(statistics, title=f"{PASS_TABLE.title}{passes}")] if passes else [first]
