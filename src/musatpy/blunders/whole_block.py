"""What may be wrong with a block as a whole: axes reversed or exchanged, factors between its lengths.

One of them explains everything, so they are tried before anything else is blamed, on a connected part of the block:
plates and control alone say where the stations are. Images cannot tell mirrored plates: with C = diag(1, -1, 1)
cameras, points, level water and refraction mirror exactly. x reversed, y reversed, x and y exchanged differ by a
turn of the plate and are, with exchanged horizontal axes of the control, one class.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.placing import MODEL, misfit, models_of, placed, sights_of, typical_height
from musatpy.adjustment.unknowns import State, given_minus
from musatpy.adjustment.waterline import heights_and_water
from musatpy.arrays import BoolArray, FloatArray, finite_rows
from musatpy.blunders import revisions
from musatpy.blunders.hypotheses import Hypothesis
from musatpy.blunders.revisions import revised
from musatpy.blunders.scene import STEP, Effort, Scene, sees_water
from musatpy.geometry.geodesy import Frame
from musatpy.jobs.extract import extracted
from musatpy.model import Block, CauseKind, CoordinateSystem, Initial
from musatpy.units import DEGREE, FOOT, YARD

MIRRORED = (  # one class, the cheapest to check first
    revisions.Y_REVERSED,
    revisions.X_REVERSED,
    revisions.EXCHANGED,
    revisions.CONTROL_EXCHANGED,
)
_FACTORS = tuple(factor for unit in (FOOT, 1e-3, 0.1, 0.01, YARD) for factor in (1.0 / unit, unit))
_PART = 10  # photos of the part that is tried, and
_POINTS = 100  # of its points, besides the control
_FAR = 0.2  # flying heights from the card of a station, and
_TURNED = 30.0 * DEGREE  # from that of its attitude: not where it should be
_MOSTLY = 0.5  # of the photos, or points, that speak against a block


@dataclass(frozen=True, kw_only=True)
class Doubts:
    """What speaks against a block as a whole, where its stations have been found."""

    reversed: bool  # cameras below their ground, or looking up
    water: bool  # submerged points above the water, or those on land below it
    cards: bool  # stations or attitudes far from where their cards put them

    @property
    def any(self) -> bool:
        """Return whether anything does."""
        return self.reversed or self.water or self.cards


def doubts(block: Block, scene: Scene, state: State) -> Doubts:
    """Return what speaks against a state of a block: cards count that have sigmas, or start it."""
    network, photos = scene.network, block.photos
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
    off = off_the_cards(block, network.frame, state.position, state.M, float(np.median(np.abs(above))), counts)
    return Doubts(
        reversed=_most(looks_up | (above < 0.0)),
        water=flagged and (_most(wrong_side[submerged]) or _most(wrong_side[~submerged])),
        cards=_most(off),
    )


def _most(wrong: BoolArray) -> bool:
    return bool(np.count_nonzero(wrong) > _MOSTLY * len(wrong))


def off_the_cards(
    block: Block, frame: Frame, position: FloatArray, M: FloatArray, height: float, given: BoolArray
) -> BoolArray:
    """Return which of some `given` stations (n,) are not where their cards put them, flown at a `height` (m)."""
    difference = given_minus(block.photos, frame, position, M, given)[given]
    far = np.linalg.norm(difference[:, :3], axis=1) > _FAR * height
    return np.asarray(far | (np.abs(difference[:, 3:]) > _TURNED).any(axis=1))


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


def likely(block: Block, found: Doubts | None, effort: Effort) -> Iterator[Hypothesis]:
    """Yield the revisions of a block that suit plates, control, cards and tides, the likeliest first.

    Each is tried by models of its plates, placed on its control. Of what fits alike, the best of each length comes
    before the second best of any: no model tells how large a block is. Mirrored plates stand for their class;
    `found` is what speaks against the block as it is, None where it does not fit by itself.
    """
    counts = finite_rows(block.photos.position) & (
        np.isfinite(block.photos.position_sigma).any(axis=1) | (block.options.initial is not Initial.COMPUTE)
    )
    nothing = np.full((len(counts), 3), np.nan)
    alone = replace(block, photos=replace(block.photos, position_sigma=nothing, attitude_sigma=nothing))
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


def _revisions(block: Block, found: Doubts | None, *, cards: bool) -> Iterator[Hypothesis]:
    """Yield what may be wrong with a block as a whole, the cheaper to check first.

    Points on the wrong side of the water alone speak against heights, and against a scale that no cards hold.
    """
    of_all = Hypothesis(kind=CauseKind.AXES, squares=np.nan, error=np.zeros(1), sigma=np.zeros(1))
    system, misplaced = block.options.system, found is None or found.reversed or found.cards
    if misplaced:
        yield replace(of_all, member=MIRRORED[0])
    if system is CoordinateSystem.GEOCENTRIC:
        whose = [revisions.PLATES_TO_FOCAL_LENGTH] if misplaced else []
    else:
        yield replace(of_all, member=revisions.HEIGHTS_NEGATED)
        local = system is CoordinateSystem.LOCAL
        scales = misplaced if cards else local  # a geographic one is that of its heights
        whose = [revisions.PLATES_TO_FOCAL_LENGTH] if misplaced else []
        whose += [revisions.CONTROL] if scales or (misplaced and not local) else []
        whose += [revisions.HEIGHTS] if found is None and local else []
        whose += [revisions.STATIONS] if cards and misplaced else []
    for member in whose:
        for value in _FACTORS:
            error = np.array([1.0 - 1.0 / value])
            yield replace(of_all, kind=CauseKind.UNIT, member=member, value=value, error=error)
