"""Waves as refracting surfaces: sinusoidal ones and sums of them, Stokes waves, trochoids, trains of unknown ones.

Okamoto (1982), eq. 1 to 8, with heights up: z = level + sum A cos(k . (x, y) - w t - phase), k the wave vector.
Among them second-order Stokes waves, with sharper crests and flatter troughs, in water of any depth (Stokes 1847):
the tests prove them by the conditions at the free surface themselves. To the sinusoidal wave comes its bound
harmonic, half as long and moving with it, about the mean level. The trochoid of Gerstner (1802) is exact in deep
water: the path of a point inside a rolling circle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray
from musatpy.refraction.surface import Relief, Surface, SurfaceLimits, unit_direction

_STEPS = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class Harmonic(Surface):
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
    def limits(self) -> SurfaceLimits:
        """What the sum keeps to: the components at their worst together."""
        number = np.linalg.norm(self.vector, axis=-1)
        height = np.abs(self.amplitude)
        return SurfaceLimits(
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


@dataclass(frozen=True, kw_only=True)
class Trochoid(Surface):
    """x = q - r sin(k q), z = level + k r^2 / 2 + r cos(k q) along the direction it runs to, k = 2 pi / length.

    amplitude r (m), half the height; length (m); azimuth (rad) from x towards y; speed (m/s); crest (m): distance
    from the origin of a crest at time 0; level (m): mean over a length, which lies k r^2 / 2 below the middle of
    crest and trough. Raises `ValueError` unless 0 <= k r < 1: from 1 on the crests are cusps.
    """

    amplitude: float
    length: float
    azimuth: float
    speed: float = 0.0
    crest: float = 0.0
    level: float = 0.0

    def __post_init__(self) -> None:
        if not (self.length > 0.0 and 0.0 <= self._steepness < 1.0):
            raise ValueError("the amplitude of a trochoidal wave lies from 0 to its length over 2 pi")

    @property
    def _number(self) -> float:
        return float(2.0 * np.pi / self.length)

    @property
    def _steepness(self) -> float:
        return self._number * self.amplitude

    @cached_property
    def limits(self) -> SurfaceLimits:
        """What it keeps to: steepest at cos(k q) = k r, most curved at the crest, third derivative beside it."""
        e, middle = self._steepness, self.level + self._number * self.amplitude**2 / 2.0
        return SurfaceLimits(
            lowest=middle - self.amplitude,
            highest=middle + self.amplitude,
            slope=e / float(np.sqrt(1.0 - e * e)),
            curvature=e * self._number / (1.0 - e) ** 2,
            third=_largest_third(e) * self._number**2,
            # a crest is as sharp as that of a sinusoidal wave shorter by 1 - k r
            length=self.length * (1.0 - e),
        )

    def relief(self, xy: FloatArray, time: ArrayLike = 0.0) -> Relief:
        """Return its shape at places xy (..., 2) m, at times (...) s."""
        direction, k, e = unit_direction(self.azimuth), self._number, self._steepness
        theta = _parameter(k * (xy @ direction - self.speed * np.asarray(time) - self.crest), e)
        sine, cosine = np.sin(theta), np.cos(theta)
        stretch = 1.0 - e * cosine
        slope = -e * sine / stretch
        bend = -e * k * (cosine - e) / stretch**3
        return Relief(
            height=self.level + k * self.amplitude**2 / 2.0 + self.amplitude * cosine,
            gradient=slope[..., None] * direction,
            hessian=bend[..., None, None] * np.outer(direction, direction),
        )


def _parameter(angle: FloatArray, e: float) -> FloatArray:
    """Return theta of theta - e sin(theta) = angle (...): Kepler's equation, whose safe start is -+ pi."""
    turn = np.round(angle / (2.0 * np.pi)) * 2.0 * np.pi
    wanted = angle - turn
    theta = np.where(wanted < 0.0, -np.pi, np.pi) if e > 0.8 else wanted + e * np.sin(wanted)
    for _ in range(_STEPS):
        step = (wanted - theta + e * np.sin(theta)) / (1.0 - e * np.cos(theta))
        theta = theta + step
        if np.all(np.abs(step) <= 4e-16 * np.pi):
            break
    return turn + theta


def _largest_third(e: float) -> float:
    """Return the largest third derivative of a trochoid of k = 1 and radius e < 1.

    It is e sin(theta) (1 + 2 e c - 3 e^2) / (1 - e c)^5 with c = cos(theta), whose derivative vanishes where a
    cubic polynomial in c does.
    """
    if e == 0.0:
        return 0.0
    c = np.roots([6.0 * e**2, 8.0 * e - 12.0 * e**3, 1.0 - 11.0 * e**2, 15.0 * e**3 - 7.0 * e])
    c = np.clip(c.real, -1.0, 1.0)  # what is no root is a value that the function takes too: it does no harm
    third = e * np.sqrt(1.0 - c * c) * (1.0 + 2.0 * e * c - 3.0 * e * e) / (1.0 - e * c) ** 5
    return float(np.abs(third).max()) * (1.0 + 1e-9)  # rounding of the roots


@dataclass(frozen=True, kw_only=True, eq=False)
class Superposed(Surface):
    """The sum of surfaces of any families; at least one."""

    surfaces: tuple[Surface, ...]

    @cached_property
    def limits(self) -> SurfaceLimits:
        """What the sum keeps to: all of them at their worst together."""
        each = [surface.limits for surface in self.surfaces]
        return SurfaceLimits(
            lowest=sum(limits.lowest for limits in each),
            highest=sum(limits.highest for limits in each),
            slope=sum(limits.slope for limits in each),
            curvature=sum(limits.curvature for limits in each),
            third=sum(limits.third for limits in each),
            length=min(limits.length for limits in each),
        )

    def relief(self, xy: FloatArray, time: ArrayLike = 0.0) -> Relief:
        """Return its shape at places xy (..., 2) m, at times (...) s."""
        each = [surface.relief(xy, time) for surface in self.surfaces]
        return Relief(
            height=np.asarray(sum(relief.height for relief in each)),
            gradient=np.asarray(sum(relief.gradient for relief in each)),
            hessian=np.asarray(sum(relief.hessian for relief in each)),
        )

    def covers(self, xy: FloatArray, time: ArrayLike = 0.0) -> BoolArray:
        """Tell where (...) all of them are known."""
        return np.all([surface.covers(xy, time) for surface in self.surfaces], axis=0)


def superposed(*surfaces: Surface) -> Surface:
    """Return the sum of surfaces; that of harmonic ones is one harmonic surface with all their components."""
    harmonic = [surface for surface in surfaces if isinstance(surface, Harmonic)]
    if len(harmonic) < len(surfaces):
        return Superposed(surfaces=surfaces)
    return Harmonic(
        level=sum(wave.level for wave in harmonic),
        amplitude=np.concatenate([wave.amplitude for wave in harmonic]),
        vector=np.concatenate([wave.vector for wave in harmonic]),
        frequency=np.concatenate([wave.frequency for wave in harmonic]),
        phase=np.concatenate([wave.phase for wave in harmonic]),
    )


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


def _towards(azimuth: FloatArray) -> FloatArray:
    """Return unit vectors (k, 2) of azimuths (k,), clockwise from y."""
    return np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
