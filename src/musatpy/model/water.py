"""The water of a job: refractive index and tilt of its surface; its level is the tide of each photo."""

from __future__ import annotations

from dataclasses import dataclass

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
