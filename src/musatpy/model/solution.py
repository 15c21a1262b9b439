"""What an adjustment found: the only thing that statistics and reports read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

import musatpy
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.block import Block
from musatpy.model.findings import Cause, Finding
from musatpy.model.kinds import ObservationKind
from musatpy.model.parameters import AdjustedParameters, DistortionGrid
from musatpy.model.tables import Table, freeze, per_row
from musatpy.units import DEGREE

if TYPE_CHECKING:
    from musatpy.model.reduction import Reduced  # of raw plates only

_REASON = 200  # characters of a reason that are shown
WAVE_VALUES = ("height", "length", "azimuth", "crest")
CORRELATED = 0.95  # as where correlations are listed: so much of a parameter is another's
_SEEN = 5.0  # sigmas of a height that is no noise: of many waves, one always fits it by three or four
OPEN = 0.5  # of a length: a guess that leaves crests more open than that may lead to wrong ones
_SURE = 0.5  # of the sigma before: a parameter whose sigma is at most that much of it is determined


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
    """Joint covariances of g quantities of water, adjusted and considered ones, and of lenses, in m, mm, rad.

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

    @property
    def sigmas_of_depths(self) -> FloatArray:
        """(0,) or (2,) m, the median and the largest of those that are known."""
        sigma = self.depth_sigma[np.isfinite(self.depth_sigma)]
        return np.array([np.median(sigma), sigma.max()] if sigma.size else [])


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


