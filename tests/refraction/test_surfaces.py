"""Every family of surfaces: its derivatives, its movement, its limits, and what makes it that family."""

import numpy as np
import pytest

from musatpy.refraction.surface import Gridded
from musatpy.refraction.waves import Harmonic, Trochoid, second_harmonic, sinusoidal, stokes, superposed
from refraction.seas import CHOP, SEAS, SWELL, measured

PLACES = np.random.default_rng(1).uniform(-90.0, 90.0, (300, 2))
G = 9.8


@pytest.mark.parametrize("name", SEAS)
def test_gradient_and_second_derivatives(name: str) -> None:
    sea, h = SEAS[name], 1e-4
    relief = sea.relief(PLACES, 2.0)
    for axis in range(2):
        step = np.eye(2)[axis] * h
        fore, aft = sea.relief(PLACES + step, 2.0), sea.relief(PLACES - step, 2.0)
        # central differences: h^2/6 of the third derivative (below 0.05 m^-2 here), and rounding over h; the third
        # derivative of a bicubic spline jumps at its nodes, which leaves h/2 of the jump
        np.testing.assert_allclose(relief.gradient[:, axis], (fore.height - aft.height) / (2 * h), atol=1e-9)
        tolerance = 1e-6 if name == "gridded" else 1e-9
        bend = (fore.gradient - aft.gradient) / (2 * h)
        np.testing.assert_allclose(relief.hessian[:, axis], bend, atol=tolerance)


@pytest.mark.parametrize("name", SEAS)
def test_shapes_of_one_place_and_of_many_agree(name: str) -> None:
    sea = SEAS[name]
    many = sea.relief(PLACES.reshape(10, 30, 2), np.full((10, 1), 0.5))
    one = sea.relief(PLACES[42], 0.5)
    assert many.height.shape == (10, 30) and many.gradient.shape == (10, 30, 2)
    assert many.hessian.shape == (10, 30, 2, 2)
    assert many.height[1, 12] == pytest.approx(float(one.height), abs=1e-14)  # rounding of metres
    assert sea.covers(PLACES.reshape(10, 30, 2)).all()


@pytest.mark.parametrize(
    ("name", "velocity"),
    [
        ("sinusoidal", 9.2 * np.array([np.cos(0.5), np.sin(0.5)])),
        ("stokes", 6.8 * np.array([np.cos(0.5), np.sin(0.5)])),
        ("trochoidal", 6.8 * np.array([np.cos(0.3), -np.sin(0.3)])),
        ("gridded", np.array([5.0, 2.0])),
        ("level", np.array([3.0, 4.0])),
    ],
)
def test_the_shape_moves_with_the_phase_speed(name: str, velocity: np.ndarray) -> None:
    sea = SEAS[name]
    later = sea.relief(PLACES + 3.0 * velocity, 3.0)
    now = sea.relief(PLACES)
    np.testing.assert_allclose(later.height, now.height, atol=1e-12)  # rounding of phases of some turns
    np.testing.assert_allclose(later.hessian, now.hessian, atol=1e-12)


@pytest.mark.parametrize("name", SEAS)
def test_limits_are_kept(name: str) -> None:
    sea = SEAS[name]
    places = np.random.default_rng(2).uniform(-100.0, 100.0, (20000, 2))
    relief, limits = sea.relief(places), sea.limits
    assert limits.lowest <= relief.height.min() and relief.height.max() <= limits.highest
    # a plane is at its limit, apart from rounding
    assert np.linalg.norm(relief.gradient, axis=1).max() <= limits.slope * (1.0 + 1e-14)
    assert np.abs(np.linalg.eigvalsh(relief.hessian)).max() <= limits.curvature


@pytest.mark.parametrize("name", SEAS)
def test_the_limit_of_third_derivatives_is_kept_and_near(name: str) -> None:
    sea, h = SEAS[name], 1e-4
    rng = np.random.default_rng(3)
    places, angle = rng.uniform(-100.0, 100.0, (20000, 2)), rng.uniform(0.0, 2.0 * np.pi, 20000)
    e = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    change = (sea.relief(places + h * e).hessian - sea.relief(places - h * e).hessian) / (2.0 * h)
    third = np.abs(np.einsum("ni,nij,nj->n", e, change, e)).max()
    # differences leave 1e-16 of a second derivative over h; components are rarely at their worst together
    assert third <= sea.limits.third * (1.0 + 1e-9) + 1e-10
    assert third >= sea.limits.third / 4.0 - 1e-10


