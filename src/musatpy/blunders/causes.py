"""The ranked causes of what does not fit, in words: what may be wrong, its size, and which card to read again.

Those that the search has found; and those that the answer of a run shows by itself. Heights may contradict flags;
check points, which take no part in the adjustment, may not agree: their cards and their images explain that alike;
and, where there is no time for a search, the linear model at the answer says what explains the misfit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from musatpy import adjustment
from musatpy.adjustment.iteration import State, given_minus
from musatpy.adjustment.job import prepared
from musatpy.adjustment.precision import reach_of
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import IntArray
from musatpy.blunders.competition import Rival, rivals
from musatpy.blunders.explanation import NEARLY, sensible
from musatpy.blunders.findings import findings
from musatpy.blunders.hypotheses import CARDS, CONTROL, PLATES, STATIONS, Hypothesis, hypotheses, in_words
from musatpy.blunders.linear_model import linear_model
from musatpy.blunders.names import FAR, exchanged_photos
from musatpy.blunders.scene import Effort, StagedBlock, ones, scene_of, search_block, standing, taking_part
from musatpy.blunders.search import BlunderSearch
from musatpy.errors import AdjustmentError
from musatpy.model import Block, Cause, CauseKind, CoordinateSystem, Initial, OtherFlags, Solution
from musatpy.model.findings import mnemonics
from musatpy.model.progress import Progress
from musatpy.model.tables import finite_rows
from musatpy.statistics import Statistics
from musatpy.statistics.gates import NO_BETTER, elevations
from musatpy.statistics.verdict import CHECK_POINT_RISK, in_feet
from musatpy.units import DEGREE, FOOT

MOST = 12  # causes that are named
_CHECK_POINTS = 3  # the worst first
_FIRST = 3  # hypotheses of the linear model at the answer
_TURNED = 10.0 * DEGREE  # farther than any start value that serves


def causes(search: BlunderSearch, sea: Sea | None) -> tuple[Cause, ...]:
    """Return the causes, `MOST` at most: the group that explains most first, its equal explanations together."""
    block, last = search.block, search.last
    groups = [
        *(
            [cause_of(block, last.judgement.sigma0, rival) for rival in group]
            for group in rivals(search, sea, MOST)
        ),
        *([cause] for cause in _named(search)),
        *_misplaced(block, last.scene, last.state),
    ]
    groups.sort(key=lambda group: -max(np.inf if np.isnan(cause.drop) else cause.drop for cause in group))
    said: dict[str, Cause] = {}  # the whole and its parts may say the same
    for number, group in enumerate(groups, 1):
        for cause in group:
            said.setdefault(str(cause), replace(cause, group=number))
    return tuple(said.values())[:MOST]


def cause_of(block: Block, sigma0: float, rival: Rival) -> Cause:
    """Return a hypothesis in words."""
    hypothesis = rival.hypothesis
    kind = hypothesis.kind
    size, sigma = hypothesis.error / kind.scale, hypothesis.sigma * sigma0 / kind.scale
    if kind is CauseKind.UNIT:
        size, sigma = np.array([hypothesis.value]), np.full(1, np.nan)
    shown = (len(kind.axes) or len(size)) if kind.sized else 0
    return replace(
        _in_words(block, hypothesis),
        size=tuple(size[:shown].tolist()),
        sigma=tuple(sigma[:shown].tolist()),
        parameters=hypothesis.parameters,
        drop=rival.drop,
        test=float(np.sqrt(max(rival.drop, 0.0) / max(hypothesis.parameters, 1)) / sigma0),
        rank=rival.rank,
    )


def _in_words(block: Block, hypothesis: Hypothesis) -> Cause:
    """Return what a hypothesis says, without its size."""
    kind, words = hypothesis.kind, in_words(hypothesis)
    name, component = "", hypothesis.name or words.component
    if kind is CauseKind.AXES and hypothesis.name:
        name, component = f"; {hypothesis.name}", words.component
    cause = _cause(block, kind, hypothesis.photo, hypothesis.point, component=component)
    return replace(cause, cards=mnemonics(words.cards, block.options.system), advice=f"{words.advice}{name}")


def _cause(
    block: Block, kind: CauseKind, photos: Sequence[int] = (), points: Sequence[int] = (), **fields: Any
) -> Cause:
    """Return a cause that concerns some photos and points (numbers), as the table of kinds has it."""
    return Cause(
        kind=kind,
        cards=mnemonics(kind.cards, block.options.system),
        photos=tuple(block.photos.ids[list(photos)].tolist()),
        points=tuple(block.points.ids[list(points)].tolist()),
        **{"unit": kind.unit, "advice": kind.advice} | fields,
    )


def _named(search: BlunderSearch) -> Iterator[Cause]:
    """Yield images with wrong names, and wrong flags."""
    block, variance = search.block, search.last.judgement.sigma0**2
    for renaming in search.renamings:
        yield _cause(
            block,
            CauseKind.NAME,
            [int(block.plates.photo[renaming.row])],
            [int(block.plates.point[renaming.row]), renaming.point],
            unit="",
            parameters=2,
            drop=renaming.test**2 * variance,
            test=renaming.test,
            advice=f"it is point {block.points.ids[renaming.point]}: {CauseKind.NAME.advice}",
        )
    changed = set(block.points.ids[list(search.flags)].tolist())
    for finding in findings(search):
        if finding.kind not in (CauseKind.DRY_FLAG, CauseKind.WET_FLAG):
            continue
        yield replace(
            _cause(block, CauseKind.FLAG, component=finding.blunder, size=finding.size, test=finding.test),
            points=(finding.point,),
            drop=finding.test**2 * variance if finding.point in changed else 0.0,
        )


def _misplaced(block: Block, scene: StagedBlock, state: State) -> Iterator[list[Cause]]:
    """Yield what may be wrong with given stations, not observed, that are far from where the images say.

    In groups of equal explanations: a unit of length, labels, or wrong cards.
    """
    photos = block.photos
    given = finite_rows(np.concatenate([photos.position, photos.attitude], axis=1))
    if not given.any():
        return
    difference = given_minus(photos, scene.network.frame, state.position, state.M, given)
    shift, turn = difference[:, :3], difference[:, 3:]
    height = reach_of(scene.network, state, taking_part(scene.network)).height
    far = np.linalg.norm(np.nan_to_num(shift), axis=1) / (FAR * height)
    far = np.where(np.isfinite(photos.position_sigma).any(axis=1), 0.0, far)
    turned = np.abs(np.nan_to_num(turn)).max(axis=1) / _TURNED
    worst = np.maximum(far, np.where(np.isfinite(photos.attitude_sigma).any(axis=1), 0.0, turned))
    if not (worst > 1.0).any():
        return
    whose, _ = in_feet(scene.network.frame.working(photos.position[given]), state.position[given])
    if whose and block.options.system is CoordinateSystem.LOCAL:
        member = {"control": CONTROL, "stations": STATIONS}[whose]
        unit = Hypothesis(kind=CauseKind.UNIT, member=member, value=1.0 / FOOT)
        yield [replace(_in_words(block, unit), size=(1.0 / FOOT,))]
        return
    exchanged: set[int] = set()
    for pair in exchanged_photos(block, scene, state):
        if far[list(pair)].max() > 0.0:
            exchanged |= set(pair)
            labels = [Hypothesis(kind=CauseKind.LABELS, photo=pair, member=which) for which in (CARDS, PLATES)]
            yield [_in_words(block, hypothesis) for hypothesis in labels]
    for photo in np.argsort(-worst, kind="stable").tolist():
        if worst[photo] > 1.0 and photo not in exchanged and block.options.initial is not Initial.COMPUTE:
            by_place = far[photo] > 1.0
            card = CauseKind.POSITION if by_place else CauseKind.ATTITUDE
            start = _cause(block, CauseKind.START, [photo], component=card.component, parameters=3, drop=0.0)
            size = shift[photo] if by_place else turn[photo] / DEGREE
            yield [
                replace(
                    start,
                    cards=mnemonics(card.cards, block.options.system),
                    size=tuple(size.tolist()),
                    unit="m" if by_place else "degrees",
                )
            ]


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
    statistics, block = Statistics(solution), solution.block
    tests = statistics.flags
    rows = tests.doubted
    if not len(rows):
        return
    test = float(tests.sigmas[rows[0]])
    flags = _cause(
        block,
        CauseKind.FLAG,
        points=tests.point[rows].tolist(),
        size=(float(tests.wrong_side[rows[0]]),),
        sigma=(float(tests.sigma[rows[0]]),),
        test=test,
    )
    least, most = tests.offset
    if not (np.isfinite(least) and least <= most < np.inf):
        yield flags
        return
    size, sigma = -0.5 * (least + most), 0.5 * (most - least) / tests.limit
    tides = _cause(block, CauseKind.TIDES, size=(size,), sigma=(sigma,), test=test)
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
        size = -statistics.control_difference[row]  # given minus what the images say
        sigma = np.hypot(statistics.point_sigmas[point], np.nan_to_num(block.control.sigma[row]))
        known = np.isfinite(size)
        tested: dict[str, Any] = {
            "parameters": components,
            "drop": squares * statistics.check_sigma0**2,
            "test": float(np.sqrt(squares / components)),
            "group": number,
        }
        yield _cause(
            block,
            CauseKind.CONTROL,
            points=[point],
            component="check point",
            size=tuple(size[known].tolist()),
            sigma=tuple(sigma[known].tolist()),
            **tested,
        )
        yield _cause(block, CauseKind.IMAGES, list(dict.fromkeys(images.tolist())), [point], **tested)


def first_look(solution: Solution, sea: Sea | None) -> tuple[Cause, ...]:
    """Return the hypotheses that explain most, each taken alone, of a linear model at the answer of a run.

    It takes one factorisation. Raises `AdjustmentError` and `SingularNormalsError`.
    """
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
    near = [option for option in options if option.squares >= NEARLY * best][:_FIRST]
    return tuple(
        cause_of(block, sigma0, Rival(option, option.squares, number)) for number, option in enumerate(near, 1)
    )
