"""What the reduction of the plates of a job did: steps, parameters, residuals, refusals. For listings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.model.block import Block
from musatpy.model.tables import Table, per_row

Unit = Literal["", "count", "mm", "m", "rad", "mm/unit"]

BY_HEIGHTS = "HEIGHTS"  # the reason of a refusal by the heights of camera and ground
SPREAD_LEVEL = 0.05  # probability below which the spread of repeated readings is unlikely

_NAN = float("nan")


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One number of a step."""

    name: str
    value: float
    unit: Unit = ""  # of coefficients of polynomials, none: they are by powers of mm
    sigma: float = _NAN  # NaN where the number was given


@dataclass(frozen=True, kw_only=True)
class ReductionStep:
    """One step that the points of a plate took."""

    name: str  # comparator, fiducials, reseau, lens, refraction, curvature
    parameters: tuple[Quantity, ...]
    largest: float  # mm, largest displacement; NaN where the step changes the system, or without points


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Repeated readings of the marks, points or crosses of a plate, in their unit."""

    what: str  # marks, points, crosses
    freedom: int  # readings less targets
    pooled: tuple[float, float]  # standard deviation of one reading
    probability: tuple[float, float]  # to be so large by chance
    largest: float  # deviation of a coordinate from its mean
    beyond: tuple[str, ...]  # targets of readings that are beyond the limit

    @property
    def unlikely(self) -> bool:
        """True where so large a spread, in a coordinate, is hardly that of readings as good as stated."""
        return min(self.probability) < SPREAD_LEVEL


@dataclass(frozen=True, kw_only=True, eq=False)
class ReducedPlate(Table):
    """One plate: q measured marks that its camera has, or e distances between them."""

    photo: str
    steps: tuple[ReductionStep, ...]
    marks: TextArray = per_row()  # (q,)
    residuals: FloatArray = per_row(2)  # (q, 2) mm, transformed minus calibrated; NaN without
    normalized: FloatArray = per_row(2)  # (q, 2) residuals over their own sigma
    ends: TextArray = per_row(2, rows="distances")  # (e, 2) marks of the distances
    distance_residuals: FloatArray = per_row(rows="distances")  # (e,) mm, scaled minus calibrated
    sigma0: float  # of the fiducial transformation, NaN without redundancy
    freedom: int
    missing: tuple[str, ...]  # calibrated marks that were not measured
    spreads: tuple[Spread, ...]  # of what was read more than once
    beyond_reseau: tuple[str, ...]  # points outside the measured crosses
    beyond_table: tuple[str, ...]  # points outside the calibrated radii
    refusal: str  # why the plate is refused; empty: it is not
    reason: str  # the same in one word
    suspects: tuple[str, ...]  # marks without any one of which the others would do

    @property
    def used(self) -> int:
        """The number of marks that the transformation goes by."""
        return len(self.marks) or len(np.unique(self.ends))

    @property
    def rms(self) -> FloatArray:
        """(2,) mm, root mean squares of the residuals of the marks by coordinate, NaN where there are none."""
        rms = np.sqrt(np.square(self.residuals).sum(axis=0) / (len(self.marks) or _NAN))
        return np.asarray(rms, dtype=float)

    def largest(self, name: str) -> float:
        """Return the largest displacement (mm) by a step, NaN where it was not taken, or took no points."""
        return next((step.largest for step in self.steps if step.name == name), _NAN)


@dataclass(frozen=True, kw_only=True, eq=False)
class Reduced:
    """The reduction of all plates of a job, and the block as its deck gives it."""

    given: Block
    plates: tuple[ReducedPlate, ...]

    @property
    def refusals(self) -> dict[str, str]:
        """The photos that were left out, each with why its plate is refused."""
        return {plate.photo: plate.refusal for plate in self.plates if plate.refusal}

    @property
    def by_heights(self) -> frozenset[str]:
        """The photos that were left out by the heights of camera and ground."""
        return frozenset(plate.photo for plate in self.plates if plate.reason == BY_HEIGHTS)

    def largest(self, name: str) -> tuple[str, float] | None:
        """Return the photo with the largest displacement by a step, and that (mm); None where no plate took it."""
        pairs = [(plate.photo, plate.largest(name)) for plate in self.plates if not plate.refusal]
        pairs = [pair for pair in pairs if np.isfinite(pair[1])]
        return max(pairs, key=lambda pair: pair[1]) if pairs else None
