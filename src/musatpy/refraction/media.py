"""Refractive indices of water and air: the phase index by temperature, salinity and wavelength.

Water by one of two formulas:

    quan-fry    Quan and Fry (1995), Applied Optics 34 (18), 3477, eq. 3, a fit to the sea water of Austin and
                Halikas (1976), Scripps Institution of Oceanography Ref. 76-1. Relative to air
    iapws       IAPWS Release R9-97 on the refractive index of ordinary water substance (1997), eq. 1, with the
                density of Tanaka et al. (2001), Metrologia 38, 301, eq. 1, at one atmosphere. Absolute, pure water

Dry air by Birch and Downs (1994), Metrologia 31, 315.

Wavelengths are those in vacuum, nanometres. (The data behind quan-fry are of wavelengths in air, 0.03 % shorter:
that is 1e-5 of n, within its own error of 1.5e-5.) Temperatures are degrees Celsius, salinities parts per thousand.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray

STANDARD_TEMPERATURE, STANDARD_PRESSURE = 15.0, 101325.0  # of air: degrees Celsius, Pa
PER_CHLORINITY = 1.80655  # salinity of a chlorinity of one: the definition of 1969 (UNESCO)

_QUAN_FRY = (1.31405, 1.779e-4, -1.05e-6, 1.6e-8, -2.02e-6, 15.868, 0.01155, -0.00423, -4382.0, 1.1455e6)
_IAPWS = (
    0.244257733, 9.74634476e-3, -3.73234996e-3, 2.68678472e-4, 1.58920570e-3, 2.45934259e-3, 0.900704920,
    -1.66626219e-2,
)  # fmt: skip
_ULTRAVIOLET, _INFRARED = 0.2292020, 5.432937  # resonances, in units of 589 nm
_IAPWS_KELVIN, _IAPWS_DENSITY, _IAPWS_WAVELENGTH = 273.15, 1000.0, 589.0  # references: K, kg/m3, nm
_TANAKA = (-3.983035, 301.797, 522528.9, 69.34881, 999.974950)


class Formula(StrEnum):
    """Formulas of the index of water."""

    QUAN_FRY = "quan-fry"
    IAPWS = "iapws"


# Formula -> what it holds for: temperature, salinity, wavelength
RANGES = {
    # extrapolated above a salinity of 35: it is linear
    Formula.QUAN_FRY: ((0.0, 30.0), (0.0, 42.0), (400.0, 700.0)),
    Formula.IAPWS: ((0.0, 40.0), (0.0, 0.0), (200.0, 1100.0)),
}
AIR_RANGES = ((-40.0, 100.0), (10e3, 140e3), (300.0, 1700.0))  # degrees Celsius, Pa, nm
_NAMES = (("temperature", "degrees Celsius"), ("salinity", "parts per thousand"), ("wavelength", "nm"))
_AIR_NAMES = (("temperature of the air", "degrees Celsius"), ("pressure", "Pa"), ("wavelength", "nm"))


def salinity_of_chlorinity(chlorinity: ArrayLike) -> FloatArray:
    """Return the salinity (parts per thousand) of water of a chlorinity (parts per thousand)."""
    return PER_CHLORINITY * np.asarray(chlorinity, dtype=float)


def relative_index(
    wavelength: ArrayLike,
    temperature: ArrayLike,
    salinity: ArrayLike = 0.0,
    *,
    formula: Formula = Formula.QUAN_FRY,
    air_temperature: ArrayLike = STANDARD_TEMPERATURE,
    air_pressure: ArrayLike = STANDARD_PRESSURE,
) -> FloatArray:
    """Return the phase index of water relative to the air above it: what bends a ray at the surface.

    Raises `ValueError` outside the range of the formula.
    """
    water = water_index(wavelength, temperature, salinity, formula=formula)
    return water / air_index(wavelength, air_temperature, air_pressure)


def water_index(
    wavelength: ArrayLike,
    temperature: ArrayLike,
    salinity: ArrayLike = 0.0,
    *,
    formula: Formula = Formula.QUAN_FRY,
) -> FloatArray:
    """Return the absolute phase index of water at one atmosphere.

    Raises `ValueError` outside the range of the formula.
    """
    L, T, S = (np.asarray(number, dtype=float) for number in (wavelength, temperature, salinity))
    _within(RANGES[formula], _NAMES, (T, S, L), f"the formula {formula}")
    if formula is Formula.IAPWS:
        return iapws_index(L, T, water_density(T))
    n0, n1, n2, n3, n4, n5, n6, n7, n8, n9 = _QUAN_FRY  # relative to standard air
    n = n0 + (n1 + n2 * T + n3 * T**2) * S + n4 * T**2 + (n5 + n6 * S + n7 * T) / L + n8 / L**2 + n9 / L**3
    return n * air_index(L)


def air_index(
    wavelength: ArrayLike,
    temperature: ArrayLike = STANDARD_TEMPERATURE,
    pressure: ArrayLike = STANDARD_PRESSURE,
) -> FloatArray:
    """Return the absolute phase index of dry air at a pressure (Pa).

    Raises `ValueError` outside the range of the formula.
    """
    L, t, p = (np.asarray(number, dtype=float) for number in (wavelength, temperature, pressure))
    _within(AIR_RANGES, _AIR_NAMES, (t, p, L), "the formula of air")
    square = np.square(1e3 / L)  # of the wave number, per micrometre
    standard = 1e-8 * (8342.54 + 2406147.0 / (130.0 - square) + 15998.0 / (38.9 - square))
    return 1.0 + standard * (p / 96095.43 * (1.0 + 1e-8 * (0.601 - 0.00972 * t) * p) / (1.0 + 0.0036610 * t))


def water_density(temperature: ArrayLike) -> FloatArray:
    """Return the density (kg/m3) of pure water at one atmosphere, 0 to 40 degrees Celsius (Tanaka et al. 2001)."""
    t = np.asarray(temperature, dtype=float)
    a1, a2, a3, a4, a5 = _TANAKA
    return a5 * (1.0 - np.square(t + a1) * (t + a2) / (a3 * (t + a4)))


def iapws_index(wavelength: ArrayLike, temperature: ArrayLike, density: ArrayLike) -> FloatArray:
    """Return n of R9-97 for water of any density (kg/m3)."""
    square = np.square(np.asarray(wavelength, dtype=float) / _IAPWS_WAVELENGTH)
    T = (np.asarray(temperature, dtype=float) + _IAPWS_KELVIN) / _IAPWS_KELVIN
    rho = np.asarray(density, dtype=float) / _IAPWS_DENSITY
    a0, a1, a2, a3, a4, a5, a6, a7 = _IAPWS
    ultraviolet, infrared = square - _ULTRAVIOLET**2, square - _INFRARED**2
    A = a0 + a1 * rho + a2 * T + a3 * square * T + a4 / square + a5 / ultraviolet + a6 / infrared + a7 * rho**2
    return np.asarray(np.sqrt((2.0 * rho * A + 1.0) / (1.0 - rho * A)))  # (n^2 - 1) / (n^2 + 2) = rho A


def _within(
    ranges: tuple[tuple[float, float], ...],
    names: tuple[tuple[str, str], ...],
    values: tuple[FloatArray, ...],
    holds: str,
) -> None:
    for (low, high), (name, unit), value in zip(ranges, names, values, strict=True):
        bad = value[~((value >= low) & (value <= high))]
        if bad.size:
            span = f"{low:g} to {high:g}" if low < high else f"{low:g}"
            raise ValueError(f"{name} {bad.flat[0]:g} {unit}: {holds} holds for {span}")
