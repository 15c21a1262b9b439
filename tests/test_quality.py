"""The tests of a solution against scipy.stats, and against what their definitions say."""

import numpy as np
import pytest
from scipy import stats

from musatpy.model import ObservationKind
from musatpy.probability import probability_beyond, quantile
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import ellipses
from musatpy.statistics.quality import ALPHA, BETA, DETECTABLE, TEST_LIMIT, check_test, chi_square
from sample_solutions import sample_solution


def test_limits_of_a_variance_factor() -> None:
    found = chi_square(31.0, 24.0)
    assert found.factor == pytest.approx(31.0 / 24.0)
    np.testing.assert_allclose([found.low, found.high], stats.chi2.ppf([0.025, 0.975], 24.0) / 24.0)
    assert found.accepted
    assert not chi_square(60.0, 24.0).accepted
    assert not chi_square(5.0, 24.0).accepted


def test_baardas_constants() -> None:
    assert pytest.approx(stats.norm.ppf(1.0 - ALPHA / 2.0), abs=1e-12) == TEST_LIMIT
    assert pytest.approx(TEST_LIMIT + stats.norm.ppf(BETA), abs=1e-12) == DETECTABLE
    assert pytest.approx(4.13, abs=5e-3) == DETECTABLE  # as printed by Baarda (1968)


@pytest.mark.parametrize("freedom", [0.05, 0.5, 1.0, 2.0, 3.0, 7.3, 24.0, 171.0, 2500.0, 130000.0])
def test_chi_square_is_that_of_the_library(freedom: float) -> None:
    for p in (1e-3, 0.025, 0.3, 0.5, 0.9, 0.975, 0.999):
        # near 1e-12 the logarithms of large numbers have no more digits
        assert quantile(p, freedom) == pytest.approx(stats.chi2.ppf(p, freedom), rel=1e-9)
        squares = float(stats.chi2.ppf(p, freedom))
        assert probability_beyond(squares, freedom) == pytest.approx(1.0 - p, rel=1e-9)
    assert probability_beyond(0.0, freedom) == 1.0


def test_test_values_are_students_of_the_residual_without_itself() -> None:
    quality = Statistics(sample_solution())
    f = quality.solution.degrees_of_freedom
    tau = quality.standardised / quality.solution.sigma0
    np.testing.assert_allclose(quality.test, tau * np.sqrt((f - 1) / (f - tau**2)))
    assert np.isnan(quality.test[0])  # of no redundancy
    order = np.abs(quality.test[quality.worst_first])
    assert (np.diff(np.round(order[np.isfinite(order)], 2)) <= 0.0).all()  # as they are printed
    assert np.isnan(order[-1])


def test_variance_components_share_out_the_squares() -> None:
    quality = Statistics(sample_solution())
    observed = quality.observed
    squares = np.square(observed.residual / observed.sigma).sum()
    total = sum(one.factor * one.redundancy for one in quality.components.values())
    assert total == pytest.approx(squares)


def test_check_points_against_their_covariance() -> None:
    rng = np.random.default_rng(2)
    root = rng.normal(size=(4000, 3, 3))
    covariance = root @ np.swapaxes(root, 1, 2)
    difference = np.einsum("cij,cj->ci", root, rng.normal(size=(4000, 3)))
    difference[::2, 2] = np.nan
    found = check_test(np.arange(4000), difference, covariance)
    assert found.components.tolist() == [2, 3] * 2000
    # right probabilities are evenly spread; the limit is that of a sample of 4000 at one in a thousand
    assert stats.kstest(found.probability, "uniform").pvalue > 1e-3
    assert found.total is not None and found.total.accepted
    assert not check_test(np.arange(4000), 2.0 * difference, covariance).total.accepted
    covariance[3] = np.nan
    assert check_test(np.arange(4000), difference, covariance).components[3] == 0


def test_ellipses_have_the_axes_of_the_covariance() -> None:
    angle, a, b = 0.7, 3.0, 1.0  # bearing from north
    along = np.array([np.sin(angle), np.cos(angle), 0.0])
    across = np.array([np.cos(angle), -np.sin(angle), 0.0])
    C = a**2 * np.outer(along, along) + b**2 * np.outer(across, across)
    C[2, 2] = 4.0
    found = ellipses(C[None])
    np.testing.assert_allclose([found.major[0], found.minor[0], found.bearing[0]], [a, b, angle])
    assert found.vertical[0] == 2.0
    assert np.isnan(ellipses(np.full((1, 3, 3), np.nan)).major[0])


def test_control_has_the_tests_of_its_observations() -> None:
    statistics = Statistics(sample_solution())
    observed, rows = statistics.observed, statistics.control_tests
    control = np.flatnonzero(observed.kind == ObservationKind.CONTROL)
    assert len(control) and np.count_nonzero(np.isfinite(rows)) == len(control)
    for row in control.tolist():
        test = rows[observed.row[row], observed.component[row]]
        share = observed.residual[row] / observed.sigma[row] / np.sqrt(observed.redundancy[row])
        assert np.sign(test) == np.sign(share) and abs(test) >= abs(share) - 1e-12


def test_residuals_of_control_are_those_of_what_took_part() -> None:
    statistics = Statistics(sample_solution())
    control, analysis = statistics.block.control, statistics.control_residuals
    for axis, found in enumerate(analysis.statistics):
        used = statistics.block.control.known[:, axis] & ~control.fixed
        d = statistics.control_difference[used, axis]
        d = d[np.isfinite(d)]
        assert found.size == len(d) > 0
        assert found.rms == pytest.approx(np.sqrt(np.mean(d**2)))
    assert control.fixed.any()


def test_an_estimated_error_is_what_the_others_say_of_an_observation() -> None:
    """An observation that is left out has the residual v / r, with the sign of adjusted minus observed."""
    statistics = Statistics(sample_solution())
    observed, error = statistics.observed, statistics.estimated_error
    known = statistics.testable
    np.testing.assert_allclose(error[known], -observed.residual[known] / observed.redundancy[known])
    assert np.isnan(error[~known]).all()
