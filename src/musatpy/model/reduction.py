"""What a deck with comparator readings says of their reduction: options, comparator, lens, distances, reseau."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.model.arrays import freeze

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
    left_handed: bool = False
    reading_sigma: float = 0.003  # of one reading, in its unit
    repeat_limit: float = _NAN  # of the deviation of repeated readings from their mean, in their unit


@dataclass(frozen=True, kw_only=True, eq=False)
class Lenses:
    """What cameras have besides their records of distortion, one row for each camera that has any of it."""

    camera: IntArray  # (l,) link to Cameras
    centre: FloatArray  # (l, 2) mm, principal point of best symmetry; NaN: that of the camera
    k0: FloatArray  # (l,) of the radial distortion; NaN: 0

    def __post_init__(self) -> None:
        freeze(self, "camera", int, -1)
        freeze(self, "centre", float, len(self.camera), 2)
        freeze(self, "k0", float, len(self.camera))


@dataclass(frozen=True, kw_only=True, eq=False)
class MarkDistances:
    """e calibrated distances between the fiducial marks of cameras.

    `axis` says which pairs of marks the axes go through: `X` and `Y` of side marks, from the first to the second;
    of corner marks `D1` the diagonal from lower left to upper right, `D2` that from lower right to upper left.
    """

    camera: IntArray  # (e,) link to Cameras
    marks: TextArray  # (e, 2) ids of the marks
    distance: FloatArray  # (e,) mm
    sigma: FloatArray  # (e,) mm
    axis: TextArray  # (e,) empty: none

    def __post_init__(self) -> None:
        freeze(self, "camera", int, -1)
        e = len(self.camera)
        freeze(self, "marks", str, e, 2)
        freeze(self, "distance", float, e)
        freeze(self, "sigma", float, e)
        freeze(self, "axis", str, e)


@dataclass(frozen=True, kw_only=True, eq=False)
class ReseauCrosses:
    """x calibrated crosses of the reseaux of cameras; rows and columns count from 1."""

    camera: IntArray  # (x,) link to Cameras
    ids: TextArray  # (x,)
    row: FloatArray  # (x,) whole numbers
    column: FloatArray  # (x,)
    xy: FloatArray  # (x, 2) mm

    def __post_init__(self) -> None:
        freeze(self, "camera", int, -1)
        x = len(self.camera)
        freeze(self, "ids", str, x)
        freeze(self, "row", float, x)
        freeze(self, "column", float, x)
        freeze(self, "xy", float, x, 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossMeasurements:
    """r readings of reseau crosses, in the order of the deck."""

    photo: IntArray  # (r,) link to Photos
    ids: TextArray  # (r,) id of the cross on the camera
    xy: FloatArray  # (r, 2) in the unit of the readings

    def __post_init__(self) -> None:
        freeze(self, "photo", int, -1)
        freeze(self, "ids", str, len(self.photo))
        freeze(self, "xy", float, len(self.photo), 2)


def no_lenses() -> Lenses:
    """Return no lenses at all."""
    return Lenses(camera=np.zeros(0, dtype=int), centre=np.zeros((0, 2)), k0=np.zeros(0))


def no_mark_distances() -> MarkDistances:
    """Return no distances between marks at all."""
    return MarkDistances(
        camera=np.zeros(0, dtype=int),
        marks=np.zeros((0, 2), dtype=np.str_),
        distance=np.zeros(0),
        sigma=np.zeros(0),
        axis=np.zeros(0, dtype=np.str_),
    )


def no_reseau_crosses() -> ReseauCrosses:
    """Return no calibrated crosses at all."""
    return ReseauCrosses(
        camera=np.zeros(0, dtype=int),
        ids=np.zeros(0, dtype=np.str_),
        row=np.zeros(0),
        column=np.zeros(0),
        xy=np.zeros((0, 2)),
    )


def no_cross_measurements() -> CrossMeasurements:
    """Return no readings of crosses at all."""
    return CrossMeasurements(photo=np.zeros(0, dtype=int), ids=np.zeros(0, dtype=np.str_), xy=np.zeros((0, 2)))
