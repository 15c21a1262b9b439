"""The refracting surface of one train of waves, by its shape."""

from __future__ import annotations

from enum import StrEnum

from musatpy.refraction.surface import Surface
from musatpy.refraction.waves import Trochoid, sinusoidal, stokes


class Shape(StrEnum):
    """Shapes of a wave."""

    SINUSOIDAL = "sinusoidal"
    STOKES = "stokes"
    TROCHOIDAL = "trochoidal"


def wave_surface(
    shape: Shape, *, amplitude: float, length: float, azimuth: float, speed: float, crest: float, depth: float
) -> Surface:
    """Return a wave about level 0; the arguments are those of `sinusoidal`, and the mean depth (m) of the water.

    Raises `ValueError` where it is too high for the theory of its shape.
    """
    if shape is Shape.STOKES:
        return stokes(amplitude=amplitude, length=length, azimuth=azimuth, speed=speed, crest=crest, depth=depth)
    if shape is Shape.TROCHOIDAL:
        return Trochoid(amplitude=amplitude, length=length, azimuth=azimuth, speed=speed, crest=crest)
    return sinusoidal(amplitude=amplitude, length=length, azimuth=azimuth, speed=speed, crest=crest)