def _surface_conditions(amplitude: float, k: float, depth: float) -> float:
    """Return how far a second-order wave is from meeting both conditions at its free surface, at worst.

    The velocity potential of second order; the pressure at the surface may differ by a constant.
    """
    length = 2.0 * np.pi / k
    omega = np.sqrt(G * k * np.tanh(k * depth))
    wave = stokes(amplitude=amplitude, length=length, azimuth=0.0, speed=omega / k, depth=depth)
    x = np.linspace(0.0, length, 200)
    relief = wave.relief(np.stack([x, 0 * x], axis=1))
    z, slope = relief.height, relief.gradient[:, 0]
    first = amplitude * omega / (k * np.sinh(k * depth))
    second = 0.375 * amplitude**2 * omega / np.sinh(k * depth) ** 4
    th, zz = k * x, k * (z + depth)
    u = k * first * np.cosh(zz) * np.cos(th) + 2 * k * second * np.cosh(2 * zz) * np.cos(2 * th)
    w = k * first * np.sinh(zz) * np.sin(th) + 2 * k * second * np.sinh(2 * zz) * np.sin(2 * th)
    by_time = -omega * (first * np.cosh(zz) * np.cos(th) + 2 * second * np.cosh(2 * zz) * np.cos(2 * th))
    kinematic = w - slope * (u - omega / k)
    dynamic = by_time + 0.5 * (u**2 + w**2) + G * z
    return max(np.abs(kinematic).max(), np.abs(dynamic - dynamic.mean()).max())


@pytest.mark.parametrize("kh", [0.6, 1.5, 4.0])
def test_stokes_waves_meet_the_conditions_at_the_surface_to_second_order(kh: float) -> None:
    """With half the amplitude the misfit falls to an eighth; that of a first-order theory would to a fourth."""
    k = kh / 10.0
    ratio = _surface_conditions(0.02, k, 10.0) / _surface_conditions(0.01, k, 10.0)
    assert 7.8 < ratio < 8.2  # the terms of fourth order are a hundredth


def test_stokes_waves_become_sinusoidal_and_say_when_they_break_down() -> None:
    assert second_harmonic(0.5, 0.1, 1e4) == pytest.approx(0.5**2 * 0.1 / 2.0)  # a^2 k / 2 in deep water
    low = stokes(amplitude=1e-6, length=68.0, azimuth=0.5, speed=6.8, depth=5.0, crest=17.0)
    plain = sinusoidal(amplitude=1e-6, length=68.0, azimuth=0.5, speed=6.8, crest=17.0)
    np.testing.assert_allclose(low.relief(PLACES).height, plain.relief(PLACES).height, atol=1e-11)  # a^2 k
    with pytest.raises(ValueError, match="too high for second-order theory at depth 5 m"):
        stokes(amplitude=1.3, length=103.0, azimuth=0.0, speed=6.9, depth=5.0)


def test_trochoid_is_the_path_of_a_rolling_circle() -> None:
    wave = Trochoid(amplitude=1.4, length=20.0, azimuth=0.0, crest=2.0, level=5.0)
    k, r = 2.0 * np.pi / 20.0, 1.4
    q = np.linspace(-50.0, 50.0, 77)
    x = 2.0 + q - r * np.sin(k * q)
    height = wave.relief(np.stack([x, 0 * x], axis=1)).height
    np.testing.assert_allclose(height, 5.0 + k * r * r / 2.0 + r * np.cos(k * q), atol=1e-12)  # rounding
    x = np.arange(4096) / 4096 * 20.0
    assert wave.relief(np.stack([x, 0 * x], axis=1)).height.mean() == pytest.approx(5.0, abs=1e-12)


def test_a_measured_surface_is_known_to_the_fourth_order_of_its_interval() -> None:
    places = np.random.default_rng(3).uniform(-60.0, 60.0, (4000, 2))
    truth = superposed(SWELL, CHOP).relief(places).height
    coarse, fine = (np.abs(measured(i).relief(places).height - truth).max() for i in (2.0, 1.0))
    assert fine < 1e-5 and 12.0 < coarse / fine < 24.0  # 2^4, apart from where the worst place lies


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Harmonic(amplitude=np.ones(2), vector=np.ones((1, 2)), frequency=np.ones(1), phase=np.ones(1)),
         "one amplitude, vector, frequency and phase"),
        (lambda: Harmonic(amplitude=np.ones(1), vector=np.zeros((1, 2)), frequency=np.ones(1), phase=np.ones(1)),
         "length zero"),
        (lambda: sinusoidal(amplitude=1.0, length=0.0, azimuth=0.0), "wave length is positive"),
        (lambda: stokes(amplitude=1.0, length=10.0, azimuth=0.0, speed=1.0, depth=0.0), "are positive"),
        (lambda: Trochoid(amplitude=2.0, length=10.0, azimuth=0.0), "from 0 to its length over 2 pi"),
        (lambda: Gridded(x=np.arange(4.0), y=np.arange(5.0), height=np.zeros((5, 4))), "one row per x"),
        (lambda: Gridded(x=np.arange(3.0), y=np.arange(5.0), height=np.zeros((3, 5))), "four nodes"),
        (lambda: Gridded(x=np.zeros(4), y=np.arange(4.0), height=np.zeros((4, 4))), "ascend"),
        (lambda: Gridded(x=np.arange(4.0), y=np.arange(4.0), height=np.full((4, 4), np.nan)), "at every node"),
    ],
)  # fmt: skip
def test_what_is_no_surface_is_refused(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
