"""Solution -> numbers: the statistics that the standard analyses print (ETL-0306, Tables 6-1 to 6-9).

Nothing is adjusted and nothing is printed here. The definitions are those that the tables of the report follow
(docs/reports.md): mean = sum/N, signed; RMS = sqrt(sum d^2/N); standard deviation from the mean = sqrt(sum (d -
mean)^2/(N - 1)); maximum difference = the signed difference of the largest magnitude.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.rotations import wrapped
from musatpy.model import Block, ControlKind, CoordinateSystem, ObservationKind, Solution, Verdict
from musatpy.model.ranking import falling, largest
from musatpy.statistics.flags import FlagTests, flag_tests
from musatpy.statistics.quality import TEST_DECIMALS, CheckTest, Ellipses, Quality, check_test, ellipses
from musatpy.statistics.undetected import CommonErrors, HiddenErrors, common_errors, hidden_errors
from musatpy.statistics.words import Words, words_of

if TYPE_CHECKING:
    from musatpy.systems import Stated, StatedSolution

LARGE_RESIDUAL = 3.0  # sigmas
PRINTED_TEST = 0.005  # test values below print as zero: which one is the largest, is then rounding error
PLATE_KINDS = ("triangulated", "not triangulated", "all")


@dataclass(frozen=True, kw_only=True, eq=False)
class DifferenceStatistics:
    """One sample of differences in numbers, in the unit of the sample; NaN where the sample is too small."""

    size: int
    sum: float
    mean: float
    rms: float
    deviation: float  # standard deviation from the mean, N - 1 in the denominator
    maximum: float  # signed
    maximum_id: str  # whose difference the maximum is; empty for an empty sample


@dataclass(frozen=True, kw_only=True, eq=False)
class Analysis:
    """The differences of three components, and the statistics of each.

    Rows are those of `ids`; a component that is not part of its sample is NaN.
    """

    components: tuple[str, str, str]
    units: tuple[str, str, str]  # "rad" or "m"
    ids: TextArray  # (n,)
    differences: FloatArray  # (n, 3)
    statistics: tuple[DifferenceStatistics, DifferenceStatistics, DifferenceStatistics]


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlDifferences:
    """Adjusted minus given of every control card, metres along east, north, up (X, Y, Z in local jobs)."""

    difference: FloatArray  # (k, 3) NaN where a component is not given, or the point not determined
    used: BoolArray  # (k, 3) the component was an observation, or fixed
    adjusted_sigma: FloatArray  # (k, 3) m, of the adjusted position


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateStatistics:
    """RMS plate residuals of n photos and of the job, by kind of point: triangulated, not triangulated, all."""

    count: IntArray  # (n, 3) points
    rms: FloatArray  # (n, 3, 2) mm, x and y; NaN where there is no point of the kind
    largest: tuple[int, int, int]  # photo of the largest sqrt(x^2 + y^2) of each kind, -1 where there is none
    total_count: IntArray  # (3,)
    total_rms: FloatArray  # (3, 2) mm


@dataclass(frozen=True, eq=False)
class Statistics:
    """Every statistic of one solution, each computed when it is first asked for."""

    solution: Solution

    @property
    def block(self) -> Block:
        """The block that was adjusted."""
        return self.solution.block

    @property
    def read(self) -> Block:
        """The block with its plates as they were read, where they have been reduced."""
        reduced = self.solution.reduced
        return self.block if reduced is None else reduced.given

    @cached_property
    def station_positions(self) -> Analysis:
        """Camera Station Position Analysis: adjusted minus initial."""
        photos = self.block.photos
        difference = self.solution.stations.position - photos.position
        if _system(self.block) is CoordinateSystem.GEOGRAPHIC:
            difference[:, 1] = wrapped(difference[:, 1])
        return analysis_of(position_components(self.block), photos.ids, difference)

    @cached_property
    def station_attitudes(self) -> Analysis:
        """Camera Station Attitude Analysis: adjusted minus given, between -180 and +180 degrees."""
        photos = self.block.photos
        difference = wrapped(self.solution.stations.attitude - photos.attitude)
        components = {"X-Tilt": "rad", "Y-Tilt": "rad", "Heading": "rad"}
        return analysis_of(components, photos.ids, difference)

    @cached_property
    def ground_points(self) -> Analysis:
        """Ground Point Analysis: adjusted minus given of control points, in the components that were known.

        Full and horizontal points make the horizontal sample, full and vertical points the vertical one. In a
        geocentric job the components are east, north and up (metres), for those are what a card can leave out.
        """
        block = self.block
        ids = block.points.ids[block.control.point]
        if _system(block) is CoordinateSystem.GEOGRAPHIC:
            components = position_components(block)
            difference = self.solution.points.position[block.control.point] - block.control.position
            difference[:, 1] = wrapped(difference[:, 1])
        else:
            components = metric_components(block)
            difference = self.control.difference
        return analysis_of(components, ids, np.where(block.control.known, difference, np.nan))

    @cached_property
    def check_points(self) -> Analysis:
        """Adjusted minus given of check points, metres along east, north, up (X, Y, Z in local jobs)."""
        block = self.block
        check = block.control.kind == ControlKind.CHECK
        ids = block.points.ids[block.control.point[check]]
        return analysis_of(metric_components(block), ids, self.control.difference[check])

    @cached_property
    def control(self) -> ControlDifferences:
        """Adjusted minus given of every control card in metres, with the sigma of the adjusted position."""
        block = self.block
        rows = block.control.point
        return ControlDifferences(
            difference=metric_differences(block, block.control.position, self.solution.points.position[rows]),
            used=block.control.known,
            adjusted_sigma=self.point_sigmas[rows],
        )

    @cached_property
    def quality(self) -> Quality:
        """The tests of the solution."""
        return Quality(self.solution)

    @cached_property
    def normal_tests(self) -> FloatArray:
        """(o,) test values of the observations as normal variables, NaN where nothing checks one."""
        from musatpy.statistics.verdict import normal_tests  # it reads these statistics

        return normal_tests(self)

    @cached_property
    def worst_observations(self) -> IntArray:
        """Rows of the observations by falling `normal_tests`; those without one, or with zero, left out."""
        size = np.nan_to_num(np.abs(self.normal_tests), posinf=np.inf)
        return falling(size, TEST_DECIMALS)[: np.count_nonzero(size > PRINTED_TEST)]

    @cached_property
    def control_tests(self) -> FloatArray:
        """(k, 3) `normal_tests` of the components of every control card, NaN where there is none."""
        tests = np.full((len(self.block.control.point), 3), np.nan)
        if self.solution.observed is not None:
            observed = self.quality.observed
            control = observed.kind == ObservationKind.CONTROL
            tests[observed.row[control], observed.component[control]] = self.normal_tests[control]
        return tests

    @cached_property
    def control_residuals(self) -> Analysis:
        """Adjusted minus given of the control that took part, in metres; control without error left out."""
        control = self.block.control
        ids = self.block.points.ids[control.point]
        used = self.control.used & ~control.fixed[:, None]
        return analysis_of(metric_components(self.block), ids, np.where(used, self.control.difference, np.nan))

    @cached_property
    def hidden(self) -> HiddenErrors:
        """How far errors that no test finds may move the points."""
        return hidden_errors(self)

    @cached_property
    def common_errors(self) -> CommonErrors | None:
        """The tests of the parameters that are held; None where the solution says nothing of them."""
        return common_errors(self)

    @cached_property
    def verdict(self) -> Verdict:
        """What the solution is worth."""
        from musatpy.statistics.verdict import verdict_of  # it reads these statistics

        return verdict_of(self)

    @property
    def check_sigma0(self) -> float:
        """Sigma0 as it scales the covariance of check points: not below 1, unless the plate sigma is a guess.

        Plate sigmas that are too large say nothing of the errors of the control.
        """
        from musatpy.statistics.verdict import tests_sigma0  # it reads these statistics

        unit_sigma = self.solution.unit_sigma
        return max(unit_sigma, 1.0) if tests_sigma0(self) else unit_sigma

    @cached_property
    def check_test(self) -> CheckTest:
        """The check points against their own covariance by `check_sigma0`, that of their cards included."""
        block, unit_sigma = self.block, self.solution.unit_sigma
        rows = np.flatnonzero(block.control.kind == ControlKind.CHECK)
        given = np.where(np.isnan(block.control.sigma[rows]), 0.0, block.control.sigma[rows])
        scale = (self.check_sigma0 / unit_sigma) ** 2 if unit_sigma > 0.0 else 1.0
        covariance = self.solution.points.covariance[block.control.point[rows]] * scale
        covariance = covariance + np.square(given)[:, :, None] * np.eye(3)
        return check_test(rows, self.control.difference[rows], covariance)

    @cached_property
    def plates(self) -> PlateStatistics:
        """Plate Residuals: the RMS of each photo and of the job, by kind of point."""
        return _plate_statistics(self.solution)

    @cached_property
    def plate_sigmas(self) -> FloatArray:
        """(m, 2) mm, a priori: of the card, or the job's where the card gives none, times the submerged factor."""
        return self.block.plate_sigmas

    @cached_property
    def large_residuals(self) -> BoolArray:
        """(m,) True where a plate residual in x or y is larger than `LARGE_RESIDUAL` of its a priori sigmas."""
        residual = np.abs(self.solution.plates.residual)
        return np.asarray((residual > LARGE_RESIDUAL * self.plate_sigmas).any(axis=1))

    @cached_property
    def submerged_plates(self) -> BoolArray:
        """(m,) True where a plate measurement is of a submerged point."""
        return self.block.points.bathymetric[self.block.plates.point]

    @cached_property
    def flags(self) -> FlagTests:
        """The flags of the points against their heights."""
        return flag_tests(self)

    @cached_property
    def plate_order(self) -> IntArray:
        """(m,) rows of the plate measurements, photo by photo, in the order of the deck within each."""
        return np.argsort(self.block.plates.photo, kind="stable")

    @cached_property
    def level_differences(self) -> FloatArray:
        """(e,) m, elevation of each equal elevation point minus the adjusted level of its group."""
        groups = self.block.equal_elevations
        positions = self.solution.points.position[groups.point]
        return elevations(self.block, positions) - self.solution.levels[groups.group]

    @cached_property
    def station_sigmas(self) -> FloatArray:
        """(n, 6) a posteriori: east, north, up (m), omega, phi, kappa (rad)."""
        return _sigmas(self.solution.stations.covariance)

    @cached_property
    def point_sigmas(self) -> FloatArray:
        """(p, 3) m, a posteriori, along east, north, up (X, Y, Z in local jobs)."""
        return _sigmas(self.solution.points.covariance)

    @cached_property
    def given_words(self) -> Words | None:
        """The words in which the deck states coordinates and attitudes; None: those of the block."""
        return words_of(self.block.given_in, self.block)

    @cached_property
    def given(self) -> Stated | None:
        """The block in these words. Raises `SystemsError` where it cannot be stated so."""
        if self.given_words is None:
            return None
        from musatpy.systems import stated

        return stated(self.block, self.given_words.statement)

    @cached_property
    def answer_words(self) -> Words | None:
        """The words in which the answer is to be stated; None: those of the block."""
        return words_of(self.block.answer_in, self.block)

    @cached_property
    def answer(self) -> StatedSolution | None:
        """The solution in these words."""
        if self.answer_words is None:
            return None
        from musatpy.systems import stated_solution

        return stated_solution(self.solution, self.answer_words.statement)

    @cached_property
    def answer_station_sigmas(self) -> FloatArray:
        """(n, 6) a posteriori, of what the sigmas of the answer are of: see `Words.of_system`."""
        if self.answer is None or self.answer_words is None or not self.answer_words.of_system:
            return self.station_sigmas
        return _sigmas(self.answer.covariance)

    @cached_property
    def answer_point_sigmas(self) -> FloatArray:
        """(p, 3) a posteriori, likewise."""
        if self.answer is None or self.answer_words is None or not self.answer_words.of_system:
            return self.point_sigmas
        return _sigmas(self.answer.point_covariance)

    @cached_property
    def point_ellipses(self) -> Ellipses:
        """Error ellipses of the ground points, in the plane of `Words.has_plane` or across the vertical."""
        if self.answer is None or self.answer_words is None or not self.answer_words.has_plane:
            return self.quality.points
        return ellipses(self.answer.point_covariance)

    @cached_property
    def station_ellipses(self) -> Ellipses:
        """Error ellipses of the exposure stations, likewise."""
        if self.answer is None or self.answer_words is None or not self.answer_words.has_plane:
            return self.quality.stations
        return ellipses(self.answer.covariance[:, :3, :3])

    @cached_property
    def bathymetric_xyz(self) -> FloatArray:
        """(s, 3, 3) m: X, Y, Z of the submerged points without refraction, as predicted, and as adjusted.

        Geocentric in geographic and geocentric jobs (Table 6-9), in the job's own frame in local ones.
        """
        solution, rows = self.solution, self.solution.bathymetric.point
        positions = (
            solution.bathymetric.apparent,
            solution.bathymetric.predicted,
            solution.points.position[rows],
        )
        return np.stack([rectangular(solution.block, position) for position in positions], axis=1)


