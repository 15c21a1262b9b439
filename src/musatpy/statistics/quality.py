"""Tests of a solution: of sigma0, of observations and groups of them, of what many have in common, of check points.

Sources: Baarda (1968) for the standardised residual, the smallest detectable error, and how far an error that no
test finds may move a point, its external reliability; Pope (1976) for the test with an estimated sigma0; Foerstner
(1979) for variance components. Levels of significance are named constants.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

import numpy as np

from musatpy import model
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.collinearity import attitude_matrix, turn_about_one_line
from musatpy.model.tables import Table, falling, per_row
from musatpy.probability import (
    probability_beyond,
    quantile,
    student_as_normal,
    students_of_pope,
    test_limit,
)
from musatpy.statistics.gates import FlagTests, flag_tests, metric_differences
from musatpy.units import DEGREE

SIGMA0_LEVEL = 0.95  # of the two-sided tests of sigma0 and of variance components
ALPHA, BETA = 0.001, 0.80  # significance and power behind the smallest detectable errors
TEST_LIMIT = 3.290526731491894  # normal quantile of 1 - ALPHA / 2: test values beyond it are suspicious
POWER = 0.8416212335729143  # and that of BETA
DETECTABLE = TEST_LIMIT + POWER  # 4.13 sigmas of the residual
TEST_DECIMALS = 2  # with which test values are printed
PRINTED_TEST = 0.005  # test values below print as zero: which one is the largest, is then rounding error
BEST_SIGMA0 = 0.2  # for tests: the residuals of decks without errors are rounding
SEEN = 1e-8  # of the squares of a column: what the residuals show below is rounding
FAR = 5.0  # sigmas of a point: what moves it farther and stays hidden makes it weakly checked
_DECIMALS = 1  # of sigmas, as they are printed
_BELIEVED = 4.0  # sigmas: no error that one may believe moves anything by more
_ROUNDING = 1e-5  # redundancy numbers of control, and of groups, below are rounding
_UNCHECKED = 0.01  # redundancy numbers below: errors ten times the detectable ones of others would not show
_CONTROL, _PLATE = model.ObservationKind.CONTROL, model.ObservationKind.PLATE
_UP = 2
_ONE_LINE = 1e-7  # rad from a phi of 90 degrees: nearer, the covariance has only what they have in common
_WIDE = 0.1  # rad: sigmas of omega and kappa that are no longer those of small angles


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
class CommonErrors(Table):
    """The tests of h parameters that are held; NaN where there is none."""

    held: model.HeldParameters
    limit: float  # of the tests, together at the level of `probability.FAMILY_RISK`
    test: FloatArray = per_row()  # (h,) normal
    estimated: FloatArray = per_row()  # (h,) given minus true, in its unit
    smallest: FloatArray = per_row()  # (h,) error that the test finds with the power `BETA`

    @property
    def tested(self) -> BoolArray:
        """(h,) True where there is a test."""
        return ~np.isnan(self.smallest)

    @property
    def beyond(self) -> IntArray:
        """The parameters beyond their tests, the worst first."""
        size = np.nan_to_num(np.abs(self.test))
        return falling(size, TEST_DECIMALS)[: np.count_nonzero(size > self.limit)]

    def moved_by(self, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return by how much errors (h,) move what they move most in its sigmas: (h, 3) m, and in sigmas."""
        return self.held.shift * error[:, None], self.held.sigmas * error[:, None]


@dataclass(frozen=True, kw_only=True, eq=False)
class HiddenErrors(Table):
    """What the largest error of an image or of the control of p points does to them while no test finds it."""

    shift: FloatArray = per_row()  # (p,) m, infinite where nothing checks an observation, NaN without a position
    sigmas: FloatArray = per_row()  # (p,) the same in sigmas of the coordinate that moves most of its own

    @property
    def worst_first(self) -> IntArray:
        """Rows of the points that have a shift, by falling sigmas."""
        return falling(self.sigmas, _DECIMALS)[: np.count_nonzero(~np.isnan(self.sigmas))]

    @property
    def weak(self) -> BoolArray:
        """(p,) True where a hidden error may move the point by more than `FAR` of its sigmas."""
        with np.errstate(invalid="ignore"):
            return self.sigmas > FAR


