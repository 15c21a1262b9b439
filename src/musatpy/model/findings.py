"""What the search for blunders found in a block, what was done about it, and what the run is worth."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from musatpy.model.kinds import NAMED_BY_COMPONENT, Action, CauseKind
from musatpy.model.options import CoordinateSystem

_SHOWN = 5  # ids in a row, the others by their number
SEARCH_GIVEN_UP = "the search for blunders was given up"  # how the warning begins that says so
_NOUNS = {  # of a cause, before the name of its point or photo
    CauseKind.VERTICAL: "height on the control card",
    CauseKind.HORIZONTAL: "position on the control card",
    CauseKind.START: "starting values of the station",
    CauseKind.FLAG: "flag",
    CauseKind.NAME: "name of the image",
    CauseKind.EXCHANGED_IMAGES: "exchanged images",
    CauseKind.IMAGES: "all images",
}


def mnemonics(cards: str, system: CoordinateSystem) -> tuple[str, ...]:
    """Return the mnemonics of cards in a job: of `CTG/CTX ATT` in one of a local system CTX and ATT."""
    return tuple(card.split("/")[0 if system is CoordinateSystem.GEOGRAPHIC else -1] for card in cards.split())


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One finding. Ids are those of the deck as it was given."""

    kind: CauseKind
    photo: str = ""
    point: str = ""  # of a pair: both ids, with a hyphen; of an equal elevation the group follows
    test: float  # Student's t, or the root of a chi-square of one degree of freedom; NaN where nothing checks it
    size: tuple[float, ...]  # estimated: given minus what the others say, in the unit of the kind
    action: Action
    note: str = ""

    @property
    def blunder(self) -> str:
        """What is wrong, as the list has it."""
        return self.kind.listed


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

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> Cause:
        """Return the cause in a row of the table of a record."""
        size = tuple(math.nan if value is None else value for value in row["size"])
        values = {name: row[name] for name in ("cards", "photos", "points", "component", "unit", "advice")}
        return cls(kind=CauseKind(row["cause"]), size=size, **values)

    @property
    def name(self) -> str:
        """What is wrong, in words: `position on the control card of point 112`."""
        noun = _NOUNS.get(self.kind, str(self.kind))
        if self.kind is CauseKind.FLAG and len(self.points) > 1:
            noun = "flags"
        elif self.kind in NAMED_BY_COMPONENT:
            noun += f" ({self.component})" if self.component and self.component not in noun else ""
        owners = " on ".join(text for text in (named("point", self.points), named("photo", self.photos)) if text)
        return f"{noun} of {owners}" if owners else noun

    def __str__(self) -> str:
        known = [f"{value:.3f}" for value in self.size if math.isfinite(value) and self.kind is not CauseKind.UNIT]
        size = f", off by {', '.join(known)} {self.unit}".rstrip() if known else ""
        return f"{self.name}{size}: {self.advice}"


def named(noun: str, names: Iterable[object]) -> str:
    """Return `photos 1, 2, 3`: a few by name, the others by their number; nothing of none."""
    texts = [str(name) for name in names]
    return f"{noun}{'s' if len(texts) > 1 else ''} {a_few(texts[:_SHOWN], len(texts))}" if texts else ""


def a_few(first: Sequence[str], count: int, joint: str = ", ") -> str:
    """Return the first of `count` names in a row, and the number of the others."""
    return joint.join(first) + (f" and {count - len(first)} more" if count > len(first) else "")


class Grade(StrEnum):
    """What may be done with an answer, from the best to the worst."""

    ACCEPTED = "ACCEPTED"  # no test rejects it
    DOUBTFUL = "DOUBTFUL"  # converged; to be looked at before it is used
    REJECTED = "REJECTED"  # converged, but not to be used
    FAILED = "FAILED"  # not converged


GRADES = tuple(Grade)


class Concern(StrEnum):
    """What a reason is about."""

    CONVERGENCE = "convergence"
    FINITE = "finite numbers"
    STATION = "stations above ground and water"
    DISTANCE = "distance of points"
    INDEX = "refractive index"
    FORMAT = "residuals within the plate"
    SIGMA0 = "sigma0"
    REDUNDANCY = "redundancy"
    OBSERVATION = "single observations"
    CONTROL = "control"
    COMMON = "errors common to all"
    CHECK_POINTS = "check points"
    GIVEN_STATIONS = "given stations"
    UNIT = "units"
    CAMERA = "camera"
    WAVES = "waves"
    UNDETERMINED = "what is not determined"
    BLUNDERS = "blunders"
    FLAGS = "flags of points"
    DATUM = "heights of water and control"
    INERTIAL = "inertial attitudes"
    REFRACTION = "refraction"


NO_CARD_EXPLAINS = frozenset(
    {Concern.REFRACTION, Concern.UNDETERMINED}
)  # no error is behind them: the reason says what to do

OF_FLAGS = frozenset({Concern.FLAGS, Concern.DATUM})  # whose causes stand with them: v'Pv does not show them


@dataclass(frozen=True)
class Reason:
    """One reason against an answer."""

    grade: Grade  # that it alone would give
    concern: Concern
    text: str  # a sentence without a full stop
    section: str  # beginning of the title of the section of the listing where it shows


@dataclass(frozen=True, kw_only=True, repr=False)
class Verdict:
    """The grade of a solution: that of its worst reason. Notes are worth knowing and cast no doubt."""

    reasons: tuple[Reason, ...]  # the worst first
    notes: tuple[str, ...] = ()

    @property
    def grade(self) -> Grade:
        """The grade of the worst reason, `ACCEPTED` without any."""
        return max((reason.grade for reason in self.reasons), key=GRADES.index, default=Grade.ACCEPTED)

    @property
    def usable(self) -> bool:
        """True where the answer was accepted, or is doubtful."""
        return self.grade in (Grade.ACCEPTED, Grade.DOUBTFUL)

    def __repr__(self) -> str:
        more = f"; and {len(self.reasons) - 1} more" if len(self.reasons) > 1 else ""
        return f"Verdict({self.grade}{f': {self.reasons[0].text}{more}' if self.reasons else ''})"

    def __str__(self) -> str:
        texts = "; ".join(reason.text for reason in self.reasons)
        return f"{self.grade}: {texts}" if texts else str(self.grade)
