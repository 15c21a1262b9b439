"""The way of a block to its solution: plates reduced, blunders searched and edited, adjusted, causes of doubt."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from musatpy import adjustment
from musatpy.adjustment.job import with_plate_sigmas
from musatpy.adjustment.wavy_water import Sea, sea_of
from musatpy.errors import AdjustmentError, NumericalError, Problem, and_warnings, numerics
from musatpy.model import Block, Cause, CauseKind, CauseSearch, Editing, Finding, Options, Order, Solution
from musatpy.model.block import in_order_of_ids
from musatpy.model.findings import NO_CARD_EXPLAINS, OF_FLAGS, SEARCH_GIVEN_UP
from musatpy.model.progress import Progress
from musatpy.statistics.quality import Quality
from musatpy.statistics.verdict import verdict_of

if TYPE_CHECKING:
    from musatpy.blunders.scene import Effort


_OF_ALL = (  # heights bend under them
    CauseKind.FOCAL_LENGTH, CauseKind.PRINCIPAL_POINT, CauseKind.DISTORTION, CauseKind.INDEX,
)  # fmt: skip
_STOPPED = "search stopped: the causes are those found until then; --causes all searches four times as long"


def adjust(
    block: Block,
    progress: Progress | None = None,
    sea: Sea | None = None,
    causes: CauseSearch = CauseSearch.USUAL,
    *,
    options: Options | None = None,
) -> Solution:
    """Return the solution of a block by the program of its options, its blunders listed or edited as these say.

    Other `options` stand in place of those of the block.

    A block of raw plates is reduced first: the block of the solution has their refined coordinates. Where the rows
    are to be in the order of the identifiers (OP2), the block of the solution has them so. `progress` is called
    after every iteration; with a `sea`, rays are refracted by its waves. `causes` says how far those of a run that
    is not accepted are looked for. Raises `AdjustmentError` with every reason where the block cannot be adjusted,
    as it is or edited, `PlatesError` where plates are refused, and `DeckError` where calibrations cannot be used.
    """
    if options is not None:
        block = replace(block, options=options)
    if block.options.order is Order.IDS:
        block = in_order_of_ids(block)
    if block.raw:
        from musatpy.reduction.readings_job import reduce  # most jobs come refined

        block, reduced = reduce(block)
        try:
            return replace(adjust(block, progress, sea, causes), reduced=reduced)
        except AdjustmentError as error:
            without = (f"photo {photo} was left out: {why}" for photo, why in reduced.refusals.items())
            raise AdjustmentError(and_warnings(error.problems, without)) from error
    if block.options.editing is not Editing.NONE:
        return _edited(block, progress, sea)
    try:
        solution = adjustment.adjust(block, progress, sea)
    except AdjustmentError as error:
        found, stopped = _causes(block, sea, progress, causes, None)
        texts = (*(f"possible cause: {cause}" for cause in found), *stopped)
        raise AdjustmentError(and_warnings(error.problems, texts)) from error
    of_flags: tuple[Cause, ...] = ()
    statistics = Quality(solution)
    if len(statistics.flags.doubted):
        from musatpy.blunders.causes import flag_causes, with_other_flags  # few heights contradict flags

        statistics = Quality(solution := with_other_flags(solution, progress, sea))
        of_flags = () if causes is CauseSearch.NONE else tuple(flag_causes(solution))
    if not doubtful(statistics):
        return replace(solution, causes=of_flags)
    from musatpy.blunders.causes import check_point_causes  # most runs are accepted

    if solution.plate_factor != 1.0:
        block = with_plate_sigmas(block, solution.plate_factor)
    found, stopped = _causes(block, sea, progress, causes, solution)
    if not found and causes is not CauseSearch.NONE:
        found = tuple(check_point_causes(solution))
    if found and found[0].kind in (CauseKind.AXES, CauseKind.UNIT):
        of_flags = ()  # heights contradict them because the whole block does
    whole = bool(found) and (np.isnan(found[0].drop) or found[0].kind in _OF_ALL)
    if found and of_flags and of_flags[0].points and not set(found[0].points) & set(of_flags[0].points):
        # heights bend under an error elsewhere that explains more than other flags do
        other = solution.other_flags
        whole = whole or other is None or not found[0].drop < solution.sum_of_squares - other.sum_of_squares
    parts = (found, of_flags) if whole else (of_flags, found)
    after = max((cause.group for cause in parts[0]), default=0)
    last = tuple(replace(cause, group=cause.group + after) for cause in parts[1])
    return replace(solution, causes=parts[0] + last, warnings=(*solution.warnings, *stopped))


def causes_of(
    block: Block, sea: Sea | None = None, progress: Progress | None = None, effort: Effort | None = None
) -> tuple[Cause, ...]:
    """Return the ranked causes of what does not fit in a block, without changing anything.

    The limit is the `effort`, or that of an explicit search. With unknown waves there is no search, and no cause.
    Raises `AdjustmentError` and `scene.GIVEN_UP` where the block cannot be adjusted even by robust weights.
    """
    from musatpy.blunders.causes import causes  # most jobs do without all this
    from musatpy.blunders.search import search

    waves = sea_of(block, sea)
    if waves is not None and waves.unknown.any():
        return ()
    with numerics("causes"), np.errstate(all="ignore"):  # wild points are met, and given up
        return causes(search(block, progress, sea, effort), sea)


def _causes(
    block: Block, sea: Sea | None, progress: Progress | None, causes: CauseSearch, solution: Solution | None
) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Return the causes of a run that is not accepted, or has no solution, and that their search was stopped."""
    from musatpy.blunders.causes import first_look  # most runs are accepted
    from musatpy.blunders.hypotheses import of_kinds
    from musatpy.blunders.scene import GIVEN_UP, LIMIT, SearchLimitError
    from musatpy.blunders.search import usual_effort

    if causes is CauseSearch.NONE:
        return (), ()
    if solution is not None and solution.misread:
        kind = CauseKind.INERTIAL_CONVENTION
        return (Cause(kind=kind, cards=tuple(kind.cards.split()), advice=kind.advice),), ()
    effort = usual_effort(block, solution, {CauseSearch.USUAL: 2.0, CauseSearch.ALL: 8.0}[causes])
    found: tuple[Cause, ...] = ()
    ended = True
    with suppress(AdjustmentError, *GIVEN_UP):  # nothing holds the block well enough to tell
        try:
            found = causes_of(block, sea, progress, effort)
        except SearchLimitError:
            ended = False
        if solution is not None and (not ended or (not found and of_kinds(block))):
            with numerics("causes"), np.errstate(all="ignore"):
                found = first_look(solution, sea)
            if ended:  # parameters follow an error in common, as shifts of lines do: no robust weights show that
                found = tuple(cause for cause in found if cause.test > LIMIT)
    return found, (_STOPPED,) if effort.left <= 0 else ()


