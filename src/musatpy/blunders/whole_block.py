"""Where the search starts: the block as it is given, or, where that leads nowhere, under an error of all of it.

Stations far from their places, axes reversed or exchanged, factors between lengths: one of them explains everything
and leaves nothing that robust weights could hold on to. So they are tried where the block as given does not fit, or
stands where no block does; first on a connected part of it: plates and control alone say where the stations are.
Images cannot tell mirrored plates: with C = diag(1, -1, 1) cameras, points, level water and refraction mirror
exactly. x reversed, y reversed, x and y exchanged differ by a turn of the plate and are, with exchanged horizontal
axes of the control, one class.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import islice

import numpy as np

from musatpy.adjustment.initial import MODEL, misfit, placed, typical_height
from musatpy.adjustment.iteration import SingularNormalsError, given_minus, heights_and_water
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import BoolArray
from musatpy.blunders import hypotheses
from musatpy.blunders.explanation import Case, first_case
from musatpy.blunders.hypotheses import Hypothesis, revised
from musatpy.blunders.scene import (
    GIVEN_UP,
    STEP,
    Effort,
    SearchLimitError,
    rebuilt,
    sees_water,
    sizes,
    staged,
    standing,
    taking_part,
)
from musatpy.errors import AdjustmentError
from musatpy.jobs.extract import extracted
from musatpy.model import Block, CauseKind, CoordinateSystem, Initial, ObservationKind
from musatpy.model.progress import Progress, begin
from musatpy.model.tables import finite_rows
from musatpy.orientation.strips import models_of, sights_of
from musatpy.units import DEGREE, FOOT, YARD

MIRRORED = (  # one class, the cheapest to check first
    hypotheses.Y_REVERSED,
    hypotheses.X_REVERSED,
    hypotheses.EXCHANGED,
    hypotheses.CONTROL_EXCHANGED,
)
REVERSED, WATER, OFF_CARDS = "reversed", "water", "cards"  # what speaks against a block
_FACTORS = tuple(factor for unit in (FOOT, 1e-3, 0.1, 0.01, YARD) for factor in (1.0 / unit, unit))
_PART = 10  # photos of the part that is tried, and
_POINTS = 100  # of its points, besides the control
_FAR = 0.2  # flying heights from the card of a station, and
_TURNED = 30.0 * DEGREE  # from that of its attitude: not where it should be
_MOSTLY = 0.5  # of the photos, or points, that speak against a block


_LOST = 6.0  # sigmas beyond which an observation counts as this
_FITS = 2.5  # mean of the squares so cut: one observation in 20 may be lost
_MOST = 0.5  # of the images of a photo, beyond 6 sigmas: its place is wrong
_FEW, _MUCH = 3, 0.25  # control points beyond 6 sigmas, and share of them: no single cards
_BETTER = 0.5  # of that of the block as given, for another start to be taken
_TRIED = 4  # revisions of the whole block that are adjusted

_K = ObservationKind


def best_start(
    block: Block, progress: Progress | None, sea: Sea | None, effort: Effort
) -> tuple[Case, Case | None]:
    """Return the start that fits best, and beside one under a revision of the whole block that as given, if any.

    A revision is taken where nothing speaks against the block under it. Raises `AdjustmentError`,
    `SingularNormalsError` or `SearchLimitError` where the block as given does and no other start helps.
    """
    failure: AdjustmentError | SingularNormalsError | SearchLimitError | None = None
    given: Case | None = None
    try:
        given = _start(block, (), progress, sea, effort)
        if _fits(given) and not doubts(given):
            return given, None
    except (AdjustmentError, *GIVEN_UP) as error:
        failure = error
    begin(progress, "search for blunders: axes and units of the whole block")
    share = Effort(left=0.75 * effort.left)  # the rest searches from what is found
    alike = _explaining(part_of(block), sea, share)
    effort.left -= 0.75 * effort.left - share.left
    if alike:
        start = None
        if block.options.initial is Initial.GIVEN:  # which its cards suit, or it is no explanation
            with suppress(AdjustmentError, *GIVEN_UP):
                start = _start(revised(block, alike[0]), alike[:1], None, sea, effort)
        if start is None or not _fits(start):
            start = _computed(block, alike[0], sea, effort)
        if start is not None and _fits(start):
            return replace(start, alike=alike), given
    if given is not None and _fits(given):
        return given, None
    start = _computed(block, None, sea, effort)
    if start is not None and (given is None or _misfit(start) < _BETTER * _misfit(given)):
        return start, None
    if given is None:
        assert failure is not None  # nothing else leaves no start
        raise failure
    return given, None


def _explaining(block: Block, sea: Sea | None, effort: Effort) -> tuple[Hypothesis, ...]:
    """Return the revisions of a part of a block under which it fits and nothing speaks against it.

    None where it does so as it is. Of a class that only cards tell apart, all where these tell nothing.
    """
    start = _computed(block, None, sea, effort)
    against = doubts(start) if start and _fits(start) else None
    if against is not None and not against:
        return ()
    explaining: list[Hypothesis] = []
    with suppress(AdjustmentError, *GIVEN_UP):  # what has been found by then stands
        for revision in islice(likely(block, against, effort), _TRIED):
            members = MIRRORED if revision.kind is CauseKind.AXES and revision.member in MIRRORED else ()
            found = []
            for one in [replace(revision, member=member) for member in members] or [revision]:
                trial = _computed(block, one, sea, effort)
                if trial is None or not _fits(trial):
                    break  # nor does any other of its class: images cannot tell them apart
                doubt = doubts(trial)
                found += [(one, doubt)] if doubt <= {OFF_CARDS} else []
            agree = [one for one, doubt in found if not doubt]
            if 0 < len(agree) < len(found):
                agree = [replace(one, name="the station cards agree with this one") for one in agree]
            explaining += agree or [one for one, _ in found if members]
            if members and explaining:
                break
    return tuple(explaining)


def _start(
    block: Block, taken: tuple[Hypothesis, ...], progress: Progress | None, sea: Sea | None, effort: Effort
) -> Case:
    return replace(first_case(block, *staged(block, progress, sea, effort)), taken=taken)


def _computed(block: Block, revision: Hypothesis | None, sea: Sea | None, effort: Effort) -> Case | None:
    """Return the start of a block under a revision from plates and control alone, None where there is none.

    Observed stations are compared with it, no more.
    """
    if revision is not None:
        block = revised(block, revision)
    alone = replace(_unobserved(block), options=replace(block.options, initial=Initial.COMPUTE))
    try:
        scene, state = staged(alone, None, sea, effort)
        scene, state = rebuilt(scene, standing(block, scene.block.photos), state, sea)
    except (AdjustmentError, *GIVEN_UP):
        return None
    return replace(first_case(block, scene, state), taken=() if revision is None else (revision,))


def _unobserved(block: Block) -> Block:
    """Return the block with stations that are given, and not observed."""
    nothing = np.full((block.photos.count, 3), np.nan)
    return replace(block, photos=replace(block.photos, position_sigma=nothing, attitude_sigma=nothing))


def _misfit(start: Case) -> float:
    """Return the mean square of the residuals of images and control, all cut at the same size."""
    size = sizes(start.scene, start.state)
    squares = [np.square(size[kind][start.scene.weight[kind] > 0.0]) for kind in (_K.PLATE, _K.CONTROL)]
    return float(np.minimum(np.nan_to_num(np.concatenate(squares), nan=_LOST**2), _LOST**2).mean())


def _fits(start: Case) -> bool:
    """Return whether a start is one to search from: no photo has lost most of its images, nor it much control."""
    network, used, size = start.scene.network, taking_part(start.scene.network), sizes(start.scene, start.state)
    lost, gone = (~(np.abs(size[kind]) <= _LOST).all(axis=1) for kind in (_K.PLATE, _K.CONTROL))
    share = np.bincount(network.photo[lost & used], minlength=network.photos)
    some = bool((share > _MOST * np.bincount(network.photo[used], minlength=network.photos)).any())
    much = np.count_nonzero(gone) >= max(
        _FEW, _MUCH * np.count_nonzero(start.scene.block.control.known.any(axis=1))
    )
    return _misfit(start) <= _FITS and not some and not much


def doubts(start: Case) -> set[str]:
    """Return what speaks against the state of a block as a whole; cards count that have sigmas, or start it.

    REVERSED: cameras are below their ground, or look up. WATER: submerged points are above the water, or those on
    land below it. OFF_CARDS: stations or attitudes are far from where their cards put them.
    """
    block, network, state, photos = start.block, start.scene.network, start.state, start.block.photos
    height, water = heights_and_water(network, state)
    submerged = block.points.bathymetric[network.point]
    axes = np.asarray(network.frame.axes(state.position))
    looks_up = np.einsum("ni,ni->n", state.M[:, 2], axes[:, 2]) < 0.0
    middle = float(np.nanmedian(height)) if np.isfinite(height).any() else -np.inf
    above = np.asarray(network.frame.height(state.position)) - middle
    with np.errstate(invalid="ignore"):
        wrong_side = np.where(submerged, height > water, height < water)
    flagged = bool(submerged.any()) and sees_water(block)
    counts = finite_rows(np.concatenate([photos.position, photos.attitude], axis=1))
    if block.options.initial is Initial.COMPUTE:
        counts &= np.isfinite(np.concatenate([photos.position_sigma, photos.attitude_sigma], axis=1)).any(axis=1)
    off = given_minus(photos, network.frame, state.position, state.M, counts)[counts]
    far = np.linalg.norm(off[:, :3], axis=1) > _FAR * float(np.median(np.abs(above)))
    against = {
        REVERSED: _most(looks_up | (above < 0.0)),
        WATER: flagged and (_most(wrong_side[submerged]) or _most(wrong_side[~submerged])),
        OFF_CARDS: _most(far | (np.abs(off[:, 3:]) > _TURNED).any(axis=1)),
    }
    return {doubt for doubt, speaks in against.items() if speaks}


def _most(wrong: BoolArray) -> bool:
    return bool(np.count_nonzero(wrong) > _MOSTLY * len(wrong))


def part_of(block: Block) -> Block:
    """Return a connected part of a block: the photo with most control, and those that share most points with it."""
    n = len(block.photos.ids)
    if n <= _PART:
        return _thinned(block)
    shown = np.zeros((n, len(block.points.ids)), dtype=bool)
    shown[block.plates.photo, block.plates.point] = block.plates.triangulated
    control = shown[:, block.control.point[block.control.known.any(axis=1)]]
    chosen = np.zeros(n, dtype=bool)
    chosen[int(control.sum(axis=1).argmax())] = True
    while np.count_nonzero(chosen) < _PART:
        common = (shown & shown[chosen].any(axis=0)).sum(axis=1)
        new = control[:, ~control[chosen].any(axis=0)].sum(axis=1)
        value = np.where(chosen, 0, common * (1 + new))
        if not value.any():
            break
        chosen[int(value.argmax())] = True
    return _thinned(extracted(block, chosen, drop_single=True).block)


def _thinned(block: Block) -> Block:
    """Return a block with some of its points alone, and its control."""
    count = len(block.points.ids)
    stays = np.arange(count) % -(-count // _POINTS) == 0
    stays[block.control.point] = True
    triangulated = block.plates.triangulated & stays[block.plates.point]
    return replace(block, plates=replace(block.plates, triangulated=triangulated))


def likely(block: Block, found: set[str] | None, effort: Effort) -> Iterator[Hypothesis]:
    """Yield the revisions of a block that suit plates, control, cards and tides, the likeliest first.

    Each is tried by models of its plates, placed on its control. Of what fits alike, the best of each length comes
    before the second best of any: no model tells how large a block is. Mirrored plates stand for their class;
    `found` is what speaks against the block as it is, None where it does not fit by itself.
    """
    counts = finite_rows(block.photos.position) & (
        np.isfinite(block.photos.position_sigma).any(axis=1) | (block.options.initial is not Initial.COMPUTE)
    )
    alone = _unobserved(block)
    sights = sights_of(alone)
    effort.spend_start(len(counts))
    models = models_of(alone, sights)
    scored: list[tuple[int, float, int, Hypothesis]] = []
    for revision in _revisions(block, found, cards=bool(counts.any())):
        other, seen, joined = revised(alone, revision), sights, models
        effort.spend(STEP)
        if other.plates is not alone.plates:
            effort.spend_start(len(counts))
            seen = sights_of(other)
            joined = models_of(other, seen)
        place = placed(other, seen, joined, MODEL)
        lost, error = misfit(other, seen, place)
        height, there = typical_height(other, place), counts & finite_rows(place.C)
        shift = given_minus(other.photos, place.frame, place.C, place.M, there)[there, :3]
        far = int(np.count_nonzero(~(np.linalg.norm(shift, axis=1) <= _FAR * height)))
        if revision.kind is CauseKind.AXES:
            far, error = 0, 0.0  # which one of its class it is, the cards tell; no factor is likelier
        alike = float(f"{error:.3g}")
        scored.append((lost + far + _on_wrong_side(other), alike, len(scored), revision))
    scored.sort(key=lambda entry: entry[:3])
    turns = [[other[3].member for other in scored[:row]].count(entry[3].member) for row, entry in enumerate(scored)]
    order = sorted(range(len(scored)), key=lambda row: (scored[row][0], turns[row], row))
    yield from (scored[row][3] for row in order)


def _on_wrong_side(block: Block) -> int:
    """Return how many heights of control are on the wrong side of the water, by the flags of their points."""
    control, tide = block.control, block.photos.tide
    if not (sees_water(block) and block.points.bathymetric.any() and np.isfinite(tide).any()):
        return 0
    if block.options.system is CoordinateSystem.GEOCENTRIC:
        return 0
    above = control.position[:, 2] > np.nanmedian(tide)
    known = control.known[:, 2]
    return int(np.count_nonzero(above[known] == block.points.bathymetric[control.point[known]]))


def _revisions(block: Block, found: set[str] | None, *, cards: bool) -> Iterator[Hypothesis]:
    """Yield what may be wrong with a block as a whole, the cheaper to check first.

    Points on the wrong side of the water alone speak against heights, and against a scale that no cards hold.
    """
    of_all = Hypothesis(kind=CauseKind.AXES, squares=np.nan, error=np.zeros(1), sigma=np.zeros(1))
    system, misplaced = block.options.system, found is None or bool(found & {REVERSED, OFF_CARDS})
    if misplaced:
        yield replace(of_all, member=MIRRORED[0])
    if system is CoordinateSystem.GEOCENTRIC:
        whose = [hypotheses.PLATES_TO_FOCAL_LENGTH] if misplaced else []
    else:
        yield replace(of_all, member=hypotheses.HEIGHTS_NEGATED)
        local = system is CoordinateSystem.LOCAL
        scales = misplaced if cards else local  # a geographic one is that of its heights
        whose = [hypotheses.PLATES_TO_FOCAL_LENGTH] if misplaced else []
        whose += [hypotheses.CONTROL] if scales or (misplaced and not local) else []
        whose += [hypotheses.HEIGHTS] if found is None and local else []
        whose += [hypotheses.STATIONS] if cards and misplaced else []
    for member in whose:
        for value in _FACTORS:
            error = np.array([1.0 - 1.0 / value])
            yield replace(of_all, kind=CauseKind.UNIT, member=member, value=value, error=error)
