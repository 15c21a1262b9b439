"""Refractive indices of water and air against published values and finite differences."""

import numpy as np
import pytest

from musatpy.refraction import media
from musatpy.refraction.media import Formula

SODIUM_D = 589.3  # nm

# Groeneveld Meijer (1964) Table 4, after Utterback, Thompson and Thomas (1934): sodium D, relative to air
TEMPERATURE = np.array([0.0, 15.0, 25.0])
TABLE_4 = {  # chlorinity, parts per thousand
    0.0: (1.33402, 1.33340, 1.33250),
    1.477: (1.33453, 1.33388, 1.33299),
    10.476: (1.33774, 1.33692, 1.33595),
    19.227: (1.34082, 1.33985, 1.33881),
    21.381: (1.34158, 1.34055, 1.33949),  # a salinity of 38.6, to which the formula is extrapolated
}


@pytest.mark.parametrize("chlorinity", list(TABLE_4))
def test_table_4_of_groeneveld_meijer(chlorinity: float) -> None:
    """Measured in 1934 to some units of the fifth decimal; the fit of 1995 has an error of 1.5e-5."""
    found = media.relative_index(SODIUM_D, TEMPERATURE, media.salinity_of_chlorinity(chlorinity))
    np.testing.assert_allclose(found, TABLE_4[chlorinity], atol=7e-5, rtol=0.0)
    if not chlorinity:
        pure = media.relative_index(SODIUM_D, TEMPERATURE, formula=Formula.IAPWS)
        np.testing.assert_allclose(pure, TABLE_4[chlorinity], atol=7e-5, rtol=0.0)


def test_iapws_check_values() -> None:
    """R9-97, Table 3: 25 degrees and 226.5 nm, and steam of 500 degrees at 589 nm; eight decimals."""
    assert media.iapws_index(226.5, 25.0, 997.047435) == pytest.approx(1.39277824, abs=5e-9)
    assert media.iapws_index(589.3, 500.0, 30.4758534) == pytest.approx(1.00949307, abs=5e-9)


def test_density_of_water() -> None:
    """Tanaka et al. (2001), Table 2: 999.9750 at its largest, 998.2067 at 20 degrees; four decimals."""
    assert media.water_density(20.0) == pytest.approx(998.2067, abs=1e-4)
    assert media.water_density(3.983035) == pytest.approx(999.97495, abs=1e-5)


def test_the_formulas_agree_on_pure_water() -> None:
    """Fits of different measurements: a few units of the fifth decimal from 0 to 30 degrees over the visible."""
    L, T = np.meshgrid(np.linspace(400.0, 700.0, 13), np.linspace(0.0, 30.0, 13))
    apart = media.water_index(L, T) - media.water_index(L, T, formula=Formula.IAPWS)
    assert np.abs(apart).max() < 6e-5


def test_air_against_ciddor() -> None:
    """Ciddor (1996), Applied Optics 35, 1566, Table 1: refractivity of dry air at 633 nm, in 1e-8.

    His equation and this one are fits to the same measurements; they differ by 0.7 there.
    """
    temperature = np.array([20.0, 20.0, 20.0, 10.0, 30.0])
    pressure = np.array([80e3, 100e3, 120e3, 100e3, 100e3])
    printed = [21458.0, 26824.4, 32191.6, 27774.7, 25937.2]
    found = 1e8 * (media.air_index(633.0, temperature, pressure) - 1.0)
    np.testing.assert_allclose(found, printed, atol=1.0)


WATER = [(formula, quantity, end) for formula in Formula for quantity in range(3) for end in range(2)]


@pytest.mark.parametrize(("formula", "quantity", "end"), [*WATER, *((None, *of[1:]) for of in WATER[:6])])
def test_every_limit_holds_from_both_sides(formula: Formula | None, quantity: int, end: int) -> None:
    """Of water: temperature, salinity, wavelength; of air: temperature, pressure, wavelength."""
    values = [20.0, 1e5 if formula is None else 0.0, 550.0]

    def index() -> np.ndarray:
        if formula is None:
            return media.air_index(values[2], *values[:2])
        return media.water_index(values[2], *values[:2], formula=formula)

    ranges = media.AIR_RANGES if formula is None else media.RANGES[formula]
    values[quantity] = ranges[quantity][end]
    assert np.isfinite(index())
    values[quantity] += (-1e-9, 1e-9)[end] * max(abs(values[quantity]), 1.0)
    with pytest.raises(ValueError, match="holds for"):
        index()
