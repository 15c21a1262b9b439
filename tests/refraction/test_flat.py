"""The flat water surface: Snell's law, limits, reversal, and agreement with the bisection of 1983."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from musatpy.refraction import flat
from musatpy.refraction.flat import water_tangent_ratio
from refraction.bisection import incidence_distance

UP = np.array([0.0, 0.0, 1.0])
CAMERA = np.array([0.0, 0.0, 3000.0])

heights = st.floats(1.0, 20000.0)
depths = st.floats(0.0, 200.0)
tangents = st.floats(0.0, 30.0)
indices = st.floats(1.0, 1.6)


@given(H=heights, h=depths, slope=tangents, n=indices)
def test_snell_holds_at_the_incidence_point(H: float, h: float, slope: float, n: float) -> None:
    D = slope * H
    t = float(flat.air_tangent(H, h, D, n))
    under = t * float(water_tangent_ratio(t, n))
    sine_air, sine_water = t / np.hypot(1.0, t), under / np.hypot(1.0, under)
    # both identities to rounding of the numbers that enter them
    assert abs(sine_air - n * sine_water) < 1e-14
    assert abs(H * t + h * under - D) <= 1e-14 * max(D, 1.0) * 10.0


@given(H=heights, h=depths, slope=st.floats(0.0, 3.0), n=st.floats(1.01, 1.6))
def test_agrees_with_the_bisection_of_1983(H: float, h: float, slope: float, n: float) -> None:
    D = slope * H
    Q = H * float(flat.air_tangent(H, h, D, n))
    # the bisection stops when D is met to 1e-6 m; Q is off by less than that
    assert abs(Q - incidence_distance(H, h, D, n)) < 1.1e-6


def test_equal_indices_refract_nothing() -> None:
    ground = np.array([[800.0, -300.0, -20.0], [0.0, 0.0, -5.0]])
    result = flat.incidence(CAMERA + 0 * ground, ground, UP + 0 * ground, np.array([20.0, 5.0]), 1.0)
    gap = ground - CAMERA
    np.testing.assert_allclose(np.cross(result.v, gap), 0.0, atol=1e-9)  # parallel to the straight ray


def test_nadir_and_zero_depth_are_guarded() -> None:
    ground = np.array([[0.0, 0.0, -20.0], [500.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    result = flat.incidence(CAMERA + 0 * ground, ground, UP + 0 * ground, np.array([20.0, 0.0, 0.0]), 1.34)
    for value in (result.v, result.by_camera, result.by_ground, result.by_level, result.by_index):
        assert np.isfinite(value).all()
    np.testing.assert_allclose(result.v[0], [0.0, 0.0, -3000.0])
    # K at the nadir is n H / (n H + h)
    assert result.by_ground[0, 0, 0] == pytest.approx(1.34 * 3000.0 / (1.34 * 3000.0 + 20.0), rel=1e-14)
    np.testing.assert_allclose(result.v[1], ground[1] - CAMERA)


def test_points_above_the_water_are_untouched() -> None:
    ground = np.array([[700.0, 100.0, 4.0]])
    result = flat.incidence(CAMERA + 0 * ground, ground, UP + 0 * ground, np.array([-4.0]), 1.34)
    np.testing.assert_array_equal(result.v, ground - CAMERA)
    np.testing.assert_array_equal(result.by_ground[0], np.eye(3))
    np.testing.assert_array_equal(result.by_camera[0], -np.eye(3))


def test_image_is_continuous_through_the_water_line() -> None:
    """The wet formula goes smoothly through depth 0."""
    ground = np.array([700.0, 100.0, 0.0])
    directions = [flat.incidence(CAMERA, ground - d * UP, UP, np.array(d), 1.34, wet=True).v for d in (1e-6, -1e-6)]
    unit = [v / np.linalg.norm(v) for v in directions]
    assert np.abs(unit[0] - unit[1]).max() < 1e-9  # 2e-6 m over 3000 m


@given(
    x=st.floats(-8000.0, 8000.0), y=st.floats(-8000.0, 8000.0), depth=st.floats(0.001, 100.0), n=st.floats(1.0, 1.5)
)
def test_the_refracted_ray_is_the_way_back(x: float, y: float, depth: float, n: float) -> None:
    """From the ground point to the camera and back along the refracted ray: the round trip ends where it began."""
    ground = np.array([x, y, -depth])
    v = flat.incidence(CAMERA, ground, UP, np.array(depth), n).v
    bent = flat.refracted_ray(CAMERA, v / np.linalg.norm(v), UP, 3000.0, n)
    reached = bent.origin + bent.direction * depth / -bent.direction[2]
    np.testing.assert_allclose(reached, ground, atol=1e-9)  # rounding of coordinates of 1e4 m
    assert np.linalg.norm(bent.direction) == pytest.approx(1.0, abs=1e-15)


def test_any_orientation_of_the_vertical() -> None:
    """The same picture turned in space gives the same result turned."""
    rng = np.random.default_rng(5)
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    ground = np.array([900.0, -1200.0, -14.0])
    plain = flat.incidence(CAMERA, ground, UP, np.array(14.0), 1.34)
    turned = flat.incidence(R @ CAMERA, R @ ground, R @ UP, np.array(14.0), 1.34)
    np.testing.assert_allclose(turned.v, R @ plain.v, atol=1e-9)
    np.testing.assert_allclose(turned.by_ground, R @ plain.by_ground @ R.T, atol=1e-12)


@pytest.mark.parametrize("wet", [None, True, np.arange(20002).reshape(2, -1) % 3 == 0])
def test_vectors_alone_are_those_with_partials(wet: np.ndarray | bool | None) -> None:
    """In several chunks, dry and wet, one camera for all; a ray by itself has the same partials."""
    rng = np.random.default_rng(8)
    ground = rng.normal(size=(2, 10001, 3)) * [2000.0, 2000.0, 10.0]
    tilted = np.array([0.01, -0.02, np.sqrt(1.0 - 5e-4)])
    arguments = (CAMERA, ground, tilted, 4.0 - ground[..., 2], 1.34, wet)
    whole = flat.incidence(*arguments)
    np.testing.assert_array_equal(flat.water_vector(*arguments), whole.v)
    assert whole.by_camera.shape == (2, 10001, 3, 3) and whole.by_index.shape == (2, 10001, 3)
    one = wet[1, 9000] if isinstance(wet, np.ndarray) else wet
    single = flat.incidence(CAMERA, ground[1, 9000], tilted, 4.0 - ground[1, 9000, 2], 1.34, one)
    for name in ("v", "by_camera", "by_ground", "by_level", "by_index"):
        np.testing.assert_allclose(getattr(whole, name)[1, 9000], getattr(single, name), rtol=1e-13, atol=1e-13)
