"""The water of a job: refractive index and tilt of its surface; its level, the tide of each photo; its waves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.model.tables import POSITION_UNIT, Table, per_job, per_row
from musatpy.units import HECTOPASCAL

INDEX_RANGE = (1.0, 2.0)  # of refractive indices, on cards as in adjustments: the air itself, and beyond any liquid
WATER_INDICES = (1.30, 1.40)  # of water: 1.325 to 1.365 from the near infrared to violet, fresh to salt, 0 to 30 C
USUAL_INDICES = (1.32, 1.36)  # of water in visible light
FITTED_SALINITY, FITTED_CHLORINITY = 35.0, 35.0 / 1.80655  # parts per thousand; beyond, the formula is extrapolated


@dataclass(frozen=True, kw_only=True)
class WaterConditions:
    """What the refractive index of water is computed from; salinity or chlorinity, and None where not given."""

    temperature: float  # degrees Celsius
    wavelength: float  # nm, in vacuum
    salinity: float | None = None  # parts per thousand
    chlorinity: float | None = None  # parts per thousand
    formula: str = ""  # QUANFRY, IAPWS; empty is the first
    air_temperature: float | None = None  # degrees Celsius; None is 15
    air_pressure: float | None = None  # Pa; None is one atmosphere

    def __str__(self) -> str:
        return f"{self.of_water}, {self.of_air}"

    @property
    def of_water(self) -> str:
        """Water, light and formula in words."""
        salt, content = ("chlorinity", self.chlorinity) if self.salinity is None else ("salinity", self.salinity)
        formula = self.formula or "QUANFRY"
        if (self.salinity or 0.0) > FITTED_SALINITY or (self.chlorinity or 0.0) > FITTED_CHLORINITY:
            formula += f" extrapolated beyond a salinity of {FITTED_SALINITY:g}"
        return (
            f"{self.temperature:g} degrees Celsius, {salt} {content:g}, {self.wavelength:g} nm, formula {formula}"
        )

    @property
    def of_air(self) -> str:
        """The air above in words."""
        given = []
        if self.air_temperature is not None:
            given.append(f"{self.air_temperature:g} degrees Celsius")
        if self.air_pressure is not None:
            given.append(f"{self.air_pressure / HECTOPASCAL:g} hPa")
        return f"air of {' and '.join(given)}" if given else "standard air"


@dataclass(frozen=True, kw_only=True)
class Water:
    """Refractive index of water relative to air, tilt of the surface, and their sigmas (None where not given).

    The tilts are the slopes of the surface (rad) towards east and north, rising positive, against the level surface
    through the tide; they turn it about the middle of the exposure stations, where the tides hold. None is level.
    """

    index: float = 1.340  # sea water; fresh water is 1.3333 (docs/theory.md, Errata)
    sigma: float | None = None
    tilt_east: float | None = None
    tilt_north: float | None = None
    tilt_sigma: float | None = None
    liquid: str = ""  # name of another liquid; empty is water
    conditions: WaterConditions | None = None  # what the index comes from; None where it is given itself


def index_range(liquid: str) -> tuple[float, float]:
    """Return the limits of a refractive index, given or adjusted: of water, or of the liquid that is named."""
    return INDEX_RANGE if liquid else WATER_INDICES


def index_fault(index: float, liquid: str) -> str:
    """Return why a given refractive index cannot be that of water or of the liquid, empty where it can."""
    low, high = index_range(liquid)
    if low <= index <= high:
        return ""
    why = f"a refractive index of {index:g} is not within {low:g} to {high:g}"
    return why if liquid else f"{why}, as that of water is; another liquid is to be named"


class WaveShape(StrEnum):
    """Shapes of a wave."""

    SINUSOIDAL = "SINU"
    STOKES = "STOK"
    TROCHOIDAL = "TROC"


@dataclass(frozen=True, kw_only=True, eq=False)
class Waves(Table):
    """k trains of waves, added up on the tide of each photo; what is not given is NaN.

    Period, or length, or two of period, length and speed: linear theory knows the rest (`musatpy.sea.deck_waves`).
    Azimuths count clockwise from true north (+Y of local jobs), crests from the `WaveOrigin`. A parameter is known
    where its sigma is NaN.
    """

    ids: TextArray = per_row(identity=True)  # (k,)
    shape: TextArray = per_row(role="waves")  # (k,) of WaveShape; empty is the first
    period: FloatArray = per_row(role="waves", unit="s")  # (k,)
    depth: FloatArray = per_row(role="waves", unit="m")  # (k,) of the water, for theory; NaN: deep
    length: FloatArray = per_row(role="waves", unit="m")  # (k,)
    speed: FloatArray = per_row(role="waves", unit="m/s")  # (k,) of the crests
    height: FloatArray = per_row(role="waves", unit="m")  # (k,) from trough to crest
    azimuth: FloatArray = per_row(role="waves", unit="rad")  # (k,) of the direction the wave runs to
    crest: FloatArray = per_row(role="waves", unit="m")  # (k,) that way from the origin to a crest, at time 0
    height_sigma: FloatArray = per_row(role="wave_sigmas", unit="m")  # (k,)
    length_sigma: FloatArray = per_row(role="wave_sigmas", unit="m")  # (k,)
    azimuth_sigma: FloatArray = per_row(role="wave_sigmas", unit="rad")  # (k,)
    crest_sigma: FloatArray = per_row(role="wave_sigmas", unit="m")  # (k,)

    @property
    def unknown(self) -> BoolArray:
        """(k,) some parameter of the wave is unknown: it has a sigma."""
        return np.asarray(np.isfinite([getattr(self, name) for name in WAVE_SIGMAS]).any(axis=0))


WAVE_SIGMAS = ("height_sigma", "length_sigma", "azimuth_sigma", "crest_sigma")


def known_waves(waves: Waves) -> Waves:
    """Return the waves without sigmas."""
    return replace(waves, **dict.fromkeys(WAVE_SIGMAS, np.full(len(waves.ids), np.nan)))


@dataclass(frozen=True, kw_only=True)
class WaveOrigin:
    """Where the surface of the waves has its x = y = 0, in the coordinate system of the job."""

    position: tuple[float, float, float] = per_job(unit=POSITION_UNIT)
