"""Points whose heights contradict their flags, adjusted once more with the other ones; and as causes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from musatpy.adjustment import programs
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import IntArray
from musatpy.blunders.causes import ADVICE
from musatpy.errors import AdjustmentError
from musatpy.model import Block, Cause, CauseKind, OtherFlags, Solution
from musatpy.model.progress import Progress
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import elevations
from musatpy.statistics.flags import NO_BETTER


def with_other_flags(solution: Solution, progress: Progress | None = None, sea: Sea | None = None) -> Solution:
    """Return a solution with what becomes of points that contradict their flags when all have the other one.

    That is one more adjustment. A point can be flagged where there is an index, and a tide at all its photos.
    """
    statistics = Statistics(solution)
    points = statistics.flags.point[statistics.flags.doubted]
    if not len(points) or not solution.converged:
        return solution
    block, height, squares, consistent = solution.block, np.full(len(points), np.nan), np.nan, False
    turned = _with_flags_turned(block, points)
    changed = turned.points.bathymetric[points] != block.points.bathymetric[points]
    try:
        other = programs.adjust(turned, progress, sea) if changed.any() else None
    except AdjustmentError:
        other = None
    if other is not None and other.converged:
        again, unit = Statistics(other), max(solution.unit_sigma, other.unit_sigma)
        height = np.where(changed, elevations(block, other.points.position)[points], np.nan)
        squares = other.sum_of_squares
        as_good = squares - solution.sum_of_squares < NO_BETTER * unit**2
        consistent = bool(changed.all() and as_good and not len(again.flags.doubted))
    other_flags = OtherFlags(point=points, height=height, sum_of_squares=squares, consistent=consistent)
    return replace(solution, other_flags=other_flags)


def _with_flags_turned(block: Block, points: IntArray) -> Block:
    """Return a block with the flags of some points the other way, as far as water over them is known."""
    without = block.points.ids != ""  # no index: no point can be refracted
    if block.water is not None:
        without = np.zeros(len(without), dtype=bool)
        without[block.plates.point[np.isnan(block.photos.tide[block.plates.photo])]] = True
    wet = block.points.bathymetric.copy()
    wet[points] = ~wet[points] & ~without[points]
    return replace(block, points=replace(block.points, bathymetric=wet))


def flag_causes(solution: Solution) -> Iterator[Cause]:
    """Yield what explains heights that contradict flags: the flags, and an offset of the water where one does.

    The flags are the likelier; the offset alone, where so many contradict theirs that other ones do not end it.
    """
    statistics = Statistics(solution)
    tests, points = statistics.flags, solution.block.points
    rows = tests.doubted
    if not len(rows):
        return
    flags = Cause(
        kind=CauseKind.FLAG,
        cards=("PLT",),
        points=tuple(points.ids[tests.point[rows]].tolist()),
        size=(float(tests.wrong_side[rows[0]]),),
        sigma=(float(tests.sigma[rows[0]]),),
        unit="m",
        test=float(tests.sigmas[rows[0]]),
        advice=ADVICE[CauseKind.FLAG],
    )
    least, most = tests.offset
    if not (np.isfinite(least) and least <= most < np.inf):
        yield flags
        return
    size = (-0.5 * (least + most),)
    sigma = (0.5 * (most - least) / tests.limit,)
    kind = CauseKind.TIDES
    tides = replace(flags, kind=kind, cards=("TID",), points=(), size=size, sigma=sigma, advice=ADVICE[kind])
    yield from (tides,) if tests.is_of_the_whole(solution.other_flags) else (flags, tides)
