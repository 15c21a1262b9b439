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
from musatpy.orientation.twomedia.helmert import Adjusted, HelmertProblem, adjust, misfits, refined
from musatpy.orientation.twomedia.outliers import outlying, snooped
from musatpy.orientation.twomedia.precision import (
    OF_WATER,
    Direction,
    covariance_of,
    expected_squares,
    free,
    image_partials,
    inflation,
    redundancy_numbers,
    weakest,
)
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
from musatpy.orientation.twomedia.solutions import REASONS, exact_roots, rejections

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

    @property
    def sigma0(self) -> float:
        """Standard deviation of unit weight, NaN without redundancy."""
        return float(np.sqrt(self.adjusted.squares[0] / self.expected[0])) if self.redundancy else float("nan")

    @cached_property
    def expected(self) -> tuple[float, float]:
        """The squares that the sigmas of the images let expect, and their degrees of freedom."""
        if not self.problem.equal:
            return float(self.redundancy), float(self.redundancy)
        return expected_squares(self.problem, self.adjusted)

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
        checked = self.image_redundancy > _CHECKED
        sigma = self.problem.image_sigma * np.sqrt(np.where(checked, self.image_redundancy, np.nan))
        return self.image_residuals / sigma

    @property
    def correlations(self) -> FloatArray:
        """(6 m + 4, 6 m + 4), NaN for what is held."""
        sigma = np.where(self.sigma > 0.0, self.sigma, np.nan)
        return self.covariance / np.outer(sigma, sigma)

    @property
    def condition(self) -> float:
        """Condition number of the normals, scaled to unit diagonal, along the directions of the steps."""
        N = self.adjusted.normals[0]
        scale = 1.0 / np.sqrt(np.diagonal(N))
        return float(np.linalg.cond(N * np.outer(scale, scale)))

    @property
    def inflation(self) -> FloatArray:
        """(6 m + 4,) variance inflation factors, NaN for what is held."""
        return inflation(self.adjusted, self.problem.unknown)

    @property
    def weakest(self) -> list[Direction]:
        """The two weakest directions of the normals, scaled to unit diagonal."""
        return weakest(self.adjusted, self.problem.unknown, self.sights.photos)

    @property
    def free(self) -> list[Direction]:
        """What the images, the control and the priors leave free; no sigma speaks of it."""
        return free(self.problem, self.adjusted, self.sights.photos, priors=True)

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
        points = self.points
        for rows in self.sights.rows_by_count():
            number = self.sights.point[rows[:, 0]]
            new = ~self.sights.is_control[number]
            by_point, by_unknown = image_partials(self.problem, self.adjusted, rows[new], points[number[new]])
            weight = 1.0 / np.square(self.problem.image_sigma[rows[new]]).reshape(-1, 2 * rows.shape[1], 1)
            across = np.swapaxes(by_point, -1, -2)
            inverse = np.linalg.inv(across @ (weight * by_point))
            carried = inverse @ (across @ (weight * by_unknown))
            covariance[number[new]] = inverse + carried @ self.covariance @ np.swapaxes(carried, -1, -2)
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
        share = np.inf if _of_water(self.free) else self._level_share(self.covariance)
        if not np.isfinite(self.problem.prior).any():
            share = max(share, self._dry_share())
            return (PlaneVerdict.DETERMINED if share <= limit else PlaneVerdict.NOT), share
        unaided = replace(self.problem, prior=np.full_like(self.problem.prior, np.inf))
        if not _of_water(free(self.problem, self.adjusted, self.sights.photos, priors=False)):
            alone = max(self._level_share(covariance_of(unaided, self.adjusted)), self._dry_share())
            if alone <= limit:
                return PlaneVerdict.DETERMINED, alone
        return (PlaneVerdict.BY_PRIOR if share <= limit else PlaneVerdict.NOT), share

    @property
    def level_share(self) -> float:
        """Sigma of the level over the middle of the wet points, as a share of their mean depth."""
        return self._level_share(self.covariance)

    def _level_share(self, covariance: FloatArray) -> float:
        """Return the sigma of the level over the middle of the wet points, as a share of their mean depth."""
        points = self.points
        wet = points[self.sights.wet & np.isfinite(points).all(axis=1)]
        depth = float(np.mean(self.adjusted.at.water_at(wet[None, :, :2])[0] - wet[:, 2]))
        weights = np.array([*wet[:, :2].mean(axis=0), 1.0])
        variance = float(weights @ covariance[-WATER:-1, -WATER:-1] @ weights)
        return float(np.sqrt(max(variance, 0.0))) / depth if depth > 0.0 else np.inf

    def _dry_share(self) -> float:
        """Return the share of a sigma at which no water, a whole depth off, would fit as badly as it does."""
        sights = replace(self.sights, wet=np.zeros_like(self.sights.wet))
        dry = problem_of(sights, self.method, WaterPlane(treatment=PlaneTreatment.KNOWN))
        worse = float(adjust(dry, self.adjusted.at).squares[0] - self.adjusted.squares[0])
        return 1.0 / np.sqrt(worse) if worse > 0.0 else np.inf


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
    _require_enough(sights, problem_of(sights, method, plane, equal), method)
    if near is not None and (solution := _oriented_near(sights, method, plane, near, equal)) is not None:
        return solution
    try:
        oriented = _oriented(sights, method, plane, base, equal)
    except OrientationError:
        _require_agreement(sights, method, plane, equal, len(sights.points))
        raise
    if oriented.outliers.any():
        _require_agreement(sights, method, plane, equal, int(oriented.outliers.sum()))
    return oriented


