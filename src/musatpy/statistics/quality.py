"""Tests of a solution: of sigma0, of single observations, of groups of them, of check points; error ellipses.

Sources: Baarda (1968) for the standardised residual and the smallest detectable error, Pope (1976) for the test
with an estimated sigma0, Foerstner (1979) for variance components. Levels of significance are named constants.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import Dependence, ObservationKind, Observations, Solution
from musatpy.model.ranking import falling
from musatpy.probability import normal_quantile, probability_beyond, quantile, students_of_pope

SIGMA0_LEVEL = 0.95  # of the two-sided tests of sigma0 and of variance components
ALPHA, BETA = 0.001, 0.80  # significance and power behind the smallest detectable errors
TEST_LIMIT = 3.290526731491894  # normal quantile of 1 - ALPHA / 2: test values beyond it are suspicious
POWER = 0.8416212335729143  # and that of BETA
DETECTABLE = TEST_LIMIT + POWER  # 4.13 sigmas of the residual
TEST_DECIMALS = 2  # with which test values are printed
FAMILY_RISK = 0.01  # that any observation of a clean run fails the test of the verdict
_ROUNDING = 1e-5  # redundancy numbers of control below are rounding
_UNCHECKED = 0.01  # redundancy numbers below: errors ten times the detectable ones of others would not show
_CONTROL, _PLATE = ObservationKind.CONTROL, ObservationKind.PLATE
_UP = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class ChiSquare:
    """A variance factor with its two-sided test: accepted within the limits."""

    factor: float  # v'Pv / redundancy
    redundancy: float
    low: float
    high: float

    @property
    def accepted(self) -> bool:
        """True where the factor agrees with 1."""
        return self.low <= self.factor <= self.high


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckTest:
    """Check points against their own covariance: that of the adjusted position and, where given, of the card."""

    row: IntArray  # (c,) link to Control
    squares: FloatArray  # (c,) d' C^-1 d
    components: IntArray  # (c,) how many of east, north, up were given
    probability: FloatArray  # (c,) of squares as large or larger by chance
    total: ChiSquare | None  # None without check points


@dataclass(frozen=True, kw_only=True, eq=False)
class Ellipses:
    """Standard error ellipses (n,): semi-axes in m, and the bearing of the longer one, rad from north to east."""

    major: FloatArray
    minor: FloatArray
    bearing: FloatArray
    vertical: FloatArray  # sigma of the height


@dataclass(frozen=True, eq=False)
class Quality:
    """The tests of one solution, each computed when it is first asked for. NaN where nothing checks."""

    solution: Solution

    @cached_property
    def observed(self) -> Observations:
        """The observations. Raises `ValueError` for a solution that carries none."""
        if self.solution.observed is None:
            raise ValueError("the solution carries no observations")
        return self.solution.observed

    @cached_property
    def dependence(self) -> Dependence:
        """The dependence of the unknowns. Raises `ValueError` for a solution that carries none."""
        if self.solution.dependence is None:
            raise ValueError("the solution carries no dependence of its unknowns")
        return self.solution.dependence

    @cached_property
    def sigma0(self) -> ChiSquare | None:
        """The test of sigma0 squared, considered water allowed for; None without redundancy."""
        solution, dof = self.solution, self.solution.degrees_of_freedom
        return chi_square(solution.unit_sigma**2 * dof, dof) if dof > 0 else None

    @cached_property
    def checked(self) -> BoolArray:
        """(o,) True for observations that others check."""
        return self.observed.redundancy > _UNCHECKED

    @cached_property
    def testable(self) -> BoolArray:
        """(o,) True for observations that are checked, and for control that is held almost without error.

        Of such control, residual and sigma of the residual vanish alike: their ratio still tells a wrong card.
        """
        control = self.observed.kind == _CONTROL
        return self.checked | (control & (self.observed.redundancy > _ROUNDING))

    @cached_property
    def standardised(self) -> FloatArray:
        """(o,) residual over its own a priori sigma, that of considered water in it: Baarda's test value."""
        observed = self.observed
        share = np.sqrt(np.where(self.checked, observed.share, np.nan))
        return observed.residual / (observed.sigma * share)

    @cached_property
    def test(self) -> FloatArray:
        """(o,) residual over its own sigma with sigma0 from all others: Student's t of f - 1 degrees of freedom."""
        f = self.solution.degrees_of_freedom
        if f < 2:
            return np.full(len(self.observed.kind), np.nan)
        return students_of_pope(self.standardised / self.solution.unit_sigma, f)

    @cached_property
    def detectable(self) -> FloatArray:
        """(o,) smallest error that the test of the observation finds with the power `BETA`, in its unit."""
        observed = self.observed
        return DETECTABLE * observed.sigma / np.where(self.checked, observed.visibility, np.nan)

    @cached_property
    def estimated_error(self) -> FloatArray:
        """(o,) the error that an observation has if all others are right, in its unit: -v / r (Baarda 1968)."""
        observed = self.observed
        with np.errstate(divide="ignore", invalid="ignore"):
            return -observed.residual / np.where(self.testable, observed.redundancy, np.nan)

    @cached_property
    def effect(self) -> FloatArray:
        """(o, 3) m, what that error, not found, does to the own position: external reliability."""
        return self.observed.influence * self.detectable[:, None]

    @cached_property
    def worst_first(self) -> IntArray:
        """(o,) rows of the observations by falling test value; those without one last."""
        return falling(np.abs(self.test), TEST_DECIMALS)

    @cached_property
    def components(self) -> dict[str, ChiSquare]:
        """Variance components by group: v'Pv over what it is on average, the sum of the redundancy numbers.

        Considered water adds to both.
        """
        observed = self.observed
        squares = np.square(observed.residual / observed.sigma)
        tests = {}
        for name, rows in self._groups().items():
            redundancy = float(observed.redundancy[rows].sum())
            if rows.any() and redundancy > 0.0:
                added = float(observed.share[rows].sum()) - redundancy
                tests[name] = chi_square(float(squares[rows].sum()), redundancy, added)
        return tests

    def _groups(self) -> dict[str, BoolArray]:
        observed, block = self.observed, self.solution.block
        kind, plate = observed.kind, observed.kind == _PLATE
        submerged = np.zeros(len(kind), dtype=bool)
        submerged[plate] = block.points.bathymetric[block.plates.point[observed.row[plate]]]
        up = observed.component == _UP
        return {
            "plate coordinates, land": plate & ~submerged,
            "plate coordinates, submerged": submerged,
            "horizontal control": (kind == _CONTROL) & ~up,
            "vertical control": (kind == _CONTROL) & up,
            **{each.noun: kind == each for each in ObservationKind if each not in (_PLATE, _CONTROL)},
        }

    @cached_property
    def points(self) -> Ellipses:
        """Error ellipses of the ground points."""
        return ellipses(self.solution.points.covariance)

    @cached_property
    def stations(self) -> Ellipses:
        """Error ellipses of the exposure stations."""
        return ellipses(self.solution.stations.covariance[:, :3, :3])


