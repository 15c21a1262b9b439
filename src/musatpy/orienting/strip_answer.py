"""What came of the orientation of a strip: first values by triplets, adjusted by IIIA, with joins and a verdict."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from musatpy import adjustment
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray, at_rows, rows_of
from musatpy.errors import MusatError
from musatpy.geometry import similarity
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix, wrapped
from musatpy.model import Block, PlaneTreatment, Solution
from musatpy.model.findings import Concern, Reason
from musatpy.model.tables import taken
from musatpy.orientation.twomedia.oriented import PlaneVerdict
from musatpy.orientation.twomedia.rays import Orientation, paper_partials, paper_vector
from musatpy.orientation.twomedia.strip import Strip
from musatpy.orienting.placement import Placement, doubt, left_out, misfit, punched
from musatpy.orienting.task import OrientationTask
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
    posteriori sigmas. Where there is none all are those of the chained triplets, without sigmas, and `unadjusted`
    says why. planes (N, 3) are slopes and level at the origin of the axes of the chained triplets, levels (N,) m
    those over the middles of their points. control_rows (c,) are the control points in the strip, with residuals
    (c, 3) m, known less oriented, NaN for what is not known, and tests (c,), the largest of their components, NaN
    without one; control_wrong (c,) are beyond the limit. chain_difference (m, 3) m and chain_turn (m, 3) rad are
    the chained stations and attitudes less those of IIIA, of a model after a similarity.
    """

    strip: Strip
    solution: Solution | None
    unadjusted: str
    planes: FloatArray
    levels: FloatArray
    control_rows: IntArray
    control_residual: FloatArray
    control_test: FloatArray
    control_wrong: BoolArray
    chain_difference: FloatArray
    chain_turn: FloatArray

    @property
    def control_ids(self) -> TextArray:
        """(c,)."""
        return self.task.sights.points[self.control_rows]

    @property
    def join_turn(self) -> FloatArray:
        """(N - 1,) rad."""
        turns = np.array([np.trace(join.move.rotation) for join in self.strip.joins])
        return np.arccos(np.clip((turns - 1.0) / 2.0, -1.0, 1.0))

    @property
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


def strip_answer(task: OrientationTask, strip: Strip) -> StripAnswer:
    """Return a strip as IIIA adjusts it, without the points that do not fit and the few wrong control points.

    Where many control points do not fit, no few wrong cards are the reason: all of them stay.
    """
    ids, out = task.sights.points, np.zeros(len(task.points), dtype=bool)
    block = punched(task, strip.orientation())
    block = replace(block, plates=taken(block.plates, ~_among(block, block.plates.point, ids[strip.outliers])))
    block = _without_control(block, ids[strip.outliers])
    whole = answer = _adjusted(task, strip, block, out)
    for _ in range(max(int(_FEW * len(whole.control_rows)), 1)):
        if not answer.control_wrong.any():
            break
        out = out.copy()
        out[answer.control_rows[np.argmax(np.nan_to_num(answer.control_test))]] = True
        answer = _adjusted(task, strip, _without_control(block, ids[out]), out)
    answer = whole if answer.solution is None or answer.control_wrong.any() else answer
    return replace(answer, plane=(PlaneVerdict.BY_PRIOR, answer.plane[1])) if _by_prior(answer) else answer


def _by_prior(answer: StripAnswer) -> bool:
    """Return whether IIIA determines the plane of water only with the sigmas that the deck states of it."""
    plane = answer.task.plane
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
    alone = _adjusted(answer.task, answer.strip, unaided, np.zeros(len(answer.task.points), dtype=bool))
    return alone.solution is None or alone.plane[0] is not PlaneVerdict.DETERMINED


def _adjusted(task: OrientationTask, strip: Strip, block: Block, control_out: BoolArray) -> StripAnswer:
    """Return the answer with the solution of IIIA of a block, or why there is none."""
    solution, unadjusted = None, ""
    try:
        solution = adjustment.adjust(block)
    except MusatError as error:
        unadjusted = str(error).splitlines()[0]
    if solution is not None and not solution.converged:
        unadjusted = solution.reason
    elif solution is not None and solution.water is not None and solution.water.undetermined:
        unadjusted = f"the images do not determine {' and '.join(solution.water.undetermined)}"
    answer = _chained(task, strip, control_out, unadjusted)
    if solution is not None and not unadjusted:
        answer = _solved(answer, solution)
    return replace(answer, misgivings=tuple(_misgivings(answer)))


