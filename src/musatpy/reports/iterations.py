"""How the adjustment went: every iteration, and every pass of the water point correction."""

from __future__ import annotations

from musatpy.reports import result_record
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics

# The name of what moved most is left out where the movement prints as zero: which one it is, is then rounding error
# of the machine, and a listing must not depend on that.
ITERATIONS: Report[Statistics] = Report(
    title="Iterations",
    table=result_record.ITERATIONS,
    columns=(
        *("pass", "number", "rotation", "rotation_photo"),
        *("translation", "translation_photo", "sum_of_squares", "damping"),
    ),
)
PASSES: Report[Statistics] = Report(
    title="Passes Of The Water Point Correction: ",
    pattern=r"Passes Of The Water Point Correction: \d+",
    table=result_record.PASSES,
    columns=("number", "movement", "point", "rms_movement", "rms_residual"),
)
STATED = (ITERATIONS, PASSES)


def sections(statistics: Statistics) -> list[Section]:
    """Return the iterations, and the passes where there are any."""
    solution, passes = statistics.solution, len(statistics.solution.passes)
    start = ["", *wrapped([f"Two starts were made. The iterations are those from {solution.start}."])]
    first = ITERATIONS.section(statistics, start if solution.start else (), new_page=True)
    return [first, PASSES.section(statistics, title=f"{PASSES.title}{passes}")] if passes else [first]
