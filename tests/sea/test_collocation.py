"""Collocation: against independent formulations, brute force, simulation, and what it is the limit of."""

from dataclasses import replace

import numpy as np
import pytest

from musatpy.errors import CollocationError
from musatpy.sea.interpolation.correlation import Correlation, SignalKind
from musatpy.sea.interpolation.estimation import empirical, estimate, extent, spacing, wave_vectors
from musatpy.sea.interpolation.interpolate import Benefit, InterpolationOptions, interpolate
from musatpy.sea.interpolation.likelihood import Likelihood, uncertain, unknowns_of
from musatpy.sea.interpolation.prediction import (
    JITTER,
    MOST_CONTROL,
    Collocation,
    Covariance,
    Observed,
    Trend,
    lags,
)

CORRELATIONS = {
    SignalKind.GAUSSIAN: (np.log(80.0),),
    SignalKind.EXPONENTIAL: (np.log(60.0),),
    SignalKind.ELLIPTIC: (np.log(150.0), np.log(40.0), 0.6),
    SignalKind.BESSEL: (np.log(90.0), np.log(300.0)),
    SignalKind.SWELL: (0.008, 0.006, np.log(300.0)),
}


def correlation(family: SignalKind) -> Correlation:
    return Correlation(family=family, parameters=tuple(float(value) for value in CORRELATIONS[family]))


def covariance(family: SignalKind = SignalKind.GAUSSIAN, signal: float = 0.09, noise: float = 0.01) -> Covariance:
    return Covariance(signal=signal, noise=noise, correlation=correlation(family))


def places(count: int, seed: int = 5) -> np.ndarray:
    return np.random.default_rng(seed).uniform([0.0, -200.0], [300.0, 200.0], (count, 2))


def observed(count: int = 40, seed: int = 5, sigma: float = 0.0) -> Observed:
    place = places(count, seed)
    value = 0.3 * np.sin(place[:, 0] / 30.0) + 0.2 * np.cos(place[:, 1] / 50.0) + 0.1
    return Observed(place=place, value=value, sigma=np.full(count, sigma))


