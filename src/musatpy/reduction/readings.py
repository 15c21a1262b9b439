"""What a plate reduction starts from: the camera's calibration, the readings of a plate, the plan of the job."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.reduction.atmosphere import Model
from musatpy.reduction.comparator import Comparator
from musatpy.reduction.curvature import EARTH_RADIUS
from musatpy.reduction.distortion import Lens
from musatpy.reduction.fiducials import Limits
from musatpy.reduction.mark_distances import Scales
from musatpy.reduction.nadir import DOWN
from musatpy.reduction.planar import Kind


@dataclass(frozen=True, kw_only=True, eq=False)
class MarkDistances:
    """Calibrated distances between marks, where their coordinates are not known. All positive, or `ValueError`."""

    ends: TextArray  # (e, 2) ids of the marks
    distance: FloatArray  # (e,) mm
    sigma: FloatArray  # (e,) mm
    first: tuple[str, str]  # the pair of marks on the x axis, or on the diagonal from lower left to upper right
    second: tuple[str, str]  # on the y axis, or on the diagonal from lower right to upper left
    corners: bool = False  # the pairs are diagonals
    scales: Scales = Scales.AXES

    def __post_init__(self) -> None:
        if not (np.all(self.distance > 0.0) and np.all(self.sigma > 0.0)):
            raise ValueError("distances between marks and their sigmas must be positive")


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """The calibrated crosses of a reseau in the fiducial system."""

    ids: TextArray  # (r, c)
    xy: FloatArray  # (r, c, 2) mm


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """What a camera's certificate says: q marks, or distances between marks, which take precedence."""

    focal_length: float  # mm
    principal_point: FloatArray  # (2,) mm, of autocollimation
    mark_ids: TextArray  # (q,)
    marks: FloatArray  # (q, 2) mm
    mark_sigma: FloatArray  # (q, 2) mm, NaN where not given
    distances: MarkDistances | None = None
    reseau: Grid | None = None
    lens: Lens | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateReadings:
    """The readings of one plate, repeated ones of the same id included, in the unit of the comparator."""

    photo: str
    mark_ids: TextArray  # (r,)
    marks: FloatArray  # (r, 2)
    point_ids: TextArray  # (m,)
    points: FloatArray  # (m, 2)
    mark_sigma: FloatArray | None = None  # (r, 2) of each reading, its unit; None, NaN, 0: that of the plan
    point_sigma: FloatArray | None = None  # (m, 2)
    cross_ids: TextArray = field(default_factory=lambda: np.zeros(0, dtype=np.str_))  # (x,) of the reseau
    crosses: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))  # (x, 2)
    camera_height: float = float("nan")  # m above sea level
    ground_height: float = float("nan")  # m, mean of what the plate shows
    nadir: FloatArray = field(default_factory=lambda: DOWN)  # (3,) unit vector to the nadir in the photo's system


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Which steps a job takes, and its limits. A step without its calibration in the camera is left out.

    Raises `ValueError` where the sigma of a reading is not positive, or that of a mark negative.
    """

    comparator: Comparator | None = None
    fiducials: Kind | None = Kind.AFFINE  # None: the readings are in the fiducial system already
    limits: Limits = field(default_factory=Limits)
    reading_sigma: float = 0.003  # of one reading, in its unit
    mark_sigma: float = 0.003  # mm, of calibrated marks whose certificate gives none
    repeat_limit: float = float("inf")  # of a reading's deviation from its mean, in the unit of the readings
    reseau: bool = True
    lens: bool = True
    refraction: Model | None = None
    curvature: bool = False  # for jobs in a grid
    earth_radius: float = EARTH_RADIUS  # m

    def __post_init__(self) -> None:
        if not (self.reading_sigma > 0.0 and self.mark_sigma >= 0.0):
            raise ValueError("readings need a positive sigma, marks none that is negative")
