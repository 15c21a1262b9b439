"""Refractive indices of water and air against published values and finite differences."""

import numpy as np
import pytest

from musatpy.refraction import media
from musatpy.refraction.media import SODIUM_D, Formula

# Groeneveld Meijer (1964) Table 4, after Utterback, Thompson and Thomas (1934): sodium D, relative to air
TEMPERATURE = np.array([0.0, 15.0, 25.0])
TABLE_4 = {  # chlorinity, parts per thousand
    0.0: (1.33402, 1.33340, 1.33250),
    1.477: (1.33453, 1.33388, 1.33299),
    10.476: (1.33774, 1.33692, 1.33595),
    19.227: (1.34082, 1.33985, 1.33881),
}
BEYOND = 21.381  # of its last line: a salinity of 38.6, to which the formula is extrapolated


@pytest.mark.parametrize("chlorinity", list(TABLE_4))
def test_table_4_of_groeneveld_meijer(chlorinity: float) -> None:
    """Measured in 1934 to some units of the fifth decimal; the fit of 1995 has an error of 1.5e-5."""
    found = media.relative_index(SODIUM_D, TEMPERATURE, media.salinity_of_chlorinity(chlorinity))
    np.testing.assert_allclose(found, TABLE_4[chlorinity], atol=7e-5, rtol=0.0)
    if not chlorinity:
        pure = media.relative_index(SODIUM_D, TEMPERATURE, formula=Formula.IAPWS)
        np.testing.assert_allclose(pure, TABLE_4[chlorinity], atol=7e-5, rtol=0.0)


def test_the_formula_is_extrapolated_to_a_salinity_of_42() -> None:
    found = media.relative_index(SODIUM_D, TEMPERATURE, media.salinity_of_chlorinity(BEYOND))
    np.testing.assert_allclose(found, (1.34158, 1.34055, 1.33949), atol=7e-5, rtol=0.0)  # as the other lines
    media.relative_index(SODIUM_D, TEMPERATURE, 42.0)
    with pytest.raises(ValueError, match=r"salinity 42\.1.* quan-fry holds for 0 to 42"):
        media.relative_index(SODIUM_D, TEMPERATURE, 42.1)


def test_iapws_check_values() -> None:
    """R9-97, Table 3: 25 degrees and 226.5 nm, and steam of 500 degrees at 589 nm; eight decimals."""
    assert media.iapws_index(226.5, 25.0, 997.047435)[0] == pytest.approx(1.39277824, abs=5e-9)
    assert media.iapws_index(589.3, 500.0, 30.4758534)[0] == pytest.approx(1.00949307, abs=5e-9)


def test_density_of_water() -> None:
    """Tanaka et al. (2001), Table 2: 999.9750 at its largest, 998.2067 at 20 degrees; four decimals."""
    assert media.water_density(20.0) == pytest.approx(998.2067, abs=1e-4)
    assert media.water_density(3.983035) == pytest.approx(999.97495, abs=1e-5)


def test_air() -> None:
    """Dry air of 20 degrees and one atmosphere at 632.8 nm: 1.0002718 (NIST, seven decimals)."""
    assert media.air_index(632.8, 20.0).phase == pytest.approx(1.0002718, abs=5e-8)
    moist = media.air_index(632.8, 20.0, vapour=1000.0).phase
    assert media.air_index(632.8, 20.0).phase - moist == pytest.approx(3.63e-7, abs=1e-8)  # 0.4 ppm a kPa


def test_the_formulas_agree_on_pure_water() -> None:
    """Fits of different measurements: a few units of the fifth decimal from 0 to 30 degrees over the visible."""
    L, T = np.meshgrid(np.linspace(400.0, 700.0, 13), np.linspace(0.0, 30.0, 13))
    apart = media.water_index(L, T).phase - media.water_index(L, T, formula=Formula.IAPWS).phase
    assert np.abs(apart).max() < 6e-5