@dataclass(frozen=True, eq=False)
class Quality:
    """The tests of one solution, each computed when it is first asked for. NaN where nothing checks."""

    solution: model.Solution

    @property
    def block(self) -> model.Block:
        """The block that was adjusted."""
        return self.solution.block

    @cached_property
    def observed(self) -> model.Observations:
        """The observations. Raises `ValueError` for a solution that carries none."""
        if self.solution.observed is None:
            raise ValueError("the solution carries no observations")
        return self.solution.observed

    @cached_property
    def dependence(self) -> model.Dependence:
        """The dependence of the unknowns. Raises `ValueError` for a solution that carries none."""
        if self.solution.dependence is None:
            raise ValueError("the solution carries no dependence of its unknowns")
        return self.solution.dependence

    @cached_property
    def station_sigmas(self) -> FloatArray:
        """(n, 6) a posteriori: east, north, up (m), omega, phi, kappa (rad).

        NaN of omega and kappa where they turn about one line as far as anyone can tell: only their sum is known.
        """
        sigmas, attitude = sigmas_of(self.solution.stations.covariance), self.solution.stations.attitude
        wide = np.nanmax(sigmas[:, [3, 5]], axis=1, initial=0.0) > _WIDE
        together = turn_about_one_line(attitude, DEGREE) & wide | turn_about_one_line(attitude, _ONE_LINE)
        sigmas[together, 3] = sigmas[together, 5] = np.nan
        return sigmas

    @cached_property
    def station_rotations(self) -> FloatArray:
        """(n, 3, 3) M, from east, north, up at the station (X, Y, Z in local jobs) to the photo."""
        return attitude_matrix(self.solution.stations.attitude)

    @cached_property
    def point_sigmas(self) -> FloatArray:
        """(p, 3) m, a posteriori, along east, north, up (X, Y, Z in local jobs)."""
        return sigmas_of(self.solution.points.covariance)

    @cached_property
    def sigma0(self) -> ChiSquare | None:
        """The test of sigma0 squared, considered water allowed for; None without redundancy."""
        solution, dof = self.solution, self.solution.degrees_of_freedom
        return chi_square(solution.unit_sigma**2 * dof, dof) if dof > 0 else None

    @cached_property
    def tests_sigma0(self) -> bool:
        """True where sigma0 has a value that it should have: not where the plate sigma is a guess."""
        options = self.block.options
        equal = options.program is model.Program.IIA and options.weights is model.Weights.EQUAL
        return options.plate_sigma_is is model.PlateSigma.KNOWN and not equal

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
        return self._baarda(self.checked)

    def _baarda(self, tested: BoolArray) -> FloatArray:
        """Return Baarda's test values (o,) of the observations that are tested (o,), NaN of the others."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            share = np.sqrt(np.where(tested, self.observed.share, np.nan))
            return self.observed.residual / (self.observed.sigma * share)

    @cached_property
    def test(self) -> FloatArray:
        """(o,) residual over its own sigma with sigma0 from all others: Student's t of f - 1 degrees of freedom."""
        f = self.solution.degrees_of_freedom
        if f < 2:
            return np.full(len(self.observed.kind), np.nan)
        return students_of_pope(self.standardised / self.solution.unit_sigma, f)

    @cached_property
    def normal_tests(self) -> FloatArray:
        """(o,) test values of the observations as normal variables, NaN where nothing checks them.

        The larger of the residual over its a priori sigma (Baarda) and Student's t with sigma0 from all others
        (Pope), turned to a normal variable (Wallace 1959). Images alone have the second one where sigma0 is below
        1: what makes it small are plate sigmas that are too large, and control is as good as its cards say. Where
        the plate sigma is a guess, all have the second one only. Control that is held almost without error is
        tested as well: residual and sigma of the residual vanish alike.
        """
        return self._by_sigma0(self._baarda(self.testable), self.observed.kind == _PLATE)

    def _by_sigma0(self, baarda: FloatArray, images: BoolArray) -> FloatArray:
        """Return test values (o,) with the a priori sigma as `normal_tests` are; which are of `images` (o,)."""
        f = self.solution.degrees_of_freedom
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            tau = baarda / max(self.solution.unit_sigma, BEST_SIGMA0)
            student = np.full(len(tau), np.nan)
            if f >= 2:
                largest = 1e6 * np.sqrt(f - 1.0)  # of an infinite one too a test value is told
                student = student_as_normal(np.clip(students_of_pope(tau, f), -largest, largest), f - 1.0)
        if not self.tests_sigma0:
            return student
        if self.solution.unit_sigma < 1.0:
            student = np.where(images, student, baarda)
        return np.where(np.abs(student) > np.abs(baarda), student, baarda)

    @cached_property
    def worst_observations(self) -> IntArray:
        """Rows of the observations by falling `normal_tests`; those without one, or with zero, left out."""
        size = np.nan_to_num(np.abs(self.normal_tests), posinf=np.inf)
        return falling(size, TEST_DECIMALS)[: np.count_nonzero(size > PRINTED_TEST)]

    @cached_property
    def control_tests(self) -> FloatArray:
        """(k, 3) `normal_tests` of the components of every control card, NaN where there is none."""
        return self.of_table(_CONTROL, "normal_tests")

    def of_table(self, kind: model.ObservationKind, name: str) -> FloatArray:
        """Return (rows, components) an attribute of the observations of a kind, NaN where there is none."""
        out = np.full((getattr(self.block, kind.attribute).count, len(kind.components)), np.nan)
        if self.solution.observed is not None:
            rows = self.observed.kind == kind
            out[self.observed.row[rows], self.observed.component[rows]] = attrgetter(name)(self)[rows]
        return out

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
            if redundancy > _ROUNDING:
                added = float(observed.share[rows].sum()) - redundancy
                tests[name] = chi_square(float(squares[rows].sum()), redundancy, added)
        return tests

    def _groups(self) -> dict[str, BoolArray]:
        observed, block = self.observed, self.block
        kind, plate = observed.kind, observed.kind == _PLATE
        submerged = np.zeros(len(kind), dtype=bool)
        submerged[plate] = block.points.bathymetric[block.plates.point[observed.row[plate]]]
        up = observed.component == _UP
        return {
            "plate coordinates, land": plate & ~submerged,
            "plate coordinates, submerged": submerged,
            "horizontal control": (kind == _CONTROL) & ~up,
            "vertical control": (kind == _CONTROL) & up,
            **{each.noun: kind == each for each in model.ObservationKind if each not in (_PLATE, _CONTROL)},
        }

    @cached_property
    def common_errors(self) -> CommonErrors | None:
        """The tests of the parameters that are held; None where the solution says nothing of them.

        A parameter has no test where residuals show less than `SEEN` of its error, or none that is smaller than
        what anybody would believe of it. The limit is that of those that have one.
        """
        solution, held = self.solution, self.solution.held
        if held is None:
            return None
        seen = (held.redundant >= SEEN * held.whole) & (held.redundant > 0.0) & (solution.degrees_of_freedom > 0)
        redundant = np.where(seen, held.redundant, np.nan)
        deviation = np.sqrt(redundant + held.considered)  # of the pull
        # of the errors that these tests find, sigma0 is 1 but where the plate sigma is a guess
        sigma = (1.0 if self.tests_sigma0 else max(solution.unit_sigma, BEST_SIGMA0)) * deviation / redundant
        limit = test_limit(_tests(sigma / held.limit))
        smallest = (limit + POWER) * sigma
        with np.errstate(invalid="ignore"):
            smallest = np.where(smallest <= held.limit, smallest, np.nan)
        test = np.where(np.isnan(smallest), np.nan, held.pull / deviation)
        return CommonErrors(
            held=held,
            limit=limit,
            test=self._by_sigma0(test, np.zeros(len(test), dtype=bool)),
            estimated=np.where(np.isnan(smallest), np.nan, held.pull / redundant),
            smallest=smallest,
        )

    @cached_property
    def hidden(self) -> HiddenErrors:
        """How far errors that the tests of the verdict do not find may move the points."""
        block, observed = self.block, self.observed
        detectable = test_limit(int(self.testable.sum())) + POWER
        with np.errstate(divide="ignore", invalid="ignore"):
            error = detectable * observed.sigma / np.where(self.testable, observed.visibility, 0.0)
            effect = np.where(observed.influence == 0.0, 0.0, np.abs(observed.influence) * error[:, None])
        shift, sigmas = np.full((2, len(block.points.ids)), np.nan)
        for kind, table in ((_PLATE, block.plates), (_CONTROL, block.control)):
            rows = np.flatnonzero(observed.kind == kind)
            point = table.point[observed.row[rows]]
            with np.errstate(divide="ignore", invalid="ignore"):
                relative = effect[rows] / self.point_sigmas[point]
            np.fmax.at(shift, point, np.linalg.norm(effect[rows], axis=1))
            np.fmax.at(sigmas, point, np.nan_to_num(relative, nan=0.0, posinf=np.inf).max(axis=1))
        kept_out = self.solution.points.status == model.PointStatus.INTERSECTED  # no test has their images
        shift[kept_out] = sigmas[kept_out] = np.inf
        return HiddenErrors(shift=shift, sigmas=sigmas)

    @cached_property
    def flags(self) -> FlagTests:
        """The flags of the points against their heights."""
        return flag_tests(self.solution, self.point_sigmas)

    @cached_property
    def control_difference(self) -> FloatArray:
        """(k, 3) m, adjusted minus given of every control card along east, north, up (X, Y, Z in local jobs).

        NaN where a component is not given, or the point not determined.
        """
        control = self.block.control
        return metric_differences(self.block, control.position, self.solution.points.position[control.point])

    @property
    def check_sigma0(self) -> float:
        """Sigma0 as it scales the covariance of check points: not below 1, unless the plate sigma is a guess.

        Plate sigmas that are too large say nothing of the errors of the control.
        """
        unit_sigma = self.solution.unit_sigma
        return max(unit_sigma, 1.0) if self.tests_sigma0 else unit_sigma

    @cached_property
    def check_test(self) -> CheckTest:
        """The check points against their own covariance by `check_sigma0`, that of their cards included."""
        control, unit_sigma = self.block.control, self.solution.unit_sigma
        rows = np.flatnonzero(control.kind == model.ControlKind.CHECK)
        scale = (self.check_sigma0 / unit_sigma) ** 2 if unit_sigma > 0.0 else 1.0
        covariance = self.solution.points.covariance[control.point[rows]] * scale
        covariance = covariance + control.covariance[rows]
        return check_test(rows, self.control_difference[rows], covariance)


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


