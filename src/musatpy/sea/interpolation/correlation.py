"""Correlation functions in the plane: how alike the signal is at two places, by what parts them.

Each is positive definite in two dimensions: a Gaussian and an exponential function (Moritz 1980, Kraus 1972), a
Gaussian whose length depends on direction, and two that turn negative as errors due to waves do: J0 of the
distance, that of waves of one length from all directions, and the cosine along one direction, that of one swell;
both die away by a Gaussian factor (products of positive definite functions are so too).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.units import DEGREE

Evaluation = tuple[FloatArray, list[FloatArray]]  # correlations, and their partials by each parameter


class SignalKind(StrEnum):
    """Kinds of correlation functions."""

    NONE = "none"  # no signal: trend and noise alone
    GAUSSIAN = "gaussian"
    EXPONENTIAL = "exponential"
    ELLIPTIC = "elliptic"
    BESSEL = "bessel"
    SWELL = "swell"


class ParameterKind(StrEnum):
    """What a parameter of a correlation function is."""

    LENGTH = "ln of a length"
    FADE = "ln of the length over which a wave dies away"
    WAVE = "ln of a wave length"
    NUMBER = "cycles/m"
    AZIMUTH = "rad"


@dataclass(frozen=True, kw_only=True, eq=False)
class Correlation:
    """A correlation function with its parameters, in the units of `names`: ln m for lengths, cycles/m for waves."""

    family: SignalKind
    parameters: tuple[float, ...] = ()

    def __call__(self, lag: FloatArray) -> FloatArray:
        """Return the correlations (...) at lags (..., 2) m."""
        return _FORMS[self.family].function(lag, np.array(self.parameters), False)[0]

    def with_partials(self, lag: FloatArray) -> Evaluation:
        """Return the correlations (...) at lags (..., 2) m, and their partials by each parameter."""
        return _FORMS[self.family].function(lag, np.array(self.parameters), True)

    def in_words(self) -> str:
        """Return the parameters as they are printed: lengths in m, azimuths in degrees from x towards y."""
        return _FORMS[self.family].words(np.array(self.parameters))

    @property
    def length(self) -> float:
        """Length (m) over which the function dies away; 0 without a signal."""
        named = zip(parameter_kinds(self.family), self.parameters, strict=True)
        return max(
            (float(np.exp(p)) for kind, p in named if kind in (ParameterKind.LENGTH, ParameterKind.FADE)),
            default=0.0,
        )

    @property
    def wave_length(self) -> float | None:
        """Wave length (m) of a function that is nearly periodic, None of others."""
        if self.family == SignalKind.BESSEL:
            return float(np.exp(self.parameters[0]))
        if self.family == SignalKind.SWELL:
            return float(1.0 / np.hypot(self.parameters[0], self.parameters[1]))
        return None

    def reach(self, least: float = 0.1) -> float:
        """Return the distance (m) at which the correlation, of a swell its envelope, first falls below `least`."""
        if self.family == SignalKind.NONE:
            return 0.0
        if self.family in (SignalKind.SWELL, SignalKind.GAUSSIAN, SignalKind.ELLIPTIC):
            return self.length * float(np.sqrt(-np.log(least)))
        if self.family == SignalKind.EXPONENTIAL:
            return self.length * float(-np.log(least))
        assert self.wave_length is not None
        distance = np.linspace(0.0, self.wave_length, 2001)
        value = self(np.stack([distance, np.zeros_like(distance)], axis=-1))
        return float(distance[np.argmax(value < least)])


def _gaussian(lag: FloatArray, p: FloatArray, partials: bool) -> Evaluation:
    """exp(-(d/L)^2); p = ln L."""
    ratio = np.square(lag).sum(axis=-1) * np.exp(-2.0 * p[0])
    value = np.exp(-ratio)
    return value, [2.0 * ratio * value] if partials else []


def _exponential(lag: FloatArray, p: FloatArray, partials: bool) -> Evaluation:
    """exp(-d/L); p = ln L."""
    ratio = np.hypot(lag[..., 0], lag[..., 1]) * np.exp(-p[0])
    value = np.exp(-ratio)
    return value, [ratio * value] if partials else []


def _elliptic(lag: FloatArray, p: FloatArray, partials: bool) -> Evaluation:
    """exp(-(u/L1)^2 - (v/L2)^2), u along the azimuth a, v across it; p = ln L1, ln L2, a."""
    c, s = np.cos(p[2]), np.sin(p[2])
    u, v = c * lag[..., 0] + s * lag[..., 1], c * lag[..., 1] - s * lag[..., 0]
    first, second = np.exp(-2.0 * p[0]), np.exp(-2.0 * p[1])
    value = np.exp(-u * u * first - v * v * second)
    if not partials:
        return value, []
    return value, [
        2.0 * u * u * first * value,
        2.0 * v * v * second * value,
        2.0 * u * v * (second - first) * value,
    ]


def _bessel(lag: FloatArray, p: FloatArray, partials: bool) -> Evaluation:
    """J0(2 pi d / w) exp(-(d/L)^2); p = ln w, ln L."""
    from scipy.special import j0, j1  # a plain run does without

    d = np.hypot(lag[..., 0], lag[..., 1])
    turn = 2.0 * np.pi * d * np.exp(-p[0])
    ratio = np.square(d * np.exp(-p[1]))
    fade = np.exp(-ratio)
    value = j0(turn) * fade
    return value, [j1(turn) * turn * fade, 2.0 * ratio * value] if partials else []


def _swell(lag: FloatArray, p: FloatArray, partials: bool) -> Evaluation:
    """cos 2 pi (p1 dx + p2 dy) exp(-(d/L)^2); p = cycles per m along x and y, ln L."""
    turn = 2.0 * np.pi * (p[0] * lag[..., 0] + p[1] * lag[..., 1])
    ratio = np.square(lag).sum(axis=-1) * np.exp(-2.0 * p[2])
    fade = np.exp(-ratio)
    value = np.cos(turn) * fade
    if not partials:
        return value, []
    slope = -2.0 * np.pi * np.sin(turn) * fade
    return value, [slope * lag[..., 0], slope * lag[..., 1], 2.0 * ratio * value]


def _azimuth(x: float, y: float) -> float:
    """Return the azimuth (degrees, 0 to 180) of an axis without a sense."""
    return float(np.arctan2(y, x) / DEGREE) % 180.0


@dataclass(frozen=True)
class _Form:
    """What makes a family: its unknowns, its function, and its parameters as they are printed."""

    unknowns: tuple[ParameterKind, ...]
    function: Callable[[FloatArray, FloatArray, bool], Evaluation]
    words: Callable[[FloatArray], str]


_FORMS = {
    SignalKind.NONE: _Form(
        (), lambda lag, p, partials: (np.zeros(lag.shape[:-1]), []), lambda p: "trend and noise alone"
    ),
    SignalKind.GAUSSIAN: _Form((ParameterKind.LENGTH,), _gaussian, lambda p: f"length {np.exp(p[0]):.1f} m"),
    SignalKind.EXPONENTIAL: _Form((ParameterKind.LENGTH,), _exponential, lambda p: f"length {np.exp(p[0]):.1f} m"),
    SignalKind.ELLIPTIC: _Form(
        (ParameterKind.LENGTH, ParameterKind.LENGTH, ParameterKind.AZIMUTH),
        _elliptic,
        lambda p: (
            f"lengths {np.exp(p[0]):.1f} m along {_azimuth(np.cos(p[2]), np.sin(p[2])):.1f} deg, "
            f"{np.exp(p[1]):.1f} m across"
        ),
    ),
    SignalKind.BESSEL: _Form(
        (ParameterKind.WAVE, ParameterKind.FADE),
        _bessel,
        lambda p: f"waves of {np.exp(p[0]):.1f} m, length {np.exp(p[1]):.1f} m",
    ),
    SignalKind.SWELL: _Form(
        (ParameterKind.NUMBER, ParameterKind.NUMBER, ParameterKind.FADE),
        _swell,
        lambda p: (
            f"waves of {1.0 / np.hypot(p[0], p[1]):.1f} m along {_azimuth(p[0], p[1]):.1f} deg, "
            f"length {np.exp(p[2]):.1f} m"
        ),
    ),
}


def parameter_kinds(family: SignalKind) -> tuple[ParameterKind, ...]:
    """Return what the parameters of a family are."""
    return _FORMS[family].unknowns


def units_of(family: SignalKind, turn: float) -> list[float]:
    """Return units of the parameters of a family in which they matter alike: wave numbers by a `turn`, cycles/m."""
    return [turn if kind is ParameterKind.NUMBER else 1.0 for kind in parameter_kinds(family)]
