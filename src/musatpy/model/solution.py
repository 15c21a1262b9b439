"""What an adjustment found: the only thing that statistics and reports read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np

import musatpy
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.adjusted_waves import AdjustedWaves
from musatpy.model.block import Block
from musatpy.model.findings import Cause, Finding
from musatpy.model.kinds import ObservationKind
from musatpy.model.reliability import ConsideredWater, Dependence, HeldParameters, Observations
from musatpy.model.tables import Table, freeze, per_row

if TYPE_CHECKING:
    from musatpy.model.reduced import Reduced  # of raw plates only

_REASON = 200  # characters of a reason that are shown


@dataclass(frozen=True, kw_only=True, eq=False)
class Iteration:
    """One iteration of one triangulation."""

    outer_pass: int  # 0: the first triangulation, without refraction; 1.. those of WATPT, or of the wet rays
    number: int  # from 1, within the pass
    rotation: float  # rad, largest differential rotation
    rotation_photo: int  # link to Photos
    translation: float  # m, largest differential translation
    translation_photo: int  # link to Photos
    sum_of_squares: float  # weighted, after the step
    damping: float  # of the step control, 0 for a full Gauss-Newton step


@dataclass(frozen=True, kw_only=True, eq=False)
class WaterPass:
    """One outer pass of the water point correction."""

    number: int
    movement: float  # m, largest movement of a submerged point since the pass before
    point: int  # link to Points, of the largest movement
    rms_movement: float  # m
    rms_residual: float  # mm, of the plate residuals of submerged points after the pass
    image_change: float = 0.0  # sigmas, largest change of a corrected image from this pass to the next
    image: int = -1  # link to PlateMeasurements, of that change
    turning: int = -1  # link to Points, one whose rays change between wet and dry after the pass, -1 for none


class PointStatus(IntEnum):
    """What became of a point."""

    TRIANGULATED = 0  # took part in the solution
    INTERSECTED = 1  # kept out by its flags, intersected from the adjusted stations
    NOT_DETERMINED = 2  # no position; `GroundPoints.reasons` says why


@dataclass(frozen=True, kw_only=True, eq=False)
class AdjustedStations(Table):
    """n adjusted exposure stations, row by row those of `Block.photos`.

    The covariance is that of (east, north, up, omega, phi, kappa) in metres and radians (X, Y, Z in local jobs),
    a posteriori: scaled by sigma0 squared.
    """

    position: FloatArray = per_row(3)  # (n, 3) in the job's system
    attitude: FloatArray = per_row(3)  # (n, 3) rad, in the local vertical frame of the adjusted position
    covariance: FloatArray = per_row(6, 6)  # (n, 6, 6)


@dataclass(frozen=True, kw_only=True, eq=False)
class StationPairs(Table):
    """e pairs of photos that share a point, the first before the second in the order of `Block.photos`."""

    photo: IntArray = per_row(2)  # (e, 2)
    covariance: FloatArray = per_row(6, 6)  # (e, 6, 6) of the parameters of the first with those of the second


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelPairs(Table):
    """Levels that photos have of their own as unknowns: e pairs of photos, as `StationPairs`, and each alone."""

    photo: IntArray = per_row(2)  # (e, 2)
    of_first: FloatArray = per_row(6)  # (e, 6) covariances of the parameters of the first with the second's level
    of_second: FloatArray = per_row(6)  # (e, 6) of the first's level with the parameters of the second
    level: FloatArray = per_row()  # (e,) of both levels, m2


@dataclass(frozen=True, kw_only=True, eq=False)
class WaterPrecision:
    """Joint covariances of g quantities of the water, adjusted and considered ones, in m and rad.

    A posteriori, as those of the stations, with which they stand here too, and with the levels that photos have of
    their own as unknowns, which are not among them.
    """

    names: tuple[str, ...]  # (g,) in the order of the border of the normal equations
    covariance: FloatArray  # (g, g)
    stations: FloatArray  # (n, 6, g) of the parameters of stations with the water
    levels: FloatArray  # (n, g) of the levels of single photos with it, (0, g) where these are no unknowns


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundPoints(Table):
    """p ground points, row by row those of `Block.points`; NaN where not determined."""

    position: FloatArray = per_row(3)  # (p, 3) in the job's system
    covariance: FloatArray = per_row(3, 3)  # (p, 3, 3) m2, east north up (X, Y, Z in local jobs), a posteriori
    status: IntArray = per_row()  # (p,) PointStatus
    rays: IntArray = per_row()  # (p,) number of plate measurements used for the position
    water: FloatArray = per_row(2, blank=np.nan)  # (p, 2) m, lowest and highest over it, of its photos with a tide
    water_sigma: FloatArray = per_row(blank=np.nan)  # (p,) m, the largest of these tides, 0 without error
    reasons: dict[int, str]  # point link -> why it has no position, or took no part
    lost: tuple[int, ...] = ()  # links of those that took part, and that their rays do not determine


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherFlags(Table):
    """d points whose heights contradict their flags, as they are when all of them have the other one."""

    point: IntArray = per_row(link="points")  # (d,)
    height: FloatArray = per_row()  # (d,) m, NaN where it was not to be had
    sum_of_squares: float  # weighted, of the adjustment with these flags
    consistent: bool  # no height contradicts its flag in it, and it fits as well


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateResiduals(Table):
    """m plate residuals, row by row the measurements of `Block.plates`: adjusted minus measured, mm."""

    residual: FloatArray = per_row(2)  # (m, 2) mm, NaN where the point is not determined
    triangulated: BoolArray = per_row()  # (m,) the measurement took part in the solution
    correction: FloatArray = per_row(2)  # (m, 2) mm, refraction: straight minus refracted adjusted image; 0 on land


@dataclass(frozen=True, kw_only=True, eq=False)
class BathymetricPoints(Table):
    """s submerged points: where they seem to be, where they should be, and where they are.

    `apparent` is where the straight rays of the adjusted stations meet; `predicted` is below it, along the
    local vertical, at n times its depth (docs/theory.md); the position with refraction is that of `GroundPoints`.
    Depths are positive below the mean water level of the point's photos.
    """

    point: IntArray = per_row()  # (s,) link to Points
    apparent: FloatArray = per_row(3)  # (s, 3) in the job's system, NaN where its rays do not give it
    predicted: FloatArray = per_row(3)  # (s, 3) in the job's system
    water_level: FloatArray = per_row()  # (s,) m, mean height of the water over the photos that give the point
    incidence: FloatArray = per_row()  # (s,) rad, mean angle in air between its rays and the normal of the water
    apparent_depth: FloatArray = per_row()  # (s,) m
    predicted_depth: FloatArray = per_row()  # (s,) m
    depth: FloatArray = per_row()  # (s,) m, with refraction
    depth_sigma: FloatArray = per_row()  # (s,) m

    @property
    def height(self) -> FloatArray:
        """(s,) m, of the adjusted points."""
        return self.water_level - self.depth


@dataclass(frozen=True, kw_only=True, eq=False)
class AdjustedWater(Table):
    """The water surface after the adjustment; sigmas are NaN for what was known, and for what is not determined.

    In IIA all of it is known. A level that is not determined has no correction either; its tide is the
    given one, or where the adjustment has left it.
    """

    tide: FloatArray = per_row()  # (n,) m, height of the water at each photo
    correction: FloatArray = per_row(rows="corrections")  # (c,) m, of tides, one for each group of photos
    correction_ids: TextArray = per_row(rows="corrections")  # (c,) names of the groups, or of the photos
    correction_sigma: FloatArray = per_row(rows="corrections")  # (c,) m
    tilt: FloatArray = per_row(rows="slopes")  # (2,) rad, slopes towards east and north
    tilt_sigma: FloatArray = per_row(rows="slopes")  # (2,) rad
    index: float
    index_sigma: float
    waves: AdjustedWaves | None = None  # None: there are none, or they were known
    undetermined: Mapping[str, bool] = field(default_factory=dict)  # name of an unknown -> whether images need it


@dataclass(frozen=True, kw_only=True)
class Departure:
    """How far a result of WATPT or LEGACY is from that of RIGOROUS."""

    sigmas: float  # of the coordinate, or angle, that is farthest, of a station or point
    farthest: str  # its name

    def __str__(self) -> str:
        return f"{self.sigmas:.2f} sigma from that of RIGOROUS: {self.farthest}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """The result of an adjustment, converged or not, with the block it belongs to."""

    block: Block
    converged: bool
    reason: str  # why not converged, which station still moves and by how much; empty when converged
    warnings: tuple[str, ...]  # ill-determined unknowns and the like
    iterations: tuple[Iteration, ...]
    passes: tuple[WaterPass, ...]  # of legacy and watpt
    sigma0: float  # a posteriori standard deviation of unit weight (a priori 1)
    degrees_of_freedom: int
    sum_of_squares: float  # weighted
    observations: dict[str, int]  # kind of observation -> number of scalar observations, in printing order
    unknowns: dict[str, int]  # kind of unknown -> number of scalar unknowns (ground coordinates included)
    stations: AdjustedStations
    points: GroundPoints
    plates: PlateResiduals
    bathymetric: BathymetricPoints
    levels: FloatArray  # (g,) m, adjusted levels of the equal elevation groups
    level_sigmas: FloatArray  # (g,) m
    measured: Mapping[
        ObservationKind, FloatArray
    ]  # (r,) adjusted lengths, ... of a table; NaN: an end has no place
    water: AdjustedWater | None = None  # None: a job without water
    pairs: StationPairs | None = None  # None: the solution was not built by an adjustment
    level_pairs: LevelPairs | None = None  # None: no photo has a water level of its own as an unknown
    water_precision: WaterPrecision | None = None  # None: nothing of the water is uncertain
    considered: ConsideredWater | None = None  # None: nothing of the water has a sigma without being unknown
    observed: Observations | None = None  # None: the solution was not built by an adjustment
    dependence: Dependence | None = None  # likewise
    departure: Departure | None = None  # None: its rays are refracted, or there are none, or it has not converged
    held: HeldParameters | None = None  # None: not converged, or likewise
    findings: tuple[Finding, ...] = ()  # of the search for blunders, where one was asked for
    causes: tuple[Cause, ...] = ()  # that explain what does not fit, ranked; of a search that was asked for or not
    unedited: str = ""  # why EDIT has edited nothing; empty where it has, or was not asked to
    edited: Block | None = None  # the block without what was found; None: no search
    other_flags: OtherFlags | None = None  # None: no height contradicts its flag
    reduced: Reduced | None = None  # what the reduction of its plates did; None: they came refined
    cards: FloatArray | None = None  # (n, 3) positions of the station cards; computed starts differ
    plate_factor: float = 1.0  # by which a guessed plate sigma was multiplied: the block has the product
    start: str = ""  # of two starts of IIIA, from which one it came, and how the other one ended; empty of one
    kernels: str = "numpy"  # that did the work point after point

    def __post_init__(self) -> None:
        groups = len(self.block.equal_elevations.ids)
        freeze(self, "levels", float, groups)
        freeze(self, "level_sigmas", float, groups)
        for kind, values in self.measured.items():
            if len(values) != kind.size(self.block):
                raise ValueError(f"{len(values)} adjusted {kind.noun}, not {kind.size(self.block)}")

    def __repr__(self) -> str:
        """Return how the adjustment ended, its main numbers and the block."""
        end = "converged" if self.converged else f"not converged: {self.reason[:_REASON]}"
        numbers = f"sigma0={self.sigma0:.4f}, degrees_of_freedom={self.degrees_of_freedom}"
        steps = f"iterations={len(self.iterations)}, passes={len(self.passes)}"
        return f"Solution({end}, {numbers}, {steps}, block={self.block!r})"

    def _repr_html_(self) -> str:
        """Return what a notebook shows of it."""
        return musatpy.to_html(self)

    def to_pandas(self) -> dict[str, Any]:
        """Return the tables of its record: see `musatpy.to_pandas`."""
        return musatpy.to_pandas(self)

    def to_xarray(self) -> Any:
        """Return its record as one dataset: see `musatpy.to_xarray`."""
        return musatpy.to_xarray(self)

    @property
    def unit_sigma(self) -> float:
        """Sigma0 without what errors of considered water explain: it is tested, and scales the covariances."""
        if self.considered is None or self.degrees_of_freedom <= 0:
            return self.sigma0
        return math.sqrt(max(self.sum_of_squares - self.considered.explained, 0.0) / self.degrees_of_freedom)
