"""Trains of sinusoidal waves by four numbers each, which may be unknown: amplitude, length, direction, crest.

The crest is a distance from the origin, along the direction, at time 0. Length and direction turn and stretch the
wave about that place: far from it, or long after, they cannot be told from the crest. Whoever wants them apart puts
origin and time 0 in the middle of what is observed (`about`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from musatpy.refraction.harmonic import Harmonic
from musatpy.refraction.surface import FloatArray, unit_direction

AMPLITUDE, LENGTH, DIRECTION, CREST = range(4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trains:
    """Waves about a level (m): values (k, 4) of amplitude (m), length (m), direction (rad, from x to y), crest (m).

    number (k,) rad/m and frequency (k,) rad/s are those of the waves as they were given. As a length changes, the
    frequency follows by linear theory in water of a depth (m, infinite for deep water), w^2 ~ k tanh kh; without a
    depth the speed of the crests stays.
    """

    level: float
    values: FloatArray
    number: FloatArray
    frequency: FloatArray
    depth: float | None = None

    @classmethod
    def of(cls, wave: Harmonic, depth: float | None = None) -> Self:
        """Return the trains of a surface. Raises `ValueError` unless the depth is positive."""
        if depth is not None and not depth > 0.0:
            raise ValueError("the depth from which the speed of waves follows is positive")
        number = np.linalg.norm(wave.vector, axis=1)
        values = [wave.amplitude, 2.0 * np.pi / number, np.arctan2(wave.vector[:, 1], wave.vector[:, 0]),
                  wave.phase / number]  # fmt: skip
        return cls(
            level=wave.level,
            values=np.stack(values, axis=1),
            number=number,
            frequency=wave.frequency,
            depth=depth,
        )

    def with_values(self, values: FloatArray) -> Self:
        """Return the trains with other values (k, 4)."""
        return replace(self, values=values)

    @property
    def sensible(self) -> bool:
        """Whether these are waves at all: lengths are positive, and no slope is steeper than 45 degrees."""
        A, L = self.values[:, AMPLITUDE], self.values[:, LENGTH]
        return bool(np.isfinite(self.values).all() and (L > 0.0).all() and (2.0 * np.pi * np.abs(A) < L).all())

    @property
    def speed(self) -> FloatArray:
        """Speed (k,) m/s of the crests."""
        k = 2.0 * np.pi / self.values[:, LENGTH]
        return np.asarray(self._frequency(k)[0] / k)

    @property
    def surface(self) -> Harmonic:
        """The waves as a refracting surface."""
        A, L, a, c = self.values.T
        k = 2.0 * np.pi / L
        return Harmonic(
            level=self.level,
            amplitude=A,
            vector=k[:, None] * unit_direction(a),
            frequency=self._frequency(k)[0],
            phase=k * c,
        )

    def by_parameters(self, xy: FloatArray, time: ArrayLike = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return partials by the values, of height (..., k, 4) and gradient (..., 2, k, 4), at places (..., 2)."""
        A, L, a, c = self.values.T
        k = 2.0 * np.pi / L
        frequency, by_number = self._frequency(k)
        u, across = unit_direction(a), unit_direction(a + 0.5 * np.pi)
        t = np.asarray(time)[..., None]
        along = xy @ u.T - c
        angle = k * along - frequency * t
        cosine, sine = np.cos(angle), np.sin(angle)
        nothing = np.zeros_like(angle)
        # of the angle by the four values; the amplitude has no part in it
        turn = np.stack([nothing, -k / L * (along - by_number * t), k * (xy @ across.T), nothing - k], axis=-1)
        height = -(A * sine)[..., None] * turn
        height[..., AMPLITUDE] = cosine
        vector = k[:, None] * u
        # of the wave vectors (k, 2) by the four values
        stretch = np.zeros((len(k), 2, 4))
        stretch[:, :, LENGTH] = -vector / L[:, None]
        stretch[:, :, DIRECTION] = k[:, None] * across
        gradient = -(A * cosine)[..., None, None] * vector[:, :, None] * turn[..., None, :]
        gradient -= (A * sine)[..., None, None] * stretch
        gradient[..., AMPLITUDE] = -sine[..., None] * vector
        return height, np.moveaxis(gradient, -2, -3)

    def _frequency(self, k: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the frequencies (k,) rad/s of wave numbers (k,), and their derivatives, the speeds of groups."""
        ratio = k / self.number
        if self.depth is None:
            return self.frequency * ratio, self.frequency / self.number
        if np.isinf(self.depth):
            frequency = self.frequency * np.sqrt(ratio)
            return frequency, frequency / (2.0 * k)
        h = self.depth
        t = np.tanh(k * h)
        frequency = self.frequency * np.sqrt(ratio * t / np.tanh(self.number * h))
        return frequency, frequency * 0.5 * (1.0 / k + h * (1.0 - t * t) / t)


def about(wave: Harmonic, place: ArrayLike, time: float = 0.0) -> Harmonic:
    """Return the same waves with x and y (2,) m counted from another place, and times from another moment (s)."""
    shift = wave.vector @ np.asarray(place, dtype=float) - wave.frequency * time
    return replace(wave, phase=wave.phase - shift)
