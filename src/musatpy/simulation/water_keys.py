"""The keys of a spec that say what the water is like, and what of that is on cards."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.model import WaterConditions
from musatpy.model.water import index_fault
from musatpy.specs import Pair, key
from musatpy.units import HECTOPASCAL

INDEX_DECIMALS = 12  # of an index that is computed: the truth is the same on every machine


@dataclass(frozen=True, kw_only=True)
class ConditionKeys:
    """[water.conditions]: what the true index comes from, on a WTC card in its place (salinity or chlorinity)."""

    temperature: float = key(doc="of the water", unit="degC")
    salinity: float | None = key(None, "of the water, 0 for fresh water", unit="ppt", low=0.0)
    chlorinity: float | None = key(None, "of the water", unit="ppt", low=0.0)
    wavelength: float = key(550.0, "of the light, in vacuum", unit="nm", low=1.0)
    formula: str = key("QUANFRY", "of the index", choices=("QUANFRY", "IAPWS"))
    air_temperature: float | None = key(None, "above the water; absent: 15", unit="degC")
    air_pressure: float | None = key(None, "above the water; absent: 1013.25", unit="hPa")
    temperature_error: float = key(0.0, "actual error of the temperature of the water on the card", unit="degC")

    def __post_init__(self) -> None:
        if (self.salinity is None) == (self.chlorinity is None):
            raise ValueError("one of salinity, chlorinity is needed")
        for conditions in (self.true, self.on_card):
            index_of(conditions)

    @property
    def true(self) -> WaterConditions:
        """The conditions of the water, in the decimals of the card."""
        return self._stated(0.0)

    @property
    def on_card(self) -> WaterConditions:
        """What the card says."""
        return self._stated(self.temperature_error)

    def _stated(self, error: float) -> WaterConditions:
        pressure = None if self.air_pressure is None else round(self.air_pressure, 2) * HECTOPASCAL
        return WaterConditions(
            temperature=round(self.temperature + error, 2),
            wavelength=round(self.wavelength, 2),
            salinity=None if self.salinity is None else round(self.salinity, 2),
            chlorinity=None if self.chlorinity is None else round(self.chlorinity, 3),
            formula=self.formula,
            air_temperature=None if self.air_temperature is None else round(self.air_temperature, 2),
            air_pressure=pressure,
        )


def index_of(conditions: WaterConditions) -> float:
    """Return the index that a deck with these conditions has; raises `ValueError` beyond the range of a formula."""
    from musatpy.formats import refractive_index as formulas  # few specs need it

    return formulas.index_of(conditions)


@dataclass(frozen=True, kw_only=True)
class WaterKeys:
    """[water]: the water surface; without this table there is none."""

    index: float = key(1.34, "true refractive index", low=1.0, high=2.0)
    index_error: float = key(0.0, "actual error of the index on the water card", low=-1.0, high=1.0, quiet=True)
    index_sigma: float | None = key(None, "its sigma on the water card", low=0.0)
    liquid: str = key("", "name of the liquid where it is not water: at most 12 characters", quiet=True)
    level: float = key(0.0, "mean height of the surface", unit="m")
    tides: tuple[float, ...] = key((), "height of the surface at each photo, in place of the next two", unit="m")
    tide_trend: float = key(0.0, "growth of the tide from photo to photo, about level in the middle", unit="m")
    tide_scatter: float = key(0.0, "random part of the tide of each photo", unit="m", low=0.0)
    tide_sigma: float | None = key(None, "sigma on the tide cards", unit="m", low=0.0)
    level_error: float = key(0.0, "actual error that all tide cards have in common", unit="m", quiet=True)
    group_size: int = key(
        0, "so many photos, one after the other, are a group on the tide cards; 0: no groups", low=0, quiet=True
    )
    group_level_error: float = key(
        0.0, "actual error that the tides of a group have in common, 1 sigma", unit="m", low=0.0, quiet=True
    )
    day_size: int = key(0, "so many photos are a day on the tide cards; 0: no days", low=0, quiet=True)
    day_level_error: float = key(
        0.0, "actual error that the tides of a day have in common, 1 sigma", unit="m", low=0.0, quiet=True
    )
    photo_level_error: float = key(
        0.0, "actual error of the tide of each photo, 1 sigma", unit="m", low=0.0, quiet=True
    )
    tilt: Pair = key(
        (0.0, 0.0), "true slopes of the surface towards east and north, about the middle of the stations",
        unit="arcsec", low=-3600.0, high=3600.0, quiet=True,
    )  # fmt: skip
    tilt_on_card: Pair | None = key(
        None, "the slopes on the water card; absent: none, level", unit="arcsec", low=-3600.0, high=3600.0
    )
    tilt_sigma: float | None = key(None, "their sigma on the water card", unit="arcsec", low=0.0)
    conditions: ConditionKeys | None = key(None, quiet=True)
    wave_origin: Pair = key(
        (0.0, 0.0), "from which the crests of waves count: east and north of the centre", unit="m", quiet=True
    )

    def __post_init__(self) -> None:
        for index, where in ((self.index, ""), (self.index + self.index_error, "on the card: ")):
            if fault := index_fault(index, self.liquid):
                raise ValueError(f"{where}{fault}" + ("" if self.liquid else " by the key liquid"))
        if self.conditions is not None:
            index = round(index_of(self.conditions.true), INDEX_DECIMALS)
            if self.index not in (type(self).index, index) or self.index_error:
                raise ValueError("the index is given by its conditions: index and index_error do not go with them")
            object.__setattr__(self, "index", index)
        for size in ("group_size", "day_size"):
            error = size.replace("size", "level_error")
            if getattr(self, error) and not getattr(self, size):
                raise ValueError(f"{error} needs a {size}")
