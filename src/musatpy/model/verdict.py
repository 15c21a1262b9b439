"""What a run is worth: accepted, doubtful, rejected or failed, with its reasons."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Grade(StrEnum):
    """What may be done with an answer, from the best to the worst."""

    ACCEPTED = "ACCEPTED"  # no test speaks against it
    DOUBTFUL = "DOUBTFUL"  # converged; to be looked at before it is used
    REJECTED = "REJECTED"  # converged, but not to be used
    FAILED = "FAILED"  # not converged

    @property
    def rank(self) -> int:
        """0 for the best."""
        return list(Grade).index(self)


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
    REFRACTION = "refraction"


NO_CARD_EXPLAINS = frozenset(
    {Concern.REFRACTION, Concern.UNDETERMINED}
)  # no error is behind them: the reason says what to do

OF_FLAGS = frozenset({Concern.FLAGS, Concern.DATUM})  # whose causes stand with them: v'Pv does not show them


@dataclass(frozen=True, kw_only=True)
class Reason:
    """One reason against an answer."""

    grade: Grade  # that it alone would give
    concern: Concern
    text: str  # a sentence without a full stop
    section: str  # beginning of the title of the section of the listing where it shows


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The grade of a solution: that of its worst reason. Notes are worth knowing and cast no doubt."""

    reasons: tuple[Reason, ...]  # the worst first
    notes: tuple[str, ...] = ()

    @property
    def grade(self) -> Grade:
        """The grade of the worst reason, `ACCEPTED` without any."""
        return max((reason.grade for reason in self.reasons), key=lambda grade: grade.rank, default=Grade.ACCEPTED)

    @property
    def usable(self) -> bool:
        """True where the answer was accepted, or is doubtful."""
        return self.grade.rank <= Grade.DOUBTFUL.rank

    def __str__(self) -> str:
        texts = "; ".join(reason.text for reason in self.reasons)
        return f"{self.grade}: {texts}" if texts else str(self.grade)