def _require_agreement(sights: Sights, method: Method, plane: WaterPlane, equal: bool, outliers: int) -> None:
    """Raise `OrientationError` where the images fit another plane than the given one, and with fewer outliers.

    That it is another is tested by the difference of both, in the covariances of both, 0 of what is held.
    """
    treatment, held = plane.treatment, plane.treatment is PlaneTreatment.KNOWN
    sigmas = np.array([plane.slope_sigma or 0.0, plane.slope_sigma or 0.0, plane.level_sigma or 0.0])
    tilted = treatment is not PlaneTreatment.ADJUST
    given = (sigmas > 0.0) | [tilted, tilted, held]
    if method.in_model or not given.any():
        return
    alone = replace(
        plane, treatment=PlaneTreatment.ADJUST, slope=(0.0, 0.0), slope_sigma=None, level=None, level_sigma=None
    )
    problem = problem_of(sights, method, alone)
    if redundancy_of(problem) < 0:
        return
    try:
        unaided = _oriented(sights, method, alone, 1.0, equal)
    except OrientationError:
        return
    water = slice(len(problem.unknown) - WATER, len(problem.unknown) - 1)
    values = np.array([*plane.slope, plane.level or 0.0])
    difference = (unaided.at.vector[water] - values)[given]
    covariance = (unaided.covariance[water, water] + np.diag(sigmas**2))[np.ix_(given, given)]
    square = float(difference @ np.linalg.solve(covariance, difference))
    if np.count_nonzero(unaided.outliers) < outliers and chdtrc(len(difference), square) < _SIGNIFICANCE:
        names = np.array(OF_WATER[:3])[given]
        parts = [
            f"{name} {value:.4g}, by them alone {other:.4g}"
            for name, value, other in zip(names, values[given], values[given] + difference, strict=True)
        ]
        raise OrientationError(f"{method.name}: the images contradict the water that is given: {'; '.join(parts)}")


def _oriented_near(
    sights: Sights, method: Method, plane: WaterPlane, near: Orientation, equal: bool
) -> Oriented | None:
    """Return the orientation from one start (1,), with few outliers; None where it leads nowhere."""
    problem = problem_of(sights, method, plane, equal)
    if (solution := _fitting(sights, method, problem, refined(problem, near))) is not None:
        return solution
    tested = snooped(sights, method, plane, near)
    if tested is not None and np.mean(tested[0]) < _FEW:
        with suppress(OrientationError):
            return _without_outliers(sights, method, plane, equal, tested)
    return None


def _oriented(sights: Sights, method: Method, plane: WaterPlane, base: float, equal: bool) -> Oriented:
    """Return the orientation by all sights, or by those that are left without outliers."""
    problem = problem_of(sights, method, plane, equal)
    starts = method.starts(sights, plane, base)
    if not len(starts.level):
        raise OrientationError(f"{method.name}: no solution for air to start from; images or control contradict")
    order = np.argsort(np.median(misfits(problem, starts), axis=-1))
    for count in _TRIED:
        if (solution := _fitting(sights, method, problem, adjust(problem, starts[order[:count]]))) is not None:
            return solution
    tested = outlying(sights, method, plane, starts[order])
    try:
        return _without_outliers(sights, method, plane, equal, tested)
    except NotConvergedError:
        if (solution := _adrift(sights, method, problem, adjust(problem, starts[order]))) is None:
            raise
        return solution


