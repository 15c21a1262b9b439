"""What a plate reduction starts from: the camera's calibration, the readings of a plate, the plan of the job.

Repeated readings of the same mark or point on a plate: their means, and a test of their spread.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.probability import probability_beyond
from musatpy.reduction.displacements import DOWN, EARTH_RADIUS, Model
from musatpy.reduction.distortion import Lens
from musatpy.reduction.fiducials import FiducialLimits, Scales
from musatpy.reduction.planar import Comparator, PlanarKind


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
class ReductionPlan:
    """Which steps a job takes, and its limits. A step without its calibration in the camera is left out.

    Raises `ValueError` where the sigma of a reading is not positive, or that of a mark negative.
    """

    comparator: Comparator | None = None
    fiducials: PlanarKind | None = PlanarKind.AFFINE  # None: the readings are in the fiducial system already
    limits: FiducialLimits = field(default_factory=FiducialLimits)
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Means:
    """The means of g targets read m times altogether, in the unit of the readings.

    The spread of a target is the standard deviation of one reading, coordinate by coordinate; pooled over all
    targets it has `freedom` = m - g degrees of freedom in each coordinate. `probability` is that of a chi-square
    variable to exceed the sum of the squared deviations over the stated sigma of one reading.
    """

    ids: TextArray  # (g,) in the order in which they were first read
    xy: FloatArray  # (g, 2)
    count: IntArray  # (g,)
    sigma: FloatArray  # (g, 2) of one reading; NaN where there is but one
    target: IntArray  # (m,) row of ids that each reading belongs to
    deviations: FloatArray  # (m, 2) reading minus mean
    pooled: FloatArray  # (2,) sigma of one reading, NaN where nothing was read twice
    freedom: int
    probability: FloatArray  # (2,) NaN without a stated sigma or without repeated readings
    beyond: BoolArray  # (m,) a deviation, x or y, is beyond the limit

    @property
    def largest(self) -> float:
        """Return the largest deviation of a coordinate from its mean; 0 without readings."""
        return float(np.abs(self.deviations).max(initial=0.0))


def mean_readings(
    ids: TextArray, xy: FloatArray, reading_sigma: float = float("nan"), limit: float = float("inf")
) -> Means:
    """Return the means of readings xy (m, 2) of the targets ids (m,).

    `reading_sigma` is the stated sigma of one reading, against which the spread is tested; `limit` the deviation
    beyond which a reading is reported. Nothing is left out: of two readings that differ neither is the wrong one.
    """
    names, first, target = np.unique(ids, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.argsort(order)
    target, names = rank[target.reshape(-1)], names[order]
    count = np.bincount(target, minlength=len(names))
    mean = _sums(target, xy, len(names)) / count[:, None]
    deviations = xy - mean[target]
    squares = _sums(target, np.square(deviations), len(names))
    totals, freedom = squares.sum(axis=0), len(xy) - len(names)
    return Means(
        ids=names,
        xy=mean,
        count=count,
        sigma=np.sqrt(squares / np.where(count > 1, count - 1.0, np.nan)[:, None]),
        target=target,
        deviations=deviations,
        pooled=np.sqrt(totals / (freedom or np.nan)),
        freedom=freedom,
        probability=np.array([probability_beyond(float(total) / reading_sigma**2, freedom) for total in totals])
        if freedom and reading_sigma > 0.0
        else np.full(2, np.nan),
        beyond=np.asarray((np.abs(deviations) > limit).any(axis=1)),
    )


def _sums(target: IntArray, values: FloatArray, size: int) -> FloatArray:
    total = np.zeros((size, 2))
    np.add.at(total, target, values)
    return total
