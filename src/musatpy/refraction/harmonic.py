"""Sinusoidal waves, and sums of them: components of any lengths, directions and speeds, a Fourier sum in plan.

Okamoto (1982), eq. 1 to 8, with heights up: z = level + sum A cos(k . (x, y) - w t - phase), k the wave vector.
Among them second-order Stokes waves, with sharper crests and flatter troughs, in water of any depth (Stokes 1847):
the tests prove them by the conditions at the free surface themselves. To the sinusoidal wave comes its bound
harmonic, half as long and moving with it, about the mean level.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray
from musatpy.refraction.surface import Limits, Relief, everywhere, unit_direction


@dataclass(frozen=True, kw_only=True, eq=False)
class Harmonic:
    """Waves about a level (m), one entry per component.

    amplitude (k,) m, half the height from trough to crest; vector (k, 2) rad/m, 2 pi over the length, in the
    direction the wave runs to; frequency (k,) rad/s, 2 pi over the period: a crest moves at the frequency over the
    length of the vector; phase (k,) rad. A crest stands where vector . (x, y) = phase + frequency t.
    """

    level: float = 0.0
    amplitude: FloatArray
    vector: FloatArray
    frequency: FloatArray
    phase: FloatArray

    def __post_init__(self) -> None:
        count = len(self.amplitude)
        shapes = {np.shape(self.amplitude), np.shape(self.frequency), np.shape(self.phase)}
        if shapes != {(count,)} or np.shape(self.vector) != (count, 2):
            raise ValueError("a wave has one amplitude, vector, frequency and phase per component")
        if not (np.linalg.norm(self.vector, axis=-1) > 0.0).all():
            raise ValueError("a wave vector of length zero is no wave")

    @cached_property
    def limits(self) -> Limits:
        """What the sum keeps to: the components at their worst together."""
        number = np.linalg.norm(self.vector, axis=-1)
        height = np.abs(self.amplitude)
        return Limits(
            lowest=self.level - float(height.sum()),
            highest=self.level + float(height.sum()),
            slope=float(np.sum(height * number)),
            curvature=float(np.sum(height * number**2)),
            third=float(np.sum(height * number**3)),
            length=float(2.0 * np.pi / number.max()) if len(number) else np.inf,
        )

    def relief(self, xy: FloatArray, time: ArrayLike = 0.0) -> Relief:
        """Return its shape at places xy (..., 2) m, at times (...) s."""
        k = self.vector
        angle = xy @ k.T - np.asarray(time)[..., None] * self.frequency - self.phase
        across = self.amplitude * np.cos(angle)
        along = -self.amplitude * np.sin(angle)
        return Relief(
            height=self.level + across.sum(axis=-1),
            gradient=along @ k,
            hessian=-(across @ (k[:, :, None] * k[:, None, :]).reshape(-1, 4)).reshape(*across.shape[:-1], 2, 2),
        )

    def covers(self, xy: FloatArray, time: ArrayLike = 0.0) -> BoolArray:
        """Tell that it is known everywhere."""
        return everywhere(xy)


def sinusoidal(
    *,
    amplitude: ArrayLike,
    length: ArrayLike,
    azimuth: ArrayLike,
    speed: ArrayLike = 0.0,
    crest: ArrayLike = 0.0,
    level: float = 0.0,
) -> Harmonic:
    """Return one wave, or several (k,) superposed, as they are described on paper.

    amplitude and length (m); azimuth (rad) from x towards y of the direction it runs to; speed (m/s) of the crests;
    crest (m): distance from the origin, along the direction, of a crest at time 0. Raises `ValueError`.
    """
    A, L, a, v, c = np.broadcast_arrays(*(np.atleast_1d(np.asarray(value, float)) for value in
                                          (amplitude, length, azimuth, speed, crest)))  # fmt: skip
    if not (L > 0.0).all():
        raise ValueError("a wave length is positive")
    k = 2.0 * np.pi / L
    return Harmonic(level=level, amplitude=A, vector=k[:, None] * unit_direction(a), frequency=k * v, phase=k * c)


def second_harmonic(amplitude: float, number: float, depth: float) -> float:
    """Return the amplitude (m) of the bound harmonic of a wave: `amplitude` a (m), `number` k (rad/m)."""
    kh = number * depth
    # a^2 k / 4 cosh kh (2 + cosh 2kh) / sinh^3 kh, in terms that do not overflow in deep water
    coth = 1.0 / np.tanh(kh)
    return float(amplitude**2 * number / 4.0 * coth * (3.0 * coth**2 - 1.0))


def stokes(
    *,
    amplitude: float,
    length: float,
    azimuth: float,
    speed: float,
    depth: float,
    crest: float = 0.0,
    level: float = 0.0,
) -> Harmonic:
    """Return a second-order Stokes wave; the arguments are those of `sinusoidal`, and the mean `depth` (m).

    Raises `ValueError` where the theory has left its ground: from a bound harmonic of a quarter of the amplitude on
    a second crest stands in the trough.
    """
    if not (length > 0.0 and depth > 0.0):
        raise ValueError("length and depth of a wave are positive")
    k = 2.0 * np.pi / length
    bound = second_harmonic(amplitude, k, depth)
    if bound >= abs(amplitude) / 4.0 and amplitude != 0.0:
        raise ValueError(
            f"a wave of amplitude {amplitude:g} m and length {length:g} m is too high for second-order theory "
            f"at depth {depth:g} m: its bound harmonic of {bound:.3g} m makes a second crest"
        )
    orders = np.array([1.0, 2.0])
    return Harmonic(
        level=level,
        amplitude=np.array([amplitude, bound]),
        vector=(orders * k)[:, None] * unit_direction(azimuth),
        frequency=orders * k * speed,
        phase=orders * k * crest,
    )
