"""What came of the orientation of a strip: first values by triplets, adjusted by IIIA, with joins and a verdict."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtri

from musatpy import adjustment
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.errors import MusatError
from musatpy.geometry import similarity
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix, wrapped
from musatpy.model import Block, PlaneTreatment, Solution
from musatpy.model.findings import Concern, Reason
from musatpy.model.tables import taken
from musatpy.orientation.twomedia.oriented import PlaneVerdict
from musatpy.orientation.twomedia.rays import Orientation, paper_partials, paper_vector
from musatpy.orientation.twomedia.strip import Strip
from musatpy.orienting.placement import Placement, doubt, left_out, misfit
from musatpy.orienting.punched import punched
from musatpy.orienting.scene import Scene
from musatpy.statistics import Statistics
from musatpy.statistics.quality import sigmas_of
from musatpy.statistics.verdict import sigma0_doubt

_SIGNIFICANCE = 0.001  # of the test of a control point
_OF_PLANE = ("water level", "tilt of the water east", "tilt of the water north")  # as IIIA names its unknowns
_FEW = 0.25  # of the control points, up to which those that do not fit are wrong


@dataclass(frozen=True, kw_only=True, eq=False)
class StripAnswer(Placement):
    """The orientation of a strip of m photos, of N triplets and N - 1 joins, with c control points.

    `solution` is that of IIIA, which starts from the strip: stations, points and water are its own then, with its a
    posteriori sigmas, and `by_prior` says that it determines the plane of water only with its prior. Where there is
    none all are those of the chained triplets, without sigmas, and `unadjusted` says why. control_out (p,) are the
    control points that do not fit.
    """

    strip: Strip
    control_out: BoolArray
    solution: Solution | None = None
    by_prior: bool = False
    unadjusted: str = ""

    @cached_property
    def at(self) -> Orientation:
        """The photos over the water, in the axes of the scene."""
        if self.solution is None:
            return self.chained
        stations, water = self.solution.stations, self.solution.water
        assert water is not None  # there are submerged points
        station = self.scene.axes.inside(stations.position[self._photo_rows])
        turn = self.scene.axes.local_turn(station)
        slope = water.tilt if len(water.tilt) else np.zeros(2)
        return Orientation(
            attitude=attitude_from_matrix(attitude_matrix(stations.attitude[self._photo_rows]) @ turn),
            station=station,
            slope=slope,
            level=np.asarray(water.tide[self._photo_rows].mean() - self._pivot @ slope),
            index=np.asarray(water.index),
        )

    @cached_property
    def chained(self) -> Orientation:
        """The photos as the triplets are chained, over their mean plane."""
        return self.strip.orientation()

    @cached_property
    def inside(self) -> FloatArray:
        """(p, 3) the points in these axes, NaN for those without a place."""
        if self.solution is None:
            return self.strip.points
        place = self._of_points(self.solution.points.position)
        known = np.isfinite(place).all(axis=1)
        place[known] = self.scene.axes.inside(place[known])
        return place

    @cached_property
    def depth(self) -> FloatArray:
        """(p,) m, of the points below the water; negative above it."""
        under_plane = self.at.water_at(self.inside[:, :2]) - self.inside[:, 2]
        if self.solution is None:
            return under_plane
        adjusted = np.full(len(self.solution.block.points.ids), np.nan)
        adjusted[self.solution.bathymetric.point] = self.solution.bathymetric.depth
        depth = self._of_points(adjusted)
        return np.where(np.isfinite(depth), depth, under_plane)

    @property
    def outliers(self) -> BoolArray:
        """(p,) points that are left out, as they do not fit."""
        return self.strip.outliers | self.control_out

    @cached_property
    def rays(self) -> IntArray:
        """(p,) images that took part."""
        images = np.bincount(self.scene.sights.point, minlength=len(self.scene.points))
        return images * np.isfinite(self.inside).all(axis=1)

    @property
    def sigma0(self) -> float:
        """Standard deviation of unit weight of IIIA, of all triplets where it has no solution."""
        return self.strip.sigma0 if self.solution is None else self.solution.sigma0

    @property
    def redundancy(self) -> int:
        """Of IIIA, of all triplets where it has no solution."""
        return self.strip.redundancy if self.solution is None else self.solution.degrees_of_freedom

    @property
    def fits(self) -> bool:
        """Whether sigma0 passes its test."""
        return self.strip.fits if self.solution is None else self.sigma0 <= sigma0_doubt(self.redundancy)

    @cached_property
    def plane(self) -> tuple[PlaneVerdict, float]:
        """Whether the plane is determined, and the sigma of its level over the mean depth.

        By IIIA, at the middle of the submerged points; where it has no solution by the weakest triplet.
        """
        limit = self.scene.spec.limit
        if self.solution is None or self.scene.spec.plane is PlaneTreatment.KNOWN:
            return self.strip.verdict(limit)
        wet = self.scene.sights.wet & np.isfinite(self.inside).all(axis=1)
        depth = float(self.depth[wet].mean())
        share = self._level_sigma(self.inside[wet, :2].mean(axis=0)) / depth if depth > 0.0 else np.inf
        if not share <= limit:
            return PlaneVerdict.NOT, share
        return PlaneVerdict.BY_PRIOR if self.by_prior else PlaneVerdict.DETERMINED, share

    @property
    def summary(self) -> str:
        """The plane of water in a few words."""
        plane, share = self.plane
        return f"plane of water {plane} ({share:.3g} of the depth)"

    @cached_property
    def _photo_rows(self) -> IntArray:
        """(m,) of the photos in the solution."""
        assert self.solution is not None
        return _rows(self.photos, self.solution.block.photos.ids)

    def _of_points(self, values: FloatArray) -> FloatArray:
        """Return rows (p, ...) of the points, of those of the solution; NaN for points that it does not have."""
        assert self.solution is not None
        rows = _rows(self.scene.sights.points, self.solution.block.points.ids)
        result = values[rows].copy()
        result[rows < 0] = np.nan
        return result

    @cached_property
    def _station_covariance(self) -> FloatArray:
        """(m, 6, 6) of positions and attitudes, NaN where there is no solution."""
        if self.solution is None:
            return np.full((len(self.photos), 6, 6), np.nan)
        return self.solution.stations.covariance[self._photo_rows]

    @property
    def attitude_sigma(self) -> FloatArray:
        """(m, 3) rad, NaN where IIIA has no solution."""
        return sigmas_of(self._station_covariance)[:, 3:]

    @property
    def position_sigma(self) -> FloatArray:
        """(m, 3) m, likewise."""
        return sigmas_of(self._station_covariance)[:, :3]

    @cached_property
    def point_sigma(self) -> FloatArray:
        """(p, 3) m, likewise."""
        if self.solution is None:
            return np.full(self.inside.shape, np.nan)
        return self._of_points(sigmas_of(self.solution.points.covariance))

    @cached_property
    def _each(self) -> Orientation:
        """(m,) orientations of one photo each."""
        at, count = self.at, len(self.photos)
        return Orientation(
            attitude=at.attitude[:, None],
            station=at.station[:, None],
            slope=np.broadcast_to(at.slope, (count, 2)),
            level=np.broadcast_to(at.level, (count,)),
            index=np.broadcast_to(at.index, (count,)),
        )

    @property
    def paper_photos(self) -> FloatArray:
        """(m, 6) phi, omega, kappa, X0, Y0, Z0 of the paper."""
        return paper_vector(self._each)[:, :6]

    @cached_property
    def paper_photo_sigmas(self) -> FloatArray:
        """(m, 6)."""
        J = paper_partials(self._each)[:, :3, :3]
        attitude = sigmas_of(J @ self._station_covariance[:, 3:, 3:] @ np.swapaxes(J, 1, 2))
        return np.concatenate([attitude, self.position_sigma], axis=1)

    @property
    def water(self) -> FloatArray:
        """(4,) slopes towards X and Y, level at the origin of the axes (m), index."""
        return np.array([*self.at.slope, self.at.level, self.at.index])

    @property
    def water_sigma(self) -> FloatArray:
        """(4,) NaN for what is held, and where there is no solution."""
        sigma = np.array([*sigmas_of(self._water_covariance)[1:], self._level_sigma(np.zeros(2)), 0.0])
        return np.where(sigma > 0.0, sigma, np.nan)

    @cached_property
    def _pivot(self) -> FloatArray:
        """(2,) where the water of IIIA turns: the middle of the stations from which it starts."""
        assert self.solution is not None
        start = self.solution.block.photos.position[self._photo_rows]
        return self.scene.axes.inside(start)[:, :2].mean(axis=0)

    @cached_property
    def _water_covariance(self) -> FloatArray:
        """(3, 3) of the level at the pivot, and slopes; 0 for what is held, and where there is no solution."""
        covariance = np.zeros((3, 3))
        water = None if self.solution is None else self.solution.water_precision
        if water is not None and self.scene.spec.plane is not PlaneTreatment.KNOWN:
            rows = [water.names.index(name) for name in _OF_PLANE if name in water.names]
            covariance[: len(rows), : len(rows)] = water.covariance[np.ix_(rows, rows)]
        return covariance

    def _level_sigma(self, place: FloatArray) -> float:
        """Return the sigma (m) of the level at a place (2,), 0 where it is held or there is no solution."""
        if self.solution is None:
            return 0.0
        lever = np.append(1.0, place - self._pivot)
        return float(np.sqrt(max(lever @ self._water_covariance @ lever, 0.0)))

    @cached_property
    def planes(self) -> FloatArray:
        """(N, 3) slopes and level at the origin of the axes, of the chained triplets."""
        return self.strip.planes()

    @property
    def levels(self) -> FloatArray:
        """(N,) m, of the water of the triplets over the middles of their points."""
        parts = zip(self.strip.triplets, self.strip.moves, strict=True)
        middles = np.array([move.apply(triplet.place).mean(axis=0)[:2] for triplet, move in parts])
        return self.planes[:, 2] + np.sum(self.planes[:, :2] * middles, axis=1)

    @property
    def join_scale(self) -> FloatArray:
        """(N - 1,) of the triplets, a base each."""
        return np.array([join.move.scale for join in self.strip.joins])

    @property
    def join_turn(self) -> FloatArray:
        """(N - 1,) rad."""
        turns = np.array([np.trace(join.move.rotation) for join in self.strip.joins])
        return np.arccos(np.clip((turns - 1.0) / 2.0, -1.0, 1.0))

    @cached_property
    def _units(self) -> FloatArray:
        """(N - 1,) m of the job, or units of the model, in a unit of the triplets before the joins."""
        return np.array([move.scale for move in self.strip.moves[:-1]])

    @property
    def join_residual(self) -> FloatArray:
        """(N - 1,) m, root mean square of the points that take part, in each coordinate."""
        sizes = [np.sqrt(np.mean(np.square(join.residual[~join.left_out]))) for join in self.strip.joins]
        return np.array(sizes) * self._units

    @property
    def join_station(self) -> FloatArray:
        """(N - 1,) m, root mean square of the two stations, in each coordinate."""
        return np.array([np.sqrt(np.mean(np.square(join.station))) for join in self.strip.joins]) * self._units

    @property
    def join_plane(self) -> FloatArray:
        """(N - 1, 3) slopes, rad, and level, m, of the water before less that after, in the axes before."""
        plane = np.array([join.plane for join in self.strip.joins]).reshape(-1, 3)
        return plane * np.stack([np.ones_like(self._units)] * 2 + [self._units], axis=1)

    @cached_property
    def _control_rows(self) -> IntArray:
        """(c,) the control points in the strip."""
        known = np.isfinite(self.scene.sights.control).any(axis=1) & np.isfinite(self.inside).all(axis=1)
        return np.flatnonzero(known & ~self.outliers)

    @property
    def control_ids(self) -> TextArray:
        """(c,)."""
        return self.scene.sights.points[self._control_rows]

    @property
    def control_residual(self) -> FloatArray:
        """(c, 3) m, known less oriented, NaN for what is not known."""
        return (self.scene.sights.control - self.inside)[self._control_rows]

    @cached_property
    def control_test(self) -> FloatArray:
        """(c,) the largest test value of its components; NaN where there is no solution, or no test."""
        if self.solution is None:
            return np.full(len(self._control_rows), np.nan)
        control = self.solution.block.control
        rows = _rows(self.control_ids, self.solution.block.points.ids[control.point])
        tests = np.abs(np.where(rows[:, None] < 0, np.nan, Statistics(self.solution).control_tests[rows]))
        return np.where(np.isfinite(tests).any(axis=1), np.nanmax(np.nan_to_num(tests), axis=1), np.nan)

    @property
    def control_wrong(self) -> BoolArray:
        """(c,) those whose test value is beyond its limit."""
        limit = ndtri(1.0 - _SIGNIFICANCE / (6.0 * max(len(self.control_test), 1)))  # three components, two sides
        return np.nan_to_num(self.control_test) > limit

    @property
    def chain_difference(self) -> FloatArray:
        """(m, 3) m, the chained stations less those of IIIA, of a model after a similarity."""
        return self._chained_there[0] - self.at.station

    @property
    def chain_turn(self) -> FloatArray:
        """(m, 3) rad, the chained attitudes less those of IIIA."""
        return wrapped(attitude_from_matrix(self._chained_there[1]) - self.at.attitude)

    @cached_property
    def _chained_there(self) -> tuple[FloatArray, FloatArray]:
        """Stations (m, 3) and rotations (m, 3, 3) of the chain, of a model moved to those of IIIA."""
        station, M = self.chained.station, attitude_matrix(self.chained.attitude)
        if not self.scene.in_model:
            return station, M
        move = similarity.fit(station, self.at.station, np.ones(len(station)))
        return move.apply(station), move.turn(M)

    def reasons(self) -> list[Reason]:
        """Return what speaks against the answer, besides points on the wrong side of the water."""
        reasons = []
        if not self.fits:
            control = self.solution is not None and len(self.control_ids) > 0
            reasons.append(misfit(self.sigma0, "images and the control" if control else "images"))
        if self.plane[0] is PlaneVerdict.NOT:
            reasons.append(doubt(Concern.STATION, self._creep()))
        if self.solution is None:
            text = (
                f"IIIA does not hold the strip: first values by joined triplets, without sigmas ({self.unadjusted})"
            )
            reasons.append(doubt(Concern.CONVERGENCE, text))
        if self.control_wrong.any():
            ids = ", ".join(self.control_ids[self.control_wrong])
            reasons.append(doubt(Concern.STATION, f"the strip does not fit its control, at {ids}"))
        return reasons + left_out(self.scene.sights.points, self.outliers)

    def _creep(self) -> str:
        """Return what an undetermined plane does to a strip."""
        share = self.plane[1]
        size = f"{share:.3g} of the mean depth" if np.isfinite(share) else "without limit"
        where = creep = ""
        if self.solution is None:
            number = self.strip.weakest
            where = f" in photos {', '.join(self.photos[number : number + 3])}"
        else:
            worst = int(np.argmax(self.position_sigma[:, 2]))
            creep = f", heights by {self.position_sigma[worst, 2]:.3g} (one sigma, at {self.photos[worst]})"
        return (
            f"the plane of water is not determined: the sigma of its level{where} is {size} (limit "
            f"{self.scene.spec.limit:g}); scale and height creep along the strip{creep}; depths and heights are "
            "not to be used"
        )


def strip_answer(scene: Scene, strip: Strip) -> StripAnswer:
    """Return a strip as IIIA adjusts it, without the points that do not fit and the few wrong control points.

    Where many control points do not fit, no few wrong cards are the reason: all of them stay.
    """
    chained = StripAnswer(scene=scene, strip=strip, control_out=np.zeros(len(scene.points), dtype=bool))
    block = _without_plates(punched(chained), scene.sights.points[strip.outliers])
    whole = answer = _adjusted(chained, block)
    for _ in range(max(int(_FEW * len(whole.control_ids)), 1)):
        if not answer.control_wrong.any():
            break
        out = answer.control_out.copy()
        out[answer._control_rows[np.argmax(np.nan_to_num(answer.control_test))]] = True
        answer = _adjusted(replace(answer, control_out=out), _without_control(block, scene.sights.points[out]))
    answer = whole if answer.solution is None or answer.control_wrong.any() else answer
    return replace(answer, by_prior=_by_prior(answer))


def _by_prior(answer: StripAnswer) -> bool:
    """Return whether IIIA determines the plane of water only with the sigmas that the deck states of it."""
    plane = answer.scene.plane
    stated = plane.level_sigma is not None or plane.slope_sigma is not None
    if answer.solution is None or not stated or answer.plane[0] is not PlaneVerdict.DETERMINED:
        return False
    block = answer.solution.block
    water, photos = block.water, block.photos
    assert water is not None  # there are submerged points
    unaided = replace(
        block,
        photos=replace(photos, tide_sigma=np.full_like(photos.tide_sigma, np.nan)),
        water=replace(water, tilt_sigma=None),
    )
    alone = _adjusted(answer, unaided)
    return alone.solution is None or alone.plane[0] is not PlaneVerdict.DETERMINED


def _adjusted(answer: StripAnswer, block: Block) -> StripAnswer:
    """Return an answer with the solution of IIIA of a block, or why there is none."""
    try:
        solution = adjustment.adjust(block)
    except MusatError as error:
        return replace(answer, solution=None, unadjusted=str(error).splitlines()[0])
    if not solution.converged:
        return replace(answer, solution=None, unadjusted=solution.reason)
    if solution.water is not None and solution.water.undetermined:
        loose = " and ".join(solution.water.undetermined)
        return replace(answer, solution=None, unadjusted=f"the images do not determine {loose}")
    return replace(answer, solution=solution, unadjusted="")


def _without_plates(block: Block, points: TextArray) -> Block:
    """Return a block without the images and the control of points."""
    return _without_control(
        replace(block, plates=taken(block.plates, ~np.isin(block.points.ids[block.plates.point], points))), points
    )


def _without_control(block: Block, points: TextArray) -> Block:
    """Return a block without the control of points."""
    return replace(block, control=taken(block.control, ~np.isin(block.points.ids[block.control.point], points)))


def _rows(ids: TextArray, among: TextArray) -> IntArray:
    """Return the rows of identifiers among others, -1 for those that are not there."""
    rows = {name: row for row, name in enumerate(among.tolist())}
    return np.array([rows.get(name, -1) for name in ids.tolist()], dtype=int)