def test_limit(count: int) -> float:
    """Return the limit of so many test values together: the risk of all of them is `FAMILY_RISK` (Bonferroni)."""
    return normal_quantile(1.0 - 0.5 * FAMILY_RISK / max(count, 1))


def chi_square(squares: float, redundancy: float, added: float = 0.0) -> ChiSquare:
    """Return the variance factor of a weighted sum of squares with the limits of its test.

    `added` is what one common error, of considered water, adds to the sum on average: it is then tested as a
    chi-square variable of the same mean and variance, times a factor (Satterthwaite 1946).
    """
    mean, variance = redundancy + added, 2.0 * (redundancy + 2.0 * added + added**2)
    tail, freedom = 0.5 * (1.0 - SIGMA0_LEVEL), 2.0 * mean**2 / variance
    low, high = (quantile(p, freedom) / freedom for p in (tail, 1.0 - tail))
    return ChiSquare(factor=squares / mean, redundancy=redundancy, low=low, high=high)


def check_test(rows: IntArray, difference: FloatArray, covariance: FloatArray) -> CheckTest:
    """Return the test of check points: rows (c,) of Control, adjusted minus given (c, 3) m, covariance (c, 3, 3).

    Components that are not given (NaN), and points without a covariance, are left out.
    """
    determined = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))
    given = np.isfinite(difference) & determined[:, None]
    # a component that is left out gets the variance 1 and the difference 0: it adds nothing
    both = given[:, :, None] & given[:, None, :]
    C = np.where(both, covariance, np.eye(3))
    d = np.where(given, difference, 0.0)
    squares = np.einsum("ci,ci->c", d, np.linalg.solve(C, d[..., None])[..., 0])
    components = given.sum(axis=1)
    pairs = zip(squares.tolist(), components.tolist(), strict=True)
    probability = np.array([probability_beyond(q, k) if k else np.nan for q, k in pairs])
    total = chi_square(float(squares.sum()), float(components.sum())) if components.any() else None
    return CheckTest(row=rows, squares=squares, components=components, probability=probability, total=total)


def owners(solution: Solution, kind: ObservationKind, rows: IntArray) -> list[list[str]]:
    """Return the ids of the photos and points that observations (r,) of a kind belong to, or their tide or wave."""
    water, ids = solution.water, None
    if kind.attribute:
        return kind.ids_of(solution.block, rows)
    if water and kind is ObservationKind.WATER_LEVEL:
        ids = water.correction_ids
    elif water and water.waves and kind is ObservationKind.WAVE:
        ids = water.waves.ids
    return [[] if ids is None else ids[row].split() for row in rows.tolist()]


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
