"""How the adjustment went: every iteration, and every pass of the water point correction."""

from __future__ import annotations

from musatpy.reports import result_record
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics

# The name of what moved most is left out where the movement prints as zero: which one it is, is then rounding error
# of the machine, and a listing must not depend on that.
ITERATIONS: Report[Statistics] = Report(
    title="Iterations",
    table=result_record.ITERATIONS,
    columns=(
        key("Pass", "I4", "pass"),
        key("Iteration", "I9", "number"),
        Column("Largest rotation\narc sec", "F14.4", shows="rotation"),
        Column("Photo", "A8", shows=Origin(field="rotation_photo", unless="Largest rotation")),
        Column("Largest translation\nm", "F14.5", shows="translation"),
        Column("Photo", "A8", shows=Origin(field="translation_photo", unless="Largest translation")),
        Column("Sum of squares", "F16.2", shows="sum_of_squares"),
        Column("Damping", "E10.2", shows="damping"),
    ),
)
PASSES: Report[Statistics] = Report(
    title="Passes Of The Water Point Correction: ",
    pattern=r"Passes Of The Water Point Correction: \d+",
    table=result_record.PASSES,
    columns=(
        key("Pass", "I4", "number"),
        Column("Largest movement\nm", "F14.5", shows="movement"),
        Column("Point", "A8", shows=Origin(field="point", unless="Largest movement")),
        Column("RMS movement\nm", "F14.5", shows="rms_movement"),
        Column("RMS residual of\nsubmerged points um", "F10.2", shows=Origin(field="rms_residual", unit="um")),
    ),
)
STATED = (ITERATIONS, PASSES)


def sections(statistics: Statistics) -> list[Section]:
    """Return the iterations, and the passes where there are any."""
    solution, passes = statistics.solution, len(statistics.solution.passes)
    start = ["", *wrapped([f"Two starts were made. The iterations are those from {solution.start}."])]
    first = ITERATIONS.section(statistics, start if solution.start else (), new_page=True)
    return [first, PASSES.section(statistics, title=f"{PASSES.title}{passes}")] if passes else [first]
