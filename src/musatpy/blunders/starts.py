"""Where the search starts: the block as it is given, or, where that leads nowhere, under an error of all of it.

Stations far from their places, lengths in feet and exchanged plate axes leave nothing that robust weights could
hold on to. Each is tried only where the block as given does not fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.iteration import SingularNormalsError
from musatpy.adjustment.network import inverse_squares
from musatpy.adjustment.unknowns import State, attitude_in
from musatpy.adjustment.wavy_water import Sea
from musatpy.blunders.factors import taking_part, weights
from musatpy.blunders.hypotheses import Hypothesis
from musatpy.blunders.revisions import CONTROL, FEET, STATIONS, revised
from musatpy.blunders.scene import GIVEN_UP, Effort, Scene, SearchLimitError, sizes, staged
from musatpy.errors import AdjustmentError
from musatpy.model import Block, CauseKind, CoordinateSystem, Initial, ObservationKind, Photos
from musatpy.model.progress import Progress

_LOST = 6.0  # sigmas beyond which an observation counts as this
_FITS = 2.5  # mean of the squares so cut: one observation in 20 may be lost
_MOST = 0.5  # of the images of a photo, beyond 6 sigmas: its place is wrong
_BETTER = 0.5  # of that of the block as given, for another start to be taken

_K = ObservationKind


@dataclass(frozen=True, kw_only=True, eq=False)
class Start:
    """A block with what is revised in it, and its state after robust weights."""

    block: Block
    common: tuple[Hypothesis, ...]  # what is revised
    scene: Scene
    state: State
    misfit: float


def best_start(block: Block, progress: Progress | None, sea: Sea | None, effort: Effort) -> Start:
    """Return the start that fits best; one under a revision only where it fits, and the block as given does not.

    Raises `AdjustmentError`, `SingularNormalsError` or `SearchLimitError` where the block as given does and no
    other one helps.
    """
    failure: AdjustmentError | SingularNormalsError | SearchLimitError | None = None
    given: Start | None = None
    try:
        given = _start(block, (), progress, sea, effort)
        if _fits(given):
            return given
    except (AdjustmentError, *GIVEN_UP) as error:
        failure = error
    best = given
    for revision in (None, *_revisions(block)):
        try:
            start = _restarted(block, revision, sea, effort)
        except (AdjustmentError, *GIVEN_UP):
            continue
        least = np.inf if best is None else best.misfit * (_BETTER if best is given else 1.0)
        if start.misfit < least and (revision is None or _fits(start)):
            best = start
        if best is not None and best is not given and _fits(best):
            break
    if best is None:
        assert failure is not None  # nothing else leaves no start
        raise failure
    return best


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
    """Return whether a start is one to search from: no photo has lost most of its images."""
    network, used = start.scene.network, taking_part(start.scene.network)
    size = np.nan_to_num(sizes(start.scene, start.state)[_K.PLATE], nan=2.0 * _LOST)
    lost = used & (np.maximum(*np.abs(size.T)) > _LOST)
    share = np.bincount(network.photo[lost], minlength=network.photos)
    some = bool((share > _MOST * np.bincount(network.photo[used], minlength=network.photos)).any())
    return start.misfit <= _FITS and not some


def _revisions(block: Block) -> Iterator[Hypothesis]:
    """Yield what may be wrong with the block as a whole, the likeliest first."""
    of_all = Hypothesis(kind=CauseKind.AXES, squares=np.nan, error=np.zeros(1), sigma=np.zeros(1))
    if block.options.system is not CoordinateSystem.GEOCENTRIC:
        observed = np.isfinite(block.photos.position_sigma).any()
        for whose in (CONTROL, STATIONS) if observed else (CONTROL,):
            for value in (FEET, 1.0 / FEET):
                error = np.array([1.0 - 1.0 / value])
                yield replace(of_all, kind=CauseKind.UNIT, member=whose, value=value, error=error)
    yield of_all


def _restarted(block: Block, revision: Hypothesis | None, sea: Sea | None, effort: Effort) -> Start:
    """Return the start under a revision; without one, and with exchanged axes, stations are found anew."""
    if revision is None:
        return _computed(block, (), sea, effort)
    if revision.kind is CauseKind.AXES:
        return _computed(revised(block, revision), (revision,), sea, effort)
    return _start(revised(block, revision), (revision,), None, sea, effort)


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
