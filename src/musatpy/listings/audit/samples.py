"""What the statistics of one sample of N differences d say about one another, roundings included.

    m = S / N,   D^2 = N / (N - 1) (R^2 - m^2),   |m| <= R <= |X|,   N R^2 >= X^2 + (S - X)^2 / (N - 1)

with sum S, mean m, RMS R, standard deviation from the mean D and the signed difference X of the largest magnitude.
The last one holds because the N - 1 others have the sum S - X (Cauchy and Schwarz). Numbers are intervals (low,
high): what rounds to the printed one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

Interval = tuple[float, float]
_SLACK = 1e-9  # relative: a number exactly between two prints may have gone either way
_STEPS = 60  # of the search for the smallest sum of squares, which halves its error in each


def consistent(N: int, cells: Mapping[str, Interval]) -> bool:
    """Tell whether some sample of N has statistics within all `cells`: sum, mean, rms, deviation, maximum."""
    m = _mean(N, cells)
    if m is None or cells.get("deviation", (0.0, 0.0))[1] < 0.0:
        return False
    R = _rms(N, m, cells)
    if R is None:
        return False
    if "maximum" not in cells:
        return True
    low, high = cells["maximum"]
    if max(abs(low), abs(high)) * (1.0 + _SLACK) < max(R[0], _smallest(m)):
        return False
    return _least_squares(N, m, (low, high)) <= N * R[1] ** 2 * (1.0 + _SLACK) + _SLACK**2


def implied(N: int, name: str, cells: Mapping[str, Interval]) -> Interval | None:
    """Return within what the statistic `name` must lie by the others; None where they do not tell."""
    others = {key: value for key, value in cells.items() if key != name}
    m = _mean(N, others)
    if m is None:
        return None
    if name in ("sum", "mean"):
        times = N if name == "sum" else 1
        return None if math.isinf(m[1]) else (m[0] * times, m[1] * times)
    if name == "rms":
        return _rms(N, m, others) if "deviation" in others else None
    R = _rms(N, m, others)
    if R is None or math.isinf(R[1]):
        return None
    if name == "deviation":
        k = N / (N - 1)
        squares = (k * (R[0] ** 2 - _largest(m) ** 2), k * (R[1] ** 2 - _smallest(m) ** 2))
        return _root(squares[0]), _root(squares[1])
    return None


def sizes_implied(cells: Mapping[str, Interval]) -> range:
    """Return the sizes N that sum and mean allow; none where the mean may be zero, or too many."""
    if "sum" not in cells or "mean" not in cells or _smallest(cells["mean"]) == 0.0:
        return range(0)
    S, m = cells["sum"], cells["mean"]
    if (S[0] + S[1]) * (m[0] + m[1]) <= 0.0:
        return range(0)
    low, high = _smallest(S) / _largest(m), _largest(S) / _smallest(m)
    return range(max(1, math.ceil(low)), math.floor(high) + 1) if high - low < 3.0 else range(0)


def _mean(N: int, cells: Mapping[str, Interval]) -> Interval | None:
    """Return the mean by sum and mean, everything where both are missing, None where they contradict."""
    low, high = cells.get("mean", (-math.inf, math.inf))
    if "sum" in cells:
        low, high = max(low, cells["sum"][0] / N), min(high, cells["sum"][1] / N)
    return _not_empty(low, high)


def _rms(N: int, m: Interval, cells: Mapping[str, Interval]) -> Interval | None:
    """Return the RMS by itself, by the deviation, and as no smaller than the mean; None where they contradict."""
    low, high = cells.get("rms", (0.0, math.inf))
    low = max(low, 0.0, _smallest(m))
    if "deviation" in cells and N > 1:
        D = cells["deviation"]
        low = max(low, math.sqrt(_smallest(m) ** 2 + (N - 1) / N * max(D[0], 0.0) ** 2))
        high = min(high, math.sqrt(_largest(m) ** 2 + (N - 1) / N * D[1] ** 2))
    elif N == 1:
        high = min(high, _largest(m))
    return _not_empty(low, high)


def _least_squares(N: int, m: Interval, X: Interval) -> float:
    """Return the smallest sum of squares of N numbers, one of them in X and their mean in m.

    Convex in both: each in turn goes where it is best, which converges in a box.
    """
    if N == 1:
        return _smallest((max(X[0], m[0]), min(X[1], m[1]))) ** 2 if X[0] <= m[1] and m[0] <= X[1] else math.inf
    x = _nearest(X, 0.0)
    mean = _nearest(m, x / N)
    for _ in range(_STEPS):
        x = _nearest(X, mean)
        mean = _nearest(m, x / N)
    return x**2 + (N * mean - x) ** 2 / (N - 1)


def _not_empty(low: float, high: float) -> Interval | None:
    if low > high + _SLACK * max(abs(low), abs(high)):
        return None
    return min(low, high), max(low, high)


def _nearest(interval: Interval, value: float) -> float:
    return min(max(value, interval[0]), interval[1])


def _smallest(interval: Interval) -> float:
    return abs(_nearest(interval, 0.0))


def _largest(interval: Interval) -> float:
    return max(abs(interval[0]), abs(interval[1]))


def _root(square: float) -> float:
    return math.sqrt(max(square, 0.0))
