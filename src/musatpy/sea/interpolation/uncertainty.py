"""What it adds to the sigma of a prediction that its covariance is estimated and not known.

The parameters have the inverse of the second derivatives of -ln of the likelihood as their covariance; a prediction
depends on them by its partials, from central differences. Of a wave length and direction this is the larger part of
the sigma, because the prediction would turn with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.sea.interpolation.correlation import Family, units_of
from musatpy.sea.interpolation.likelihood import Likelihood
from musatpy.sea.interpolation.prediction import Collocation, Covariance, Prediction

_FLAT = 1.0  # 1/second derivative of ln of a parameter: beyond, the likelihood does not tell it, nor does it matter


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
        added = [self._added(part) for part in self.collocation.parts(place)]
        variance = plain.sigma**2 + np.concatenate([np.empty(0), *added])
        return Prediction(value=plain.value, sigma=np.sqrt(variance), distance=plain.distance)

    def _added(self, place: FloatArray) -> FloatArray:
        variance = np.zeros(len(place))
        for more, less in self.pairs:
            variance += np.square((more.value(place) - less.value(place)) / 2.0)
        return variance


def unknowns_of(covariance: Covariance, free_noise: bool) -> FloatArray:
    """Return the unknowns of `Likelihood` that stand for a covariance."""
    signal = [] if covariance.correlation.family == Family.NONE else [np.log(covariance.signal)]
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
        if value * _FLAT <= 1.0:
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
