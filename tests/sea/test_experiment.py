"""Theory of waves, and what they do to a map that takes them for level water."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from musatpy.refraction.surface import PlanarSurface
from musatpy.refraction.waves import sinusoidal
from musatpy.sea.experiment import Experiment, histogram, intersect, run, spread
from musatpy.sea.theory import linear_wave, shoaling

PRINTED = Path(__file__).parents[2] / "fixtures" / "okamoto" / "tables1to3.csv"
G = 9.8  # the paper's
# printed -> what theory gives there: the misprints of Tables 1 to 3
OFF = {("2", "5", "height"): 2.644, ("2", "10", "height"): 2.275, ("3", "5", "speed"): 5.545}
DIGITS = {"length": 0, "speed": 1, "height": 2}

ROWS = list(csv.DictReader(PRINTED.open(newline="")))
NAMES = [f"table {row['table']}, {row['depth']} m" for row in ROWS]


@pytest.mark.parametrize("row", ROWS, ids=NAMES)
@pytest.mark.parametrize("what", DIGITS)
def test_tables_1_to_3(row: dict[str, str], what: str) -> None:
    wave = linear_wave(float(row["period"]), float(row["depth"]), deep_height=float(row["deep_height"]), gravity=G)
    computed = float(getattr(wave, what))
    off = OFF.get((row["table"], row["depth"], what))
    if off is None:
        assert f"{computed:.{DIGITS[what]}f}" == f"{float(row[what]):.{DIGITS[what]}f}"
    else:
        assert computed == pytest.approx(off, abs=0.0005)  # as many digits as the errata have
        assert abs(computed - float(row[what])) > 0.5 * 10.0 ** -DIGITS[what]


@given(period=st.floats(0.5, 300.0), depth=st.floats(0.01, 6000.0))
def test_the_dispersion_relation_holds(period: float, depth: float) -> None:
    wave = linear_wave(period, depth)
    omega, kh = 2.0 * np.pi / period, wave.number * depth
    # rounding, which tanh magnifies little
    assert float(9.80665 * wave.number * np.tanh(kh)) == pytest.approx(omega**2, rel=1e-13)
    assert wave.length / period == pytest.approx(wave.speed, rel=1e-15)


def test_the_group_speed_is_the_slope_of_the_dispersion() -> None:
    """d omega / d k, by central differences over the depths: k h from 0.05 to 20."""
    depth = 10.0
    k = np.geomspace(0.005, 2.0, 40)

    def omega(number: np.ndarray) -> np.ndarray:
        return np.sqrt(9.80665 * number * np.tanh(number * depth))

    h = 1e-6 * k
    slope = (omega(k + h) - omega(k - h)) / (2.0 * h)
    wave = linear_wave(2.0 * np.pi / omega(k), depth)
    np.testing.assert_allclose(wave.group_speed, slope, rtol=1e-8)  # rounding over the step


def test_energy_flows_at_the_same_rate_everywhere() -> None:
    """Height^2 times group speed is that of deep water: what shoaling means."""
    depth = np.array([0.5, 2.0, 10.0, 50.0, 3000.0])
    wave = linear_wave(8.0, depth, deep_height=0.4)
    flow = wave.height**2 * wave.group_speed
    np.testing.assert_allclose(flow, flow[-1], rtol=1e-12)  # rounding
    assert wave.height[-1] == pytest.approx(0.4, rel=1e-12)
    assert float(shoaling(1.2)) < 1.0 < float(shoaling(0.2))  # it falls a little before it rises


def test_orbits_are_circles_in_deep_and_flat_in_shallow_water() -> None:
    deep = linear_wave(5.0, 4000.0, height=1.0)
    wide, high = deep.orbits(-3.0)
    assert wide == pytest.approx(0.5 * np.exp(-3.0 * deep.number)) and high == pytest.approx(float(wide))
    shallow = linear_wave(600.0, 2.0, height=0.1)
    top, bottom = shallow.orbits(0.0), shallow.orbits(-2.0)
    assert top[1] == pytest.approx(0.05, rel=1e-12)  # the surface itself rises by the amplitude
    assert bottom[1] == pytest.approx(0.0, abs=1e-15)  # the bottom lets nothing through
    assert bottom[0] == pytest.approx(float(top[0]), rel=1e-4)  # kh squared
    assert bottom[0] == pytest.approx(0.05 / float(shallow.number * 2.0), rel=1e-4)
    assert shallow.bottom_speed == pytest.approx(float(bottom[0]) * 2.0 * np.pi / 600.0)


def test_waves_break_by_steepness_or_by_depth() -> None:
    deep = linear_wave(5.0, 4000.0, height=[5.4, 5.7])
    assert deep.breaking_height == pytest.approx(0.142 * deep.length[0])
    assert list(deep.breaks) == [False, True]
    shallow = linear_wave(20.0, 2.0, height=[1.5, 1.6])
    assert shallow.breaking_height == pytest.approx(0.78 * 2.0)
    assert list(shallow.breaks) == [False, True]
    assert shallow.ursell[0] == pytest.approx(1.5 * float(shallow.length[0]) ** 2 / 8.0)


PLACES = np.stack(np.meshgrid(np.linspace(0, 300, 7), np.linspace(-200, 200, 9), indexing="ij"), -1).reshape(-1, 2)
POINTS = np.column_stack([PLACES, np.full(len(PLACES), -8.0)])
CALM = Experiment(
    cameras=np.array([[10.0, -5.0, 500.0], [280.0, 12.0, 490.0]]),
    times=np.array([0.0, 3.0]),
    points=POINTS,
    index=1.34,
    surface=PlanarSurface(),
)
WAVES = sinusoidal(amplitude=0.3, length=80.0, azimuth=0.4, speed=8.0)


def test_level_water_costs_nothing() -> None:
    for surface in (PlanarSurface(), sinusoidal(amplitude=0.0, length=50.0, azimuth=0.3)):
        errors = run(replace(CALM, surface=surface))
        np.testing.assert_allclose(errors.error, 0.0, atol=1e-9)  # rounding of 500 m over a base half as long
        np.testing.assert_allclose(errors.parallax, 0.0, atol=1e-9)
        assert errors.number.shape == (len(POINTS), 2) and (errors.number == 1).all()


def test_intersection_is_that_of_equation_36() -> None:
    """Written out as printed."""
    rng = np.random.default_rng(4)
    origin = rng.normal(size=(2, 5, 3)) + np.array([0.0, 0.0, 3.0])
    direction = rng.normal(size=(2, 5, 3)) * 0.1 + np.array([[[0.3, 0.0, -1.0]], [[-0.3, 0.0, -1.0]]])
    (x1, e1, z1), (x2, e2, z2) = np.moveaxis(origin, 2, 1)
    (l1, m1, n1), (l2, m2, n2) = np.moveaxis(direction, 2, 1)
    Z = (x2 - x1 + (l1 * z1 / n1 - l2 * z2 / n2)) / (l1 / n1 - l2 / n2)
    X = x1 + l1 * (Z - z1) / n1
    Y1, Y2 = e1 + m1 * (Z - z1) / n1, e2 + m2 * (Z - z2) / n2
    point, parallax = intersect(origin, direction)
    np.testing.assert_allclose(point, np.stack([X, (Y1 + Y2) / 2.0, Z], axis=1), atol=1e-12)  # rounding
    np.testing.assert_allclose(parallax, Y2 - Y1, atol=1e-12)


def test_statistics_are_those_of_the_paper() -> None:
    """1/10,000 and 1/5,000 of the height are allowed: 0.15 m and 0.30 m from 1500 m."""
    error = np.array([[1.0, 0.0, -2.0], [-3.0, 0.5, 1.0], [2.0, -0.5, 1.0]])
    sizes = spread(error)
    np.testing.assert_array_equal(sizes.largest, [-3.0, 0.5, -2.0])
    np.testing.assert_array_equal(sizes.point, [1, 1, 0])
    np.testing.assert_allclose(sizes.sigma, np.sqrt([14.0 / 3.0, 0.5 / 3.0, 2.0]))
    np.testing.assert_allclose(sizes.mean, 0.0, atol=1e-15)
    found = spread(np.array([[0.14, 0.16, 0.29]]), 1500.0)
    np.testing.assert_allclose(found.allowed, [0.15, 0.15, 0.30])
    assert list(found.kept) == [True, False, True]
    counted = histogram(np.random.default_rng(5).normal(size=(500, 3)) * [1.0, 0.1, 3.0])
    assert (counted.count.sum(axis=1) == 500).all() and counted.count.shape == (3, 21)
    np.testing.assert_allclose(counted.edges[:, 0], -counted.edges[:, -1])
    assert (histogram(np.zeros((4, 3))).count[:, 10] == 4).all()


SHALLOW = POINTS + np.array([0.0, 0.0, 7.9])
ACROSS = replace(
    CALM, cameras=np.array([[10.0, -80.0, 500.0], [10.0, 80.0, 500.0]]), points=np.array([[10.0, -200.0, -8.0]])
)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (lambda: linear_wave([5.0, 0.0], 3.0), "period and depth of a wave are positive"),
        (lambda: linear_wave(5.0, 3.0, height=1.0).orbits(-3.1), "between the bottom and the mean level"),
        (lambda: run(replace(CALM, surface=WAVES, points=SHALLOW)), r"point \d+ stands above the water"),
        (lambda: run(ACROSS), "no component along x"),
    ],
)
def test_what_cannot_be_is_refused(asked, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        asked()