def _adrift(sights: Sights, method: Method, problem: HelmertProblem, adjusted: Adjusted) -> Oriented | None:
    """Return the best place that an adjustment has come to which fits though it does not come to rest there.

    What the images do not determine goes on and on, and they fit as well: None where they do not.
    """
    anywhere = replace(adjusted, converged=np.isfinite(adjusted.squares))
    best = _best(problem, anywhere)
    if best is None:
        return None
    nowhere = replace(best, converged=np.zeros(1, dtype=bool))
    solution = _described(sights, method, problem, nowhere, np.zeros(len(sights.points), dtype=bool))
    return solution if solution.fits and solution.redundancy else None


def _require_enough(sights: Sights, problem: HelmertProblem, method: Method) -> None:
    """Raise `OrientationError` where conditions are fewer than unknowns, or shared points than a start takes.

    And for equal weights beside prior sigmas, which the conditions of the paper know nothing of.
    """
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
        raise OrientationError(f"{method.name}: {'; '.join(faults)}")


def _of_water(directions: list[Direction]) -> bool:
    """Return whether any of these directions moves the plane of water."""
    return any(direction.moves_water for direction in directions)


def _fitting(sights: Sights, method: Method, problem: HelmertProblem, adjusted: Adjusted) -> Oriented | None:
    """Return the best of the solutions, None where it does not fit."""
    best = _best(problem, adjusted)
    if best is None:
        return None
    solution = _described(sights, method, problem, best, np.zeros(len(sights.points), dtype=bool))
    return solution if solution.fits else None


def _best(problem: HelmertProblem, adjusted: Adjusted) -> Adjusted | None:
    """Return the converged solution of least squares that is not to be rejected, None where there is none."""
    possible = adjusted.converged & ~rejections(problem, adjusted).any(axis=1)
    squares = np.where(possible, adjusted.squares, np.inf)
    row = int(np.argmin(squares))
    return adjusted[row] if np.isfinite(squares[row]) else None


def _without_outliers(
    sights: Sights, method: Method, plane: WaterPlane, equal: bool, tested: tuple[BoolArray, Adjusted] | None
) -> Oriented:
    """Return the orientation without the points (p,) that do not fit that of the others."""
    if tested is not None:
        outliers, near = tested
        left = without(sights, outliers)
        problem = problem_of(left, method, plane, equal)
        adjusted = adjust(problem, near.at) if equal else near
        reasons = [reason for reason, holds in zip(REASONS, rejections(problem, adjusted)[0], strict=True) if holds]
        if reasons:
            raise OrientationError(f"{method.name}: no solution is possible; of the best {', and '.join(reasons)}")
        out, count = int(outliers.sum()), len(np.unique(sights.point))
        if 2 * out > count:
            raise OrientationError(f"{method.name}: no orientation fits more than {count - out} of {count} points")
        if adjusted.converged[0]:
            return _described(left, method, problem, adjusted, outliers)
    fault = f"{method.name}: the adjustment does not converge from any start"
    if _in_line(sights, method):
        fault += ": the points lie on a line, about which all else may turn: not determined; points off it hold it"
    raise NotConvergedError(fault)


def _in_line(sights: Sights, method: Method) -> bool:
    """Return whether all points that hold the photos lie on a line: on the ground, or in every photo of a model."""
    sets = [sights.image[sights.photo == photo] for photo in range(method.photos)]
    if not method.in_model:
        sets = [sights.control[np.isfinite(sights.control).all(axis=1)]]
    extents = [np.linalg.svd(places - places.mean(axis=0), compute_uv=False) for places in sets if len(places)]
    return all(extent[1] <= _LINE * extent[0] for extent in extents)


def _described(
    sights: Sights, method: Method, problem: HelmertProblem, adjusted: Adjusted, outliers: BoolArray
) -> Oriented:
    """Return a solution with its precision and reliability."""
    covariance = covariance_of(problem, adjusted)
    return Oriented(
        sights=sights,
        method=method,
        problem=problem,
        adjusted=adjusted,
        outliers=outliers,
        redundancy=redundancy_of(problem),
        covariance=covariance,
        image_redundancy=redundancy_numbers(problem, adjusted),
    )
