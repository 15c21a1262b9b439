"""The water of a job: refractive index and tilt of its surface; its level is the tide of each photo."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.units import HECTOPASCAL

INDEX_RANGE = (1.0, 2.0)  # of refractive indices, on cards as in adjustments: the air itself, and beyond any liquid
WATER_INDICES = (1.30, 1.40)  # of water: 1.325 to 1.365 from the near infrared to violet, fresh to salt, 0 to 30 C


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
        return (
            f"{self.temperature:g} degrees Celsius, {salt} {content:g}, {self.wavelength:g} nm, "
            f"formula {self.formula or 'QUANFRY'}"
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
    conditions: WaterConditions | None = None  # what the index comes from; None where it is given itself


def index_range(given: float) -> tuple[float, float]:
    """Return between which limits an adjusted refractive index makes sense, by what was given of it."""
    low, high = WATER_INDICES
    return WATER_INDICES if low < given < high else INDEX_RANGE
