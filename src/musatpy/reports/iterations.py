"""How the adjustment went: every iteration, and every pass of the water point correction."""

from __future__ import annotations

from musatpy.model import Iteration, WaterPass
from musatpy.reports.editing import prints_as_zero
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table
from musatpy.statistics import Statistics
from musatpy.units import ARC_SECOND, MICROMETRE

_ROTATION, _TRANSLATION = "F14.4", "F14.5"

# The name of what moved most is left out where the movement prints as zero: which one it is, is then rounding error
# of the machine, and a listing must not depend on that.
ITERATIONS: tuple[Column[Statistics], ...] = (
    Column("Pass", "I4", lambda s: [i.outer_pass for i in s.solution.iterations]),
    Column("Iteration", "I9", lambda s: [i.number for i in s.solution.iterations]),
    Column("Largest rotation\narc sec", _ROTATION, lambda s: [_seconds(i) for i in s.solution.iterations]),
    Column("Photo", "A8", lambda s: [_rotated(s, i) for i in s.solution.iterations]),
    Column("Largest translation\nm", _TRANSLATION, lambda s: [i.translation for i in s.solution.iterations]),
    Column("Photo", "A8", lambda s: [_moved(s, i) for i in s.solution.iterations]),
    Column("Sum of squares", "F16.2", lambda s: [i.sum_of_squares for i in s.solution.iterations]),
    Column("Damping", "E10.2", lambda s: [i.damping for i in s.solution.iterations]),
)
PASSES: tuple[Column[Statistics], ...] = (
    Column("Pass", "I4", lambda s: [p.number for p in s.solution.passes]),
    Column("Largest movement\nm", "F14.5", lambda s: [p.movement for p in s.solution.passes]),
    Column("Point", "A8", lambda s: [_drifted(s, p) for p in s.solution.passes]),
    Column("RMS movement\nm", "F14.5", lambda s: [p.rms_movement for p in s.solution.passes]),
    Column("RMS residual of\nsubmerged points um", "F10.2", lambda s: [_residual(p) for p in s.solution.passes]),
)


def sections(statistics: Statistics) -> list[Section]:
    """Return the iterations, and the passes where there are any."""
    iterations, passes = Table(ITERATIONS), Table(PASSES)
    found = [Section(title="Iterations", head=iterations.head(), lines=iterations.lines(statistics), new_page=True)]
    if statistics.solution.passes:
        title = f"Passes Of The Water Point Correction: {len(statistics.solution.passes)}"
        found.append(Section(title=title, head=passes.head(), lines=passes.lines(statistics)))
    return found


def _seconds(iteration: Iteration) -> float:
    return iteration.rotation / ARC_SECOND


def _residual(water_pass: WaterPass) -> float:
    return water_pass.rms_residual / MICROMETRE


def _rotated(statistics: Statistics, iteration: Iteration) -> str:
    if prints_as_zero(_ROTATION, _seconds(iteration)):
        return ""
    return str(statistics.block.photos.ids[iteration.rotation_photo])


def _moved(statistics: Statistics, iteration: Iteration) -> str:
    if prints_as_zero(_TRANSLATION, iteration.translation):
        return ""
    return str(statistics.block.photos.ids[iteration.translation_photo])


def _drifted(statistics: Statistics, water_pass: WaterPass) -> str:
    if prints_as_zero("F14.5", water_pass.movement):
        return ""
    return str(statistics.block.points.ids[water_pass.point])