def drawn(cov: Covariance, place: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a signal (n,) with the given covariance."""
    C = cov.signal * cov.correlation(lags(place, place))
    return np.linalg.cholesky(C + 1e-9 * cov.signal * np.eye(len(place))) @ rng.normal(size=len(place))


@pytest.mark.parametrize("family", CORRELATIONS)
def test_a_correlation_is_positive_definite_and_small_beyond_its_reach(family: SignalKind) -> None:
    place, given = places(60), correlation(family)
    R = given(lags(place, place))
    assert np.array_equal(np.diag(R), np.ones(60)) and np.array_equal(R, given.with_partials(lags(place, place))[0])
    assert np.linalg.eigvalsh(R)[0] > -1e-12  # rounding of sixty values of one
    direction = np.array([1.0, 0.0]) if family != SignalKind.ELLIPTIC else np.array([np.cos(0.6), np.sin(0.6)])
    before, at = (float(given(given.reach() * part * direction)) for part in (0.95, 1.001))
    assert at < 0.1 and (before > 0.1 or family == SignalKind.SWELL)  # of a swell the envelope is at the limit


def joint_prediction(
    data: Observed, cov: Covariance, place: np.ndarray, trend: Trend
) -> tuple[np.ndarray, np.ndarray]:
    """Return value and sigma from one joint normal distribution of everything, the trend with a vague prior.

    Nothing of `prediction` is used: the trend is a random vector of huge variance, the rest is conditioning.
    """
    rows = [np.ones(len(data.value) + len(place))]
    every = np.vstack([data.place, place])
    if trend == Trend.PLANE:
        rows += [every[:, 0] / 300.0, every[:, 1] / 300.0]
    A = np.stack(rows, axis=1)
    difference = every[:, None] - every[None]
    K = cov.signal * cov.correlation(difference) + 1e6 * A @ A.T
    n = len(data.value)
    C = K[:n, :n] + np.diag(cov.noise + data.sigma**2 + JITTER * cov.signal)
    gain = np.linalg.solve(C, K[:n, n:]).T
    return gain @ data.value, np.sqrt(np.diag(K[n:, n:] - gain @ K[:n, n:]))


@pytest.mark.parametrize("trend", Trend)
@pytest.mark.parametrize("family", CORRELATIONS)
def test_prediction_is_the_conditional_mean_of_a_joint_normal_distribution(
    family: SignalKind, trend: Trend
) -> None:
    data, cov, at = observed(30, sigma=0.05), covariance(family), places(20, seed=8)
    value, sigma = joint_prediction(data, cov, at, trend)
    found = Collocation(data, cov, trend).predict(at)
    # a prior variance of 1e6 against 0.1 costs the joint system seven of its sixteen digits, a root half the rest
    assert np.abs(found.value - value).max() < 1e-6
    assert np.abs(found.sigma - sigma).max() < 1e-5
    assert np.allclose(
        found.distance, np.sqrt(((at[:, None] - data.place) ** 2).sum(axis=-1)).min(axis=1), atol=1e-9
    )


def test_blocks_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    found, at = uncertain(Collocation(observed(30), covariance()), True), places(100, seed=9)
    whole = found.predict(at)
    monkeypatch.setattr("musatpy.sea.interpolation.prediction._BLOCK", 30 * 7)
    assert len(found.collocation._parts(at)) == 15
    parts = found.predict(at)
    # other shapes of one product: another order of its sums
    assert np.abs(parts.value - whole.value).max() < 1e-12
    assert np.abs(parts.sigma - whole.sigma).max() < 1e-12
    assert len(found.predict(np.empty((0, 2))).value) == 0


@pytest.mark.parametrize("trend", Trend)
def test_closed_cross_validation_is_leaving_out_one_by_one(trend: Trend) -> None:
    data, cov = observed(25, sigma=0.03), covariance()
    closed = Collocation(data, cov, trend).cross_validation
    for row in range(25):
        kept = np.arange(25) != row
        one = Collocation(data[kept], cov, trend).predict(data.place[row : row + 1])
        # both solve a system of condition 1e3 or so
        assert closed.error[row] == pytest.approx(data.value[row] - one.value[0], abs=1e-10)
        noise = cov.noise + data.sigma[row] ** 2 + JITTER * cov.signal
        assert closed.sigma[row] ** 2 == pytest.approx(one.sigma[0] ** 2 + noise, abs=1e-10)


@pytest.mark.parametrize("free_noise", [True, False])
@pytest.mark.parametrize("family", [SignalKind.NONE, *CORRELATIONS])
def test_partials_of_the_likelihood_are_those_of_central_differences(family: SignalKind, free_noise: bool) -> None:
    parameters = () if family == SignalKind.NONE else correlation(family).parameters
    cov = Covariance(signal=0.09, noise=0.01, correlation=Correlation(family=family, parameters=parameters))
    likelihood = Likelihood(observed(30, sigma=0.1), Trend.PLANE, family, free_noise=free_noise)
    unknowns = unknowns_of(cov, free_noise)
    _, slope = likelihood(unknowns)
    for row in range(len(unknowns)):
        step = np.zeros(len(unknowns))
        step[row] = 1e-5 * max(abs(unknowns[row]), 1e-2)
        numerical = (likelihood(unknowns + step)[0] - likelihood(unknowns - step)[0]) / (2.0 * step[row])
        # values of some tens over steps of 1e-5 and less
        assert slope[row] == pytest.approx(numerical, rel=1e-5, abs=1e-5)


def test_the_likelihood_is_that_of_contrasts() -> None:
    """The restricted likelihood is that of n - u combinations without a trend, whichever: those of a QR here."""
    data, cov = observed(20, sigma=0.05), covariance()
    A = np.column_stack([np.ones(20), data.place])
    Q = np.linalg.qr(A, mode="complete")[0][:, 3:]
    C = cov.signal * cov.correlation(lags(data.place, data.place)) + np.diag(cov.noise + data.sigma**2)
    from scipy.stats import multivariate_normal

    expected, found = [], []
    for scale in (1.0, 1.3):
        expected.append(-multivariate_normal(np.zeros(17), scale * Q.T @ C @ Q).logpdf(Q.T @ data.value))
        blown = replace(data, sigma=data.sigma * np.sqrt(scale))
        likelihood = Likelihood(blown, Trend.PLANE, SignalKind.GAUSSIAN, free_noise=True)
        scaled = Covariance(signal=scale * cov.signal, noise=scale * cov.noise, correlation=cov.correlation)
        found.append(likelihood(unknowns_of(scaled, True))[0])
    # they differ by a constant, the size of the contrasts; the jitter moves the tenth digit
    assert found[1] - found[0] == pytest.approx(expected[1] - expected[0], abs=1e-6)


def test_covariances_of_a_known_process_are_found_again() -> None:
    rng, cov, place = np.random.default_rng(3), covariance(SignalKind.GAUSSIAN), places(150)
    sums, count = np.zeros(6), 60
    for _ in range(count):
        value = drawn(cov, place, rng) + rng.normal(0.0, 0.1, 150)
        table = empirical(place, value, width=25.0, classes=5)
        sums += table.covariance
    expected = cov.signal * np.exp(-((table.distance / 80.0) ** 2))
    expected[0] += 0.01
    # the signal has some ten independent patches: 0.09 sqrt(2 / 10 / 60) = 0.005 of standard error; three of these
    assert np.abs(sums / count - expected).max() < 0.016
    assert table.pairs[0] == 150 and table.distance[0] == 0.0
    every = np.sqrt(((place[:, None] - place) ** 2).sum(axis=-1))[np.triu_indices(150, 1)]
    assert table.pairs[1:].tolist() == np.histogram(every, np.arange(6) * 25.0)[0].tolist()


@pytest.mark.parametrize("family", [SignalKind.GAUSSIAN, pytest.param(SignalKind.BESSEL, marks=pytest.mark.slow)])
def test_an_estimate_comes_near_the_covariance_drawn_from(family: SignalKind) -> None:
    rng, place = np.random.default_rng(21), places(180)
    value = drawn(covariance(family), place, rng) + rng.normal(0.0, 0.1, 180)
    data = Observed(place=place, value=value, sigma=np.zeros(180))
    found = estimate(data, Trend.CONSTANT, family, free_noise=True).covariance
    # noise from 180 points: 1 / sqrt(360) of it; lengths and waves from some ten patches
    assert found.noise**0.5 == pytest.approx(0.1, rel=0.2)
    assert np.exp(found.correlation.parameters[0]) == pytest.approx(
        np.exp(CORRELATIONS[family][0]), rel=0.35 if family == SignalKind.GAUSSIAN else 0.05
    )


def test_a_swell_is_found_with_its_length_and_direction() -> None:
    place, rng = places(40), np.random.default_rng(4)
    wave = np.array([0.011, 0.006])
    value = 0.4 * np.cos(2.0 * np.pi * place @ wave + 1.0) + rng.normal(0.0, 0.05, 40)
    data = Observed(place=place, value=value, sigma=np.zeros(40))
    peak = wave_vectors(place, value - value.mean(), spacing(place), extent(place))[0]
    assert min(np.hypot(*(peak - wave)), np.hypot(*(peak + wave))) < 0.4 / extent(place)  # a mesh
    found = interpolate(data)
    assert found.best.family == SignalKind.SWELL
    p = np.array(found.best.estimate.covariance.correlation.parameters[:2])
    # a wave of 0.4 m in noise of 0.05 m, 40 points over 500 m: about 0.05 / 0.4 / sqrt(40) / 500 cycles per m
    assert min(np.hypot(*(p - wave)), np.hypot(*(p + wave))) < 3e-4
    assert found.verdict == Benefit.HELPS and found.removed > 0.7
    at = places(200, seed=30)
    truth = 0.4 * np.cos(2.0 * np.pi * at @ wave + 1.0)
    assert np.sqrt(np.mean((found.uncertain.predict(at).value - truth) ** 2)) < 0.05


def test_the_sigma_of_an_estimated_wave_is_larger_than_of_a_given_one() -> None:
    place = places(25)
    value = 0.4 * np.cos(2.0 * np.pi * place @ [0.011, 0.006]) + np.random.default_rng(6).normal(0.0, 0.1, 25)
    found = interpolate(
        Observed(place=place, value=value, sigma=np.zeros(25)),
        InterpolationOptions(families=(SignalKind.SWELL,)),
    )
    away = np.array([[600.0, 0.0]])  # three hundred m outside: a wrong length shows most there
    assert found.uncertain.predict(away).sigma[0] > 1.3 * found.collocation.predict(away).sigma[0]
    assert np.array_equal(found.uncertain.predict(away).value, found.collocation.predict(away).value)


def test_sigmas_given_are_used_without_noise() -> None:
    data = observed(40, sigma=0.02)
    found = interpolate(data, InterpolationOptions(free_noise=False, families=(SignalKind.GAUSSIAN,)))
    assert found.best.estimate.covariance.noise == 0.0
    weak = np.where(np.arange(40) == 0, 5.0, 0.02)
    spoiled = replace(data, value=data.value + 3.0 * (np.arange(40) == 0), sigma=weak)
    at = places(50, seed=3)
    first, second = (Collocation(one, found.best.estimate.covariance).predict(at).value for one in (data, spoiled))
    rest = Collocation(data[np.arange(40) > 0], found.best.estimate.covariance).predict(at).value
    assert np.abs(second - rest).max() < 0.01 < np.abs(first).max()  # a point of 5 m counts for next to nothing


def test_control_points_that_are_measured_twice_are_no_error() -> None:
    data = observed(30)
    twice = Observed(
        place=np.tile(data.place, (2, 1)),
        value=np.concatenate([data.value, data.value + 0.01]),
        sigma=np.tile(data.sigma, 2),
    )
    assert spacing(twice.place) == spacing(data.place) > 0.0
    found = interpolate(twice, InterpolationOptions(families=(SignalKind.GAUSSIAN,)))
    assert np.isfinite(found.grouped.rms)


@pytest.mark.parametrize(
    ("given", "trend", "message"),
    [
        (observed(2), Trend.CONSTANT, "too few: a constant as trend needs 3"),
        (observed(4), Trend.PLANE, "too few: a plane as trend needs 5"),
        (observed(MOST_CONTROL + 1), Trend.CONSTANT, f"at most {MOST_CONTROL}"),
        (observed(10)[np.array([0, 0, 1, 2, 3])], Trend.CONSTANT, "singular"),
        (Observed(place=np.arange(10.0)[:, None] * [1.0, 2.0], value=np.ones(10), sigma=np.zeros(10)), Trend.PLANE,
         "stand in a line"),
    ],
)  # fmt: skip
def test_control_points_that_do_not_do(given: Observed, trend: Trend, message: str) -> None:
    noise = 0.0 if message == "singular" else 0.01
    with pytest.raises(CollocationError, match=message):
        Collocation(given, covariance(signal=0.0 if not noise else 0.09, noise=noise), trend)