def _chained(task: OrientationTask, strip: Strip, control_out: BoolArray, unadjusted: str) -> StripAnswer:
    """Return the answer of the chained triplets alone, without sigmas."""
    at, points, sights = strip.orientation(), strip.points, task.sights
    seen = np.isfinite(points).all(axis=1)
    outliers = strip.outliers | control_out
    rows = np.flatnonzero(np.isfinite(sights.control).any(axis=1) & seen & ~outliers)
    nothing, planes = np.full((len(at.station), 3), np.nan), strip.planes()
    parts = zip(strip.triplets, strip.moves, strict=True)
    middles = np.array([move.apply(triplet.place).mean(axis=0)[:2] for triplet, move in parts])
    held = unadjusted or task.spec.plane is PlaneTreatment.KNOWN
    return StripAnswer(
        task=task,
        at=at,
        inside=points,
        depth=at.water_at(points[:, :2]) - points[:, 2],
        outliers=outliers,
        rays=np.bincount(sights.point, minlength=len(task.points)) * seen,
        sigma0=strip.sigma0,
        redundancy=strip.redundancy,
        fits=strip.fits,
        plane=strip.verdict(task.spec.limit) if held else (PlaneVerdict.NOT, np.inf),
        position_sigma=nothing,
        attitude_sigma=nothing,
        point_sigma=np.full(points.shape, np.nan),
        paper_photos=paper_vector(_each(at))[:, :6],
        paper_photo_sigmas=np.full((len(at.station), 6), np.nan),
        water=np.array([*at.slope, at.level, at.index]),
        water_sigma=np.full(4, np.nan),
        misgivings=(),
        strip=strip,
        solution=None,
        unadjusted=unadjusted,
        planes=planes,
        levels=planes[:, 2] + np.sum(planes[:, :2] * middles, axis=1),
        control_rows=rows,
        control_residual=(sights.control - points)[rows],
        control_test=np.full(len(rows), np.nan),
        control_wrong=np.zeros(len(rows), dtype=bool),
        chain_difference=np.zeros((len(at.station), 3)),
        chain_turn=np.zeros((len(at.station), 3)),
    )


def _solved(chain: StripAnswer, solution: Solution) -> StripAnswer:
    """Return the answer of IIIA, which starts from a chain."""
    task, block, stations, water = chain.task, solution.block, solution.stations, solution.water
    assert water is not None  # there are submerged points
    photos = rows_of(block.photos.ids, chain.photos)
    points = rows_of(block.points.ids, task.sights.points)
    pivot = task.axes.inside(block.photos.position[photos])[:, :2].mean(axis=0)  # where the water of IIIA turns
    station = task.axes.inside(stations.position[photos])
    slope = water.tilt if len(water.tilt) else np.zeros(2)
    at = Orientation(
        attitude=attitude_from_matrix(attitude_matrix(stations.attitude[photos]) @ task.axes.local_turn(station)),
        station=station,
        slope=slope,
        level=np.asarray(water.tide[photos].mean() - pivot @ slope),
        index=np.asarray(water.index),
    )
    inside = at_rows(solution.points.position, points)
    known = np.isfinite(inside).all(axis=1)
    inside[known] = task.axes.inside(inside[known])
    under = rows_of(block.points.ids[solution.bathymetric.point], task.sights.points)
    depth = at_rows(solution.bathymetric.depth, under)
    depth = np.where(np.isfinite(depth), depth, at.water_at(inside[:, :2]) - inside[:, 2])
    water_covariance = _water_covariance(solution, task.spec.plane)
    wet = task.sights.wet & known
    sigma, mean = _level_sigma(water_covariance, inside[wet, :2].mean(axis=0) - pivot), float(depth[wet].mean())
    share = sigma / mean if mean > 0.0 else np.inf
    determined = (PlaneVerdict.DETERMINED if share <= task.spec.limit else PlaneVerdict.NOT), share
    covariance = stations.covariance[photos]
    position_sigma, attitude_sigma = np.split(sigmas_of(covariance), 2, axis=1)
    water_sigma = np.array([*sigmas_of(water_covariance)[1:], _level_sigma(water_covariance, -pivot), 0.0])
    rows = np.flatnonzero(np.isfinite(task.sights.control).any(axis=1) & known & ~chain.outliers)
    test, wrong = _control_tests(solution, task.sights.points[rows])
    chained, turned = chain.at.station, attitude_matrix(chain.at.attitude)
    if task.in_model:
        move = similarity.fit(chained, station, np.ones(len(station)))
        chained, turned = move.apply(chained), move.turn(turned)
    return replace(
        chain,
        at=at,
        inside=inside,
        depth=depth,
        rays=np.bincount(task.sights.point, minlength=len(task.points)) * known,
        sigma0=solution.sigma0,
        redundancy=solution.degrees_of_freedom,
        fits=solution.sigma0 <= sigma0_doubt(solution.degrees_of_freedom),
        plane=chain.plane if task.spec.plane is PlaneTreatment.KNOWN else determined,
        position_sigma=position_sigma,
        attitude_sigma=attitude_sigma,
        point_sigma=at_rows(sigmas_of(solution.points.covariance), points),
        paper_photos=paper_vector(_each(at))[:, :6],
        paper_photo_sigmas=_paper_sigmas(at, covariance),
        water=np.array([*at.slope, at.level, at.index]),
        water_sigma=np.where(water_sigma > 0.0, water_sigma, np.nan),
        solution=solution,
        control_rows=rows,
        control_residual=(task.sights.control - inside)[rows],
        control_test=test,
        control_wrong=wrong,
        chain_difference=chained - station,
        chain_turn=wrapped(attitude_from_matrix(turned) - at.attitude),
    )


