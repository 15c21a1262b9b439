"""Collocation with known covariances: l = A x + s + n, trend, signal and noise (Moritz 1980).

The trend x comes from generalised least squares, the signal at any place from the residuals of the control points;
both together are the best linear unbiased prediction. Cross-validation, each control point predicted from all
others, is in closed form (Dubrule 1983): with P = C^-1 - C^-1 A (A' C^-1 A)^-1 A' C^-1 the error at point i is
(P l)_i / P_ii, its variance 1 / P_ii.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from musatpy.arrays import FloatArray, InRows
from musatpy.errors import CollocationError
from musatpy.sea.interpolation.correlation import Correlation

MOST_CONTROL = 5000  # control points: their covariances fill 200 MB, the factors as much
_BLOCK = 250_000  # covariances between places and control points at a time: 2 MB, the cache of a processor
JITTER = 1e-10  # of the variance of the signal, on the diagonal: what makes a smooth function solvable


class Trend(IntEnum):
    """The trend; its value is the number of unknowns."""

    CONSTANT = 1
    PLANE = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Covariance:
    """Variance of the signal (m2) with its correlation function, and the variance of noise (m2) at control points.

    The noise is of each point by itself, besides what its own sigma says.
    """

    signal: float
    noise: float
    correlation: Correlation


@dataclass(frozen=True, kw_only=True, eq=False)
class Observed(InRows):
    """Values at control points: place (n, 2) m, value (n,) m, sigma (n,) m of each (0 where it is not known)."""

    place: FloatArray
    value: FloatArray
    sigma: FloatArray

    @cached_property
    def scale(self) -> float:
        """The longer side (m) of the rectangle that the points fill."""
        return max(float(np.ptp(self.place, axis=0).max()), 1e-9)

    def trend_rows(self, trend: Trend, place: FloatArray | None = None) -> FloatArray:
        """Return the rows (m, u) of a trend at places (m, 2), or at the points: 1, and for a plane x and y.

        x and y count from the middle of the points, in units of their `scale`.
        """
        at = self.place if place is None else place
        ones = np.ones((len(at), 1))
        middle = self.place.mean(axis=0)
        return ones if trend == Trend.CONSTANT else np.hstack([ones, (at - middle) / self.scale])


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """At each place the value and its sigma (m), those of trend and signal, and the distance (m) of a control."""

    value: FloatArray
    sigma: FloatArray
    distance: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossValidation:
    """Of each control point, predicted from all others: given minus predicted (n,) m, and sigma (n,) m of that."""

    error: FloatArray
    sigma: FloatArray

    @property
    def standardised(self) -> FloatArray:
        """(n,) errors over their sigmas."""
        return self.error / self.sigma

    @property
    def rms(self) -> float:
        """Root of the mean square error, m."""
        return float(np.sqrt(np.mean(np.square(self.error))))

    @property
    def standardised_rms(self) -> float:
        """That of the standardised errors: 1 where the sigmas are honest."""
        return float(np.sqrt(np.mean(np.square(self.standardised))))


def lags(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the differences (n, m, 2) between places (n, 2) and (m, 2)."""
    return first[:, None, :] - second[None, :, :]