@pytest.mark.parametrize("formula", list(Formula))
def test_the_group_index_is_that_of_the_phase_index(formula: Formula) -> None:
    L, T = np.array([410.0, 532.0, 589.3, 690.0]), np.array([3.0, 12.0, 20.0, 29.0])
    S = 0.0 if formula is Formula.IAPWS else np.array([35.0, 20.0, 0.0, 5.0])
    step = 0.05  # nm: central differences are good to 1e-10 of an index then
    after, before = (media.water_index(L + d, T, S, formula=formula).phase for d in (step, -step))
    found = media.water_index(L, T, S, formula=formula)
    np.testing.assert_allclose(found.group, found.phase - L * (after - before) / (2.0 * step), atol=1e-8, rtol=0.0)
    assert (found.group > found.phase).all()


def test_the_group_index_of_air_is_that_of_its_phase_index() -> None:
    L, step = np.array([350.0, 532.0, 1600.0]), 0.05
    after, before = (media.air_index(L + d, 25.0, 9e4, 2000.0).phase for d in (step, -step))
    found = media.air_index(L, 25.0, 9e4, 2000.0)
    np.testing.assert_allclose(found.group, found.phase - L * (after - before) / (2.0 * step), atol=1e-11, rtol=0.0)


def test_thin_air_bends_more() -> None:
    """At 3000 m (70 kPa) the air is thinner by a third: n relative to it is greater by 9e-5."""
    sea, high = (media.relative_index(550.0, 15.0, 35.0, air_pressure=p) for p in (101325.0, 70000.0))
    assert high - sea == pytest.approx(1.15e-4, abs=1e-5)


def test_air_against_ciddor() -> None:
    """Ciddor (1996), Applied Optics 35, 1566, Table 1: refractivity of dry air at 633 nm, in 1e-8.

    His equation and this one are fits to the same measurements; they differ by 0.7 there.
    """
    temperature = np.array([20.0, 20.0, 20.0, 10.0, 30.0])
    pressure = np.array([80e3, 100e3, 120e3, 100e3, 100e3])
    printed = [21458.0, 26824.4, 32191.6, 27774.7, 25937.2]
    found = 1e8 * (media.air_index(633.0, temperature, pressure).phase - 1.0)
    np.testing.assert_allclose(found, printed, atol=1.0)


@pytest.mark.parametrize("formula", list(Formula))
@pytest.mark.parametrize("quantity", range(3))
@pytest.mark.parametrize("end", range(2))
def test_every_limit_holds_from_both_sides(formula: Formula, quantity: int, end: int) -> None:
    values = [20.0, 0.0, 550.0]  # temperature, salinity, wavelength
    values[quantity] = media.RANGES[formula][quantity][end]
    assert np.isfinite(media.water_index(values[2], *values[:2], formula=formula).phase)
    values[quantity] += (-1e-9, 1e-9)[end]
    with pytest.raises(ValueError, match="holds for"):
        media.water_index(values[2], *values[:2], formula=formula)


@pytest.mark.parametrize("quantity", range(3))
@pytest.mark.parametrize("end", range(2))
def test_every_limit_of_air_holds_from_both_sides(quantity: int, end: int) -> None:
    values = [20.0, 1e5, 550.0]  # temperature, pressure, wavelength
    values[quantity] = media.AIR_RANGES[quantity][end]
    assert np.isfinite(media.air_index(values[2], *values[:2]).phase)
    values[quantity] *= (1.0 - 1e-9, 1.0 + 1e-9)[end if values[quantity] > 0.0 else 1 - end]
    with pytest.raises(ValueError, match="the formula of air holds for"):
        media.air_index(values[2], *values[:2])


@pytest.mark.parametrize("vapour", [-1.0, np.nan, 2e5])
def test_vapour_is_a_part_of_the_air(vapour: float) -> None:
    with pytest.raises(ValueError, match="pressure of water vapour lies from 0 to"):
        media.air_index(550.0, 20.0, 1e5, vapour)
