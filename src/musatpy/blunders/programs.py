"""The adjustment of a job with the editing that its options ask for."""

from __future__ import annotations

from dataclasses import replace

from musatpy.adjustment import programs
from musatpy.adjustment.job import Progress
from musatpy.adjustment.sea import Sea, sea_of
from musatpy.errors import AdjustmentError, Problem
from musatpy.model import Block, Editing, Finding, Order, Solution
from musatpy.model.ordering import in_order_of_ids


def adjust(block: Block, progress: Progress | None = None, sea: Sea | None = None) -> Solution:
    """Return the solution of a block by the program of its options, its blunders listed or edited as these say.

    A block of raw plates is reduced first: the block of the solution has their refined coordinates. Where the rows
    are to be in the order of the identifiers (OP2), the block of the solution has them so. `progress` is
    called after every iteration; with a `sea`, rays are refracted by its waves. Raises `AdjustmentError` with every
    reason where the block cannot be adjusted, as it is or edited, `PlatesError` where plates are refused, and
    `DeckError` where calibrations cannot be used.
    """
    if block.options.order is Order.IDS:
        block = in_order_of_ids(block)
    if block.raw:
        from musatpy.reduction.job import reduce  # most jobs come refined

        block, reduced = reduce(block)
        try:
            return replace(adjust(block, progress, sea), reduced=reduced)
        except AdjustmentError as error:
            without = (f"photo {photo} was left out: {why}" for photo, why in reduced.refusals.items())
            told = [Problem(message=message, severity="warning") for message in without]
            raise AdjustmentError([*error.problems, *told]) from error
    if block.options.editing is Editing.NONE:
        return programs.adjust(block, progress, sea)
    return _edited(block, progress, sea)


def _edited(block: Block, progress: Progress | None, sea: Sea | None) -> Solution:
    from musatpy.adjustment.iteration import SingularNormalsError  # most jobs do without all this
    from musatpy.blunders.edits import edited
    from musatpy.blunders.findings import findings
    from musatpy.blunders.search import search

    waves = sea_of(block, sea)
    if waves is not None and waves.unknown.any():
        message = "unknown waves and the search for blunders exclude each other: search with known waves"
        raise AdjustmentError([Problem(message=message)])
    try:
        found = search(block, progress, sea)
    except SingularNormalsError:
        solution = programs.adjust(block, progress, sea)
        message = "the search for blunders was given up: without what it took out, unknowns were free"
        return replace(solution, warnings=(*solution.warnings, message))
    deck, listed = edited(found), findings(found)
    try:
        solution = programs.adjust(deck if block.options.editing is Editing.EDIT else block, progress, sea)
    except AdjustmentError as error:
        edits = block.options.editing is Editing.EDIT
        which = f"{'without' if edits else 'with'} its {len(listed)} blunders the job cannot be adjusted"
        told = [Problem(message=_sentence(one), severity="warning") for one in listed]
        raise AdjustmentError([Problem(message=which), *error.problems, *told]) from error
    warnings = solution.warnings
    if not found.last.rest:
        warnings += ("the search for blunders did not come to rest: look for more after editing",)
    options = replace(solution.block.options, editing=block.options.editing)
    return replace(
        solution,
        block=replace(solution.block, options=options),
        warnings=warnings,
        findings=listed,
        edited=deck,
    )


def _sentence(finding: Finding) -> str:
    """Return a finding in words, for a job that has no listing."""
    owner = " ".join(part for part in (finding.photo, finding.point) if part)
    note = f" ({finding.note})" if finding.note else ""
    return f"{finding.blunder} {owner}: test value {finding.test:.1f}, {finding.action}{note}"
