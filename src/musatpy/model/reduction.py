"""The reduction of comparator readings: what a deck says of it, and what it did with the plates.

Options, comparator, lens, distances and reseau; then steps, parameters, residuals and refusals, for listings.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Literal

import numpy as np

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.model.tables import Table, per_job, per_row

if TYPE_CHECKING:
    from musatpy.model.block import Block  # which has these tables

_NAN = float("nan")
Unit = Literal["", "count", "mm", "m", "rad", "mm/unit"]
BY_HEIGHTS = "HEIGHTS"  # the reason of a refusal by the heights of camera and ground
SPREAD_LEVEL = 0.05  # probability below which the spread of repeated readings is unlikely


class Plates(StrEnum):
    """What the plate cards of a deck give."""

    REFINED = "REFINED"  # refined plate coordinates
    RAW = "RAW"  # comparator readings, which a run reduces


class Transformation(StrEnum):
    """How readings are taken to the fiducial system."""

    SIMILARITY = "SIMILARITY"
    AFFINE = "AFFINE"
    PROJECTIVE = "PROJECTIVE"
    DISTANCES = "DISTANCES"  # by calibrated distances between marks only
    NONE = "NONE"  # the readings are in the fiducial system already


class DistortionSide(StrEnum):
    """Whose place the distortion is given for."""

    MEASURED = "MEASURED"
    IDEAL = "IDEAL"


class Polynomials(StrEnum):
    """What the coefficients of radial and decentring distortion give."""

    DISTORTION = "DIST"  # measured minus ideal place
    CORRECTION = "CORR"  # the opposite, as in reports of the U.S. Geological Survey


class Atmosphere(StrEnum):
    """The standard atmosphere by which refraction in the air is corrected."""

    NONE = "NONE"
    ARDC = "ARDC"
    US1976 = "US1976"


class Curvature(StrEnum):
    """Whether the earth's curvature is corrected."""

    NO = "NO"
    YES = "YES"


class Refused(StrEnum):
    """What happens to a job of which a plate is refused."""

    STOP = "STOP"
    GO_ON = "GO"  # without the plate


@dataclass(frozen=True, kw_only=True)
class ReductionOptions:
    """How the plates of a job are reduced; NaN: not given."""

    plates: Plates = Plates.REFINED
    transformation: Transformation = Transformation.AFFINE
    residual_limit: float = _NAN  # mm, of any coordinate of a mark; of a distance between marks
    side: DistortionSide = DistortionSide.MEASURED
    polynomials: Polynomials = Polynomials.DISTORTION
    atmosphere: Atmosphere = Atmosphere.NONE
    curvature: Curvature = Curvature.NO
    ground_height: float = _NAN  # m, mean of what the photos show
    refused: Refused = Refused.STOP


@dataclass(frozen=True, kw_only=True)
class ComparatorSpec:
    """The calibration of a comparator, and what its readings are worth."""

    scale_u: float = 1.0  # mm for each unit of the readings
    scale_v: float = 1.0
    non_orthogonality: float = 0.0  # rad, by which the v rail leans towards u
    rotation: float = 0.0  # rad
    left_handed: bool = per_job(False, codes={"": False, "L": True})
    reading_sigma: float = 0.003  # of one reading, in its unit
    repeat_limit: float = _NAN  # of the deviation of repeated readings from their mean, in their unit


@dataclass(frozen=True, kw_only=True, eq=False)
class Lenses(Table):
    """What cameras have besides their records of distortion, one row for each camera that has any of it."""

    camera: IntArray = per_row(link="cameras")  # (l,) link to Cameras
    centre: FloatArray = per_row(2, unit="mm")  # (l, 2) principal point of best symmetry; NaN: that of the camera
    k0: FloatArray = per_row()  # (l,) of the radial distortion; NaN: 0
    zero_radius: FloatArray = per_row(unit="mm")  # (l,) where the radial distortion is zero without k0; NaN: 0


@dataclass(frozen=True, kw_only=True, eq=False)
class MarkDistances(Table):
    """e calibrated distances between the fiducial marks of cameras.

    `axis` says which pairs of marks the axes go through: `X` and `Y` of side marks, from the first to the second;
    of corner marks `D1` the diagonal from lower left to upper right, `D2` that from lower right to upper left.
    """

    camera: IntArray = per_row(link="cameras")  # (e,) link to Cameras
    marks: TextArray = per_row(2, sort=True)  # (e, 2) ids of the marks
    axis: TextArray = per_row()  # (e,) empty: none
    distance: FloatArray = per_row(unit="mm")  # (e,)
    sigma: FloatArray = per_row(unit="mm")  # (e,)


@dataclass(frozen=True, kw_only=True, eq=False)
class ReseauCrosses(Table):
    """x calibrated crosses of the reseaux of cameras; rows and columns count from 1."""

    camera: IntArray = per_row(link="cameras")  # (x,) link to Cameras
    ids: TextArray = per_row(sort=True)  # (x,)
    row: FloatArray = per_row()  # (x,) whole numbers
    column: FloatArray = per_row()  # (x,)
    xy: FloatArray = per_row(2, unit="mm")  # (x, 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossMeasurements(Table, noun="reseau cross"):
    """r readings of reseau crosses, in the order of the deck."""

    photo: IntArray = per_row(link="photos")  # (r,) link to Photos
    ids: TextArray = per_row(sort=True)  # (r,) id of the cross on the camera
    xy: FloatArray = per_row(2, sort=True)  # (r, 2) in the unit of the readings


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
