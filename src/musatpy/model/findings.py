"""What the search for blunders found in a block, and what was done about it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Blunder(StrEnum):
    """What is wrong, in the order of the list; sizes are in the units given here."""

    MISNAMED = "misnamed image"  # x, y um on the plate, off the image that the name wants
    PLATE = "plate measurement"  # x, y um
    HORIZONTAL = "horizontal control"  # east, north m
    VERTICAL = "vertical control"  # up m
    POSITION = "station position"  # east, north, up m
    ATTITUDE = "station attitude"  # omega, phi, kappa arc seconds
    ELEVATION = "equal elevation"  # m off the level of the group
    BASE = "air base"  # m
    DISTANCE = "distance"  # m
    HEIGHT = "height difference"  # m
    TIDE = "tide"  # m
    DRY_FLAG = "not flagged submerged"  # m below the water
    WET_FLAG = "flagged submerged"  # m above the water


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