def difference_statistics(differences: ArrayLike, ids: ArrayLike) -> DifferenceStatistics:
    """Return the statistics of `differences` (n,), whose rows are named `ids` (n,); NaN rows are left out."""
    sample, names = np.asarray(differences, dtype=float), np.asarray(ids, dtype=str)
    kept = ~np.isnan(sample)
    d, names = sample[kept], names[kept]
    N = len(d)
    if N == 0:
        nan = math.nan
        return DifferenceStatistics(size=0, sum=0.0, mean=nan, rms=nan, deviation=nan, maximum=nan, maximum_id="")
    total = math.fsum(d)
    mean = total / N
    worst = largest(np.abs(d))
    return DifferenceStatistics(
        size=N,
        sum=total,
        mean=mean,
        rms=math.sqrt(math.fsum(d**2) / N),
        deviation=math.sqrt(math.fsum((d - mean) ** 2) / (N - 1)) if N > 1 else math.nan,
        maximum=float(d[worst]),
        maximum_id=str(names[worst]),
    )


def position_components(block: Block) -> dict[str, str]:
    """Return component -> unit of positions in the job's system."""
    if _system(block) is CoordinateSystem.GEOGRAPHIC:
        return {"Latitude": "rad", "Longitude": "rad", "Elevation": "m"}
    return {"X": "m", "Y": "m", "Z": "m"}


