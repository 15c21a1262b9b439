"""What competes with each thing that was found: other causes of the same misfit, re-adjusted in its place."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from musatpy.adjustment.network import Network
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import BoolArray
from musatpy.blunders import explanation
from musatpy.blunders.alternatives import exchanged_images
from musatpy.blunders.explanation import Case
from musatpy.blunders.findings import own_tides
from musatpy.blunders.hypotheses import (
    CAUSES,
    GivenUp,
    Hypothesis,
    common_errors,
    giving_up,
    hypotheses,
    of_taken_images,
)
from musatpy.blunders.linear_model import LinearModel, as_on_cards
from musatpy.blunders.scene import GIVEN_UP, PENALTY, Factors, StagedBlock, deviations, sizes, taking_part
from musatpy.blunders.search import BlunderSearch
from musatpy.model import Block, CauseKind, ObservationKind
from musatpy.model.progress import begin
from musatpy.model.tables import falling

GROUPS = 3  # of what was found, the largest: whose competitors are looked for
COMPETITORS = 3  # of each, that are re-adjusted
_NEARLY = 0.6  # of what was found, that a competitor must explain in the linear model
_SAME = 1e-4  # of what they explain: smaller differences are those of the models
_K = ObservationKind
_IMAGES = (CauseKind.IMAGE, CauseKind.IMAGES)


class Rival(NamedTuple):
    """A hypothesis beside those that explain the same."""

    hypothesis: Hypothesis
    drop: float  # of the squares, re-adjusted
    rank: int  # in its group: equal ones explain alike


def rivals(search: BlunderSearch, sea: Sea | None, most: int) -> list[list[Rival]]:
    """Return what was found, each with what competes, what explains most first, until there are `most` of them."""
    whole, size = search.case, sizes(search.case.scene, search.case.state)
    found = [*whole.taken, *members(search, most)]
    found = [found[row] for row in falling([_explained(member, size) for member in found]).tolist()]
    rest: LinearModel | None = None
    if any(member.point or member.kind in explanation.SENSIBLE for member in found[:most]):
        with suppress(*GIVEN_UP):
            rest = explanation.model_of(whole)
    left = {one.key: one for one in common_errors(rest)} if rest else {}
    residual = _residual(whole)
    groups: list[list[Rival]] = []
    for number, member in enumerate(found, 1):
        if sum(len(group) for group in groups) >= most:
            break
        begin(whole.scene.progress, "search for causes: what competes", number, len(found))
        if number > GROUPS and member.kind in _IMAGES:  # whose competitors nobody asks for
            sized = _sized(of_taken_images(rest, member), whole.scene.network, residual) if rest else member
            groups.append([Rival(sized, sized.squares, 1)])
        elif (case := _without(whole, member, sea)) is None:
            alike = [other for other in whole.alike if other.kind is member.kind] or [member]
            groups.append([Rival(other, other.squares, 1) for other in alike])
        else:
            if not member.given_up and member.key in left:  # its size where the search has come to rest
                more = left[member.key]
                member = replace(member, error=member.error + more.error, sigma=more.sigma)
            few = COMPETITORS if number <= GROUPS else 0
            groups.append(_ranked(case, member, whole.squares, search.last.judgement.sigma0**2, few, sea))
    return groups


def members(search: BlunderSearch, most: int) -> Iterator[Hypothesis]:
    """Yield what is out, as hypotheses: cards, stations, single images, all images of points.

    Of those of images the `most` only that seem to explain most.
    """
    last, block = search.last, search.last.scene.block
    network, out = last.scene.network, last.out
    wrong = np.flatnonzero(last.rows_out(_K.PLATE))
    wrong = wrong[np.argsort(network.point[wrong], kind="stable")]
    point, seen = network.point[wrong], np.bincount(network.point[taking_part(network)], minlength=network.points)
    gone = np.bincount(point, minlength=network.points)
    every = ((gone > 1) & (gone == seen))[point]
    start = np.flatnonzero((np.diff(point, prepend=-1) != 0) | ~every)
    squares = np.square(sizes(last.scene, last.state)[_K.PLATE][wrong]).sum(axis=1)
    largest = np.sort(falling(np.add.reduceat(squares, start) if len(wrong) else squares)[:most])
    end = np.append(start[1:], len(wrong))
    for rows in [wrong[start[number] : end[number]] for number in largest.tolist()]:
        of_images = CauseKind.IMAGES if len(rows) > 1 else CauseKind.IMAGE
        yield _member(block, of_images, GivenUp.of_images(rows))
    own = own_tides(search)
    for tides in last.tides:
        photos = np.array(tides.photo)
        yield replace(tides, given_up=(GivenUp(kind=_K.WATER_LEVEL, row=photos, component=np.zeros_like(photos)),))
    stations: dict[int, list[GivenUp]] = {}
    for observed, mask in out.items():
        for row in np.flatnonzero(mask.any(axis=1)).tolist() if observed is not _K.PLATE else ():
            part = GivenUp.of_row(observed, row, np.flatnonzero(mask[row]))
            if observed in (_K.STATION_POSITION, _K.STATION_ATTITUDE):
                stations.setdefault(row, []).append(part)
            elif observed is _K.CONTROL:
                plan, height = mask[row, :2].any(), mask[row, 2]
                alone = CauseKind.HORIZONTAL if plan else CauseKind.VERTICAL
                yield _member(block, CauseKind.CONTROL if plan and height else alone, part)
            elif observed is not _K.WATER_LEVEL or own[row]:
                yield _member(block, CAUSES[observed], part)
    for _, parts in sorted(stations.items()):
        yield _member(block, CauseKind.STATION if len(parts) > 1 else CAUSES[parts[0].kind], *parts)


def _member(block: Block, kind: CauseKind, *parts: GivenUp) -> Hypothesis:
    count = sum(len(part.row) for part in parts)
    nothing = np.full(count, np.nan)
    return giving_up(block, kind, *parts, squares=np.nan, parameters=count, error=nothing, sigma=nothing)


def _without(whole: Case, member: Hypothesis, sea: Sea | None) -> Case | None:
    """Return the case without a hypothesis, not adjusted again; None where that makes no sense."""
    if member.given_up:
        return replace(whole, out=explanation.given_up(whole.out, member, 0.0))
    if member.kind not in explanation.SENSIBLE:
        return None
    case = explanation.with_revision(whole, replace(member, value=-float(member.error[0])), sea)
    taken = tuple(other for other in whole.taken if other is not member)
    return replace(case, taken=taken, state=case.state) if np.isfinite(case.squares) else None


def _explained(member: Hypothesis, size: Factors) -> float:
    """Return about how much is explained, to put the groups in order: the squares of what is given up.

    `size` are the residuals in sigmas.
    """
    if np.isfinite(member.squares) or not member.given_up:
        return np.inf if np.isnan(member.squares) else member.squares
    return float(np.square(member.values_in(size)).sum())


def _ranked(
    case: Case, member: Hypothesis, final: float, variance: float, few: int, sea: Sea | None
) -> list[Rival]:
    """Return a hypothesis and a `few` competitors, the cheapest explanation first.

    `case` is without it, the squares with it are `final`.
    """
    try:
        near = _same_photos(case.scene, member) if member.kind in _IMAGES else None
        options = hypotheses(explanation.model_of(case), near)
    except GIVEN_UP:
        return [Rival(member, np.nan, 1)]
    first = next((option for option in options if option.key == member.key), None)
    first = first or replace(member, squares=max(explanation.readjusted(case).squares - final, 0.0))
    if not first.given_up:  # the model without it is far from the minimum: so is its size
        first = replace(first, error=member.error, sigma=member.sigma)
    others = [
        option
        for option in options
        if option.key != first.key
        and explanation.sensible(option)
        and option.squares >= _NEARLY * first.squares
        and not (option.gain(variance) < first.gain(variance) and _covers(case, option, first))
    ]
    others = [others[row] for row in falling([option.gain(variance) for option in others]).tolist()]
    worst = final + first.squares
    tried = [(_sized(first, case.scene.network, _residual(case)), final)]
    if first.kind in _IMAGES and few:
        pairs = exchanged_images(case.scene.network, case.state, first.point[0])
        exchanged = replace(Hypothesis(kind=CauseKind.EXCHANGED_IMAGES), point=first.point, squares=first.squares)
        tried += [(replace(exchanged, photo=photos), final) for photos in pairs]
    for option in others[:few]:
        trial = explanation.with_hypothesis(case, option, sea)
        if worst - trial.squares >= explanation.NEARLY * (worst - final):
            tried.append((_sized(trial.taken[-1], trial.scene.network, _residual(trial)), trial.squares))
    costs = [squares / variance + PENALTY * option.parameters for option, squares in tried]
    equal = PENALTY + _SAME * (worst - final) / variance
    better = np.array([sum(other < cost - equal for other in costs) for cost in costs])
    ranks = 1 + np.unique(better, return_inverse=True)[1]
    cheap = list(CauseKind)
    order = sorted(range(len(tried)), key=lambda k: (ranks[k], cheap.index(tried[k][0].kind)))
    return [Rival(tried[k][0], worst - tried[k][1], int(ranks[k])) for k in order]


def _covers(case: Case, hypothesis: Hypothesis, other: Hypothesis) -> bool:
    """Return whether a hypothesis gives up all that another one does, which is in, and more."""
    if not other.given_up or len(hypothesis.error) <= len(other.error):
        return False
    return bool(other.values_in(explanation.given_up(case.out, hypothesis)).all())


def _same_photos(scene: StagedBlock, images: Hypothesis) -> BoolArray:
    """Return the points (p,) on the photos of the point of images: its errors hardly reach any others."""
    network, near = scene.network, np.zeros(scene.network.points, dtype=bool)
    photos = np.zeros(network.photos, dtype=bool)
    photos[network.photo[np.isin(network.point, images.point)]] = True
    near[network.point[photos[network.photo]]] = True
    return near


def _sized(hypothesis: Hypothesis, network: Network, residual: Factors) -> Hypothesis:
    """Return a hypothesis with the errors that the adjustment without its observations says, of these residuals."""
    if not hypothesis.given_up:
        return hypothesis
    error, part = -hypothesis.values_in(residual), hypothesis.given_up[0]
    if part.kind is _K.CONTROL:
        error = as_on_cards(network, hypothesis.point[0], part.component, error)
    elif part.kind in network.measured:
        error = network.measured[part.kind].on_card(int(part.row[0]), error)
    return replace(hypothesis, error=np.where(np.isfinite(hypothesis.error), error, np.nan))


def _residual(case: Case) -> Factors:
    return deviations(case.scene.network, case.scene.block, case.state)
