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

from musatpy import model
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry.collinearity import attitude_apart, wrapped
from musatpy.model.solution import WAVE_VALUES
from musatpy.model.tables import largest
from musatpy.model.water import WAVE_SIGMAS
from musatpy.statistics.gates import elevations, rectangular
from musatpy.statistics.quality import Quality
from musatpy.statistics.verdict import verdict_of

if TYPE_CHECKING:
    from musatpy.systems import StatedSolution, Statement

LARGE_RESIDUAL = 3.0  # sigmas
PLATE_KINDS = ("triangulated", "not triangulated", "all")
NOT_GIVEN = -1
_NAMED = 8  # photos: of more, the first ones are named


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
    """The differences of three components, and the statistics of each; NaN of what is not part of its sample."""

    components: tuple[str, ...]
    units: tuple[str, ...]  # "rad" or "m"
    differences: FloatArray  # (n, 3)
    statistics: tuple[DifferenceStatistics, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateStatistics:
    """RMS plate residuals of n photos and of the job, by kind of point: triangulated, not triangulated, all."""

    count: IntArray  # (n, 3) points
    rms: FloatArray  # (n, 3, 2) mm, x and y; NaN where there is no point of the kind
    largest: tuple[int, ...]  # photo of the largest sqrt(x^2 + y^2) of each kind, -1 where there is none
    total_count: IntArray  # (3,)
    total_rms: FloatArray  # (3, 2) mm


@dataclass(frozen=True, kw_only=True, eq=False)
class Ellipses:
    """Standard error ellipses (n,): semi-axes in m, and the bearing of the longer one, rad from north to east."""

    major: FloatArray
    minor: FloatArray
    bearing: FloatArray
    vertical: FloatArray  # sigma of the height


@dataclass(frozen=True, kw_only=True, eq=False)
class Words:
    """A statement, with what a SYS card says of it."""

    spec: model.SystemSpec
    statement: Statement
    has_plane: bool  # error ellipses are in the plane of the first two coordinates, not across the vertical


@dataclass(frozen=True, eq=False)
class Statistics(Quality):
    """Every statistic of one solution, each computed when it is first asked for."""

    @property
    def read(self) -> model.Block:
        """The block with its plates as they were read, where they have been reduced."""
        reduced = self.solution.reduced
        return self.block if reduced is None else reduced.given

    @cached_property
    def station_positions(self) -> Analysis:
        """Camera Station Position Analysis: adjusted minus initial."""
        photos = self.block.photos
        difference = self.solution.stations.position - photos.position
        if self.block.options.system is model.CoordinateSystem.GEOGRAPHIC:
            difference[:, 1] = wrapped(difference[:, 1])
        return analysis_of(position_components(self.block), photos.ids, difference)

    @cached_property
    def station_attitudes(self) -> Analysis:
        """Camera Station Attitude Analysis: adjusted minus given, between -180 and +180 degrees."""
        photos = self.block.photos
        difference = attitude_apart(self.solution.stations.attitude, photos.attitude)
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
        if block.options.system is model.CoordinateSystem.GEOGRAPHIC:
            components = position_components(block)
            difference = self.solution.points.position[block.control.point] - block.control.position
            difference[:, 1] = wrapped(difference[:, 1])
        else:
            components = metric_components(block)
            difference = self.control_difference
        return analysis_of(components, ids, np.where(block.control.known, difference, np.nan))

    @cached_property
    def check_points(self) -> Analysis:
        """Adjusted minus given of check points, metres along east, north, up (X, Y, Z in local jobs)."""
        block = self.block
        check = block.control.kind == model.ControlKind.CHECK
        ids = block.points.ids[block.control.point[check]]
        return analysis_of(metric_components(block), ids, self.control_difference[check])

    @cached_property
    def verdict(self) -> model.Verdict:
        """What the solution is worth."""
        return verdict_of(self)

    @cached_property
    def plates(self) -> PlateStatistics:
        """Plate Residuals: the RMS of each photo and of the job, by kind of point."""
        photo, residual = self.block.plates.photo, self.solution.plates.residual
        determined, triangulated = ~np.isnan(residual).any(axis=1), self.solution.plates.triangulated
        kinds = (determined & triangulated, determined & ~triangulated, determined)
        n = len(self.block.photos.ids)
        count, sums = np.zeros((n, 3), dtype=np.int64), np.zeros((n, 3, 2))
        for column, kind in enumerate(kinds):
            np.add.at(count[:, column], photo[kind], 1)
            np.add.at(sums[:, column], photo[kind], residual[kind] ** 2)
        rms = _root_mean(sums, count)
        total_count = count.sum(axis=0, dtype=np.int64)
        return PlateStatistics(
            count=count,
            rms=rms,
            largest=tuple(_largest(rms[:, kind]) for kind in range(3)),
            total_count=total_count,
            total_rms=_root_mean(sums.sum(axis=0), total_count),
        )

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
    def given_words(self) -> Words | None:
        """The words in which the deck states coordinates and attitudes; None: those of the block."""
        return words_of(self.block.given_in, self.block)

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

    @property
    def _in_plane(self) -> StatedSolution | None:
        """The answer, where error ellipses are in the plane of its system."""
        return self.answer if self.answer_words is not None and self.answer_words.has_plane else None

    @cached_property
    def point_ellipses(self) -> Ellipses:
        """Error ellipses of the ground points, in the plane of `Words.has_plane` or across the vertical."""
        return ellipses(self._in_plane.point_covariance if self._in_plane else self.solution.points.covariance)

    @cached_property
    def station_ellipses(self) -> Ellipses:
        """Error ellipses of the exposure stations, likewise."""
        covariance = self._in_plane.covariance if self._in_plane else self.solution.stations.covariance
        return ellipses(covariance[:, :3, :3])

    @cached_property
    def sounding_kinds(self) -> IntArray:
        """(s,) `ControlKind` of the submerged points whose height is given, `NOT_GIVEN` of the others."""
        given, kind = self._given_heights
        return np.where(np.isnan(given), NOT_GIVEN, kind)

    @cached_property
    def sounding_residuals(self) -> FloatArray:
        """(s,) m, adjusted minus given depth of the submerged points, NaN where no height is given."""
        adjusted = self.solution.points.position[self.solution.bathymetric.point]
        return self._given_heights[0] - elevations(self.block, adjusted)

    @cached_property
    def _given_heights(self) -> tuple[FloatArray, IntArray]:
        """Given heights (s,) m of the submerged points, NaN of those without, and their kinds of control (s,)."""
        control, p = self.block.control, len(self.block.points.ids)
        given, kind = np.full(p, np.nan), np.full(p, NOT_GIVEN)
        rows = control.kind != model.ControlKind.HORIZONTAL
        given[control.point[rows]] = elevations(self.block, control.position[rows])
        kind[control.point[rows]] = control.kind[rows]
        return given[self.solution.bathymetric.point], kind[self.solution.bathymetric.point]

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


def analysis_of(components: dict[str, str], ids: TextArray, differences: FloatArray) -> Analysis:
    """Return the analysis of differences (n, 3) of three components, given by name and unit."""
    return Analysis(
        components=tuple(components),
        units=tuple(components.values()),
        differences=differences,
        statistics=tuple(difference_statistics(column, ids) for column in differences.T),
    )


def position_components(block: model.Block) -> dict[str, str]:
    """Return component -> unit of positions in the job's system."""
    if block.options.system is model.CoordinateSystem.GEOGRAPHIC:
        return {"Latitude": "rad", "Longitude": "rad", "Elevation": "m"}
    return {"X": "m", "Y": "m", "Z": "m"}


def axes_of(system: str) -> tuple[str, str, str]:
    """Return the components of differences and sigmas in metres along the vertical and across it."""
    return ("X", "Y", "Z") if system == model.CoordinateSystem.LOCAL else ("East", "North", "Up")


def metric_components(block: model.Block) -> dict[str, str]:
    """Return component -> unit of these."""
    return dict.fromkeys(axes_of(block.options.system), "m")


def _root_mean(sums: FloatArray, count: IntArray) -> FloatArray:
    """Return sqrt(sums / count) (..., 2), NaN where the count (...) is zero."""
    known = np.where(count > 0, count, np.nan)[..., None]
    return np.sqrt(sums / known)


def _largest(rms: FloatArray) -> int:
    """Return the row of the largest sqrt(x^2 + y^2) of `rms` (n, 2), the first of equals, -1 where all are NaN."""
    size = np.hypot(rms[:, 0], rms[:, 1])
    return largest(size) if (~np.isnan(size)).any() else -1


def words_of(spec: model.SystemSpec | None, block: model.Block) -> Words | None:
    """Return the words of a statement of a block, None of none. Raises `SystemsError` where it is no statement."""
    if spec is None:
        return None
    from musatpy.systems import statement_of

    statement = statement_of(spec, block)
    return Words(spec=spec, statement=statement, has_plane=spec.sigmas == "SYST" and statement.system.plane)


def ellipses(covariance: FloatArray) -> Ellipses:
    """Return the standard error ellipses of covariances (n, 3, 3) along east, north, up."""
    covariance = np.where(np.isfinite(covariance), covariance, np.nan)
    ee, nn, en = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    mean, half = 0.5 * (ee + nn), np.hypot(0.5 * (nn - ee), en)
    bearing = 0.5 * np.arctan2(2.0 * en, nn - ee)
    return Ellipses(
        major=np.sqrt(mean + half),
        minor=np.sqrt(np.maximum(mean - half, 0.0)),
        bearing=np.where(bearing < 0.0, bearing + np.pi, bearing),
        vertical=np.sqrt(covariance[:, 2, 2]),
    )


def exact_water(block: model.Block) -> tuple[str, ...]:
    """Return, in words, what of the water is neither adjusted nor has a sigma; nothing without submerged points.

    A run without refraction knows of the water its level only.
    """
    options, water = block.options, block.water
    if water is None or not block.points.bathymetric.any():
        return ()
    tides = _exact_tides(block)
    exact = []
    if tides.any():
        every = not (block.photos.tide_sigma > 0.0).any() and options.water_level is model.WaterLevel.KNOWN
        exact.append("all tides" if every else f"the tides of photos {_named(block.photos.ids[tides].tolist())}")
    if options.program is model.Program.IIA and options.refraction is model.Refraction.NONE:
        return tuple(exact)
    if options.water_index is not model.Treatment.ADJUST and not water.sigma:
        exact.append("the refractive index")
    if options.water_tilt is not model.Treatment.ADJUST and not water.tilt_sigma:
        exact.append("the tilt of the surface")
    waves = block.waves
    for row, name in enumerate(waves.ids.tolist()):
        known = [
            parameter
            for parameter, sigma in zip(WAVE_VALUES, WAVE_SIGMAS, strict=True)
            if not getattr(waves, sigma)[row] > 0.0
        ]
        if known:
            exact.append(f"wave {name} ({', '.join(known)})")
    return tuple(exact)


def _exact_tides(block: model.Block) -> BoolArray:
    """Return (n,) the photos that show submerged points and whose tide has neither a sigma nor a correction."""
    photos, level = block.photos, block.options.water_level
    shown = np.zeros(len(photos.ids), dtype=bool)
    shown[block.plates.photo[block.points.bathymetric[block.plates.point]]] = True
    adjusted = np.zeros(len(photos.ids), dtype=bool)
    if block.options.program is model.Program.IIIA and level is not model.WaterLevel.KNOWN:
        labels = {model.WaterLevel.GROUP: photos.tide_group, model.WaterLevel.DAY: photos.tide_day}.get(level)
        adjusted = np.ones_like(adjusted) if labels is None else labels != ""
    return shown & np.isfinite(photos.tide) & ~adjusted & ~(photos.tide_sigma > 0.0)


def _named(ids: list[str]) -> str:
    more = len(ids) - _NAMED
    return ", ".join(ids[:_NAMED]) + (f" and {more} others" if more > 0 else "")