def _in_words(wave: FloatArray) -> str:
    """Return height, length, azimuth and crest (4,) as a deck states them."""
    height, length, azimuth, crest = wave.tolist()
    return (
        f"height {height:.2f} m, length {length:.2f} m, towards {azimuth / DEGREE:.2f} degrees, crest {crest:.2f} m"
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class AdjustedWaves(Table):
    """k waves after the adjustment, (k, 4): height (m), length (m), azimuth (rad), crest (m), as on their cards.

    Heights are from trough to crest, azimuths clockwise from true north (+Y of local jobs), crests distances from
    the origin of the waves at time 0. Sigmas and variance inflation are NaN for what was known.
    """

    ids: TextArray = per_row()  # (k,)
    value: FloatArray = per_row(4)
    prior: FloatArray = per_row(4)  # what was given
    prior_sigma: FloatArray = per_row(4)
    sigma: FloatArray = per_row(4)  # a posteriori
    kept: FloatArray = per_row(4)  # a priori sigma over that of the prior: 1 where nothing was learnt
    inflation: FloatArray = per_row(4)  # variance inflation factors
    speed: FloatArray = per_row()  # (k,) m/s of the crests
    open: FloatArray = per_row()  # (k,) of a length: sigma, as given, of crests at the typical distance of points
    rival: FloatArray = per_row(4)  # of other crests that fit nearly as well, NaN where none were met
    excess: FloatArray = per_row()  # (k,) by which the sum of squares is higher with these
    searched: BoolArray = per_row()  # (k,) the search went over all that the sigmas allow
    first: TextArray = per_row(rows="pairs")  # (c,) names of unknown parameters,
    second: TextArray = per_row(rows="pairs")  # (c,) of these, of the other water, and of one station height each,
    correlation: FloatArray = per_row(rows="pairs")  # (c,) and how they are correlated

    @property
    def period(self) -> FloatArray:
        """(k,) s, length over speed; infinite for waves that stand still."""
        with np.errstate(divide="ignore"):
            return self.value[:, WAVE_VALUES.index("length")] / self.speed

    @property
    def unsure(self) -> BoolArray:
        """(k,) True where other crests fit nearly as well, or may lie where they were not looked for."""
        return np.isfinite(self.excess) | ((self.open > OPEN) & ~self.searched)

    @property
    def warnings(self) -> tuple[str, ...]:
        """A sentence for every wave of which too little was given, and every parameter that was not determined."""
        vague = tuple(
            f"what is given of wave {self.ids[wave]} leaves its crests open by {self.open[wave]:.1f} of a length "
            f"(1 sigma) at the typical distance of the points from the origin of the waves, too much to search: "
            f"the crests may be others; an origin, and a time 0, in the middle of the points leave less open"
            for wave in np.flatnonzero((self.open > OPEN) & ~self.searched).tolist()
        )
        rivals = tuple(
            f"other crests of wave {self.ids[wave]} fit nearly as well: {_in_words(self.rival[wave])} raise the "
            f"weighted sum of squares by {self.excess[wave]:.1f} only"
            for wave in np.flatnonzero(np.isfinite(self.excess)).tolist()
        )
        lost = tuple(
            f"the {WAVE_VALUES[parameter]} of wave {self.ids[wave]} is {self.verdicts[wave, parameter]}"
            for wave, parameter in np.argwhere(np.char.startswith(self.verdicts, "not")).tolist()
        )
        return vague + rivals + lost

    @cached_property
    def verdicts(self) -> TextArray:
        """(k, 4) whether each parameter was determined, and if not, why; empty for what was known."""
        tied = self.inflation >= 1.0 / (1.0 - CORRELATED**2)
        verdict = np.where(self.kept <= _SURE, "determined", "weakly determined")
        verdict = np.where(self.kept >= CORRELATED, "not determined: does not show", verdict)
        verdict = np.where((self.kept >= CORRELATED) & tied, "not determined: not apart from others", verdict)
        with np.errstate(invalid="ignore"):
            faint = np.abs(self.value[:, :1]) < _SEEN * self.sigma[:, :1]
        faint = faint & (np.arange(4) > 0) & (self.kept < CORRELATED)
        verdict = np.where(faint, "not determined: lost in the noise", verdict)
        return np.asarray(np.where(np.isnan(self.kept), "", verdict), dtype=np.str_)


@dataclass(frozen=True, kw_only=True, eq=False)
class Observations(Table):
    """The o scalar observations that took part in an adjustment, in the units of their kinds.

    `influence` is what an error of one unit does to the position that the observation belongs to, east, north, up
    in metres: that of its ground point, or of its exposure station; of the second end of a base, distance or height
    difference; NaN for the water.
    """

    kind: IntArray = per_row()  # (o,) ObservationKind
    row: IntArray = per_row()  # (o,) link to the table of the kind
    component: IntArray = per_row()  # (o,)
    residual: FloatArray = per_row()  # (o,) adjusted minus observed
    sigma: FloatArray = per_row()  # (o,) a priori
    redundancy: FloatArray = per_row()  # (o,) share of an error that shows in the residual
    influence: FloatArray = per_row(3)  # (o, 3)
    considered: FloatArray = per_row(blank=0.0)  # (o,) variance of the residual from considered water

    @property
    def share(self) -> FloatArray:
        """(o,) variance that the residual should have, over that of the observation: the redundancy number.

        Considered parameters add to it.
        """
        return self.redundancy + self.considered / np.square(self.sigma)

    @property
    def visibility(self) -> FloatArray:
        """(o,) sigmas of the residual by which an error of one sigma of the observation moves it."""
        share = np.maximum(self.share, 0.0)
        return np.divide(self.redundancy, np.sqrt(share), out=np.zeros_like(share), where=share > 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ConsideredWater(Table):
    """c parameters of the water that have a sigma and were not adjusted; their errors are in all sigmas."""

    names: TextArray = per_row()  # (c,)
    units: TextArray = per_row()  # (c,) in which a sigma is read: m, arc sec, deg, or none for the index
    sigma: FloatArray = per_row()  # (c,) m, rad, or none for the index
    explained: float  # of the weighted sum of squares: what errors of such sigmas explain best


@dataclass(frozen=True, kw_only=True, eq=False)
class Dependence(Table):
    """How the unknowns of the normal equations depend on one another.

    The variance inflation factor of an unknown is the diagonal element of the normal matrix, before any point is
    eliminated, times its cofactor: 1/(1 - R^2) of its column against all others. Correlations are those of 0.95 and
    more between unknowns of a photo, of photos that have a point in common, and of the globals with all others.
    """

    station_inflation: FloatArray = per_row(6)  # (n, 6) NaN where a parameter was held
    names: TextArray = per_row(rows="globals")  # (g,) the global unknowns: levels, water, kept points
    sigma: FloatArray = per_row(rows="globals")  # (g,) a posteriori, in m, rad, or none for the index
    inflation: FloatArray = per_row(rows="globals")  # (g,)
    first: TextArray = per_row(rows="pairs")  # (c,) names of correlated unknowns, the most correlated ones first
    second: TextArray = per_row(rows="pairs")  # (c,)
    correlation: FloatArray = per_row(rows="pairs")  # (c,)


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldParameters(Table):
    """The h parameters that an adjustment holds and that many observations have in common, each with what it does.

    An error e of one (given minus true) adds c e to the residuals, of which the adjustment leaves r e: c'Pc is the
    `whole` column, r'Pr its `redundant` part, v'Pr the `pull` of the residuals v. What moves most in its own sigmas
    goes by `shift` metres and `sigmas` for an error of one unit: of the stations, the points, the depths; -1, and
    NaN, where nothing has a sigma.
    """

    names: TextArray = per_row()  # (h,)
    units: TextArray = per_row()  # (h,) of the errors: mm, m, or none
    reference: FloatArray = per_row()  # (h,) error by which movements are stated
    limit: FloatArray = per_row()  # (h,) error beyond which nobody believes the parameter
    pull: FloatArray = per_row()
    redundant: FloatArray = per_row()
    whole: FloatArray = per_row()
    considered: FloatArray = per_row()  # (h,) variance of the pull from considered parameters
    moved: IntArray = per_row(3)  # (h, 3) links to photos, points, points
    shift: FloatArray = per_row(3)  # (h, 3) m
    sigmas: FloatArray = per_row(3)  # (h, 3)
    adjusted: int  # parameters of the kind that are unknowns
    known_with_sigma: int  # those that are considered


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
    parameters: AdjustedParameters | None = None  # None: none of lenses or the like was unknown
    grid: DistortionGrid | None = None  # None: no distortion was unknown
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
    misread: str = ""  # how inertial attitudes that do not fit would; empty: they fit, or there are none
    kernels: str = "numpy"  # that did the work point after point

    def __post_init__(self) -> None:
        groups = len(self.block.equal_elevations.ids)
        freeze(self, "levels", float, groups)
        freeze(self, "level_sigmas", float, groups)
        for kind, values in self.measured.items():
            count = getattr(self.block, kind.attribute).count
            if len(values) != count:
                raise ValueError(f"{len(values)} adjusted {kind.noun}, not {count}")

    def __repr__(self) -> str:
        """Return how the adjustment ended, its main numbers and the block."""
        end = "converged" if self.converged else f"not converged: {self.reason[:_REASON]}"
        numbers = f"sigma0={self.sigma0:.4f}, degrees_of_freedom={self.degrees_of_freedom}"
        steps = f"iterations={len(self.iterations)}, passes={len(self.passes)}"
        return f"Solution({end}, {numbers}, {steps}, block={self.block!r})"

    def _repr_html_(self) -> str:
        """Return what a notebook shows of it."""
        return musatpy.to_html(self)

    def to_pandas(self, table: str = "") -> Any:
        """Return the tables of its record, or one with plain names, as `points`: see `musatpy.to_pandas`."""
        return musatpy.to_pandas(self, table)

    def to_xarray(self) -> Any:
        """Return its record as one dataset: see `musatpy.to_xarray`."""
        return musatpy.to_xarray(self)

    @property
    def unit_sigma(self) -> float:
        """Sigma0 without what errors of considered water explain: it is tested, and scales the covariances."""
        if self.considered is None or self.degrees_of_freedom <= 0:
            return self.sigma0
        return math.sqrt(max(self.sum_of_squares - self.considered.explained, 0.0) / self.degrees_of_freedom)