def _each(at: Orientation) -> Orientation:
    """Return the orientations (m,) of one photo each."""
    plane = (np.broadcast_to(part, (len(at.station), *part.shape)) for part in (at.slope, at.level, at.index))
    slope, level, index = plane
    return Orientation(
        attitude=at.attitude[:, None], station=at.station[:, None], slope=slope, level=level, index=index
    )


def _paper_sigmas(at: Orientation, covariance: FloatArray) -> FloatArray:
    """Return the sigmas (m, 6) of the elements of the paper, by covariances (m, 6, 6) of stations."""
    J = paper_partials(_each(at))[:, :3, :3]
    attitude = sigmas_of(J @ covariance[:, 3:, 3:] @ np.swapaxes(J, 1, 2))
    return np.concatenate([attitude, sigmas_of(covariance)[:, :3]], axis=1)


def _water_covariance(solution: Solution, plane: PlaneTreatment) -> FloatArray:
    """Return the covariance (3, 3) of the level where the water turns, and slopes; 0 for what is held."""
    covariance = np.zeros((3, 3))
    water = solution.water_precision
    if water is not None and plane is not PlaneTreatment.KNOWN:
        rows = [water.names.index(name) for name in _OF_PLANE if name in water.names]
        covariance[: len(rows), : len(rows)] = water.covariance[np.ix_(rows, rows)]
    return covariance


def _level_sigma(covariance: FloatArray, off: FloatArray) -> float:
    """Return the sigma (m) of the level at a place (2,) off where the water turns, 0 where it is held."""
    lever = np.append(1.0, off)
    return float(np.sqrt(max(lever @ covariance @ lever, 0.0)))


def _control_tests(solution: Solution, ids: TextArray) -> tuple[FloatArray, BoolArray]:
    """Return the largest test values (c,) of control points, NaN without one, and which are beyond their limit."""
    control = solution.block.control
    rows = rows_of(solution.block.points.ids[control.point], ids)
    tests = np.abs(np.where(rows[:, None] < 0, np.nan, Statistics(solution).control_tests[rows]))
    test = np.where(np.isfinite(tests).any(axis=1), np.nanmax(np.nan_to_num(tests), axis=1), np.nan)
    limit = ndtri(1.0 - _SIGNIFICANCE / (6.0 * max(len(test), 1)))  # three components, two sides
    return test, np.nan_to_num(test) > limit


def _misgivings(answer: StripAnswer) -> list[Reason]:
    """Return what speaks against a strip."""
    reasons, ids = [], ", ".join(answer.control_ids[answer.control_wrong])
    if not answer.fits:
        control = answer.solution is not None and len(answer.control_rows) > 0
        reasons.append(misfit(answer.sigma0, "images and the control" if control else "images"))
    if answer.plane[0] is PlaneVerdict.NOT:
        reasons.append(doubt(Concern.STATION, _creep(answer)))
    if answer.solution is None:
        text = (
            f"IIIA does not hold the strip: first values by joined triplets, without sigmas ({answer.unadjusted})"
        )
        reasons.append(doubt(Concern.CONVERGENCE, text))
    if ids:
        reasons.append(doubt(Concern.STATION, f"the strip does not fit its control, at {ids}"))
    return reasons + left_out(answer.task.sights.points, answer.outliers)


def _creep(answer: StripAnswer) -> str:
    """Return what an undetermined plane does to a strip."""
    share = answer.plane[1]
    size = f"{share:.3g} of the mean depth" if np.isfinite(share) else "without limit"
    where = creep = ""
    if answer.solution is None:
        number = answer.strip.weakest
        where = f" in photos {', '.join(answer.photos[number : number + 3])}"
    else:
        worst = int(np.argmax(answer.position_sigma[:, 2]))
        creep = f", heights by {answer.position_sigma[worst, 2]:.3g} (one sigma, at {answer.photos[worst]})"
    return (
        f"the plane of water is not determined: the sigma of its level{where} is {size} (limit "
        f"{answer.task.spec.limit:g}); scale and height creep along the strip{creep}; depths and heights are "
        "not to be used"
    )


def _without_control(block: Block, points: TextArray) -> Block:
    """Return a block without the control of points."""
    return replace(block, control=taken(block.control, ~_among(block, block.control.point, points)))


def _among(block: Block, rows: IntArray, points: TextArray) -> BoolArray:
    """Return which rows (n,) of the points of a block are among points by name."""
    return np.isin(block.points.ids[rows], points)
