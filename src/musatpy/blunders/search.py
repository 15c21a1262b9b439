"""The search for blunders: robust weights and data snooping, beside what explains the misfit with least.

Robust weights may start with the wrong observations out: a wrong control card looks like wrong images of its point.
So where anything is found, the search starts again from the adjustment with everything in, with one hypothesis
after the other; the explanation that costs less stays. Names that were exchanged or mistaken, and points flagged
wrongly as submerged or dry, change the block, and so does what is common to many observations: the block so revised
is searched again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.job import prepared
from musatpy.adjustment.waterline import every_ray_wet
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray
from musatpy.blunders.alternatives import misfit, wrong_flags
from musatpy.blunders.explanation import (
    Case,
    cost,
    explained,
    first_case,
    single_images,
    starts,
    submerged_points_dry,
    with_revision,
)
from musatpy.blunders.hypotheses import Hypothesis
from musatpy.blunders.names import Lookalike, exchanges, lookalikes
from musatpy.blunders.scene import (
    GIVEN_UP,
    PENALTY,
    START,
    STEP,
    Effort,
    Factors,
    scene_of,
    search_block,
    sees_water,
    taking_part,
)
from musatpy.blunders.snooping import Snooped, snooped
from musatpy.blunders.starts import Start, best_start
from musatpy.model import Block, Initial, ObservationKind, Solution
from musatpy.model.progress import Progress, begin

_EFFORT, _FOR_PHOTO = 400, 20  # steps of its adjustments; where something simple is wrong, 20 to 300 do
LEAST = 7.5e5  # images that any search may spend, and twice as many one for causes: some seconds
_FAILED, _AROUND = 20, 6  # steps that a run without solution counts for, and start and covariances of another one
_REVISIONS = 3  # of names and flags, at most
_HOPELESS = 10.0  # times the cost of the best explanation: what snooping cannot mend
_PLATE = ObservationKind.PLATE


@dataclass(frozen=True, kw_only=True, eq=False)
class Renaming:
    """An image that has got the name of another point."""

    row: int  # plate measurement
    point: int  # whose image it is
    distance: float  # mm off the image of that point, NaN where that could not be predicted
    test: float  # under the old name, NaN where that could not be tested
    error: tuple[float, float]  # mm, likewise


@dataclass(frozen=True, kw_only=True, eq=False)
class Search:
    """What the search found. Rows are those of the tables of the block, whose points it does not number anew."""

    block: Block  # the job, as it was given
    revised: Block  # with right names and flags
    last: Snooped  # the search of the revised block
    alike: list[Lookalike]  # images that lie on other points and keep their names
    renamings: tuple[Renaming, ...]
    flags: dict[int, float]  # points whose images want the other flag, with the test values of that
    common: tuple[Hypothesis, ...]  # what is wrong with many observations at once, as revised
    alike_revisions: tuple[Hypothesis, ...]  # exchanges of labels, or revisions of all, that explain what those do


def search(
    block: Block, progress: Progress | None = None, sea: Sea | None = None, effort: Effort | None = None
) -> Search:
    """Return what is wrong with a block, whose rays the waves of a `sea` may refract.

    Without an `effort` it is that of an explicit search.

    Raises `AdjustmentError` where the block cannot be adjusted, `SingularNormalsError`, and `SearchLimitError`.
    """
    effort = effort or explicit_effort(block)
    begin(progress, "search for blunders: robust weights")
    start = best_start(block, progress, sea, effort)
    best = _begun(start, sea)
    if best.common or (best.last.judgement.out.any() and not single_images(best.last)):
        best = _with_exchanges(block, _cheaper(best, sea), sea)
    if start.given and best.last.judgement.out.any():
        best = _or_as_given(best, start.given, sea, effort)
    last, revised = best.last, best.block
    renamings: tuple[Renaming, ...] = ()
    flags: dict[int, float] = {}
    alike = _lookalikes(last)
    for number in range(1, _REVISIONS + 1):
        begin(progress, "search for blunders: names and flags", number, _REVISIONS)
        names = tuple(entry for entry in _renamings(last, alike) if entry.row not in {old.row for old in renamings})
        blamed = wrong_flags(last.scene, last.state, last.judgement.sigma0) if sees_water(block) else {}
        wrong = {point: test for point, test in blamed.items() if point not in flags}
        if not names and not wrong:
            break
        renamings, flags = renamings + names, flags | wrong
        revised = _revised(revised, names, wrong)
        last = _searched_again(revised, last, names, wrong, sea)
        alike = _lookalikes(last)
    return Search(
        block=block,
        revised=revised,
        last=last,
        alike=alike,
        renamings=renamings,
        flags=flags,
        common=best.common,
        alike_revisions=(*start.alike, *best.alike),
    )


def explicit_effort(block: Block) -> Effort:
    """Return what a search may spend that is asked for: some hundred steps of an adjustment."""
    steps = _EFFORT + _FOR_PHOTO * len(block.photos.ids)
    return Effort(left=LEAST + steps * (STEP + len(block.plates.point)))


def usual_effort(block: Block, solution: Solution | None, times: float) -> Effort:
    """Return what the search for causes of a run may spend: so many `times` what the run has."""
    steps = _FAILED if solution is None else len(solution.iterations) + _AROUND
    start = 0 if block.options.initial is Initial.GIVEN else START * STEP * len(block.photos.ids)
    return Effort(left=times * max(LEAST, steps * len(block.plates.point) + start))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Explained:
    """The search at rest under an explanation, and what that costs."""

    last: Snooped
    block: Block
    common: tuple[Hypothesis, ...]
    cost: float
    alike: tuple[Hypothesis, ...] = ()  # exchanged labels, or revisions of all, that explain about the same


def _begun(start: Start, sea: Sea | None) -> _Explained:
    """Return the search from robust weights on; where that leaves unknowns free, hypothesis by hypothesis.

    Raises `SingularNormalsError`.
    """
    scene, state, common = start.scene, start.state, start.common
    try:
        last = snooped(scene, state)
    except GIVEN_UP:
        nothing = {kind: np.zeros_like(weight) for kind, weight in scene.weight.items()}
        case = replace(first_case(start.block, scene, state, nothing), taken=common)
        return _at_rest(explained(case, 1.0, sea), 1.0)
    return _priced(last, start.block, common, last.judgement.sigma0**2)


def _or_as_given(best: _Explained, given: Start, sea: Sea | None, effort: Effort) -> _Explained:
    """Return the explanation under a revision of the whole block, or the cheaper one of the block as `given`.

    What explains everything leaves nothing to explain; where it does, half of the effort goes to what is simpler.
    """
    share = Effort(left=0.5 * effort.left)
    effort.left -= share.left
    try:
        other = _begun(replace(given, scene=replace(given.scene, effort=share)), sea)
        other = _cheaper(other, sea)
    except GIVEN_UP:
        return best
    variance = min(one.last.judgement.sigma0 for one in (best, other)) ** 2
    best, other = (_priced(one.last, one.block, one.common, variance) for one in (best, other))
    return other if other.cost < best.cost else best


def _cheaper(start: _Explained, sea: Sea | None) -> _Explained:
    """Return the explanation of least cost: what robust weights began with, or one hypothesis after the other."""
    best, variance = start, start.last.judgement.sigma0**2
    for case, only_common in _first_cases(start):
        chosen = any(mask.any() for mask in case.out.values())  # which is out for good
        try:
            case = explained(case, variance, sea, only_common)
            if (only_common and not case.revisions) or case.cost(variance) > _HOPELESS * best.cost:
                continue
            other = _at_rest(case, variance, not chosen)
        except GIVEN_UP:
            continue
        if other.cost < best.cost + (PENALTY if best is start else 0.0):
            best = other
    return best


def _first_cases(start: _Explained) -> Iterator[tuple[Case, bool]]:
    """Yield where the search for a simpler explanation starts, and whether only common errors serve.

    Wrong tides may have dried points that are submerged: once more with all rays wet.
    """
    last, case = start.last, _case(start)
    begun = starts(last)
    for out, only_common in begun:
        yield replace(case, out=out), only_common
    wet = every_ray_wet(last.scene.network, last.scene.block.points.bathymetric)
    dried = not np.array_equal(wet.wet, last.scene.line.wet)
    if dried and (last.tides or submerged_points_dry(last)):
        network = last.scene.network.with_plates(last.scene.network.xy, wet.wet)
        yield replace(case, out=begun[0][0], scene=replace(last.scene, line=wet, network=network)), True


def _with_exchanges(block: Block, start: _Explained, sea: Sea | None) -> _Explained:
    """Return the explanation with labels that have been exchanged, where that costs less."""
    variance = start.last.judgement.sigma0**2
    trials = []
    exchanged = list(exchanges(block, start.last))
    for number, hypothesis in enumerate(exchanged, 1):
        begin(start.last.scene.progress, "search for blunders: exchange of labels", number, len(exchanged))
        case = _case(start)
        out = _in_again(case.out, hypothesis, case.scene.block)
        case = with_revision(replace(case, out=out, taken=(*case.taken, hypothesis)), hypothesis, sea)
        try:
            other = _at_rest(case, variance) if np.isfinite(case.squares) else None
        except GIVEN_UP:
            continue
        if other is not None and other.cost < start.cost:
            explains = replace(hypothesis, squares=(start.cost - other.cost) * variance)
            trials.append(replace(other, common=(*start.common, explains)))
    if not trials:
        return start
    best = min(trials, key=lambda trial: trial.cost)
    alike = tuple(trial.common[-1] for trial in trials if trial.cost < best.cost + PENALTY)
    return replace(best, alike=alike)


def _case(start: _Explained) -> Case:
    last = start.last
    return replace(first_case(start.block, last.scene, last.state, last.out()), taken=start.common)


def _at_rest(case: Case, variance: float, returning: bool = True) -> _Explained:
    """Return the search from an explanation on, what is out `returning` or not.

    Raises `SingularNormalsError`.
    """
    last = snooped(case.scene, case.state, case.out, returning)
    return _priced(last, case.block, tuple(one for one in case.taken if not one.given_up), variance)


def _priced(last: Snooped, block: Block, common: tuple[Hypothesis, ...], variance: float) -> _Explained:
    price = cost(last.scene, last.out(), last.state, len(common), variance)
    return _Explained(last=last, block=block, common=common, cost=price)


def _in_again(out: Factors, hypothesis: Hypothesis, block: Block) -> Factors:
    """Return what is out without the observations of the photos and of the control of a hypothesis."""
    masks, photos = {kind: mask.copy() for kind, mask in out.items()}, list(hypothesis.photo)
    for kind in (ObservationKind.STATION_POSITION, ObservationKind.STATION_ATTITUDE):
        masks[kind][photos] = 0.0
    masks[_PLATE][np.isin(block.plates.photo, photos)] = 0.0
    masks[ObservationKind.CONTROL][np.isin(block.control.point, hypothesis.point)] = 0.0
    return masks


def plate_errors(last: Snooped) -> tuple[FloatArray, FloatArray]:
    """Return the test values (m,) of the images, the larger of x and y, and their errors (m, 2) mm.

    NaN if not tested. Errors are measured minus what all else predicts.
    """
    units, judgement = last.units, last.judgement
    plate = units.of_kinds[_PLATE]
    test, error = np.full((2, *last.scene.weight[_PLATE].shape), np.nan)
    test.reshape(-1)[units.element[plate]] = np.abs(judgement.test[plate])
    error.reshape(-1)[units.element[plate]] = judgement.error[plate]
    return np.maximum(test[:, 0], test[:, 1]), error


def _lookalikes(last: Snooped) -> list[Lookalike]:
    """Return the images out, or of no point that takes part, that lie on other points."""
    scene, network = last.scene, last.scene.network
    out = last.rows_out(_PLATE)
    alone = scene.block.plates.triangulated & ~taking_part(network)
    judgement = last.judgement
    return lookalikes(scene, last.state, out, np.flatnonzero(out | alone), judgement.covariance, judgement.sigma0)


def _renamings(last: Snooped, alike: list[Lookalike]) -> list[Renaming]:
    (test, error), certain = plate_errors(last), [one for one in alike if one.certain]
    rows = np.array([one.row for one in certain if np.isnan(test[one.row])], dtype=int)
    test[rows] = misfit(last.scene.network, last.state, last.scene.network.point[rows]) / last.judgement.sigma0
    return [
        Renaming(
            row=one.row,
            point=one.point,
            distance=one.distance,
            test=float(test[one.row]),
            error=(float(error[one.row, 0]), float(error[one.row, 1])),
        )
        for one in certain
    ]


def _revised(block: Block, names: tuple[Renaming, ...], flags: Iterable[int]) -> Block:
    """Return the block with new names and flags; its points keep their numbers."""
    point, bathymetric = block.plates.point.copy(), block.points.bathymetric.copy()
    for renaming in names:
        point[renaming.row] = renaming.point
    bathymetric[list(flags)] ^= True
    return replace(
        block,
        plates=replace(block.plates, point=point),
        points=replace(block.points, bathymetric=bathymetric),
    )


def _searched_again(
    revised: Block,
    before: Snooped,
    names: tuple[Renaming, ...],
    flags: Iterable[int],
    sea: Sea | None,
) -> Snooped:
    """Return the search of a revised block, from where the search before has come to rest."""
    old = before.scene.block
    given = replace(revised, photos=old.photos, options=replace(revised.options, initial=Initial.GIVEN))
    job, fresh = prepared(search_block(given, sea), before.scene.progress, sea)
    scene = replace(scene_of(job, fresh, before.scene.effort), held=before.scene.held)
    state, out = before.state, before.out()
    state = replace(fresh, position=state.position, attitude=state.attitude, tide=state.tide, ground=state.ground)
    plates = old.plates
    touched = [*flags, *(name.point for name in names), *(int(plates.point[name.row]) for name in names)]
    anew = np.isin(revised.plates.point, touched)
    return snooped(scene, state, out | {_PLATE: np.maximum(out[_PLATE], anew[:, None])})
