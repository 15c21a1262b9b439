"""Every conversion constant, and sexagesimal angles: units change only at the edge of the program."""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray

DEGREE = math.pi / 180.0  # rad
ARC_MINUTE = DEGREE / 60.0  # rad
ARC_SECOND = DEGREE / 3600.0  # rad
GON = math.pi / 200.0  # rad
HECTOPASCAL = 100.0  # Pa
FOOT = 0.3048  # m
YARD = 3.0 * FOOT
MICROMETRE = 1.0e-3  # mm: plate coordinates and their sigmas are millimetres inside


_LENGTHS = {  # m
    "feet": FOOT,
    "kilometres": 1e3,
    "metres": 1.0,
    "centimetres": 1e-2,
    "millimetres": 1e-3,
    "micrometres": 1e-6,
}


def length_unit(factor: float, tolerance: float) -> str:
    """Return the unit of lengths whose numbers are `factor` times those in metres, to a relative tolerance.

    Empty where it is that of none.
    """
    alike = (name for name, length in _LENGTHS.items() if abs(factor * length - 1.0) < tolerance)
    return next(alike, "")


class AngleUnit(StrEnum):
    """What angles are stated in."""

    RADIANS = "RAD"
    DEGREES = "DEG"
    GONS = "GON"
    DMS = "DMS"  # degrees, minutes and seconds on a last axis of three, the sign on the degrees


def radians_from_dms(degrees: ArrayLike, minutes: ArrayLike, seconds: ArrayLike) -> FloatArray:
    """Return radians from degrees, minutes and seconds; the sign sits on the degrees, zero degrees included.

    `degrees` may be -0.0. Minutes and seconds are taken as magnitudes; shapes broadcast.
    """
    degrees = np.asarray(degrees, dtype=float)
    magnitude = np.abs(degrees) * 3600.0 + np.asarray(minutes, dtype=float) * 60.0 + np.asarray(seconds)
    return np.copysign(magnitude, degrees) * ARC_SECOND


def dms_from_radians(angle: ArrayLike, decimals: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (degrees, minutes, seconds) of angles in radians, seconds rounded to `decimals` places.

    The sign sits on the degrees: -0.0 degrees for a negative angle below one degree. Rounding carries, so that
    seconds and minutes stay below 60.
    """
    angle = np.asarray(angle, dtype=float)
    scale = 10.0**decimals
    ticks = np.rint(np.abs(angle) / ARC_SECOND * scale)
    minutes, tick = np.divmod(ticks, 60.0 * scale)
    degrees, minutes = np.divmod(minutes, 60.0)
    return np.copysign(degrees, angle), minutes, tick / scale
