"""The conditions of the water of a deck -> its refractive index, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.model import WaterConditions
from musatpy.refraction import media
from musatpy.units import HECTOPASCAL

FORMULAS = {"": media.Formula.QUAN_FRY, "QUANFRY": media.Formula.QUAN_FRY, "IAPWS": media.Formula.IAPWS}


def index_of(conditions: WaterConditions) -> float:
    """Return the index of water relative to the air above it; raises `ValueError` beyond the range of a formula."""
    temperature, pressure = conditions.air_temperature, conditions.air_pressure
    index = media.relative_index(
        conditions.wavelength,
        conditions.temperature,
        _salinity(conditions),
        formula=FORMULAS[conditions.formula],
        air_temperature=media.STANDARD_TEMPERATURE if temperature is None else temperature,
        air_pressure=media.STANDARD_PRESSURE if pressure is None else pressure,
    )
    return float(index)


def _salinity(conditions: WaterConditions) -> float:
    """Return the salinity; NaN, which no range holds, where neither it nor the chlorinity is given."""
    if conditions.chlorinity is not None:
        return float(media.salinity_of_chlorinity(conditions.chlorinity))
    return np.nan if conditions.salinity is None else conditions.salinity


def faults(conditions: WaterConditions) -> Iterator[tuple[str, str]]:
    """Yield attribute and message of each value that the formulas do not hold for; NaN counts as not given."""
    formula = FORMULAS[conditions.formula]
    heat, salt, light = media.RANGES[formula]
    air_heat, air_pressure, air_light = media.AIR_RANGES
    light = max(light[0], air_light[0]), min(light[1], air_light[1])  # both are needed
    rows = (
        ("temperature", conditions.temperature, 1.0, heat, "degrees Celsius", f"formula {formula}"),
        ("salinity", conditions.salinity, 1.0, salt, "parts per thousand", f"formula {formula}"),
        ("wavelength", conditions.wavelength, 1.0, light, "nm", f"formula {formula}"),
        ("air_temperature", conditions.air_temperature, 1.0, air_heat, "degrees Celsius", "formula of air"),
        ("air_pressure", conditions.air_pressure, HECTOPASCAL, air_pressure, "hPa", "formula of air"),
    )
    for name, value, unit, (low, high), called, holds in rows:
        if value is not None and not np.isnan(value) and not low <= value <= high:
            yield name, f"{value / unit:g} {called}: the {holds} holds for {_span(low / unit, high / unit)}"
    if conditions.chlorinity is not None and not salt[0] <= _salinity(conditions) <= salt[1]:
        message = f"a chlorinity of {conditions.chlorinity:g} is a salinity of {_salinity(conditions):.2f}"
        yield "chlorinity", f"{message}: the formula {formula} holds for {_span(*salt)}"


def _span(low: float, high: float) -> str:
    return f"{low:g} to {high:g}" if low < high else f"{low:g} only"
