"""Trains of sinusoidal waves by four numbers each, which may be unknown: height, length, azimuth, crest.

They are those of the wave cards: heights from trough to crest, azimuths clockwise from y (north) of the direction
the wave runs to, crests as distances from the origin in that direction, at time 0. Length and azimuth stretch and
turn the wave about that place: far from it, or long after, they cannot be told from the crest. Whoever wants them
apart puts origin and time 0 in the middle of what is observed (`about`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray
from musatpy.refraction.harmonic import Harmonic

HEIGHT, LENGTH, AZIMUTH, CREST = range(4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trains:
    """Waves about a level (m): values (k, 4) of height (m), length (m), azimuth (rad, from y to x), crest (m).

    number (k,) rad/m and frequency (k,) rad/s are those of the waves as they were given. As a length changes, the
    frequency follows by linear theory in water of a depth (k,) m, infinite for deep water: w^2 ~ k tanh kh. Where
    the depth is NaN the speed of the crests stays, and where `steady` (k,) is true, the period.
    """

    level: float
    values: FloatArray
    number: FloatArray
    frequency: FloatArray
    depth: FloatArray
    steady: BoolArray

    @classmethod
    def of(cls, wave: Harmonic, depth: ArrayLike = np.nan, steady: ArrayLike = False) -> Self:
        """Return the trains of a surface. Raises `ValueError` unless depths are positive, or NaN, one per wave."""
        number = np.linalg.norm(wave.vector, axis=1)
        h, fixed = np.asarray(depth, dtype=float), np.asarray(steady, dtype=bool)
        if {h.shape, fixed.shape} - {(), number.shape}:
            raise ValueError("there is one depth for all waves, or one for each")
        if (h <= 0.0).any():
            raise ValueError("the depth from which the speed of waves follows is positive")
        azimuth = np.arctan2(wave.vector[:, 0], wave.vector[:, 1]) % (2.0 * np.pi)
        values = [2.0 * wave.amplitude, 2.0 * np.pi / number, azimuth, wave.phase / number]
        return cls(
            level=wave.level,
            values=np.stack(values, axis=1),
            number=number,
            frequency=wave.frequency,
            depth=np.broadcast_to(h, number.shape),
            steady=np.broadcast_to(fixed, number.shape),
        )

    def with_values(self, values: FloatArray) -> Self:
        """Return the trains with other values (k, 4)."""
        return replace(self, values=values)

    @property
    def sensible(self) -> bool:
        """Whether these are waves at all: lengths are positive, and no slope is steeper than 45 degrees."""
        H, L = self.values[:, HEIGHT], self.values[:, LENGTH]
        return bool(np.isfinite(self.values).all() and (L > 0.0).all() and (np.pi * np.abs(H) < L).all())

    @property
    def speed(self) -> FloatArray:
        """Speed (k,) m/s of the crests."""
        k = 2.0 * np.pi / self.values[:, LENGTH]
        return self._frequency(k)[0] / k

    @property
    def surface(self) -> Harmonic:
        """The waves as a refracting surface."""
        H, L, a, c = self.values.T
        k = 2.0 * np.pi / L
        return Harmonic(
            level=self.level,
            amplitude=0.5 * H,
            vector=k[:, None] * _towards(a),
            frequency=self._frequency(k)[0],
            phase=k * c,
        )

    def by_parameters(self, xy: FloatArray, time: ArrayLike = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return partials by the values, of height (..., k, 4) and gradient (..., 2, k, 4), at places (..., 2)."""
        H, L, a, c = self.values.T
        A, k = 0.5 * H, 2.0 * np.pi / L
        frequency, by_number = self._frequency(k)
        u, across = _towards(a), _towards(a + 0.5 * np.pi)
        t = np.asarray(time)[..., None]
        along = xy @ u.T - c
        angle = k * along - frequency * t
        cosine, sine = np.cos(angle), np.sin(angle)
        nothing = np.zeros_like(angle)
        # of the angle by the four values; the height has no part in it
        turn = np.stack([nothing, -k / L * (along - by_number * t), k * (xy @ across.T), nothing - k], axis=-1)
        height = -(A * sine)[..., None] * turn
        height[..., HEIGHT] = 0.5 * cosine
        vector = k[:, None] * u
        # of the wave vectors (k, 2) by the four values
        stretch = np.zeros((len(k), 2, 4))
        stretch[:, :, LENGTH] = -vector / L[:, None]
        stretch[:, :, AZIMUTH] = k[:, None] * across
        gradient = -(A * cosine)[..., None, None] * vector[:, :, None] * turn[..., None, :]
        gradient -= (A * sine)[..., None, None] * stretch
        gradient[..., HEIGHT] = -0.5 * sine[..., None] * vector
        return height, np.moveaxis(gradient, -2, -3)

    def _frequency(self, k: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the frequencies (k,) rad/s of wave numbers (k,), and their derivatives, the speeds of groups."""
        ratio = k / self.number
        with np.errstate(invalid="ignore"):  # deep water, or none
            t, t0 = np.tanh(k * self.depth), np.tanh(self.number * self.depth)
            shallow = np.nan_to_num(self.depth * (1.0 - t * t) / t)
        by_theory = self.frequency * np.sqrt(ratio * t / t0)
        moving = np.isnan(self.depth)
        frequency = np.where(moving, self.frequency * ratio, by_theory)
        group = np.where(moving, self.frequency / self.number, by_theory * 0.5 * (1.0 / k + shallow))
        return np.where(self.steady, self.frequency, frequency), np.where(self.steady, 0.0, group)


def about(wave: Harmonic, place: ArrayLike, time: float = 0.0) -> Harmonic:
    """Return the same waves with x and y (2,) m counted from another place, and times from another moment (s)."""
    shift = wave.vector @ np.asarray(place, dtype=float) - wave.frequency * time
    return replace(wave, phase=wave.phase - shift)


def _towards(azimuth: FloatArray) -> FloatArray:
    """Return unit vectors (k, 2) of azimuths (k,), clockwise from y."""
    return np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
