"""Where the search starts: the block as it is given, or, where that leads nowhere, under an error of all of it.

Stations far from their places, lengths in feet and mirrored plates leave nothing that robust weights could hold on
to. They are tried where the block as given does not fit, or stands where no block does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from musatpy.adjustment.iteration import SingularNormalsError
from musatpy.adjustment.network import inverse_squares
from musatpy.adjustment.unknowns import State, attitude_in
from musatpy.adjustment.wavy_water import Sea
from musatpy.blunders.hypotheses import Hypothesis
from musatpy.blunders.revisions import revised
from musatpy.blunders.scene import GIVEN_UP, Effort, Scene, SearchLimitError, sizes, staged, taking_part, weights
from musatpy.blunders.whole_block import MIRRORED, doubts, likely, part_of
from musatpy.errors import AdjustmentError
from musatpy.model import Block, CauseKind, Initial, ObservationKind, Photos
from musatpy.model.progress import Progress, begin

_LOST = 6.0  # sigmas beyond which an observation counts as this
_FITS = 2.5  # mean of the squares so cut: one observation in 20 may be lost
_MOST = 0.5  # of the images of a photo, beyond 6 sigmas: its place is wrong
_FEW, _MUCH = 3, 0.25  # control points beyond 6 sigmas, and share of them: no single cards
_BETTER = 0.5  # of that of the block as given, for another start to be taken
_TRIED = 4  # revisions of the whole block that are adjusted

_K = ObservationKind


@dataclass(frozen=True, kw_only=True, eq=False)
class Start:
    """A block with what is revised in it, and its state after robust weights."""

    block: Block
    common: tuple[Hypothesis, ...]  # what is revised
    scene: Scene
    state: State
    misfit: float
    alike: tuple[Hypothesis, ...] = ()  # revisions of the whole block that explain the same as that of `common`
    given: Start | None = None  # that of the block as it is given, where this one is under a revision


def best_start(block: Block, progress: Progress | None, sea: Sea | None, effort: Effort) -> Start:
    """Return the start that fits best; one under a revision of the whole block where nothing speaks against that.

    Raises `AdjustmentError`, `SingularNormalsError` or `SearchLimitError` where the block as given does and no
    other one helps.
    """
    failure: AdjustmentError | SingularNormalsError | SearchLimitError | None = None
    given: Start | None = None
    try:
        given = _start(block, (), progress, sea, effort)
        if _fits(given) and not doubts(block, given.scene, given.state).any:
            return given
    except (AdjustmentError, *GIVEN_UP) as error:
        failure = error
    begin(progress, "search for blunders: axes and units of the whole block")
    share = Effort(left=0.75 * effort.left)  # the rest searches from what is found
    best, alike = given, _explaining(part_of(block), sea, share)
    effort.left -= 0.75 * effort.left - share.left
    for revision in (*alike[:1], None):
        if revision is None and best is not None and _fits(best):
            break
        try:
            if revision and block.options.initial is Initial.GIVEN:  # which its cards suit, or it is no explanation
                start = _start(revised(block, revision), alike[:1], None, sea, effort)
                start = start if _fits(start) else _computed(revised(block, revision), alike[:1], sea, effort)
            else:
                start = _computed(revised(block, revision) if revision else block, alike[:1], sea, effort)
        except (AdjustmentError, *GIVEN_UP):
            continue
        if revision is not None and _fits(start):
            return replace(start, alike=alike, given=given)
        if revision is None and start.misfit < (np.inf if best is None else best.misfit * _BETTER):
            best = replace(start, common=())
    if best is None:
        assert failure is not None  # nothing else leaves no start
        raise failure
    return best


def _explaining(block: Block, sea: Sea | None, effort: Effort) -> tuple[Hypothesis, ...]:
    """Return the revisions of a part of a block under which it fits and nothing speaks against it.

    None where it does so as it is. Of a class that only cards tell apart, all where these tell nothing.
    """
    start = _tried(block, None, sea, effort)
    against = doubts(block, start.scene, start.state) if start else None
    if against and not against.any:
        return ()
    explaining: list[Hypothesis] = []
    try:
        for revision in islice(likely(block, against, effort), _TRIED):
            members = MIRRORED if revision.kind is CauseKind.AXES and revision.member in MIRRORED else ()
            same = [replace(revision, member=member) for member in members] or [revision]
            first = _tried(block, same[0], sea, effort)
            if first is None:
                continue  # nor does any other of its class fit: images cannot tell them apart
            trials = [(same[0], first), *((one, _tried(block, one, sea, effort)) for one in same[1:])]
            found = [(one, doubts(revised(block, one), trial.scene, trial.state)) for one, trial in trials if trial]
            found = [(one, doubt) for one, doubt in found if not (doubt.reversed or doubt.water)]
            agree = [one for one, doubt in found if not doubt.cards]
            if 0 < len(agree) < len(found):
                agree = [replace(one, name="the station cards agree with this one") for one in agree]
            explaining += agree or [one for one, _ in found if members]
            if members and explaining:
                break
    except (AdjustmentError, *GIVEN_UP):
        pass  # what has been found by then stands
    return tuple(explaining)


def _tried(block: Block, revision: Hypothesis | None, sea: Sea | None, effort: Effort) -> Start | None:
    """Return the start of a block under a revision, None where it does not fit."""
    try:
        start = _computed(revised(block, revision) if revision else block, (), sea, effort)
    except (AdjustmentError, *GIVEN_UP):
        return None
    return start if _fits(start) else None


def _start(
    block: Block, common: tuple[Hypothesis, ...], progress: Progress | None, sea: Sea | None, effort: Effort
) -> Start:
    scene, state = staged(block, progress, sea, effort)
    return Start(block=block, common=common, scene=scene, state=state, misfit=_misfit(scene, state))


def _misfit(scene: Scene, state: State) -> float:
    """Return the mean square of the residuals of images and control, all cut at the same size."""
    size = sizes(scene, state)
    squares = [np.square(size[kind][scene.weight[kind] > 0.0]) for kind in (_K.PLATE, _K.CONTROL)]
    return float(np.minimum(np.nan_to_num(np.concatenate(squares), nan=_LOST**2), _LOST**2).mean())


def _fits(start: Start) -> bool:
    """Return whether a start is one to search from: no photo has lost most of its images, nor it much control."""
    network, used, size = start.scene.network, taking_part(start.scene.network), sizes(start.scene, start.state)
    lost, gone = (~(np.abs(size[kind]) <= _LOST).all(axis=1) for kind in (_K.PLATE, _K.CONTROL))
    share = np.bincount(network.photo[lost & used], minlength=network.photos)
    some = bool((share > _MOST * np.bincount(network.photo[used], minlength=network.photos)).any())
    much = np.count_nonzero(gone) >= max(
        _FEW, _MUCH * np.count_nonzero(start.scene.block.control.known.any(axis=1))
    )
    return start.misfit <= _FITS and not some and not much


def _computed(block: Block, common: tuple[Hypothesis, ...], sea: Sea | None, effort: Effort) -> Start:
    """Return the start from the plates and the control alone; observed stations are compared with it, no more."""
    photos = block.photos
    n = len(photos.ids)
    nothing = np.full((n, 3), np.nan)
    alone = replace(
        block,
        options=replace(block.options, initial=Initial.COMPUTE),
        photos=replace(photos, position_sigma=nothing, attitude_sigma=nothing),
    )
    scene, state = staged(alone, None, sea, effort)
    misfit = _misfit(scene, state)
    scene, state = _with_observed(scene, state, photos)
    return Start(block=block, common=common, scene=scene, state=state, misfit=misfit)


def _with_observed(scene: Scene, state: State, photos: Photos) -> tuple[Scene, State]:
    """Return a scene of computed stations with what was observed of them as observations again."""
    network = scene.network
    sigma = np.concatenate([photos.position_sigma, photos.attitude_sigma], axis=1)
    observed = np.asarray(np.isfinite(sigma).any(axis=1))
    chosen = observed[:, None]
    given = np.array(scene.block.photos.position)
    given[observed] = photos.position[observed]
    position = network.frame.working(given)
    axes = np.asarray(network.frame.axes(position))
    attitude = attitude_in(state, axes, np.where(chosen, photos.attitude, network.attitude))
    network = replace(
        network,
        position=position,
        axes=axes,
        attitude=np.where(chosen, photos.attitude, attitude),
        position_weight=inverse_squares(photos.position_sigma),
        attitude_weight=inverse_squares(photos.attitude_sigma),
        turned=np.zeros(len(position), dtype=bool),
    )
    block = replace(
        scene.block,
        photos=replace(
            scene.block.photos,
            position=given,
            attitude=network.attitude,
            position_sigma=photos.position_sigma,
            attitude_sigma=photos.attitude_sigma,
        ),
    )
    scene = replace(scene, block=block, network=network, weight=weights(network, block))
    return scene, replace(state, axes=axes, attitude=attitude)
