"""Second-order Stokes waves: sharper crests and flatter troughs, in water of any depth.

Stokes (1847), for finite depth; the tests prove it by the conditions at the free surface themselves. To the
sinusoidal wave comes its bound harmonic, half as long and moving with it. The result is a `Harmonic` of these two
components, about the mean level.
"""

from __future__ import annotations

import numpy as np

from musatpy.refraction.harmonic import Harmonic
from musatpy.refraction.surface import unit_direction


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
