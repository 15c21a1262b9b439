"""What a deck with comparator readings says of their reduction: options, comparator, lens, distances, reseau."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.model.tables import Table, per_job, per_row

_NAN = float("nan")


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
class CrossMeasurements(Table):
    """r readings of reseau crosses, in the order of the deck."""

    photo: IntArray = per_row(link="photos")  # (r,) link to Photos
    ids: TextArray = per_row(sort=True)  # (r,) id of the cross on the camera
    xy: FloatArray = per_row(2, sort=True)  # (r, 2) in the unit of the readings
