"""Orientation of the photos of a method from nothing but their images and control, with what it is worth.

Starts are found, the best of them adjusted, gross errors taken out one by one, and the result given with its
sigmas, its reliability and a verdict whether the water is determined at all.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from scipy.special import chdtrc

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import MusatError
from musatpy.geometry.collinearity import nearest_point
from musatpy.model.options import PlaneTreatment
from musatpy.orientation.twomedia import precision
from musatpy.orientation.twomedia.helmert import Adjusted, HelmertProblem, adjust, misfits, refined
from musatpy.orientation.twomedia.rays import WATER, Orientation, image_rays
from musatpy.orientation.twomedia.sights import (
    Method,
    Sights,
    WaterPlane,
    conditions_of,
    problem_of,
    redundancy_of,
    without,
)
from musatpy.orientation.twomedia.solutions import REASONS, exact_roots, outlying, rejections, snooped

LIMIT = 0.1  # sigma of the level over the mean depth, up to which the water is determined
_CHECKED = 1e-6  # redundancy number from which a residual says anything
_SIGNIFICANCE = 0.001  # of the global test
_LINE = 0.02  # of the extent along a line, up to which that across is none: water bends the images of lines
_FEW = 0.2  # of the points, up to which those that do not fit draw an adjustment little
_TRIED = (1, 6)  # starts that are adjusted: at first, and where these do not fit


class PlaneVerdict(StrEnum):
    """Whether the plane of water is determined."""

    DETERMINED = "determined"
    BY_PRIOR = "only with its prior"
    NOT = "not determined"
    HELD = "held"


class OrientationError(MusatError):
    """Sights that give no orientation, and what is lacking."""


class NotConvergedError(OrientationError):
    """An adjustment that no start leads to an end."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Oriented:
    """The orientation that fits best, with the sights that are left of those given.

    problem and adjusted (one start) of these sights; outliers (p,) points that are out. covariance (6 m + 4, 6 m +
    4) for unit weight; image_redundancy (n, 2) redundancy numbers of the images.
    """

    sights: Sights
    method: Method
    problem: HelmertProblem
    adjusted: Adjusted
    outliers: BoolArray
    redundancy: int
    covariance: FloatArray
    image_redundancy: FloatArray

    @property
    def at(self) -> Orientation:
        """The orientation."""
        return self.adjusted.at[0]

    @cached_property
    def expected(self) -> tuple[float, float]:
        """The squares that the sigmas of the images let expect, and their degrees of freedom."""
        if not self.problem.equal:
            return float(self.redundancy), float(self.redundancy)
        return precision.expected_squares(self.problem, self.adjusted)

    @property
    def sigma0(self) -> float:
        """Standard deviation of unit weight, NaN without redundancy."""
        return float(np.sqrt(self.adjusted.squares[0] / self.expected[0])) if self.redundancy else float("nan")

    @property
    def fits(self) -> bool:
        """Whether sigma0 passes its test."""
        freedom = self.expected[1]
        return not self.redundancy or bool(chdtrc(freedom, freedom * self.sigma0**2) > _SIGNIFICANCE)

    @property
    def sigma(self) -> FloatArray:
        """(6 m + 4,) standard deviations for unit weight, 0 for what is held."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))

    @property
    def image_residuals(self) -> FloatArray:
        """(n, 2) adjusted less measured images, tangents."""
        return self.adjusted.image[0] - self.problem.image

    @property
    def normalised_residuals(self) -> FloatArray:
        """(n, 2) residuals over their sigmas, NaN where an image has no redundancy."""
        share = np.where(self.image_redundancy > _CHECKED, self.image_redundancy, np.nan)
        return self.image_residuals / (self.problem.image_sigma * np.sqrt(share))

    @property
    def condition(self) -> float:
        """Condition number of the normals, scaled to unit diagonal, along the directions of the steps."""
        return float(np.linalg.cond(precision.scaled(self.adjusted.normals[0])))

    @property
    def weakest(self) -> list[precision.Direction]:
        """The two weakest directions of the normals, scaled to unit diagonal."""
        return precision.weakest(self.adjusted, self.problem.unknown, self.sights.photos)

    @property
    def free(self) -> list[precision.Direction]:
        """What the images, the control and the priors leave free; no sigma speaks of it."""
        return precision.free(self.problem, self.adjusted, self.sights.photos, priors=True)

    def other_roots(self) -> Orientation:
        """Return the other exact solutions (r,) of a minimum set that random starts lead to."""
        if self.redundancy:
            return self.adjusted.at[:0]
        return exact_roots(self.problem, self.adjusted)[1:]

    @cached_property
    def points(self) -> FloatArray:
        """(p, 3) control as adjusted, other points where their rays meet, NaN with fewer than two rays."""
        points = np.where(np.isfinite(self.sights.control), self.adjusted.control[0], np.nan)
        rays = image_rays(
            self.adjusted.at, self.problem.photo, self.adjusted.image, self.problem.wet, self.problem.rise
        )
        for rows in self.sights.rows_by_count():
            place = nearest_point(rays.origin[0, rows], rays.direction[0, rows])
            number = self.sights.point[rows[:, 0]]
            points[number] = np.where(np.isfinite(points[number]), points[number], place)
        return points

    @property
    def rays(self) -> IntArray:
        """(p,) images that took part."""
        return np.bincount(self.sights.point, minlength=len(self.sights.points))

    def point_covariance(self) -> FloatArray:
        """Return the covariances (p, 3, 3) of points without control, for unit weight; NaN for the others.

        N^-1 + N^-1 N_p C N_p' N^-1 of the bundle, with the normals N of a point, N_p of it with the orientation,
        and the covariance C of that.
        """
        covariance = np.full((len(self.sights.points), 3, 3), np.nan)
        for rows in self.sights.rows_by_count():
            number = self.sights.point[rows[:, 0]]
            new = ~self.sights.is_control[number]
            rows, number = rows[new], number[new]
            by_point, by_unknown = precision.image_partials(self.problem, self.adjusted, rows, self.points[number])
            weight = 1.0 / np.square(self.problem.image_sigma[rows]).reshape(-1, 2 * rows.shape[1], 1)
            across = np.swapaxes(by_point, -1, -2)
            inverse = np.linalg.inv(across @ (weight * by_point))
            carried = inverse @ (across @ (weight * by_unknown))
            covariance[number] = inverse + carried @ self.covariance @ np.swapaxes(carried, -1, -2)
        return covariance

    def verdict(self, limit: float = LIMIT) -> tuple[PlaneVerdict, float]:
        """Return whether the water is determined: sigma of its level over the points to their mean depth.

        Far from the truth the sigma says little: where images without any water fit nearly as well, the share is
        at least that by which they fit worse.
        """
        if not self.problem.unknown[-WATER:-1].any():
            return PlaneVerdict.HELD, 0.0
        if not self.adjusted.converged[0]:
            return PlaneVerdict.NOT, np.inf
        share = np.inf if any(direction.moves_water for direction in self.free) else self.level_share()
        verdict = PlaneVerdict.DETERMINED
        if not np.isfinite(self.problem.prior).any():
            share = max(share, self._dry_share())
        else:
            verdict = PlaneVerdict.BY_PRIOR
            unaided = replace(self.problem, prior=np.full_like(self.problem.prior, np.inf))
            loose = precision.free(self.problem, self.adjusted, self.sights.photos, priors=False)
            if not any(direction.moves_water for direction in loose):
                alone = max(self.level_share(precision.covariance_of(unaided, self.adjusted)), self._dry_share())
                if alone <= limit:
                    return PlaneVerdict.DETERMINED, alone
        return (verdict if share <= limit else PlaneVerdict.NOT), share

    def level_share(self, covariance: FloatArray | None = None) -> float:
        """Return the sigma of the level over the middle of the wet points, as a share of their mean depth.

        By its own covariance, or another one.
        """
        points = self.points
        wet = points[self.sights.wet & np.isfinite(points).all(axis=1)]
        depth = float(np.mean(self.adjusted.at.water_at(wet[None, :, :2])[0] - wet[:, 2]))
        weights = np.array([*wet[:, :2].mean(axis=0), 1.0])
        of_water = (self.covariance if covariance is None else covariance)[-WATER:-1, -WATER:-1]
        return float(np.sqrt(max(weights @ of_water @ weights, 0.0))) / depth if depth > 0.0 else np.inf

    def _dry_share(self) -> float:
        """Return the share of a sigma at which no water, a whole depth off, would fit as badly as it does."""
        sights = replace(self.sights, wet=np.zeros_like(self.sights.wet))
        dry = problem_of(sights, self.method, WaterPlane(treatment=PlaneTreatment.KNOWN))
        worse = float(adjust(dry, self.adjusted.at).squares[0] - self.adjusted.squares[0])
        return 1.0 / np.sqrt(worse) if worse > 0.0 else np.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class _OrientationAttempt:
    """What an orientation is made from, and how."""

    sights: Sights
    method: Method
    plane: WaterPlane
    equal: bool

    @cached_property
    def problem(self) -> HelmertProblem:
        """The adjustment of all sights."""
        return problem_of(self.sights, self.method, self.plane, self.equal)

    def fault(self, text: str) -> OrientationError:
        """Return the error that says so of the method."""
        return OrientationError(f"{self.method.name}: {text}")


def orient(
    sights: Sights,
    method: Method,
    plane: WaterPlane,
    base: float = 1.0,
    equal: bool = False,
    near: Orientation | None = None,
) -> Oriented:
    """Return the orientation of the photos of a method, from no starting values.

    What is `near` (1,) is tried first. `base` is the length of the first base of a model. Raises
    `OrientationError` where the sights do not suffice, where most of them fit nothing, and where they contradict
    what is given of the water.
    """
    attempt = _OrientationAttempt(sights=sights, method=method, plane=plane, equal=equal)
    _require_enough(attempt)
    if near is not None and (solution := _oriented_near(attempt, near)) is not None:
        return solution
    try:
        oriented = _oriented(attempt, base)
    except OrientationError:
        _require_agreement(attempt, len(sights.points))
        raise
    if oriented.outliers.any():
        _require_agreement(attempt, int(oriented.outliers.sum()))
    return oriented


def _require_enough(attempt: _OrientationAttempt) -> None:
    """Raise `OrientationError` where conditions are fewer than unknowns, or shared points than a start takes.

    And for equal weights beside prior sigmas, which the conditions of the paper know nothing of.
    """
    problem, method, sights = attempt.problem, attempt.method, attempt.sights
    faults, lacking = [], -redundancy_of(problem)
    if lacking > 0:
        have = conditions_of(problem)
        what = "points that the photos share" if method.in_model else "control points, of two components at least"
        faults.append(f"{have} conditions for {have + lacking} unknowns; {lacking} more are needed: {what}")
    shared = len(sights.common(tuple(range(method.photos)))[0])
    if shared < method.shared:
        names = ", ".join(sights.photos.tolist())
        faults.append(f"points that photos {names} all show: {shared}; {method.shared} are needed to start from")
    if problem.equal and np.isfinite(problem.prior[problem.unknown]).any():
        faults.append("EQUAL weights of conditions have no measure for sigmas of the water (TID, WTR): FULL has")
    if faults:
        raise attempt.fault("; ".join(faults))


def _require_agreement(attempt: _OrientationAttempt, outliers: int) -> None:
    """Raise `OrientationError` where the images fit another plane than the given one, and with fewer outliers.

    That it is another is tested by the difference of both, in the covariances of both, 0 of what is held.
    """
    plane = attempt.plane
    sigmas = np.array([plane.slope_sigma or 0.0, plane.slope_sigma or 0.0, plane.level_sigma or 0.0])
    tilted = plane.treatment is not PlaneTreatment.ADJUST
    known = (sigmas > 0.0) | [tilted, tilted, plane.treatment is PlaneTreatment.KNOWN]
    if attempt.method.in_model or not known.any():
        return
    of_images = WaterPlane(
        rise=plane.rise, index=plane.index, index_sigma=plane.index_sigma, index_unknown=plane.index_unknown
    )
    alone = replace(attempt, plane=of_images)
    if redundancy_of(alone.problem) < 0:
        return
    try:
        unaided = _oriented(alone, 1.0)
    except OrientationError:
        return
    water = slice(-WATER, -1)
    values = np.array([*plane.slope, plane.level or 0.0])
    difference = (unaided.at.vector[water] - values)[known]
    covariance = (unaided.covariance[water, water] + np.diag(sigmas**2))[np.ix_(known, known)]
    square = float(difference @ np.linalg.solve(covariance, difference))
    if np.count_nonzero(unaided.outliers) < outliers and chdtrc(len(difference), square) < _SIGNIFICANCE:
        names = np.array(precision.OF_WATER[:3])[known]
        parts = [
            f"{name} {value:.4g}, by them alone {other:.4g}"
            for name, value, other in zip(names, values[known], values[known] + difference, strict=True)
        ]
        raise attempt.fault(f"the images contradict the water that is given: {'; '.join(parts)}")


def _oriented_near(attempt: _OrientationAttempt, near: Orientation) -> Oriented | None:
    """Return the orientation from one start (1,), with few outliers; None where it leads nowhere."""
    if (solution := _fitting(attempt, refined(attempt.problem, near))) is not None:
        return solution
    tested = snooped(attempt.sights, attempt.method, attempt.plane, near)
    if tested is not None and np.mean(tested[0]) < _FEW:
        with suppress(OrientationError):
            return _without_outliers(attempt, tested)
    return None


def _oriented(attempt: _OrientationAttempt, base: float) -> Oriented:
    """Return the orientation by all sights, or by those that are left without outliers."""
    problem, starts = attempt.problem, attempt.method.starts(attempt.sights, attempt.plane, base)
    if not len(starts.level):
        raise attempt.fault("no solution for air to start from; images or control contradict")
    starts = starts[np.argsort(np.median(misfits(problem, starts), axis=-1))]
    for count in _TRIED:
        if (solution := _fitting(attempt, adjust(problem, starts[:count]))) is not None:
            return solution
    tested = outlying(attempt.sights, attempt.method, attempt.plane, starts)
    try:
        return _without_outliers(attempt, tested)
    except NotConvergedError:
        if (solution := _fitting(attempt, adjust(problem, starts), at_rest=False)) is None:
            raise
        return solution


def _fitting(attempt: _OrientationAttempt, adjusted: Adjusted, *, at_rest: bool = True) -> Oriented | None:
    """Return the solution of least squares that is not to be rejected, None where it does not fit.

    If not `at_rest`, the best place that an adjustment has come to and which fits though it does not rest there:
    what the images do not determine goes on and on, and they fit as well.
    """
    possible = adjusted.converged if at_rest else np.isfinite(adjusted.squares)
    squares = np.where(possible & ~rejections(attempt.problem, adjusted).any(axis=1), adjusted.squares, np.inf)
    row = int(np.argmin(squares))
    if not np.isfinite(squares[row]):
        return None
    best = adjusted[row] if at_rest else replace(adjusted[row], converged=np.zeros(1, dtype=bool))
    solution = _described(attempt, best, np.zeros(len(attempt.sights.points), dtype=bool))
    return solution if solution.fits and (at_rest or solution.redundancy) else None


def _without_outliers(attempt: _OrientationAttempt, tested: tuple[BoolArray, Adjusted] | None) -> Oriented:
    """Return the orientation without the points (p,) that do not fit that of the others."""
    if tested is not None:
        outliers, adjusted = tested
        left = replace(attempt, sights=without(attempt.sights, outliers))
        adjusted = adjust(left.problem, adjusted.at) if attempt.equal else adjusted
        against = [REASONS[row] for row in np.flatnonzero(rejections(left.problem, adjusted)[0])]
        if against:
            raise attempt.fault(f"no solution is possible; of the best {', and '.join(against)}")
        out, count = int(outliers.sum()), len(np.unique(attempt.sights.point))
        if 2 * out > count:
            raise attempt.fault(f"no orientation fits more than {count - out} of {count} points")
        if adjusted.converged[0]:
            return _described(left, adjusted, outliers)
    fault = f"{attempt.method.name}: the adjustment does not converge from any start"
    if _in_line(attempt):
        fault += ": the points lie on a line, about which all else may turn: not determined; points off it hold it"
    raise NotConvergedError(fault)


def _in_line(attempt: _OrientationAttempt) -> bool:
    """Return whether all points that hold the photos lie on a line: on the ground, or in every photo of a model."""
    sights = attempt.sights
    sets = [sights.image[sights.photo == photo] for photo in range(attempt.method.photos)]
    if not attempt.method.in_model:
        sets = [sights.control[np.isfinite(sights.control).all(axis=1)]]
    extents = [np.linalg.svd(places - places.mean(axis=0), compute_uv=False) for places in sets if len(places)]
    return all(extent[1] <= _LINE * extent[0] for extent in extents)


def _described(attempt: _OrientationAttempt, adjusted: Adjusted, outliers: BoolArray) -> Oriented:
    """Return a solution with its precision and reliability."""
    return Oriented(
        sights=attempt.sights,
        method=attempt.method,
        problem=attempt.problem,
        adjusted=adjusted,
        outliers=outliers,
        redundancy=redundancy_of(attempt.problem),
        covariance=precision.covariance_of(attempt.problem, adjusted),
        image_redundancy=precision.redundancy_numbers(attempt.problem, adjusted),
    )
