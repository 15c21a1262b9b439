"""What came of the orientation of a strip: on the ground or in its model, with joins, control and a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry import similarity
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix, wrapped
from musatpy.model import Solution
from musatpy.model.findings import Concern, Grade, Reason
from musatpy.orientation.twomedia.axes import paper_partials, paper_vector
from musatpy.orientation.twomedia.oriented import Verdict
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.strip import Strip, control_limit, control_tests
from musatpy.orienting.placement import Placement, doubt, left_out, misfit

_SIGNIFICANCE = 0.001  # of the test of the planes of two triplets


@dataclass(frozen=True, kw_only=True, eq=False)
class Against:
    """A strip less the solution of IIIA that starts from it: (m, 3) m, of a model after a similarity, and rad."""

    position: FloatArray
    attitude: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class StripAnswer(Placement):
    """The orientation of a strip of m photos, of N triplets and N - 1 joins, with c control points.

    `against` is its comparison with IIIA, None where there is none; `unadjusted` says why.
    """

    strip: Strip
    against: Against | None = None
    unadjusted: str = ""

    @cached_property
    def at(self) -> Orientation:
        """The photos over the mean plane of the triplets, in the axes of the scene."""
        return self.strip.orientation()

    @cached_property
    def inside(self) -> FloatArray:
        """(p, 3) the points in these axes, NaN for those without a place."""
        return self.strip.points()

    @cached_property
    def depth(self) -> FloatArray:
        """(p,) m, of the points below the water of their triplets; negative above it."""
        plane = self.planes[np.maximum(self.strip.of_point, 0)]
        return plane[:, 2] + np.sum(plane[:, :2] * self.inside[:, :2], axis=1) - self.inside[:, 2]

    @property
    def outliers(self) -> BoolArray:
        """(p,) points that are left out, as they do not fit."""
        return self.strip.outliers

    @cached_property
    def rays(self) -> IntArray:
        """(p,) images that took part."""
        return np.bincount(self.scene.sights.point, minlength=len(self.scene.points)) * (self.strip.of_point >= 0)

    @property
    def sigma0(self) -> float:
        """Standard deviation of unit weight of the images, of all triplets."""
        return self.strip.sigma0

    @property
    def fits(self) -> bool:
        """Whether sigma0 passes its test."""
        return self.strip.fits

    @cached_property
    def plane(self) -> tuple[Verdict, float, int]:
        """Whether the plane is determined, sigma of its level over the mean depth, and the triplet that says so."""
        return self.strip.verdict(self.scene.spec.limit)

    @property
    def summary(self) -> str:
        """The plane of water in a few words."""
        plane, share, _ = self.plane
        return f"plane of water {plane} ({share:.3g} of the depth)"

    @cached_property
    def _photo_sigmas(self) -> tuple[FloatArray, FloatArray]:
        return tuple(self.sigma0 * _sigma(part) for part in self.strip.photo_covariance())  # type: ignore[return-value]

    @property
    def attitude_sigma(self) -> FloatArray:
        """(m, 3) rad, 0 for what is held."""
        return self._photo_sigmas[0]

    @property
    def position_sigma(self) -> FloatArray:
        """(m, 3) m, 0 for what is held."""
        return self._photo_sigmas[1]

    @cached_property
    def point_sigma(self) -> FloatArray:
        """(p, 3) m."""
        return self.sigma0 * _sigma(self.strip.point_covariance())

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
        J = paper_partials(self._each)[:, :6, :6]
        attitude, station = self.strip.photo_covariance()
        parts = (_sigma(J[:, :3, :3] @ attitude @ np.swapaxes(J[:, :3, :3], 1, 2)), _sigma(station))
        return self.sigma0 * np.concatenate(parts, axis=1)

    @cached_property
    def planes(self) -> FloatArray:
        """(N, 3) slopes and level at the origin of the axes."""
        return self.strip.planes()

    @cached_property
    def middles(self) -> FloatArray:
        """(N, 2) the middles of the points of the triplets."""
        parts = zip(self.strip.models, self.strip.moves, strict=True)
        return np.array([move.apply(model.value[7:]).mean(axis=0)[:2] for model, move in parts])

    @property
    def levels(self) -> FloatArray:
        """(N,) m, of the water over these middles."""
        return self.planes[:, 2] + np.sum(self.planes[:, :2] * self.middles, axis=1)

    @cached_property
    def _plane_covariance(self) -> FloatArray:
        return self.sigma0**2 * self.strip.plane_covariance()

    @property
    def slope_sigma(self) -> FloatArray:
        """(N, 2)."""
        return _sigma(self._plane_covariance)[:, :2]

    @property
    def level_sigma(self) -> FloatArray:
        """(N,) m, over the middles."""
        there = np.concatenate([self.middles, np.ones((len(self.middles), 1))], axis=1)
        return np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", there, self._plane_covariance, there), 0.0))

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
    def join_plane(self) -> FloatArray:
        """(N - 1, 3) slopes, rad, and level, m, of the water before less that after, in the axes before."""
        plane = np.array([join.plane for join in self.strip.joins]).reshape(-1, 3)
        return plane * np.stack([np.ones_like(self._units)] * 2 + [self._units], axis=1)

    @property
    def join_probability(self) -> FloatArray:
        """(N - 1,) of a larger difference of the planes; NaN where they are held."""
        values = [join.plane_probability for join in self.strip.joins]
        return np.where(self.plane[0] is Verdict.HELD, np.nan, np.array(values))

    @cached_property
    def _control_rows(self) -> IntArray:
        return np.flatnonzero(self.strip.control_points >= 0)

    @property
    def control_ids(self) -> TextArray:
        """(c,)."""
        return self.scene.sights.points[self.strip.control_points[self._control_rows]]

    @property
    def control_residual(self) -> FloatArray:
        """(c, 3) m, known less oriented, NaN for what is not known."""
        placed = self.strip.placed
        return placed.residual[self._control_rows] if placed is not None else np.zeros((0, 3))

    @cached_property
    def control_test(self) -> FloatArray:
        """(c,) residual over its sigma, of all components."""
        strip = self.strip
        if strip.known is None or strip.placed is None:
            return np.zeros(0)
        return np.sqrt(control_tests(strip.known, strip.placed, strip.drift))[self._control_rows]

    def reasons(self) -> list[Reason]:
        """Return what speaks against the answer, besides points on the wrong side of the water."""
        reasons = [] if self.fits else [misfit(self.sigma0)]
        if self.plane[0] is Verdict.NOT:
            reasons.append(doubt(Concern.STATION, self._creep()))
        if not self.strip.settled:
            text = f"not converged: the plane that is known moves triplets after {self.strip.passes} passes"
            reasons.append(Reason(grade=Grade.FAILED, concern=Concern.STATION, text=text, section=""))
        if (tests := np.square(self.control_test)).max(initial=0.0) > control_limit(len(tests)):
            ids = ", ".join(self.control_ids[tests > control_limit(len(tests))])
            text = f"the strip does not fit its control, at {ids}: it bends more than its errors say"
            reasons.append(doubt(Concern.STATION, text))
        apart = np.flatnonzero(self.join_probability < _SIGNIFICANCE / max(len(self.strip.joins), 1))
        if len(apart):
            photos = ", ".join(f"{self.photos[row]} and {self.photos[row + 3]}" for row in apart.tolist())
            text = f"the planes of water of triplets differ by more than their errors, between {photos}"
            reasons.append(doubt(Concern.STATION, text))
        return reasons + left_out(self.scene.sights.points, self.outliers)

    def _creep(self) -> str:
        """Return what an undetermined plane does to a strip."""
        _, share, number = self.plane
        scale = self.sigma0 * np.sqrt(self.strip.drift.covariance[:, 0, 0].max())
        worst = int(np.argmax(self.position_sigma[:, 2]))
        size = f"{share:.3g} of the mean depth" if np.isfinite(share) else "without limit"
        creep = (
            f"{100.0 * scale:.2g} % and {self.position_sigma[worst, 2]:.3g} (one sigma, at {self.photos[worst]})"
        )
        return (
            f"the plane of water is not determined (photos {', '.join(self.photos[number : number + 3])}: the "
            f"sigma of its level is {size}, limit {self.scene.spec.limit:g}): scale and height creep along the "
            f"strip, by {creep}; depths and heights are not to be used"
        )


def _sigma(covariance: FloatArray) -> FloatArray:
    """Return the standard deviations (..., 3) of covariances (..., 3, 3)."""
    return np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0))


def against(answer: StripAnswer, solution: Solution) -> Against:
    """Return a strip less the solution of IIIA of the deck that it punches."""
    stations = solution.stations
    rows = {str(photo): row for row, photo in enumerate(solution.block.photos.ids)}
    here = np.array([rows[str(photo)] for photo in answer.photos])
    axes = answer.scene.axes
    station, mine = axes.inside(stations.position[here]), answer.at.station
    turn = axes.local_turn(station)
    attitude = attitude_from_matrix(attitude_matrix(stations.attitude[here]) @ turn)
    M = attitude_matrix(answer.at.attitude)
    if answer.scene.in_model:
        move = similarity.fit(mine, station, np.ones(len(mine)))
        mine, M = move.apply(mine), move.turn(M)
    return Against(position=mine - station, attitude=wrapped(attitude_from_matrix(M) - attitude))
