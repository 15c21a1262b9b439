"""What the search for blunders found in a block, and what was done about it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from musatpy.model.kinds import Blunder, CauseKind

_SHOWN = 5  # ids of one cause


class Action(StrEnum):
    """What was done, or with LIST would be done."""

    KEPT_OUT = "kept out"  # flag N on the plate card
    RENAMED = "renamed"  # the plate card gets the name of the point whose image it is
    NOT_KNOWN = "not held"  # control: the component is not known any more; stations: not observed
    DROPPED = "dropped"  # the card, or the point on it, is not there any more
    FLAGGED = "flag B set"
    UNFLAGGED = "flag B taken"
    NONE = "none"  # why, says the note


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One finding. Ids are those of the deck as it was given."""

    blunder: Blunder
    photo: str = ""
    point: str = ""  # of a pair: both ids, with a hyphen; of an equal elevation the group follows
    test: float  # Student's t, or the root of a chi-square of one degree of freedom; NaN where nothing checks it
    size: tuple[float, ...]  # estimated: given minus what the others say, in the unit of the kind
    action: Action
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One cause of what does not fit, among those that compete; ids are those of the deck.

    Causes of one `group` explain the same; of these, those with one `rank` explain it equally well. The first of a
    group is what the others are compared with.
    """

    kind: CauseKind
    cards: tuple[str, ...]  # mnemonics of the cards to read again
    photos: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    component: str = ""  # of the card
    size: tuple[float, ...] = ()  # given minus true
    sigma: tuple[float, ...] = ()  # of the size
    unit: str = ""  # of both
    parameters: int = 1  # that it takes
    drop: float = math.nan  # of the weighted sum of squares, when it is given up; NaN: all of it
    test: float = math.nan  # root of the drop for each parameter, in sigma0; NaN: not tested
    group: int = 1  # from 1
    rank: int = 1  # in its group, from 1; equal: explains the same
    advice: str  # what to check

    def __str__(self) -> str:
        owner = [text for text in (_named("photo", self.photos), _named("point", self.points)) if text]
        component = "" if self.kind is CauseKind.UNIT or self.component in self.kind else self.component
        name = " ".join(part for part in (self.kind, component, *owner) if part)
        if self.kind is CauseKind.FLAG:
            name = f"flag{'s' if len(self.points) > 1 else ''} of {owner[-1]}"
        known = [f"{value:.3f}" for value in self.size if math.isfinite(value) and self.kind is not CauseKind.UNIT]
        size = f", off by {', '.join(known)} {self.unit}".rstrip() if known else ""
        return f"{name}{size}: {self.advice}"


def _named(what: str, ids: tuple[str, ...]) -> str:
    """Return ids in words: a few, and the number of the others."""
    more = f" and {len(ids) - _SHOWN} more" if len(ids) > _SHOWN else ""
    return f"{what}{'s' if len(ids) > 1 else ''} {', '.join(ids[:_SHOWN])}{more}" if ids else ""