def untested(tested: BoolArray, moved: FloatArray, reference: FloatArray, believed: FloatArray) -> IntArray:
    """Return the parameters without a test an error of which may move something by over `_BELIEVED` of its sigmas.

    Of h parameters, with what their `reference` errors move (h, 3), in sigmas, and the largest that are `believed`.
    Those first whose reference error moves most.
    """
    most = np.nan_to_num(moved).max(axis=1, initial=0.0)
    named = ~tested & (most / reference * believed > _BELIEVED)
    return falling(np.where(named, most, -1.0), _DECIMALS)[: np.count_nonzero(named)]


def weakly_tested(moved: FloatArray) -> IntArray:
    """Return the parameters whose smallest error found moves something by over `_BELIEVED` of its sigmas (h, 3).

    The worst first.
    """
    most = np.nan_to_num(moved).max(axis=1, initial=0.0)
    return falling(most, _DECIMALS)[: np.count_nonzero(most > _BELIEVED)]


def _tests(sigma: FloatArray) -> int:
    """Return how many tests there are: the most that find errors within the range of their parameters.

    `sigma` (h,) are those of the estimated errors, in these ranges, NaN where nothing shows; more tests have a
    higher limit.
    """
    ordered = np.sort(sigma)  # NaN last
    counts = [count for count, most in enumerate(ordered, 1) if (test_limit(count) + POWER) * most <= 1.0]
    return max(counts, default=0)


def sigmas_of(covariance: FloatArray) -> FloatArray:
    """Return the roots of the diagonals (..., n) of covariances (..., n, n); rounding below zero counts as zero."""
    return np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0))