def metric_components(block: Block) -> dict[str, str]:
    """Return component -> unit of differences and sigmas in metres along the vertical and across it."""
    if _system(block) is CoordinateSystem.LOCAL:
        return {"X": "m", "Y": "m", "Z": "m"}
    return {"East": "m", "North": "m", "Up": "m"}


def rectangular(block: Block, positions: FloatArray) -> FloatArray:
    """Return X, Y, Z (n, 3) m of positions (n, 3) in the job's system; rows with a NaN come back all NaN."""
    if _system(block) is not CoordinateSystem.GEOGRAPHIC:
        return positions
    known = ~np.isnan(positions).any(axis=1)
    xyz = np.full(positions.shape, np.nan)
    if known.any():
        xyz[known] = _ellipsoid(block).geocentric(positions[known])
    return xyz


def elevations(block: Block, positions: FloatArray) -> FloatArray:
    """Return the heights (n,) m of positions (n, 3) in the job's system; NaN where a position has a NaN."""
    if _system(block) is not CoordinateSystem.GEOCENTRIC:
        return positions[:, 2]
    known = ~np.isnan(positions).any(axis=1)
    heights = np.full(len(positions), np.nan)
    if known.any():
        heights[known] = _ellipsoid(block).geographic(positions[known])[:, 2]
    return heights


