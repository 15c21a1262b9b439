"""Chi-square probabilities and quantiles.

Of its own because the library that has them takes longer to load than a strip takes to adjust; the tests hold it
against that library.
"""

from __future__ import annotations

import math

_TERMS = 100_000
_TINY = 1e-300


def probability_beyond(squares: float, freedom: float) -> float:
    """Return the probability of a chi-square variable of `freedom` > 0 degrees to exceed `squares` >= 0."""
    a, x = 0.5 * freedom, 0.5 * squares
    if x <= 0.0:
        return 1.0
    if math.isinf(x):
        return 0.0
    return 1.0 - _series(a, x) if x < a + 1.0 else _fraction(a, x)


def quantile(probability: float, freedom: float) -> float:
    """Return the value that a chi-square variable does not exceed with `probability`, 0 < probability < 1.

    Newton's method on the logarithm, from the cube root of Wilson and Hilferty (1931).
    """
    a = 0.5 * freedom
    c = 2.0 / (9.0 * freedom)
    x = 0.5 * freedom * max(1.0 - c + normal_quantile(probability) * math.sqrt(c), 0.02) ** 3
    for _ in range(100):
        below = 1.0 - probability_beyond(2.0 * x, freedom)
        slope = max(x * _density(a, x), _TINY)
        step = max(-1.0, min(1.0, (below - probability) / slope))
        x *= math.exp(-step)
        if abs(step) < 1e-12:
            break
    return 2.0 * x


def _density(a: float, x: float) -> float:
    return math.exp(a * math.log(x) - x - math.lgamma(a)) / x


def _series(a: float, x: float) -> float:
    """Return the lower incomplete gamma function ratio by its series."""
    term = total = 1.0 / a
    for n in range(1, _TERMS):
        term *= x / (a + n)
        total += term
        if term < 1e-17 * total:
            break
    return total * x * _density(a, x)


def _fraction(a: float, x: float) -> float:
    """Return the upper incomplete gamma function ratio by its continued fraction (Lentz)."""
    b = x + 1.0 - a
    c, d = 1.0 / _TINY, 1.0 / b
    h = d
    for n in range(1, _TERMS):
        factor = -n * (n - a)
        b += 2.0
        d = 1.0 / (factor * d + b or _TINY)
        c = b + factor / c or _TINY
        h *= d * c
        if abs(d * c - 1.0) < 1e-16:
            break
    return h * x * _density(a, x)


def normal_quantile(probability: float) -> float:
    """Return the normal quantile, good to 5e-4 (Hastings 1955), 0 < probability < 1."""
    tail = min(probability, 1.0 - probability)
    t = math.sqrt(-2.0 * math.log(tail))
    above = 2.515517 + 0.802853 * t + 0.010328 * t * t
    below = 1.0 + 1.432788 * t + 0.189269 * t * t + 0.001308 * t**3
    return math.copysign(t - above / below, probability - 0.5)
