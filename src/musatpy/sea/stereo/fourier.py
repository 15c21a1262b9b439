"""A sea as a level and a few waves: z = level + sum a cos k.x + b sin k.x, estimated by least squares.

Parameters stand in one vector: level, then a, b (m), kx, ky (rad/m) of every wave. a and b in place of amplitude
and phase, because these have no derivative where the amplitude is zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.similarity import spread
from musatpy.refraction.waves import Harmonic
from musatpy.sea.stereo.spectrum import Band, spectrum
from musatpy.sea.stereo.surface_points import SurfacePoints

PER_WAVE = 4
RISK = 0.01  # of taking noise for a wave, over all wave vectors tried
_WEIGHT_PASSES = 3  # weights depend on the slope, which hardly changes
_SET_ASIDE = 4.0  # deviations, by the median, beyond which a point has no say in the search for waves


@dataclass(frozen=True, kw_only=True, eq=False)
class FourierSurface:
    """Waves about a level: parameters (p,) and their covariance (p, p), about `origin` (2,) m of the job.

    area (2, 2) m about the origin: lower left and upper right corner of the box around its points.
    """

    origin: FloatArray
    parameters: FloatArray
    covariance: FloatArray
    area: FloatArray

    @property
    def count(self) -> int:
        """How many waves there are."""
        return (len(self.parameters) - 1) // PER_WAVE

    @property
    def level(self) -> float:
        """Mean height, m."""
        return float(self.parameters[0])

    @cached_property
    def surface(self) -> Harmonic:
        """The surface, about the origin, standing still."""
        amplitude, phase, vector = _polar(self.parameters)
        zero = np.zeros(len(amplitude))
        return Harmonic(level=self.level, amplitude=amplitude, vector=vector, frequency=zero, phase=phase)

    @property
    def described(self) -> tuple[FloatArray, FloatArray]:
        """(k, 4) amplitude (m), length (m), azimuth and phase (rad) of each wave, and their sigmas.

        The azimuth is counted from x towards y, and lies within a right angle of x: a surface that stands still
        does not say which way its waves run.
        """
        amplitude, phase, vector = _polar(self.parameters)
        number = np.linalg.norm(vector, axis=1)
        values = [amplitude, 2.0 * np.pi / number, np.arctan2(vector[:, 1], vector[:, 0]), phase]
        a, b, kx, ky = self.parameters[1:].reshape(-1, PER_WAVE).T
        T = np.zeros((len(a), 4, PER_WAVE))  # by a, b, kx, ky
        T[:, 0, 0], T[:, 0, 1] = a / amplitude, b / amplitude
        T[:, 1, 2], T[:, 1, 3] = -2.0 * np.pi * kx / number**3, -2.0 * np.pi * ky / number**3
        T[:, 2, 2], T[:, 2, 3] = -ky / number**2, kx / number**2
        T[:, 3, 0], T[:, 3, 1] = -b / amplitude**2, a / amplitude**2
        rows = 1 + PER_WAVE * np.arange(self.count)[:, None] + np.arange(PER_WAVE)
        variance = np.einsum("kij,kjl,kil->ki", T, self.covariance[rows[:, :, None], rows[:, None, :]], T)
        return np.stack(values, axis=1), np.sqrt(variance)

    def covers(self, xy: FloatArray) -> BoolArray:
        """Tell which places (..., 2) m about the origin lie among its points; the waves themselves have no end."""
        return ((xy >= self.area[0]) & (xy <= self.area[1])).all(axis=-1)

    def shape_covariance(self, xy: FloatArray) -> FloatArray:
        """Return (n, 3k, 3k) the joint covariance of height and gradient at places (n, k, 2) m about the origin."""
        n, k, _ = xy.shape
        design = shape_partials(self.parameters, xy.reshape(-1, 2)).reshape(n, 3 * k, -1)
        return design @ self.covariance @ np.swapaxes(design, 1, 2)


def _polar(parameters: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return amplitudes (k,), phases (k,) and vectors (k, 2)."""
    waves = parameters[1:].reshape(-1, PER_WAVE)
    return np.hypot(waves[:, 0], waves[:, 1]), np.arctan2(waves[:, 1], waves[:, 0]), waves[:, 2:].copy()


