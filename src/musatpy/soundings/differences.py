"""Compiled less sounded depths: who meets the bottom, and what the differences say, by depth and by regression."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, InRows, TextArray
from musatpy.soundings.s44 import survey_orders
from musatpy.statistics.analyses import DifferenceStatistics, difference_statistics
from musatpy.units import FOOT, YARD

BANDS = (0.0, 2.0, 5.0, 10.0, 20.0, np.inf)  # m, limits of the bands of depth
_NORMAL = 1.4826  # sigma of a normal distribution over its median absolute deviation
_BLUNDER = 3.29  # of that, 99.9 %
_ROUNDS = 10
_SHARE = 0.95  # of differences that an order asks for
_SCALES = {
    -1.0: ("heights, positive up", "call the column height"),
    1.0 / FOOT: ("feet", "multiply them by 0.3048"),
    0.5 / YARD: ("fathoms", "multiply them by 1.8288"),
    10.0: ("decimetres", "divide them by 10"),
    100.0: ("centimetres", "divide them by 100"),
}
_ROUNDED = 0.01  # m, of depths in files
_LIKE = 0.05  # relative, of a slope
_LEAST = 0.9  # correlation of depths that differ by a scale


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthDifferences(InRows):
    """n soundings that meet a bottom: compiled and sounded depths (n,) m, and the sigma (n,) of a difference."""

    names: TextArray
    compiled: FloatArray
    sounded: FloatArray
    sigma: FloatArray

    @property
    def difference(self) -> FloatArray:
        """(n,) m, compiled less sounded."""
        return self.compiled - self.sounded

    @property
    def blunders(self) -> BoolArray:
        """(n,) beyond 3.29 robust deviations from the median, of those that are no blunders themselves."""
        good = np.ones(len(self.sounded), dtype=bool)
        for _ in range(_ROUNDS):
            middle, spread = median_and_spread(self.difference[good])
            kept = np.abs(self.difference - middle) <= _BLUNDER * max(spread, 1e-9)
            if np.array_equal(kept, good):
                break
            good = kept
        return ~good


@dataclass(frozen=True, kw_only=True)
class Sample:
    """Differences in numbers: those of the tables of ETL-0306, section 6, the median and the scaled MAD, m."""

    what: str
    statistics: DifferenceStatistics
    median: float
    spread: float


@dataclass(frozen=True, kw_only=True)
class Regression:
    """difference = a + b depth by weighted least squares, with sigmas, the correlation of a and b, and sigma0.

    a (m) tells of the tide or the datum, b of refraction: uncorrected depths are less by a quarter and more.
    """

    a: float
    b: float
    a_sigma: float
    b_sigma: float
    correlation: float
    sigma0: float


@dataclass(frozen=True, kw_only=True)
class OrderShare:
    """The share of differences within the vertical uncertainty of an order of S-44, and whether it is 95 %."""

    name: str
    share: float

    @property
    def met(self) -> bool:
        """Whether the share is that which the order asks for."""
        return self.share >= _SHARE


def median_and_spread(values: FloatArray) -> tuple[float, float]:
    """Return the median and the median absolute deviation, scaled to a normal sigma; NaN without values."""
    if not len(values):
        return np.nan, np.nan
    middle = float(np.median(values))
    return middle, float(_NORMAL * np.median(np.abs(values - middle)))


def samples(differences: DepthDifferences) -> list[Sample]:
    """Return all differences, those without blunders, and those without blunders by bands of sounded depth."""
    good = differences[~differences.blunders]
    out = [_sample("all", differences), _sample("without blunders", good)]
    for low, high in pairwise(BANDS):
        rows = (good.sounded >= low) & (good.sounded < high)
        if rows.any():
            out.append(_sample(f"over {low:g} m" if high == np.inf else f"{low:g} to {high:g} m", good[rows]))
    return out


def _sample(what: str, part: DepthDifferences) -> Sample:
    middle, spread = median_and_spread(part.difference)
    return Sample(
        what=what, statistics=difference_statistics(part.difference, part.names), median=middle, spread=spread
    )


def regression(differences: DepthDifferences) -> Regression | None:
    """Return the regression on the sounded depth without blunders; None for fewer than three, or of one depth."""
    good = differences[~differences.blunders]
    if len(good.sounded) < 3 or not np.ptp(good.sounded) > 0.0:
        return None
    if not (good.sigma > 0.0).all():
        good = replace(good, sigma=np.ones(len(good.sounded)))  # without error: all count alike
    A = np.column_stack([np.ones(len(good.sounded)), good.sounded])
    N = A.T @ (A / np.square(good.sigma)[:, None])
    Q = np.linalg.inv(N)
    x = Q @ (A.T @ (good.difference / np.square(good.sigma)))
    v = good.difference - A @ x
    sigma0 = float(np.sqrt(np.sum(np.square(v / good.sigma)) / (len(v) - 2)))
    (a, b), (a_sigma, b_sigma) = x.tolist(), (sigma0 * np.sqrt(np.diagonal(Q))).tolist()
    correlation = float(Q[0, 1] / np.sqrt(Q[0, 0] * Q[1, 1]))
    return Regression(a=a, b=b, a_sigma=a_sigma, b_sigma=b_sigma, correlation=correlation, sigma0=sigma0)


def order_shares(differences: DepthDifferences) -> list[OrderShare]:
    """Return the share of all differences within the vertical uncertainty of each order of S-44."""
    size = np.abs(differences.difference)
    return [
        OrderShare(name=order.name, share=float(np.mean(size <= order.vertical(differences.sounded))))
        for order in survey_orders()
    ]


def likeness_warning(differences: DepthDifferences) -> str:
    """Return what soundings look like that differ from compiled depths by a scale, a sign or a constant; or ''.

    A constant is beyond 3.29 sigmas of a single difference: errors of a bottom may be common to all its places.
    """
    compiled, depth = differences.compiled, differences.sounded
    if len(depth) < 3:
        return ""
    ratios = depth / np.where(compiled == 0.0, np.nan, compiled)
    slope, spread = median_and_spread(ratios[np.isfinite(ratios)])
    told = spread < _LIKE * abs(slope)  # also over a level bottom
    if np.ptp(depth) > 0.0 and np.ptp(compiled) > 0.0 and abs(np.corrcoef(compiled, depth)[0, 1]) >= _LEAST:
        slope, told = float(np.polyfit(compiled, depth, 1)[0]), True
    for scale, (unit, advice) in _SCALES.items():
        if told and abs(slope / scale - 1.0) < _LIKE:
            return f"the soundings grow with {slope:.4g} times the compiled depths: they look like {unit}: {advice}"
    offset, spread = median_and_spread(differences.difference)
    sigma = differences.sigma[np.isfinite(differences.sigma)]
    if abs(offset) <= _BLUNDER * max(float(np.median(sigma)) if len(sigma) else 0.0, spread, _ROUNDED):
        return ""
    return (
        f"all soundings are {abs(offset):.2f} m {'less deep' if offset > 0.0 else 'deeper'} than the bottom, with "
        f"a spread of {spread:.2f} m only: they look like soundings below another datum, or without their tide; "
        f"add {offset:.2f} to --datum if that is so"
    )