class Collocation:
    """Control points with a covariance, factorised: predicts at any place, and validates itself.

    Raises `CollocationError` where there are too few or too many control points, or the system has no solution.
    """

    def __init__(self, observed: Observed, covariance: Covariance, trend: Trend = Trend.CONSTANT) -> None:
        from scipy.linalg import cho_factor, solve_triangular

        count = len(observed.value)
        check_count(count, trend)
        self.observed, self.covariance, self.trend = observed, covariance, trend
        C = covariance.signal * covariance.correlation(lags(observed.place, observed.place))
        C[np.diag_indices(count)] += covariance.noise + observed.sigma**2 + JITTER * covariance.signal
        try:
            self._L = cho_factor(C, lower=True, overwrite_a=True, check_finite=False)[0]
        except np.linalg.LinAlgError as error:
            message = "the covariances of the control points are singular: two of them at one place, without noise?"
            raise CollocationError.of(message) from error
        A = observed.trend_rows(trend)
        # with L L' = C, whitened by L^-1 the problem is one of plain least squares
        self._A = solve_triangular(self._L, A, lower=True, check_finite=False)
        self._N = self._A.T @ self._A
        if np.linalg.cond(self._N) > 1e12:
            raise CollocationError.of("the control points stand in a line: no plane through them")
        white = solve_triangular(self._L, observed.value, lower=True, check_finite=False)
        self.coefficients = np.asarray(np.linalg.solve(self._N, self._A.T @ white), dtype=float)  # of the trend
        residual = white - self._A @ self.coefficients
        self._weights = solve_triangular(self._L, residual, lower=True, trans="T", check_finite=False)

    def predict(self, place: FloatArray) -> Prediction:
        """Return value and sigma of trend and signal at places (m, 2), in blocks of bounded memory."""
        blocks = [self._block(part) for part in self._parts(place)]
        value, sigma, distance = np.concatenate([np.empty((3, 0)), *blocks], axis=1)
        return Prediction(value=value, sigma=sigma, distance=distance)

    def _parts(self, place: FloatArray) -> list[FloatArray]:
        step = max(1, _BLOCK // len(self.observed.value))
        return [place[start : start + step] for start in range(0, len(place), step)]

    def value(self, place: FloatArray) -> FloatArray:
        """Return the value alone at places (m, 2)."""
        values = [np.empty(0)]
        for part in self._parts(place):
            c = self.covariance.signal * self.covariance.correlation(lags(self.observed.place, part))
            values.append(self.observed.trend_rows(self.trend, part) @ self.coefficients + self._weights @ c)
        return np.concatenate(values)

    def _block(self, place: FloatArray) -> FloatArray:
        """Return value, sigma and distance (3, m)."""
        from scipy.linalg import solve_triangular

        lag = lags(self.observed.place, place)  # (n, m, 2)
        c = self.covariance.signal * self.covariance.correlation(lag)
        rows = self.observed.trend_rows(self.trend, place)
        value = rows @ self.coefficients + self._weights @ c
        white = solve_triangular(self._L, c, lower=True, overwrite_b=True, check_finite=False)
        # variance of the signal left, and of the trend
        left = rows.T - self._A.T @ white
        prior = float(self.covariance.signal * self.covariance.correlation(np.zeros((1, 2)))[0])
        variance = prior - np.einsum("nm,nm->m", white, white)
        variance += np.einsum("um,um->m", left, np.linalg.solve(self._N, left))
        distance = np.sqrt(np.square(lag).sum(axis=-1).min(axis=0))
        return np.stack([value, np.sqrt(np.maximum(variance, 0.0)), distance])

    @cached_property
    def cross_validation(self) -> CrossValidation:
        """Each control point predicted from all others, the covariance held."""
        from scipy.linalg import cho_solve

        inverse = cho_solve((self._L, True), np.eye(len(self._L)), overwrite_b=True, check_finite=False)
        B = cho_solve((self._L, True), self.observed.trend_rows(self.trend))
        diagonal = np.diag(inverse) - np.einsum("nu,un->n", B, np.linalg.solve(self._N, B.T))
        # P l is what the residuals of the trend weigh: C^-1 (l - A x)
        return CrossValidation(error=self._weights / diagonal, sigma=1.0 / np.sqrt(diagonal))


def check_count(count: int, trend: Trend, groups: int = 0) -> None:
    """Raise `CollocationError` where so many control points are too few or too many.

    Those that are left must be enough too, where one of some groups is left out.
    """
    if count > MOST_CONTROL:
        message = f"{count} control points are too many: at most {MOST_CONTROL} can be used together"
        raise CollocationError.of(message)
    least = trend + 2
    while groups and least - -(-least // min(groups, least)) < trend + 2:
        least += 1
    if count < least:
        what = "a plane" if trend == Trend.PLANE else "a constant"
        message = f"{count} control points are too few: {what} as trend needs {least} or more"
        message += ", to be validated without some" if groups else ""
        raise CollocationError.of(message)
