"""The restricted likelihood of a covariance, given values at control points: what is left of them without a trend.

With P as in `prediction`, -2 ln = ln|C| + ln|A' C^-1 A| + l' P l + (n - u) ln 2 pi (Patterson and Thompson 1971).
Many points are parted into blocks of neighbours, whose likelihoods are multiplied as if they were independent: that
stays unbiased and needs far less time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.sea.interpolation.correlation import Correlation, SignalKind, units_of
from musatpy.sea.interpolation.prediction import JITTER, Collocation, Covariance, Observed, Prediction, Trend, lags

BLOCK = 200  # control points: up to so many the likelihood is exact
IMPOSSIBLE = 1e12  # of covariances that cannot be factorised: an optimiser turns back there


class Likelihood:
    """-ln of the restricted likelihood of a family, with its partials.

    Unknowns are ln of the variance of the signal (not without one), ln of that of the noise (where it is free), and
    the parameters of the family.
    """

    def __init__(self, observed: Observed, trend: Trend, family: SignalKind, *, free_noise: bool) -> None:
        self.family, self.free_noise = family, free_noise
        self.has_signal = family != SignalKind.NONE
        parts = [observed[rows] for rows in neighbours(observed.place)]
        self._blocks = [(part, lags(part.place, part.place), part.trend_rows(trend)) for part in parts]

    def covariance(self, unknowns: FloatArray) -> Covariance:
        """Return the covariance that unknowns stand for."""
        values = list(unknowns)
        signal = float(np.exp(values.pop(0))) if self.has_signal else 0.0
        noise = float(np.exp(values.pop(0))) if self.free_noise else 0.0
        correlation = Correlation(family=self.family, parameters=tuple(float(value) for value in values))
        return Covariance(signal=signal, noise=noise, correlation=correlation)

    def __call__(self, unknowns: FloatArray) -> tuple[float, FloatArray]:
        """Return -ln of the likelihood, and its partials by the unknowns."""
        covariance = self.covariance(unknowns)
        total, slope = 0.0, np.zeros(len(unknowns))
        for block in self._blocks:
            try:
                value, partials = self._of(*block, covariance)
            except np.linalg.LinAlgError:
                return IMPOSSIBLE, np.zeros(len(unknowns))
            total, slope = total + value, slope + partials
        return total, slope

    def _of(
        self, observed: Observed, lag: FloatArray, A: FloatArray, covariance: Covariance
    ) -> tuple[float, FloatArray]:
        from scipy.linalg import cho_factor, cho_solve

        count, unknowns = A.shape
        R, partials = covariance.correlation.with_partials(lag)
        C = covariance.signal * R
        diagonal = np.diag_indices(count)
        C[diagonal] += covariance.noise + observed.sigma**2 + JITTER * covariance.signal
        factor = cho_factor(C, lower=True, check_finite=False)
        inverse = cho_solve(factor, np.eye(count), overwrite_b=True, check_finite=False)
        B = inverse @ A
        N = A.T @ B
        P = inverse - B @ np.linalg.solve(N, B.T)
        weights = P @ observed.value
        logs = 2.0 * np.log(np.diag(factor[0])).sum() + np.linalg.slogdet(N)[1]
        total = 0.5 * (logs + observed.value @ weights + (count - unknowns) * np.log(2.0 * np.pi))
        G = 0.5 * (P - np.outer(weights, weights))  # partials of the total by the elements of C
        slope = []
        if self.has_signal:
            slope.append(covariance.signal * (float(np.vdot(G, R)) + JITTER * float(np.trace(G))))
        if self.free_noise:
            slope.append(covariance.noise * float(np.trace(G)))
        slope += [covariance.signal * float(np.vdot(G, partial)) for partial in partials]
        return float(total), np.array(slope)


def neighbours(place: FloatArray, most: int = BLOCK) -> list[IntArray]:
    """Return the rows of places (n, 2) in blocks of at most `most`, halved across their longer side."""
    waiting, blocks = [np.arange(len(place))], []
    while waiting:
        rows = waiting.pop()
        if len(rows) <= most:
            blocks.append(rows)
            continue
        axis = int(np.argmax(np.ptp(place[rows], axis=0)))
        order = rows[np.argsort(place[rows, axis], kind="stable")]
        waiting += [order[: len(rows) // 2], order[len(rows) // 2 :]]
    return blocks


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertain:
    """A collocation with others, one each way along each direction (k) in which the covariance is uncertain.

    The directions are independent, and a standard deviation long.
    """

    collocation: Collocation
    pairs: tuple[tuple[Collocation, Collocation], ...]

    def predict(self, place: FloatArray) -> Prediction:
        """Return the prediction at places (m, 2), its sigma with that of the covariance."""
        plain = self.collocation.predict(place)
        variance = plain.sigma**2
        for more, less in self.pairs:
            variance += np.square((more.value(place) - less.value(place)) / 2.0)
        return Prediction(value=plain.value, sigma=np.sqrt(variance), distance=plain.distance)


def unknowns_of(covariance: Covariance, free_noise: bool) -> FloatArray:
    """Return the unknowns of `Likelihood` that stand for a covariance."""
    signal = [] if covariance.correlation.family == SignalKind.NONE else [np.log(covariance.signal)]
    noise = [np.log(covariance.noise)] if free_noise else []
    return np.array([*signal, *noise, *covariance.correlation.parameters])


def uncertain(collocation: Collocation, free_noise: bool) -> Uncertain:
    """Return the collocation with what its covariance is uncertain by.

    Only the parameters of the correlation count: the variances hardly change a prediction. Directions in which the
    likelihood is flat are cut off.
    """
    covariance = collocation.covariance
    unknowns = unknowns_of(covariance, free_noise)
    first = len(unknowns) - len(covariance.correlation.parameters)
    if first == len(unknowns):
        return Uncertain(collocation=collocation, pairs=())
    likelihood = Likelihood(
        collocation.observed, collocation.trend, covariance.correlation.family, free_noise=free_noise
    )
    scale = np.array(units_of(covariance.correlation.family, 1.0 / collocation.observed.scale))
    H = _curvature(likelihood, unknowns, scale, first)
    size, axes = np.linalg.eigh(H)
    pairs = []
    for value, axis in zip(size, axes.T, strict=True):
        if value <= 1.0:  # the likelihood does not tell such a parameter, nor does it matter
            continue
        step = np.concatenate([np.zeros(first), scale * axis / np.sqrt(value)])
        more, less = (likelihood.covariance(unknowns + sign * step) for sign in (1.0, -1.0))
        observed, trend = collocation.observed, collocation.trend
        pairs.append((Collocation(observed, more, trend), Collocation(observed, less, trend)))
    return Uncertain(collocation=collocation, pairs=tuple(pairs))


def _curvature(likelihood: Likelihood, unknowns: FloatArray, scale: FloatArray, first: int) -> FloatArray:
    """Return the second derivatives by the parameters, in their units, from central differences of the partials."""
    count, step = len(unknowns) - first, 1e-4
    H = np.empty((count, count))
    for row in range(count):
        move = np.zeros(len(unknowns))
        move[first + row] = step * scale[row]
        difference = likelihood(unknowns + move)[1] - likelihood(unknowns - move)[1]
        H[row] = difference[first:] * scale / (2.0 * step)
    return (H + H.T) / 2.0
