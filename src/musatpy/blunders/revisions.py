"""A block with something revised that is common to many of its observations, and a state that goes with it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from musatpy.adjustment.unknowns import State
from musatpy.arrays import IntArray
from musatpy.blunders.hypotheses import Hypothesis
from musatpy.model import Block, CauseKind, CoordinateSystem
from musatpy.model.findings import CONTROL_CARD, STATION_CARD
from musatpy.units import length_unit

CONTROL, STATIONS, PLATES_TO_FOCAL_LENGTH, HEIGHTS = range(4)  # whose unit of length is wrong; heights of control
Y_REVERSED, X_REVERSED, EXCHANGED, CONTROL_EXCHANGED, HEIGHTS_NEGATED = range(5)  # axes of plates, of control
PLATES, CARDS = 0, 1  # that bear exchanged labels: plate cards, or station cards
_EXCHANGED = "each stands where the card of the other one says: exchange the photo ids on the {} cards"
_SAME_UNIT = 0.05  # by which a factor may be off that of a unit


class Words(NamedTuple):
    """What a member of a kind is in words."""

    cards: str  # to read again, as `model.CauseKind` has them
    component: str
    advice: str  # of a unit of length, with what it does not agree


MEMBERS = {
    (CauseKind.UNIT, CONTROL): Words(CONTROL_CARD, "control", "stations and tides want"),
    (CauseKind.UNIT, STATIONS): Words(STATION_CARD, "stations", "control and tides want"),
    (CauseKind.UNIT, PLATES_TO_FOCAL_LENGTH): Words("PLT CAM", "plate coordinates", "the focal length wants"),
    (CauseKind.UNIT, HEIGHTS): Words(CONTROL_CARD, "heights of the control", "its plan wants"),
    (CauseKind.AXES, Y_REVERSED): Words(
        "PLT", "y of the plates", "y runs down: reverse its sign, or read how the axes were defined"
    ),
    (CauseKind.AXES, X_REVERSED): Words(
        "PLT", "x of the plates", "x runs backwards: reverse its sign, or read how the axes were defined"
    ),
    (CauseKind.AXES, EXCHANGED): Words(
        "PLT", "x and y of the plates", "exchanged: read the description of the comparator again"
    ),
    (CauseKind.AXES, CONTROL_EXCHANGED): Words(
        CONTROL_CARD, "plan of the control", "east and north are exchanged: read the list of control again"
    ),
    (CauseKind.AXES, HEIGHTS_NEGATED): Words(
        CONTROL_CARD, "heights of the control", "they have the other sign: depths for heights?"
    ),
    (CauseKind.LABELS, PLATES): Words("PLT", "plate cards", _EXCHANGED.format("plate")),
    (CauseKind.LABELS, CARDS): Words(STATION_CARD, "station cards", _EXCHANGED.format("station")),
}


def revised(block: Block, revision: Hypothesis) -> Block:
    """Return the block with something revised."""
    photo = np.array(revision.photo, dtype=int)
    cameras, photos, value = block.cameras, block.photos, revision.value
    match revision.kind:
        case CauseKind.FOCAL_LENGTH:
            f = cameras.focal_length.copy()
            f[revision.member] -= value
            return replace(block, cameras=replace(cameras, focal_length=f))
        case CauseKind.PRINCIPAL_POINT:
            principal = cameras.principal_point.copy()
            principal[divmod(revision.member, 2)] -= value
            return replace(block, cameras=replace(cameras, principal_point=principal))
        case CauseKind.INDEX:
            assert block.water is not None  # no index is tested without
            return replace(block, water=replace(block.water, index=block.water.index - value, conditions=None))
        case CauseKind.TIDES:
            tide = photos.tide.copy()
            tide[photo] -= value
            return replace(block, photos=replace(photos, tide=tide))
        case CauseKind.LABELS:
            if revision.member == PLATES:
                return replace(block, plates=replace(block.plates, photo=_exchanged(block.plates.photo, photo)))
            position = photos.position.copy()
            position[photo] = position[photo[::-1]]
            return replace(block, photos=replace(photos, position=position))
        case CauseKind.EXCHANGED_CONTROL:
            point = _exchanged(block.control.point, np.array(revision.point, dtype=int))
            return replace(block, control=replace(block.control, point=point))
        case CauseKind.AXES:
            return _with_other_axes(block, revision.member)
        case CauseKind.UNIT:
            return _rescaled(block, revision)
    raise ValueError(f"no revision of {revision.kind}")


def _exchanged(link: IntArray, pair: IntArray) -> IntArray:
    first, second = pair.tolist()
    return np.where(link == first, second, np.where(link == second, first, link))


def _with_other_axes(block: Block, member: int) -> Block:
    """Return the block with its plate axes, or those of its control, reversed or exchanged."""
    if member in (CONTROL_EXCHANGED, HEIGHTS_NEGATED):
        position = block.control.position
        position = position[:, [1, 0, 2]] if member == CONTROL_EXCHANGED else position * np.array([1.0, 1.0, -1.0])
        return replace(block, control=replace(block.control, position=position))
    xy = block.plates.xy
    xy = xy[:, ::-1] if member == EXCHANGED else xy * np.where(member == X_REVERSED, [-1.0, 1.0], [1.0, -1.0])
    return replace(block, plates=replace(block.plates, xy=xy))


def _rescaled(block: Block, revision: Hypothesis) -> Block:
    if revision.member == PLATES_TO_FOCAL_LENGTH:
        return replace(block, plates=replace(block.plates, xy=block.plates.xy / revision.value))
    of_all = block.options.system is CoordinateSystem.LOCAL and revision.member != HEIGHTS
    axes = slice(0, 3) if of_all else slice(2, 3)
    table = block.photos if revision.member == STATIONS else block.control
    position = table.position.copy()
    position[:, axes] /= revision.value
    if revision.member != STATIONS:
        return replace(block, control=replace(block.control, position=position))
    return replace(block, photos=replace(block.photos, position=position))


def moved_state(state: State, revision: Hypothesis) -> State:
    """Return a state that goes with what is revised."""
    photo, value = list(revision.photo), revision.value
    match revision.kind:
        case CauseKind.INDEX:
            return replace(state, index=state.index - value)
        case CauseKind.TIDES:
            tide = state.tide.copy()
            tide[photo] -= value
            return replace(state, tide=tide)
        case CauseKind.LABELS if revision.member == PLATES:
            position, attitude = state.position.copy(), state.attitude.copy()
            position[photo], attitude[photo] = position[photo[::-1]], attitude[photo[::-1]]
            return replace(state, position=position, attitude=attitude)
    return state


def in_words(revision: Hypothesis) -> Words:
    """Return what a revision is in words; its `value` is that of the unit of length."""
    kind = revision.kind
    words = MEMBERS.get((kind, revision.member), Words(kind.cards, kind.component, kind.advice))
    if kind is CauseKind.PRINCIPAL_POINT:
        return words._replace(component="xy"[revision.member % 2])
    if kind is CauseKind.UNIT:
        return words._replace(advice=_other_unit(words, revision.member, revision.value))
    return words


def _other_unit(words: Words, member: int, factor: float) -> str:
    """Return what to do about lengths that are `factor` times what the others want."""
    whose, (others, _, wants) = words.component, words.advice.rpartition(" ")
    of_plates = member == PLATES_TO_FOCAL_LENGTH
    right, scale = ("millimetres", 1e3) if of_plates else ("metres", 1.0)
    unit, inverse = (length_unit(of_metres, _SAME_UNIT) for of_metres in (scale * factor, 1.0 / factor))
    if not of_plates and "feet" in (unit, inverse):
        units = ("feet", "metres") if unit == "feet" else ("metres", "feet")
        return f"{whose} in {units[0]}, all else in {units[1]}: read the unit again"
    if unit:
        return f"{whose} in {unit}, {others} in {right}: read the unit again"
    return f"{whose} {factor:.5g} times what {others} {wants}: read both units again"
