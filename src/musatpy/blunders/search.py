"""The search for blunders: robust weights and data snooping, beside what explains the misfit with least.

Robust weights may start with the wrong observations out: a wrong control card looks like wrong images of its point.
So where anything is found, the search starts again from the adjustment with everything in, with one hypothesis
after the other; the explanation that costs less stays. Names that were exchanged or mistaken, and points flagged
wrongly as submerged or dry, change the block, and so does what is common to many observations: the block so revised
is searched again.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.waterline import every_ray_wet
from musatpy.adjustment.wavy_water import Sea
from musatpy.blunders import explanation
from musatpy.blunders.alternatives import misfit, wrong_flags
from musatpy.blunders.explanation import Case
from musatpy.blunders.names import Lookalike, exchanges, lookalikes
from musatpy.blunders.scene import (
    GIVEN_UP,
    PENALTY,
    START,
    STEP,
    Effort,
    Factors,
    rebuilt,
    sees_water,
)
from musatpy.blunders.snooping import SnoopingResult, snooped
from musatpy.blunders.whole_block import best_start
from musatpy.model import Block, Initial, ObservationKind, Solution
from musatpy.model.progress import Progress, begin

_EFFORT, _FOR_PHOTO = 400, 20  # steps of its adjustments; where something simple is wrong, 20 to 300 do
LEAST = 7.5e5  # images that any search may spend, and twice as many one for causes: some seconds; of it,
_SHARE, _SHARE_OF_PHOTO = 0.4, 0.06  # one for causes with fewer than ten photos: there is less to be tried
_FAILED, _AROUND = 20, 6  # steps that a run without solution counts for, and start and covariances of another one
_REVISIONS = 3  # of names and flags, at most
_HOPELESS = 10.0  # times the cost of the best explanation: what snooping cannot mend
_PLATE = ObservationKind.PLATE


@dataclass(frozen=True, kw_only=True, eq=False)
class BlunderSearch:
    """What the search found. Rows are those of the tables of the block, whose points it does not number anew."""

    block: Block  # the job, as it was given
    case: Case  # the explanation at rest: the block with right names and flags, and with what is common revised
    last: SnoopingResult  # the search of that
    lookalikes: list[Lookalike]  # images that lie on other points and keep their names
    renamings: tuple[Lookalike, ...]  # images that have got the names of other points
    flags: dict[int, float]  # points whose images want the other flag, with the test values of that


def search(
    block: Block, progress: Progress | None = None, sea: Sea | None = None, effort: Effort | None = None
) -> BlunderSearch:
    """Return what is wrong with a block, whose rays the waves of a `sea` may refract.

    Without an `effort` it is that of a search that is asked for: some hundred steps of an adjustment.

    Raises `AdjustmentError` where the block cannot be adjusted, `SingularNormalsError`, and `SearchLimitError`.
    """
    steps = _EFFORT + _FOR_PHOTO * len(block.photos.ids)
    effort = effort or Effort(left=LEAST + steps * (STEP + len(block.plates.point)))
    begin(progress, "search for blunders: robust weights")
    start, given = best_start(block, progress, sea, effort)
    best = _begun(start, sea)
    if best.case.taken or best.last.judgement.out.any():
        best = _with_exchanges(block, _cheaper(best, sea), sea)
    if given is not None and best.last.judgement.out.any():
        best = _or_as_given(best, given, sea, effort)
    renamings: tuple[Lookalike, ...] = ()
    flags: dict[int, float] = {}
    alike = lookalikes(best.last)
    for number in range(1, _REVISIONS + 1):
        begin(progress, "search for blunders: names and flags", number, _REVISIONS)
        last = best.last
        names = tuple(entry for entry in _renamings(last, alike) if entry.row not in {old.row for old in renamings})
        blamed = wrong_flags(last.scene, last.state, last.judgement.sigma0) if sees_water(block) else {}
        wrong = {point: test for point, test in blamed.items() if point not in flags}
        if not names and not wrong:
            break
        renamings, flags = renamings + names, flags | wrong
        best = _renamed(best.case, names, wrong, sea)
        alike = lookalikes(best.last)
    return BlunderSearch(
        block=block, case=best.case, last=best.last, lookalikes=alike, renamings=renamings, flags=flags
    )


def usual_effort(block: Block, solution: Solution | None, times: float) -> Effort:
    """Return what the search for causes of a run may spend: so many `times` what the run has."""
    steps = _FAILED if solution is None else len(solution.iterations) + _AROUND
    photos = len(block.photos.ids)
    start = 0 if block.options.initial is Initial.GIVEN else START * STEP * photos
    least = min(1.0, _SHARE + _SHARE_OF_PHOTO * photos) * LEAST
    return Effort(left=times * max(least, steps * len(block.plates.point) + start))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Explained:
    """The search at rest under an explanation."""

    case: Case
    last: SnoopingResult


def _begun(start: Case, sea: Sea | None) -> _Explained:
    """Return the search from robust weights on; where that leaves unknowns free, hypothesis by hypothesis.

    Raises `SingularNormalsError`.
    """
    try:
        return _at_rest(start, None)
    except GIVEN_UP:
        case = explanation.explained(start, 1.0, sea)
        return _at_rest(case, case.out)


def _or_as_given(best: _Explained, given: Case, sea: Sea | None, effort: Effort) -> _Explained:
    """Return the explanation under a revision of the whole block, or the cheaper one of the block as `given`.

    What explains everything leaves nothing to explain; where it does, half of the effort goes to what is simpler.
    """
    share = Effort(left=0.5 * effort.left)
    effort.left -= share.left
    try:
        other = _cheaper(_begun(replace(given, scene=replace(given.scene, effort=share)), sea), sea)
    except GIVEN_UP:
        return best
    variance = min(one.last.judgement.sigma0 for one in (best, other)) ** 2
    return other if other.case.cost(variance) < best.case.cost(variance) else best


def _cheaper(start: _Explained, sea: Sea | None) -> _Explained:
    """Return the explanation of least cost: what robust weights began with, or one hypothesis after the other."""
    best, variance = start, start.last.judgement.sigma0**2
    cases = [(replace(start.case, out=out), only_common) for out, only_common in explanation.starts(start.last)]
    scene = start.case.scene
    wet = every_ray_wet(scene.network, scene.block.points.bathymetric)
    dried = not np.array_equal(wet.wet, scene.line.wet)
    if dried and (start.last.tides or explanation.submerged_points_dry(start.last)):  # by wrong tides
        network = scene.network.with_plates(scene.network.xy, wet.wet)
        cases.append((replace(cases[0][0], scene=replace(scene, line=wet, network=network)), True))
    for case, only_common in cases:
        chosen = any(mask.any() for mask in case.out.values())  # which is out for good
        try:
            case = explanation.explained(case, variance, sea, only_common)
            unchanged = case.block is start.case.block
            if (only_common and unchanged) or case.cost(variance) > _HOPELESS * best.case.cost(variance):
                continue
            other = _at_rest(case, case.out, not chosen)
        except GIVEN_UP:
            continue
        if other.case.cost(variance) < best.case.cost(variance) + (PENALTY if best is start else 0.0):
            best = other
    return best


def _with_exchanges(block: Block, start: _Explained, sea: Sea | None) -> _Explained:
    """Return the explanation with labels that have been exchanged, where that costs less."""
    variance = start.last.judgement.sigma0**2
    cost, trials = start.case.cost(variance), []
    exchanged = list(exchanges(block, start.last))
    for number, hypothesis in enumerate(exchanged, 1):
        begin(start.last.scene.progress, "search for blunders: exchange of labels", number, len(exchanged))
        case = replace(start.case, out={kind: np.zeros_like(mask) for kind, mask in start.case.out.items()})
        case = explanation.with_revision(replace(case, taken=(*case.taken, hypothesis)), hypothesis, sea)
        try:
            other = _at_rest(case, case.out) if np.isfinite(case.squares) else None
        except GIVEN_UP:
            continue
        if other is not None and (gain := cost - other.case.cost(variance)) > 0.0:
            explains = replace(hypothesis, squares=gain * variance)
            trials.append(replace(other, case=replace(other.case, taken=(*start.case.taken, explains))))
    if not trials:
        return start
    best = min(trials, key=lambda trial: trial.case.cost(variance))
    most = best.case.cost(variance) + PENALTY
    alike = tuple(trial.case.taken[-1] for trial in trials if trial.case.cost(variance) < most)
    return replace(best, case=replace(best.case, alike=(*start.case.alike, *alike)))


def _at_rest(case: Case, first: Factors | None, returning: bool = True) -> _Explained:
    """Return the search of a case from what is out at `first` on, that `returning` or not.

    Raises `SingularNormalsError`.
    """
    last = snooped(case.scene, case.state, first, returning)
    revisions = tuple(one for one in case.taken if not one.given_up)
    squares = explanation.squares_in(last.scene, last.out, last.state)
    case = replace(case, scene=last.scene, state=last.state, out=last.out, taken=revisions, squares=squares)
    return _Explained(case=case, last=last)


def _renamings(last: SnoopingResult, alike: list[Lookalike]) -> list[Lookalike]:
    """Return the images that get the names of other points, with their tests under the old ones."""
    judgement, certain = last.judgement, [one for one in alike if one.certain]
    test = np.abs(judgement.table(_PLATE, judgement.test)).max(axis=1)
    error = judgement.table(_PLATE, judgement.error)
    rows = np.array([one.row for one in certain if np.isnan(test[one.row])], dtype=int)
    test[rows] = misfit(last.scene.network, last.state, last.scene.network.point[rows]) / judgement.sigma0
    return [one._replace(test=float(test[one.row]), error=tuple(error[one.row].tolist())) for one in certain]


def _renamed(case: Case, names: tuple[Lookalike, ...], flags: Iterable[int], sea: Sea | None) -> _Explained:
    """Return the search of the block with new names and flags, from where that before has come to rest."""
    block, old = case.block, case.block.plates.point
    point, bathymetric = old.copy(), block.points.bathymetric.copy()
    for renaming in names:
        point[renaming.row] = renaming.point
    bathymetric[list(flags)] ^= True
    block = replace(
        block,
        plates=replace(block.plates, point=point),
        points=replace(block.points, bathymetric=bathymetric),
    )
    at_rest = replace(block, photos=case.scene.block.photos)
    scene, state = rebuilt(case.scene, at_rest, case.state, sea)
    rows = [name.row for name in names]
    anew = np.isin(point, [*flags, *point[rows], *old[rows]])
    out = case.out | {_PLATE: np.maximum(case.out[_PLATE], anew[:, None])}
    return _at_rest(replace(case, block=block, scene=scene, state=state), out)
