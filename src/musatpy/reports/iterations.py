"""How the adjustment went: every iteration, and every pass of the water point correction."""

from __future__ import annotations

from musatpy.reports import result_record
from musatpy.reports.editing import prints_as_zero
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key
from musatpy.statistics import Statistics
from musatpy.units import ARC_SECOND

_ROTATION, _TRANSLATION = "F14.4", "F14.5"

# The name of what moved most is left out where the movement prints as zero: which one it is, is then rounding error
# of the machine, and a listing must not depend on that.
ITERATIONS: Report[Statistics] = Report(
    title="Iterations",
    table=result_record.ITERATIONS,
    columns=(
        key("Pass", "I4", "pass"),
        key("Iteration", "I9", "number"),
        Column("Largest rotation\narc sec", _ROTATION, shows="rotation"),
        Column("Photo", "A8", lambda s: _rotated(s), Origin(field="rotation_photo", unless="Largest rotation")),
        Column("Largest translation\nm", _TRANSLATION, shows="translation"),
        Column("Photo", "A8", lambda s: _moved(s), Origin(field="translation_photo", unless="Largest translation")),
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
        Column("Point", "A8", lambda s: _drifted(s), Origin(field="point", unless="Largest movement")),
        Column("RMS movement\nm", "F14.5", shows="rms_movement"),
        Column("RMS residual of\nsubmerged points um", "F10.2", shows=Origin(field="rms_residual", unit="um")),
    ),
)
STATED = (ITERATIONS, PASSES)


def sections(statistics: Statistics) -> list[Section]:
    """Return the iterations, and the passes where there are any."""
    found = [ITERATIONS.section(statistics, new_page=True)]
    if statistics.solution.passes:
        found.append(PASSES.section(statistics, title=f"{PASSES.title}{len(statistics.solution.passes)}"))
    return found


def _rotated(statistics: Statistics) -> list[str]:
    ids = statistics.block.photos.ids
    return [
        "" if prints_as_zero(_ROTATION, i.rotation / ARC_SECOND) else str(ids[i.rotation_photo])
        for i in statistics.solution.iterations
    ]


def _moved(statistics: Statistics) -> list[str]:
    ids = statistics.block.photos.ids
    return [
        "" if prints_as_zero(_TRANSLATION, i.translation) else str(ids[i.translation_photo])
        for i in statistics.solution.iterations
    ]


def _drifted(statistics: Statistics) -> list[str]:
    ids = statistics.block.points.ids
    return ["" if prints_as_zero("F14.5", p.movement) else str(ids[p.point]) for p in statistics.solution.passes]
