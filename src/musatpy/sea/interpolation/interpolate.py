"""From values at control points to an interpolation: families compared, outliers left out, all of it validated.

The family is that of the smallest Akaike criterion by the restricted likelihood. Its verdict does not come from
the closed cross-validation, which holds the covariance: with few points a wave can be found that fits noise, and
only a validation that estimates the covariance again without the points left out shows it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from statistics import NormalDist

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import CollocationError
from musatpy.sea.interpolation import estimation, prediction
from musatpy.sea.interpolation.correlation import SignalKind
from musatpy.sea.interpolation.likelihood import Uncertain, uncertain

GROUPS = 5  # of control points that are left out together in the verdict
_RISK = 0.05  # of calling any of all good control points an outlier
_MOST_OUT = 0.1  # part of the control points that may be outliers
_CLASSES = 12  # of distance


class Benefit(StrEnum):
    """Whether an interpolation helps."""

    HELPS = "helps"
    LITTLE = "helps little"
    NOT = "does not help"


@dataclass(frozen=True, kw_only=True)
class InterpolationOptions:
    """What is asked for: the trend, the families tried, whether noise is estimated and outliers are left out.

    `reach` (m) is how far from control points is predicted, None for that of the covariance.
    """

    trend: prediction.Trend = prediction.Trend.CONSTANT
    families: tuple[SignalKind, ...] = tuple(SignalKind)
    free_noise: bool = True
    reject: bool = True
    reach: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """The estimate of one family, and its cross-validation."""

    estimate: estimation.Estimate
    validation: prediction.CrossValidation

    @property
    def family(self) -> SignalKind:
        """The family."""
        return self.estimate.covariance.correlation.family


@dataclass(frozen=True, kw_only=True)
class Outlier:
    """A control point (row) that the others contradict: error of its prediction (m) and its sigma (m)."""

    row: int
    error: float
    sigma: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Interpolation:
    """Control points, which of them are used, the families compared (best first), and what the best is worth.

    `grouped` are the errors of control points (u,) that were left out in groups, covariance and all.
    """

    observed: prediction.Observed
    used: BoolArray  # (n,)
    outliers: tuple[Outlier, ...]
    critical: float  # standardised error from which a point is an outlier
    candidates: tuple[Candidate, ...]
    empirical: estimation.Empirical
    spacing: float  # m
    reach: float  # m
    options: InterpolationOptions
    collocation: prediction.Collocation
    uncertain: Uncertain
    grouped: prediction.CrossValidation

    @property
    def best(self) -> Candidate:
        """The family that is used."""
        return self.candidates[0]

    @property
    def before(self) -> float:
        """Root mean square (m) of the values at the control points used: the error without any correction."""
        return float(np.sqrt(np.mean(np.square(self.observed.value[self.used]))))

    @property
    def removed(self) -> float:
        """Part of the root mean square that is removed at points left out; negative where it grows."""
        return 1.0 - self.grouped.rms / self.before if self.before > 0.0 else 0.0

    @property
    def factor(self) -> float:
        """By which sigmas are larger than the covariance has them: as at control left out in groups, at least 1."""
        return max(1.0, self.grouped.standardised_rms)

    def sigma(self, predicted: prediction.Prediction) -> FloatArray:
        """Return the sigmas (m,) m of heights corrected by a prediction, noise and factor included.

        The estimated noise counts: it is what no function explains and what mapping by itself errs by, at these
        points as at control.
        """
        noise = self.best.estimate.covariance.noise
        return self.factor * np.sqrt(predicted.sigma**2 + noise)

    @property
    def verdict(self) -> Benefit:
        """Whether it helps: not where less than a twentieth of the root mean square goes, little below a fifth."""
        if self.removed < 0.05:
            return Benefit.NOT
        return Benefit.HELPS if self.removed >= 0.2 else Benefit.LITTLE


def interpolate(observed: prediction.Observed, options: InterpolationOptions | None = None) -> Interpolation:
    """Return the interpolation between control points. Raises `CollocationError`."""
    options = options or InterpolationOptions()
    count = len(observed.value)
    prediction.check_count(count, options.trend, GROUPS)
    if not np.ptp(observed.place, axis=0).any():
        raise CollocationError.of("all control points stand at one place")
    used = np.ones(count, dtype=bool)
    critical = NormalDist().inv_cdf(1.0 - _RISK / (2.0 * count))
    candidates = _candidates(observed, options)
    outliers: list[Outlier] = []
    while options.reject and len(outliers) < int(_MOST_OUT * count):
        validation = candidates[0].validation
        worst = int(np.argmax(np.abs(validation.standardised)))
        if abs(validation.standardised[worst]) <= critical:
            break
        row, error, sigma = np.flatnonzero(used)[worst], validation.error[worst], validation.sigma[worst]
        outliers.append(Outlier(row=int(row), error=float(error), sigma=float(sigma)))
        used[row] = False
        candidates = _candidates(observed[used], options)
    kept = observed[used]
    best = candidates[0].estimate
    collocation = prediction.Collocation(kept, best.covariance, options.trend)
    gap, wide = estimation.spacing(kept.place), estimation.extent(kept.place)
    return Interpolation(
        observed=observed,
        used=used,
        outliers=tuple(outliers),
        critical=critical,
        candidates=candidates,
        empirical=estimation.empirical(
            kept.place, estimation.residuals(kept, options.trend), width=wide / 2.0 / _CLASSES, classes=_CLASSES
        ),
        spacing=gap,
        reach=_reach(options, candidates[0], wide),
        options=options,
        collocation=collocation,
        uncertain=uncertain(collocation, options.free_noise),
        grouped=grouped(kept, options, candidates[0].family),
    )


def _reach(options: InterpolationOptions, best: Candidate, wide: float) -> float:
    """Return how far from control points is predicted: where the correlation is 0.1, half the extent at most.

    A trend alone reaches half the extent.
    """
    if options.reach is not None:
        return options.reach
    if best.family == SignalKind.NONE:
        return wide / 2.0
    return min(best.estimate.covariance.correlation.reach(), wide / 2.0)


def _candidates(observed: prediction.Observed, options: InterpolationOptions) -> tuple[Candidate, ...]:
    candidates = []
    for family in options.families:
        estimated = estimation.estimate(observed, options.trend, family, free_noise=options.free_noise)
        validation = prediction.Collocation(observed, estimated.covariance, options.trend).cross_validation
        candidates.append(Candidate(estimate=estimated, validation=validation))
    return tuple(sorted(candidates, key=lambda candidate: candidate.estimate.criterion))


def grouped(
    observed: prediction.Observed, options: InterpolationOptions, family: SignalKind
) -> prediction.CrossValidation:
    """Return the validation by `GROUPS` of control points, the covariance of a family estimated without each."""
    count = len(observed.value)
    member = np.random.default_rng(count).permutation(count) % min(GROUPS, count)
    error, sigma = np.empty(count), np.empty(count)
    for group in range(min(GROUPS, count)):
        out = member == group
        rest = observed[~out]
        covariance = estimation.estimate(rest, options.trend, family, free_noise=options.free_noise).covariance
        predicted = prediction.Collocation(rest, covariance, options.trend).predict(observed.place[out])
        error[out] = observed.value[out] - predicted.value
        sigma[out] = np.sqrt(predicted.sigma**2 + covariance.noise + observed.sigma[out] ** 2)
    return prediction.CrossValidation(error=error, sigma=sigma)