def height_and_gradient(parameters: FloatArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return heights (n,) m and gradients (n, 2) at places (n, 2) m about the origin."""
    waves = parameters[1:].reshape(-1, PER_WAVE)
    angle = xy @ waves[:, 2:].T
    c, s = np.cos(angle), np.sin(angle)
    return parameters[0] + c @ waves[:, 0] + s @ waves[:, 1], (c * waves[:, 1] - s * waves[:, 0]) @ waves[:, 2:]


def shape_partials(parameters: FloatArray, xy: FloatArray) -> FloatArray:
    """Return (n, 3, p) the partials of height and gradient at places (n, 2) m by the parameters (p,)."""
    a, b, kx, ky = parameters[1:].reshape(-1, PER_WAVE).T
    angle = xy @ np.stack([kx, ky])
    c, s = np.cos(angle), np.sin(angle)
    x, y = xy[:, :1], xy[:, 1:]
    along, across = b * c - a * s, -(a * c + b * s)  # of the height by the angle, once and twice
    out = np.zeros((len(xy), 3, len(parameters)))
    out[:, 0, 0] = 1.0
    out[:, 0, 1:] = _interleaved(c, s, along * x, along * y)
    out[:, 1, 1:] = _interleaved(-s * kx, c * kx, along + across * x * kx, across * y * kx)
    out[:, 2, 1:] = _interleaved(-s * ky, c * ky, across * x * ky, along + across * y * ky)
    return out


def _interleaved(*columns: FloatArray) -> FloatArray:
    return np.stack(columns, axis=-1).reshape(len(columns[0]), -1)


@dataclass(frozen=True, kw_only=True, eq=False)
class WaveTrial:
    """One wave tried: where the spectrum peaks, what the fit makes of it, and whether it is taken.

    length (m) and azimuth (rad) of the peak, its power; F of the test and what it has to exceed; reason: why it is
    not taken, blank where it is.
    """

    length: float
    azimuth: float
    power: float
    ratio: float
    critical: float
    reason: str

    @property
    def is_tested(self) -> bool:
        """Whether it came to a test."""
        return bool(np.isfinite(self.critical))

    @property
    def is_taken(self) -> bool:
        """Whether the wave is part of the model."""
        return not self.reason


def find_waves(
    points: SurfacePoints, origin: FloatArray, waves: Band, most: int, risk: float, start: FloatArray | None = None
) -> tuple[FloatArray, list[WaveTrial]]:
    """Return the parameters (p,) of at most so many waves of a band in points, and every step (matching pursuit).

    The wave of the highest peak of the spectrum of the residuals joins the model, all parameters are estimated
    anew, and an F-test says whether that is worth four parameters; the first one that is not ends the search. The
    `risk` is that noise is taken for a wave.
    """
    xy, z = points.position[:, :2] - origin, points.position[:, 2]
    q = np.array([float(np.median(z))]) if start is None else start
    steps: list[WaveTrial] = []
    while (len(q) - 1) // PER_WAVE < most:
        trial, step = _one_more(points, xy, z, q, waves, risk)
        steps.append(step)
        if not step.is_taken:
            break
        q = trial
    return q, steps


def _one_more(
    points: SurfacePoints, xy: FloatArray, z: FloatArray, q: FloatArray, waves: Band, risk: float
) -> tuple[FloatArray, WaveTrial]:
    from scipy.special import fdtri  # heavy

    height, gradient = height_and_gradient(q, xy)
    weight, residual = 1.0 / points.height_variance(gradient), z - height
    heard = np.abs(residual) <= _SET_ASIDE * spread(np.abs(residual), 1e-12)
    xy, z, weight, residual = (values[heard] for values in (xy, z, weight, residual))
    peak, power = spectrum(xy, residual, weight, waves).peak
    number, azimuth = float(np.linalg.norm(peak)), float(np.arctan2(peak[1], peak[0]))
    length = 2.0 * np.pi / number if number else np.inf
    freedom = len(z) - len(q) - PER_WAVE
    step = WaveTrial(length=length, azimuth=azimuth, power=power, ratio=0.0, critical=np.inf, reason="")
    if power <= 0.0:
        return q, replace(step, length=np.nan, azimuth=np.nan, reason="no wave of the band is in the residuals")
    if freedom < len(q) + PER_WAVE:
        return q, replace(step, reason=f"{len(z)} points are too few for {len(q) + PER_WAVE} parameters")
    before = least_squares(q, xy, z, weight)
    first = _with_wave(before, peak, xy, z, weight)
    after = least_squares(first, xy, z, weight)
    old, new = (float(weight @ np.square(z - height_and_gradient(p, xy)[0])) for p in (before, after))
    rounding = 1e-24 * float(weight @ np.square(z))
    step = replace(
        step,
        ratio=(old - new) / PER_WAVE / max(new / freedom, rounding, 1e-300),
        critical=float(fdtri(PER_WAVE, freedom, 1.0 - risk / waves.trials)),
    )
    return after, replace(step, reason=_why_not(after, xy, weight, step, waves))


def _why_not(q: FloatArray, xy: FloatArray, weight: FloatArray, step: WaveTrial, waves: Band) -> str:
    if not step.ratio > step.critical:
        return "no better than noise"
    if not all(waves.holds(vector) for vector in _polar(q)[2]):
        return "the fit leaves the band of the search"
    design = shape_partials(q, xy)[:, 0] * np.sqrt(weight)[:, None]
    size = np.linalg.norm(design, axis=0)
    # parameters are told apart where the correlation matrix of the normals is far from singular
    if not ((size > 0.0).all() and np.linalg.eigvalsh((design / size).T @ (design / size))[0] > 1e-8):
        return "cannot be told from the waves before it"
    return ""


def _with_wave(q: FloatArray, vector: FloatArray, xy: FloatArray, z: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the parameters with one more wave, cosine and sine by linear least squares."""
    first = np.concatenate([q, [0.0, 0.0], vector])
    linear = np.array([i for i in range(len(first)) if i == 0 or (i - 1) % PER_WAVE < 2])
    root = np.sqrt(weight)
    design = shape_partials(first, xy)[:, 0, linear] * root[:, None]
    first[linear] = np.linalg.lstsq(design, z * root, rcond=None)[0]
    return first


def least_squares(q: FloatArray, xy: FloatArray, z: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the parameters (p,) of least squares, by the method of Levenberg and Marquardt from q.

    Heights z (n,) m at places (n, 2) m about the origin, with weights (n,). The waves are turned to kx > 0.
    """
    from scipy.optimize import least_squares  # heavy

    root = np.sqrt(weight)

    def misfit(p: FloatArray) -> FloatArray:
        return root * (height_and_gradient(p, xy)[0] - z)

    def partials(p: FloatArray) -> FloatArray:
        return root[:, None] * shape_partials(p, xy)[:, 0]

    found = least_squares(misfit, q, jac=partials, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-14, gtol=1e-14)
    return _turned(np.asarray(found.x, dtype=float))


def _turned(q: FloatArray) -> FloatArray:
    """Return the parameters with kx > 0: k and b of opposite sign are the same wave."""
    out = q.copy()
    waves = out[1:].reshape(-1, PER_WAVE)
    back = (waves[:, 2] < 0.0) | ((waves[:, 2] == 0.0) & (waves[:, 3] < 0.0))
    waves[back, 1:] *= -1.0
    return out


def estimate(points: SurfacePoints, origin: FloatArray, start: FloatArray) -> FourierSurface:
    """Return the surface of least squares from parameters (p,) near it, with its covariance by sigmas given."""
    xy, z = points.position[:, :2] - origin, points.position[:, 2]
    q = start
    for _ in range(_WEIGHT_PASSES):
        weight = 1.0 / points.height_variance(height_and_gradient(q, xy)[1])
        q = least_squares(q, xy, z, weight)
    design = shape_partials(q, xy)[:, 0]
    covariance = np.asarray(np.linalg.inv(design.T @ (design * weight[:, None])), dtype=float)
    area = np.stack([xy.min(axis=0), xy.max(axis=0)])
    return FourierSurface(origin=origin, parameters=q, covariance=covariance, area=area)