def metric_differences(block: Block, given: FloatArray, adjusted: FloatArray) -> FloatArray:
    """Return adjusted minus given (n, 3), metres along the east, north, up of the given points.

    Both are positions (n, 3) in the job's system. A component that is not given (NaN) is NaN in the result, and
    takes no part in that of the others; in local jobs the axes are those of the frame.
    """
    if _system(block) is CoordinateSystem.LOCAL:
        return adjusted - given
    geographic = _system(block) is CoordinateSystem.GEOGRAPHIC
    return _ellipsoid(block).metric_differences(given, adjusted, geographic)


def _system(block: Block) -> CoordinateSystem:
    return block.options.system


def _ellipsoid(block: Block) -> Ellipsoid:
    spec = block.ellipsoid
    if spec is None:
        raise ValueError("a geographic or geocentric block without an ellipsoid")
    return Ellipsoid.of(spec)


def _sigmas(covariance: FloatArray) -> FloatArray:
    """Return the roots of the diagonals (..., n) of covariances (..., n, n); rounding below zero counts as zero."""
    return np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0))


def analysis_of(components: dict[str, str], ids: TextArray, differences: FloatArray) -> Analysis:
    """Return the analysis of differences (n, 3) of three components, given by name and unit."""
    first, second, third = components
    x, y, z = (difference_statistics(column, ids) for column in differences.T)
    return Analysis(
        components=(first, second, third),
        units=(components[first], components[second], components[third]),
        ids=ids,
        differences=differences,
        statistics=(x, y, z),
    )


def _plate_statistics(solution: Solution) -> PlateStatistics:
    photo, n = solution.block.plates.photo, len(solution.block.photos.ids)
    residual = solution.plates.residual
    determined = ~np.isnan(residual).any(axis=1)
    triangulated = solution.plates.triangulated
    kinds = (determined & triangulated, determined & ~triangulated, determined)
    count, sums = np.zeros((n, 3), dtype=np.int64), np.zeros((n, 3, 2))
    for column, kind in enumerate(kinds):
        np.add.at(count[:, column], photo[kind], 1)
        np.add.at(sums[:, column], photo[kind], residual[kind] ** 2)
    rms = _root_mean(sums, count)
    total_count = count.sum(axis=0, dtype=np.int64)
    first, second, third = (_largest(rms[:, kind]) for kind in range(3))
    return PlateStatistics(
        count=count,
        rms=rms,
        largest=(first, second, third),
        total_count=total_count,
        total_rms=_root_mean(sums.sum(axis=0), total_count),
    )


def _root_mean(sums: FloatArray, count: IntArray) -> FloatArray:
    """Return sqrt(sums / count) (..., 2), NaN where the count (...) is zero."""
    known = np.where(count > 0, count, np.nan)[..., None]
    return np.sqrt(sums / known)


def _largest(rms: FloatArray) -> int:
    """Return the row of the largest sqrt(x^2 + y^2) of `rms` (n, 2), the first of equals, -1 where all are NaN."""
    size = np.hypot(rms[:, 0], rms[:, 1])
    return largest(size) if (~np.isnan(size)).any() else -1
