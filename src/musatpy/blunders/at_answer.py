"""Causes that the answer of a run shows by itself, where no search is made or none can tell.

Heights that contradict flags, with what the other flags give; check points that do not agree, which take no part in
the adjustment: their card and their images explain that alike; and, where there is no time for a search, what
explains the misfit in the linear model at the answer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from musatpy import adjustment
from musatpy.adjustment.job import prepared
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import IntArray
from musatpy.errors import AdjustmentError
from musatpy.model import Block, Cause, CauseKind, OtherFlags, Solution
from musatpy.model.findings import mnemonics
from musatpy.model.progress import Progress
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import elevations
from musatpy.statistics.flags import NO_BETTER
from musatpy.statistics.verdict import CHECK_POINT_RISK

_CHECK_POINTS = 3  # the worst first
_MOST = 3  # hypotheses


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
        other = adjustment.adjust(turned, progress, sea) if changed.any() else None
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
        advice=CauseKind.FLAG.advice,
    )
    least, most = tests.offset
    if not (np.isfinite(least) and least <= most < np.inf):
        yield flags
        return
    size = (-0.5 * (least + most),)
    sigma = (0.5 * (most - least) / tests.limit,)
    kind = CauseKind.TIDES
    tides = replace(flags, kind=kind, cards=("TID",), points=(), size=size, sigma=sigma, advice=kind.advice)
    yield from (tides,) if tests.is_of_the_whole(solution.other_flags) else (flags, tides)


def check_point_causes(solution: Solution) -> Iterator[Cause]:
    """Yield card and images of each check point beyond its own test, as equal causes."""
    if solution.observed is None:
        return
    statistics, block = Statistics(solution), solution.block
    check = statistics.check_test
    beyond = np.flatnonzero(check.probability < CHECK_POINT_RISK)
    worst = beyond[np.argsort(-check.squares[beyond], kind="stable")][:_CHECK_POINTS]
    for number, place in enumerate(worst.tolist(), 1):
        row, squares = int(check.row[place]), float(check.squares[place])
        point, components = int(block.control.point[row]), int(check.components[place])
        images = block.plates.photo[block.plates.point == point]
        size = -statistics.control.difference[row]  # given minus what the images say
        sigma = np.hypot(statistics.point_sigmas[point], np.nan_to_num(block.control.sigma[row]))
        known = np.isfinite(size)
        card = Cause(
            kind=CauseKind.CONTROL,
            cards=mnemonics(CauseKind.CONTROL.cards, block.options.system),
            points=(str(block.points.ids[point]),),
            component="check point",
            size=tuple(size[known].tolist()),
            sigma=tuple(sigma[known].tolist()),
            unit="m",
            parameters=components,
            drop=squares * statistics.check_sigma0**2,
            test=float(np.sqrt(squares / components)),
            group=number,
            advice=CauseKind.CONTROL.advice,
        )
        yield card
        yield replace(
            card,
            kind=CauseKind.IMAGES,
            cards=("PLT",),
            photos=tuple(dict.fromkeys(block.photos.ids[images].tolist())),
            component="",
            size=(),
            sigma=(),
            unit="",
            advice=CauseKind.IMAGES.advice,
        )


def first_look(solution: Solution, sea: Sea | None) -> tuple[Cause, ...]:
    """Return the hypotheses that explain most, each taken alone, of a linear model at the answer of a run.

    It takes one factorisation. Raises `AdjustmentError` and `SingularNormalsError`.
    """
    from musatpy.blunders.causes import cause_of  # few runs come to this
    from musatpy.blunders.competition import Rival
    from musatpy.blunders.explanation import NEARLY, sensible
    from musatpy.blunders.hypotheses import hypotheses
    from musatpy.blunders.linear_model import linear_model
    from musatpy.blunders.scene import Effort, ones, scene_of, search_block, standing

    block = solution.block
    job, state = prepared(search_block(standing(block, solution.stations), sea), None, sea)
    scene = scene_of(job, state, Effort(left=math.inf))
    model = linear_model(scene, ones(scene), state)
    options = [option for option in hypotheses(model) if sensible(option) and option.parameters]
    best = max((option.squares for option in options), default=0.0)
    if not best > 0.0:
        return ()
    rest = max(model.squares - best, 0.0) / max(solution.degrees_of_freedom - 1, 1)
    sigma0 = float(np.sqrt(max(rest, 1.0)))
    near = [option for option in options if option.squares >= NEARLY * best][:_MOST]
    return tuple(
        cause_of(block, sigma0, Rival(hypothesis=option, drop=option.squares, group=1, rank=number))
        for number, option in enumerate(near, 1)
    )
