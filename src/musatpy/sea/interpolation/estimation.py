"""The covariance of one family that the control points speak for: the maximum of the restricted likelihood.

The likelihood has many maxima in the wave length. The search starts from several: wave vectors from the periodogram
of the values (least squares of cosine and sine), lengths spread between the spacing and the extent of the points.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.sea.interpolation.correlation import ParameterKind, SignalKind, parameter_kinds, units_of
from musatpy.sea.interpolation.likelihood import Likelihood
from musatpy.sea.interpolation.prediction import Covariance, Observed, Trend


@dataclass(frozen=True, kw_only=True, eq=False)
class Empirical:
    """Classes of distance: mean distance (k,) m, pairs (k,), covariance (k,) m2; the first is that of points alone.

    The first class, at distance 0, is the variance, noise included.
    """

    distance: FloatArray
    pairs: IntArray
    covariance: FloatArray


def residuals(observed: Observed, trend: Trend) -> FloatArray:
    """Return the values (n,) less their trend by plain least squares."""
    rows = observed.trend_rows(trend)
    return observed.value - rows @ np.linalg.lstsq(rows, observed.value, rcond=None)[0]


def empirical(place: FloatArray, residual: FloatArray, *, width: float, classes: int) -> Empirical:
    """Return the covariances of residuals (n,) at places (n, 2), classes `width` m wide; empty ones left out."""
    pairs = np.zeros(classes, dtype=np.int64)
    products, distances = np.zeros(classes), np.zeros(classes)
    for row in range(len(place) - 1):  # a row of pairs at a time: all of them would fill the memory
        lag = place[row + 1 :] - place[row]
        distance = np.hypot(lag[:, 0], lag[:, 1])
        near = distance < width * classes
        index = (distance[near] / width).astype(int)
        pairs += np.bincount(index, minlength=classes)
        distances += np.bincount(index, distance[near], minlength=classes)
        products += np.bincount(index, residual[row] * residual[row + 1 :][near], minlength=classes)
    full = pairs > 0
    return Empirical(
        distance=np.concatenate([[0.0], distances[full] / pairs[full]]),
        pairs=np.concatenate([[len(place)], pairs[full]]),
        covariance=np.concatenate([[np.mean(np.square(residual))], products[full] / pairs[full]]),
    )


def spacing(place: FloatArray) -> float:
    """Return the median distance (m) from a place to the nearest other one; 0 where all are one.

    Points that share a place, measured twice, count once.
    """
    from scipy.spatial import cKDTree  # a plain run does without

    single = np.unique(place, axis=0)
    if len(single) < 2:
        return 0.0
    distance, _ = cKDTree(single).query(single, k=2)
    return float(np.median(np.asarray(distance)[:, 1]))


def extent(place: FloatArray) -> float:
    """Return the diagonal (m) of the rectangle that the points fill."""
    return float(np.hypot(*np.ptp(place, axis=0)))


_PEAKS = 3  # wave vectors to start from
_LENGTHS = 3  # lengths to start from
_MOST = 400  # points whose periodogram is looked at
_SHORTEST = 60.0  # parts of the extent: the shortest wave that is searched for


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """A covariance, and -ln of its restricted likelihood.

    `searched` are the independent waves among which that of the covariance was found.
    """

    covariance: Covariance
    misfit: float
    unknowns: int  # how many were estimated
    searched: float = 1.0

    @property
    def criterion(self) -> float:
        """Akaike's, by the restricted likelihood, the smaller the better; a wave pays for the search too.

        The best of K waves explains noise by 2 ln K better than one that is given.
        """
        return 2.0 * (self.misfit + self.unknowns + float(np.log(self.searched)))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Frame:
    """What bounds a search: variance (m2) of the residuals, spacing and extent (m) of the points."""

    variance: float
    spacing: float
    extent: float

    @property
    def shortest(self) -> float:
        """Shortest wave, m."""
        return max(self.spacing, self.extent / _SHORTEST)

    def searched(self, family: SignalKind) -> float:
        """Return how many waves differ by a turn over the extent: those of a half plane, or of all directions."""
        turns = self.extent / self.shortest
        return {SignalKind.SWELL: 0.5 * np.pi * turns * turns, SignalKind.BESSEL: turns}.get(family, 1.0)


def estimate(observed: Observed, trend: Trend, family: SignalKind, *, free_noise: bool) -> Estimate:
    """Return the covariance of a family with the largest restricted likelihood."""
    residual = residuals(observed, trend)
    variance = float(np.mean(np.square(residual)))
    frame = _Frame(
        variance=max(variance, 1e-12), spacing=spacing(observed.place), extent=max(extent(observed.place), 1e-9)
    )
    likelihood = Likelihood(observed, trend, family, free_noise=free_noise)
    head = [np.log(0.8 * frame.variance)] * likelihood.has_signal + [np.log(0.1 * frame.variance)] * free_noise
    loose = (np.log(1e-6 * frame.variance), np.log(1e3 * frame.variance))
    bounds = [loose] * len(head) + _bounds(family, frame)
    scale = np.array([1.0] * len(head) + units_of(family, 0.1 / frame.extent))
    minima = [
        _descend(likelihood, np.array([*head, *shape]), bounds, scale)
        for shape in _starts(family, frame, observed.place, residual)
    ]
    misfit, unknowns = min(minima, key=lambda minimum: minimum[0])
    return Estimate(
        covariance=likelihood.covariance(unknowns),
        misfit=misfit,
        unknowns=len(unknowns),
        searched=frame.searched(family),
    )


def _descend(
    likelihood: Likelihood, start: FloatArray, bounds: list[tuple[float, float]], scale: FloatArray
) -> tuple[float, FloatArray]:
    """Return the least -ln of the likelihood that is reached from a start, and its unknowns."""
    if not len(start):  # nothing is free: no signal, and the noise is given
        return likelihood(start)[0], start
    from scipy.optimize import minimize

    def scaled(unknowns: Any) -> tuple[float, FloatArray]:
        value, slope = likelihood(np.asarray(unknowns * scale))
        return value, slope * scale

    minimum: Any = minimize(
        scaled,
        start / scale,
        jac=True,
        method="L-BFGS-B",
        bounds=[(low / unit, high / unit) for (low, high), unit in zip(bounds, scale, strict=True)],
        options={"maxiter": 60, "ftol": 1e-8},
    )
    return float(minimum.fun), np.asarray(minimum.x * scale)


def _bounds(family: SignalKind, frame: _Frame) -> list[tuple[float, float]]:
    """Return the bounds of the parameters of a family."""
    turns, longest = 1.0 / frame.shortest, float(np.log(2.0 * frame.extent))
    bounds = {
        ParameterKind.LENGTH: (float(np.log(0.3 * frame.spacing)), float(np.log(10.0 * frame.extent))),
        ParameterKind.WAVE: (float(np.log(frame.shortest)), longest),
        # no wave stays in step for ever: the rays of a model cross it at angles that change
        ParameterKind.FADE: (float(np.log(frame.spacing)), longest),
        ParameterKind.NUMBER: (-turns, turns),
        ParameterKind.AZIMUTH: (-2.0 * np.pi, 2.0 * np.pi),
    }
    return [bounds[kind] for kind in parameter_kinds(family)]


def _starts(family: SignalKind, frame: _Frame, place: FloatArray, residual: FloatArray) -> Iterable[list[float]]:
    lengths = np.log(np.geomspace(frame.spacing, max(frame.extent / 2.0, 2.0 * frame.spacing), _LENGTHS)).tolist()
    long = float(np.log(frame.extent))
    if family == SignalKind.NONE:
        return [[]]
    if family in (SignalKind.GAUSSIAN, SignalKind.EXPONENTIAL):
        return [[length] for length in lengths]
    if family == SignalKind.ELLIPTIC:
        return [[lengths[2], lengths[1], azimuth] for azimuth in np.arange(4) * np.pi / 4.0]
    peaks = wave_vectors(place, residual, frame.shortest, frame.extent)
    if family == SignalKind.BESSEL:
        return [[float(-np.log(np.hypot(*peak))), long] for peak in peaks]
    return [[*peak.tolist(), long] for peak in peaks]


def wave_vectors(place: FloatArray, residual: FloatArray, shortest: float, reach: float) -> FloatArray:
    """Return the wave vectors (k, 2), cycles/m, that take the most out of residuals (n,) at places (n, 2).

    Waves from `shortest` to twice `reach` (m); strongest first, each a mesh or more from those before it.
    """
    if len(place) > _MOST:
        chosen = np.random.default_rng(len(place)).choice(len(place), _MOST, replace=False)
        place, residual = place[chosen], residual[chosen]
    mesh = 0.4 / reach
    number = int(np.ceil(1.0 / (shortest * mesh)))
    fx, fy = np.meshgrid(np.arange(-number, number + 1) * mesh, np.arange(0, number + 1) * mesh)
    vectors = np.stack([fx.ravel(), fy.ravel()], axis=1)
    size = np.hypot(*vectors.T)
    vectors = vectors[(size >= 0.5 / reach) & (size <= 1.0 / shortest)]
    power = np.concatenate([_explained(place, residual, part) for part in np.array_split(vectors, 50) if len(part)])
    peaks: list[int] = []
    for row in np.argsort(-power, kind="stable"):
        near = [min(np.hypot(*(vectors[row] - s * vectors[peak])) for s in (1, -1)) < 2.0 * mesh for peak in peaks]
        if not any(near):
            peaks.append(int(row))
        if len(peaks) == _PEAKS:
            break
    return vectors[peaks]


def _explained(place: FloatArray, residual: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the sum of squares (k,) that cosine and sine of each wave vector (k, 2) explain of residuals (n,)."""
    turn = 2.0 * np.pi * vectors @ place.T
    c, s = np.cos(turn), np.sin(turn)
    cc, ss, cs = (c * c).sum(axis=1), (s * s).sum(axis=1), (c * s).sum(axis=1)
    yc, ys = c @ residual, s @ residual
    determinant = np.maximum(cc * ss - cs * cs, 1e-9 * cc * ss + 1e-30)
    return (ss * yc * yc - 2.0 * cs * yc * ys + cc * ys * ys) / determinant
