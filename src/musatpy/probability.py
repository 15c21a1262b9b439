"""Distributions of the tests: chi-square, the normal one, and Student's t, by Pope's tau too.

By plain sums where every run asks: the library that has them all takes longer to load than a strip takes to adjust.
"""

from __future__ import annotations

import math

import numpy as np

from musatpy.arrays import FloatArray

FAMILY_RISK = 0.01  # that any of the tests of a clean run fails
FITS = 4.0  # normal quantile of the squares with which observations still fit
_RARE = 1e-6  # probability below which the difference from 1 has too few digits


def probability_beyond(squares: float, freedom: float) -> float:
    """Return the probability of a chi-square variable of `freedom` > 0 degrees to exceed `squares` >= 0."""
    beyond = 1.0 - _probability_below(0.5 * squares, 0.5 * freedom)
    if beyond > _RARE:
        return beyond
    from scipy.special import chdtrc  # few runs have anything so rare

    return float(chdtrc(freedom, squares))


def quantile(probability: float, freedom: float) -> float:
    """Return the value that a chi-square variable does not exceed with `probability`, 0 < probability < 1.

    Newton's method on the logarithm, from the cube root of Wilson and Hilferty (1931).
    """
    a, c = 0.5 * freedom, 2.0 / (9.0 * freedom)
    x = a * max(1.0 - c + normal_quantile(probability) * math.sqrt(c), 0.02) ** 3
    for _ in range(100):
        density = a * _first_term(x, a)  # of the logarithm
        step = (_probability_below(x, a) - probability) / max(density, 1e-300)
        x *= math.exp(-max(-1.0, min(1.0, step)))
        if abs(step) < 1e-12:
            break
    return 2.0 * x


def chi_square_limit(redundancy: int, normal: float = FITS) -> float:
    """Return the quantile of chi-square (Wilson and Hilferty 1931), as rare as a `normal` one: so far it fits."""
    part = 2.0 / (9.0 * redundancy)
    return float(redundancy * (1.0 - part + normal * math.sqrt(part)) ** 3)


def _probability_below(x: float, a: float) -> float:
    """Return the lower incomplete gamma function ratio P(a, x) by its series, 1 where it differs by some 1e-20."""
    if x <= 0.0:
        return 0.0
    if x > a + 10.0 * math.sqrt(a) + 50.0:
        return 1.0
    n = np.arange(1.0, max(x - a, 0.0) + 10.0 * math.sqrt(x) + 60.0)
    series = 1.0 + float(np.cumprod(x / (a + n)).sum())
    return min(series * _first_term(x, a), 1.0)


def _first_term(x: float, a: float) -> float:
    """Return x^a exp(-x)/Gamma(a + 1), of large a by Stirling: large logarithms lose digits."""
    if a < 1e3:
        return math.exp(a * math.log(x) - x - math.lgamma(a + 1.0))
    beyond = x - a
    power = a * math.log1p(beyond / a) - beyond - 1.0 / (12.0 * a) + 1.0 / (360.0 * a**3)
    return math.exp(power) / math.sqrt(2.0 * math.pi * a)


def normal_quantile(probability: float) -> float:
    """Return the normal quantile, good to 5e-4 (Hastings 1955), 0 < probability < 1."""
    tail = min(probability, 1.0 - probability)
    t = math.sqrt(-2.0 * math.log(tail))
    above = 2.515517 + 0.802853 * t + 0.010328 * t * t
    below = 1.0 + 1.432788 * t + 0.189269 * t * t + 0.001308 * t**3
    return math.copysign(t - above / below, probability - 0.5)


def test_limit(count: int) -> float:
    """Return the limit of so many test values together: the risk of all of them is `FAMILY_RISK` (Bonferroni)."""
    return normal_quantile(1.0 - 0.5 * FAMILY_RISK / max(count, 1))


def students_of_pope(tau: FloatArray, freedom: float) -> FloatArray:
    """Return Pope's tau (k,), residuals by the sigma0 of all, as Student's t by that of all others (Pope 1976).

    t of f - 1 degrees, of the `freedom` f > 1 of all: infinite where one residual makes all of sigma0.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        left = freedom - np.square(tau)
        return np.where(left > 0.0, tau * np.sqrt((freedom - 1.0) / left), np.sign(tau) * np.inf)


def student_as_normal(t: FloatArray, freedom: FloatArray | float) -> FloatArray:
    """Return values (k,) of Student's t of `freedom` degrees, all or each (k,), as normal variables (Wallace 1959).

    Both have the same chance to be exceeded, to some per cent of it; infinite degrees leave t as it is.
    """
    n = np.minimum(freedom, 1e12)
    z = (8.0 * n + 1.0) / (8.0 * n + 3.0) * np.sqrt(n * np.log1p(np.square(t) / n))
    return np.asarray(np.copysign(z, t))