def doubtful(statistics: Quality) -> bool:
    """Return whether a run is not accepted, and there is something by which a cause could show."""
    against = {reason.concern for reason in verdict_of(statistics).reasons}
    return statistics.solution.degrees_of_freedom > 0 and bool(against - NO_CARD_EXPLAINS - OF_FLAGS)


def _edited(block: Block, progress: Progress | None, sea: Sea | None) -> Solution:
    from musatpy.blunders.causes import causes, with_other_flags  # most jobs do without all this
    from musatpy.blunders.findings import edited, findings, lost_points, unedited, without_positions
    from musatpy.blunders.scene import GIVEN_UP, SearchLimitError
    from musatpy.blunders.search import search

    waves = sea_of(block, sea)
    if waves is not None and waves.unknown.any():
        message = "the search for blunders cannot be combined with unknown waves: search with known waves"
        raise AdjustmentError.of(message)
    try:
        with numerics("the search for blunders"), np.errstate(all="ignore"):  # wild points are met, and given up
            result = search(block, progress, sea)
            listed, ranked = findings(result), causes(result, sea)
    except (*GIVEN_UP, NumericalError) as error:
        solution = adjustment.adjust(block, progress, sea)
        why = "without the observations that it took out, unknowns were free"
        if isinstance(error, NumericalError):
            why = "points or stations run away in it"
        elif isinstance(error, SearchLimitError):
            why = "it did not end: more is wrong than it can tell apart"
        message = f"{SEARCH_GIVEN_UP}: {why}"
        return replace(solution, warnings=(*solution.warnings, message))
    edits = block.options.editing is Editing.EDIT
    refused = unedited(result) if edits else ""
    deck = replace(block, options=replace(block.options, editing=Editing.NONE)) if refused else edited(result)
    try:
        solution = adjustment.adjust(deck if edits else block, progress, sea)
    except AdjustmentError as error:
        without = "without" if edits and not refused else "with"
        which = f"{without} its {len(listed)} blunders" if listed else "as it stands"
        problems = [Problem(message=f"{which} the job cannot be adjusted"), *error.problems]
        sentences = (*map(_sentence, listed), *(f"possible cause: {cause}" for cause in ranked))
        raise AdjustmentError(and_warnings(problems, sentences)) from error
    solution = with_other_flags(solution, progress, sea)
    warnings = solution.warnings
    if not result.last.rest:
        warnings += ("the search for blunders did not come to rest: look for more after editing",)
    options = replace(solution.block.options, editing=block.options.editing)
    if edits and not refused:
        solution = without_positions(solution, lost_points(result, deck))
    return replace(
        solution,
        block=replace(solution.block, options=options),
        warnings=warnings,
        findings=listed,
        causes=ranked,
        unedited=refused,
        edited=deck,
    )


def _sentence(finding: Finding) -> str:
    """Return a finding in words, for a job that has no listing."""
    owner = " ".join(part for part in (finding.photo, finding.point) if part)
    note = f" ({finding.note})" if finding.note else ""
    return f"{finding.blunder} {owner}: test value {finding.test:.1f}, {finding.action}{note}"
