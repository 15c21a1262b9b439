"""Refraction by Fermat's principle over any wave, and by the flat surface."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import minimum_filter

from musatpy.refraction import bending, fermat, flat
from musatpy.refraction.all_refraction_points import search
from musatpy.refraction.flat import water_tangent_ratio
from musatpy.refraction.stationary import RayEnds
from musatpy.refraction.surface import PlanarSurface
from musatpy.refraction.waves import sinusoidal
from refraction.seas import SEAS

CAMERA = np.array([40.0, -60.0, 480.0])
N = 1.333
RNG = np.random.default_rng(7)
GROUND = np.column_stack([RNG.uniform(-60.0, 60.0, (60, 2)), RNG.uniform(-20.0, -4.0, 60)])
# a wave shorter than the water is deep, steep enough to focus: Okamoto (1982), Figure 7
STEEP = sinusoidal(amplitude=[0.15, 0.1], length=[3.0, 4.0], azimuth=[0.3, 1.6])


@pytest.mark.parametrize("name", SEAS)
def test_snell_holds_about_the_normal_of_the_surface(name: str) -> None:
    sea = SEAS[name]
    found = fermat.incidence(sea, CAMERA, GROUND, N, 1.5)
    W = CAMERA + found.v
    relief = sea.relief(W[:, :2], 1.5)
    np.testing.assert_allclose(relief.height, W[:, 2], atol=1e-12)  # on the surface
    m = np.column_stack([-relief.gradient, np.ones(len(W))])
    m /= np.linalg.norm(m, axis=1)[:, None]
    air = found.v / np.linalg.norm(found.v, axis=1)[:, None]
    water = (GROUND - W) / np.linalg.norm(GROUND - W, axis=1)[:, None]
    # both sines as vectors across the normal, which also says that the three lie in one plane
    np.testing.assert_allclose(np.cross(m, air), N * np.cross(m, water), atol=1e-13)


@settings(max_examples=60, deadline=None)
@given(
    amplitude=st.floats(0.0, 1.5), length=st.floats(15.0, 200.0), azimuth=st.floats(-3.2, 3.2),
    crest=st.floats(-50.0, 50.0), depth=st.floats(0.1, 40.0), x=st.floats(-1500.0, 1500.0), n=st.floats(1.0, 1.4),
)  # fmt: skip
def test_there_and_back_over_any_wave(amplitude, length, azimuth, crest, depth, x, n) -> None:
    sea = sinusoidal(amplitude=min(amplitude, length / 20.0), length=length, azimuth=azimuth, crest=crest)
    camera = np.array([0.0, 100.0, 1500.0])
    ground = np.array([x, -30.0, 0.0])
    ground[2] = float(sea.relief(ground[:2]).height) - depth
    found = fermat.incidence(sea, camera, ground, n)
    assert found.number >= 1
    bent = bending.refracted_ray(sea, camera, found.v / np.linalg.norm(found.v), n)
    far = (ground[2] - bent.origin[2]) / bent.direction[2]
    # the requirement; a hundred times what rounding leaves over 2 km
    np.testing.assert_allclose(bent.origin + far * bent.direction, ground, rtol=0.0, atol=1e-9)


def test_points_above_the_water_keep_their_straight_ray() -> None:
    ground = np.array([[5.0, 5.0, 3.0], [5.0, 5.0, -3.0]])
    found = fermat.incidence(SEAS["sinusoidal"], CAMERA, ground, N)
    np.testing.assert_array_equal(found.v[0], ground[0] - CAMERA)
    np.testing.assert_array_equal(found.by_ground[0], np.eye(3))
    assert list(found.number) == [0, 1]


def _scanned(sea, camera, ground) -> tuple[int, float]:
    """Return how many places of a net have a shorter optical path than all eight neighbours, and the shortest."""
    nodes = np.linspace(-15.0, 15.0, 801)
    xy = ground[:2] + np.stack(np.meshgrid(nodes, nodes, indexing="ij"), axis=-1)
    W = np.concatenate([xy, sea.relief(xy).height[..., None]], axis=-1)
    path = np.linalg.norm(W - camera, axis=-1) + N * np.linalg.norm(ground - W, axis=-1)
    others = minimum_filter(path, footprint=[[1, 1, 1], [1, 0, 1], [1, 1, 1]])
    return int((path < others)[1:-1, 1:-1].sum()), float(path.min())


@pytest.mark.slow
@pytest.mark.parametrize("ground", [[3.0, 1.0, -20.0], [0.0, 0.0, -12.0], [-4.0, 7.5, -30.0]])
def test_all_refraction_points_are_found_and_the_principal_one_has_the_least_path(ground) -> None:
    ground = np.array(ground)
    points = search(STEEP, RayEnds.of(CAMERA, ground, N, 0.0))
    minima, least = _scanned(STEEP, CAMERA, ground)
    assert points.complete.all() and len(points.path) >= 3
    assert int(points.minimum.sum()) == minima
    assert points.path[0] <= least < points.path[0] + 1e-4  # a net of 4 cm comes that near
    assert (np.diff(points.path) >= 0.0).all() and points.minimum[0]
    places = np.column_stack([points.xy, STEEP.relief(points.xy).height])
    for place in places:  # every one of them images the ground point
        air = place - CAMERA
        bent = bending.refracted_ray(STEEP, CAMERA, air / np.linalg.norm(air), N)
        far = (ground[2] - bent.origin[2]) / bent.direction[2]
        np.testing.assert_allclose(bent.origin + far * bent.direction, ground, atol=1e-9)  # the requirement
    principal = fermat.incidence(STEEP, CAMERA, ground, N)
    assert principal.number == len(points.path) and principal.complete
    np.testing.assert_allclose(CAMERA + principal.v, places[0], atol=1e-10)  # rounding of 500 m


def test_a_ray_that_is_called_single_has_one_refraction_point() -> None:
    """The bound is safe: where it says one, the search finds one; and it is not idle: it says so of most rays."""
    rng = np.random.default_rng(11)
    single = checked = 0
    for _ in range(40):
        length = rng.uniform(4.0, 40.0)
        sea = sinusoidal(amplitude=rng.uniform(0.0, 0.03) * length, length=length, azimuth=rng.uniform(0, 6))
        ground = np.array([rng.uniform(-200, 200), rng.uniform(-200, 200), rng.uniform(-25.0, -2.0)])
        ray = RayEnds.of(CAMERA, ground, N, 0.0)
        checked += 1
        if fermat.is_single(sea, ray)[0]:
            single += 1
            assert len(search(sea, ray).xy) == 1
    assert 0.3 < single / checked < 1.0
    assert not fermat.is_single(STEEP, RayEnds.of(CAMERA, GROUND, N, 0.0)).any()


@pytest.mark.parametrize("name", SEAS)
def test_no_ray_meets_the_water_beyond_its_reach(name: str) -> None:
    """Of a surface without a highest place too, whose slope bounds what a ray can meet."""
    rays = RayEnds.of(CAMERA, GROUND, N, 1.5)
    W = CAMERA + fermat.incidence(SEAS[name], CAMERA, GROUND, N, 1.5).v
    reach, depth = rays.reach(SEAS[name]), W[:, 2] - GROUND[:, 2]
    assert np.isfinite(reach.radius).all()
    # a level surface leaves no room at all: rounding of 500 m
    assert (np.linalg.norm(W[:, :2] - GROUND[:, :2], axis=1) <= reach.radius + 1e-9).all()
    assert (reach.shallowest <= depth + 1e-9).all() and (depth <= reach.deepest + 1e-9).all()


def test_shapes_broadcast() -> None:
    cameras = np.array([CAMERA, CAMERA + np.array([100.0, 0.0, 3.0])])
    found = fermat.incidence(SEAS["superposed"], cameras[:, None], GROUND, N, np.array([0.0, 3.0])[:, None])
    assert found.v.shape == (2, 60, 3) and found.by_slope.shape == (2, 60, 3, 2) and found.number.shape == (2, 60)
    alone = fermat.incidence(SEAS["superposed"], cameras[1], GROUND[7], N, 3.0)
    np.testing.assert_allclose(found.v[1, 7], alone.v, atol=1e-12)  # rounding of 500 m
    assert alone.v.shape == (3,)


@pytest.mark.parametrize("name", SEAS)
@pytest.mark.parametrize("depth", [5.0, 1e-3, 1e-6, 1e-9, 1e-12])
def test_points_just_under_the_water_have_their_incidence_point(name: str, depth: float) -> None:
    """Their way under water is shorter than coordinates of hundreds of metres can say: rounding is the limit."""
    sea = SEAS[name]
    ground = GROUND.copy()
    ground[:, 2] = sea.relief(ground[:, :2], 1.5).height - depth
    found = fermat.incidence(sea, CAMERA, ground, N, 1.5)
    assert (np.linalg.norm(CAMERA + found.v - ground, axis=1) < 3.0 * depth + 1e-12).all()
    bent = bending.refracted_ray(sea, CAMERA, found.v / np.linalg.norm(found.v, axis=1)[:, None], N, 1.5)
    far = (ground[:, 2] - bent.origin[:, 2]) / bent.direction[:, 2]
    np.testing.assert_allclose(bent.origin + far[:, None] * bent.direction, ground, rtol=0.0, atol=1e-9)


def test_map_coordinates_leave_their_rounding_only() -> None:
    """5000 km of northing have 1e-9 m in their last place: the same ray comes out as near its origin."""
    sea, away = sinusoidal(amplitude=0.5, length=92.0, azimuth=0.5), np.array([5e5, 5e6, 0.0])
    moved = sinusoidal(amplitude=0.5, length=92.0, azimuth=0.5, crest=float(away[:2] @ [np.cos(0.5), np.sin(0.5)]))
    ground = GROUND + np.array([0.0, 0.0, 3.9])  # from 0.1 m deep
    here = fermat.incidence(sea, CAMERA, ground, N).v
    np.testing.assert_allclose(
        fermat.incidence(moved, CAMERA + away, ground + away, N).v, here, rtol=0.0, atol=1e-7
    )


@pytest.mark.parametrize(
    ("sea", "camera", "ground", "message"),
    [
        (SEAS["superposed"], (0.0, 0.0, 0.5), GROUND, "camera is not above the water"),
        (SEAS["gridded"], CAMERA, (400.0, 1.0, -10.0), r"not known where a ray meets it: at 39\d\.\d, 0\.\d m"),
        (sinusoidal(amplitude=1e-4, length=1e-3, azimuth=0.0), CAMERA, GROUND,
         r"waves of 0\.001 m are too short for a search over [\d.]+ m of water"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said(sea, camera, ground, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fermat.incidence(sea, np.array(camera), np.array(ground), N)


def test_flat_water_is_that_of_a_level_surface_to_the_nadir_and_the_water_line() -> None:
    """A point at the nadir, one on the water, both; one above it is seen along a straight line."""
    ground = np.array(
        [[0.0, 0.0, -20.0], [700.0, 100.0, -3.0], [500.0, 0.0, 0.0], [0.0, 0.0, 0.0], [70.0, 10.0, 4.0]]
    )
    result = flat.incidence(ABOVE + 0 * ground, ground, UP + 0 * ground, -ground[:, 2], 1.34)
    waves = fermat.incidence(PlanarSurface(), ABOVE, ground, 1.34)
    for name in ("v", "by_camera", "by_ground", "by_index"):
        assert np.isfinite(getattr(result, name)).all()
        wet = slice(0, 2)
        np.testing.assert_allclose(getattr(result, name)[wet], getattr(waves, name)[wet], atol=1e-9)  # of 3000 m
    np.testing.assert_allclose(result.v[2:], ground[2:] - ABOVE)
    np.testing.assert_array_equal(result.by_ground[4], np.eye(3))


UP = np.array([0.0, 0.0, 1.0])
ABOVE = np.array([0.0, 0.0, 3000.0])

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


def test_image_is_continuous_through_the_water_line() -> None:
    """The wet formula goes smoothly through depth 0."""
    ground = np.array([700.0, 100.0, 0.0])
    directions = [flat.incidence(ABOVE, ground - d * UP, UP, np.array(d), 1.34, wet=True).v for d in (1e-6, -1e-6)]
    unit = [v / np.linalg.norm(v) for v in directions]
    assert np.abs(unit[0] - unit[1]).max() < 1e-9  # 2e-6 m over 3000 m


@given(
    x=st.floats(-8000.0, 8000.0), y=st.floats(-8000.0, 8000.0), depth=st.floats(0.001, 100.0), n=st.floats(1.0, 1.5)
)
def test_the_ray_by_flat_water_is_the_way_back(x: float, y: float, depth: float, n: float) -> None:
    """From the ground point to the camera and back along the refracted ray: the round trip ends where it began."""
    ground = np.array([x, y, -depth])
    v = flat.incidence(ABOVE, ground, UP, np.array(depth), n).v
    bent = flat.refracted_ray(ABOVE, v / np.linalg.norm(v), UP, 3000.0, n)
    reached = bent.origin + bent.direction * depth / -bent.direction[2]
    np.testing.assert_allclose(reached, ground, atol=1e-9)  # rounding of coordinates of 1e4 m
    assert np.linalg.norm(bent.direction) == pytest.approx(1.0, abs=1e-15)


def test_any_orientation_of_the_vertical() -> None:
    """The same picture turned in space gives the same result turned."""
    rng = np.random.default_rng(5)
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    ground = np.array([900.0, -1200.0, -14.0])
    plain = flat.incidence(ABOVE, ground, UP, np.array(14.0), 1.34)
    turned = flat.incidence(R @ ABOVE, R @ ground, R @ UP, np.array(14.0), 1.34)
    np.testing.assert_allclose(turned.v, R @ plain.v, atol=1e-9)
    np.testing.assert_allclose(turned.by_ground, R @ plain.by_ground @ R.T, atol=1e-12)


@pytest.mark.parametrize("wet", [None, True, np.arange(20002).reshape(2, -1) % 3 == 0])
def test_vectors_alone_are_those_with_partials(wet: np.ndarray | bool | None) -> None:
    """In several chunks, dry and wet, one camera for all; a ray by itself has the same partials."""
    rng = np.random.default_rng(8)
    ground = rng.normal(size=(2, 10001, 3)) * [2000.0, 2000.0, 10.0]
    tilted = np.array([0.01, -0.02, np.sqrt(1.0 - 5e-4)])
    arguments = (ABOVE, ground, tilted, 4.0 - ground[..., 2], 1.34, wet)
    whole = flat.incidence(*arguments)
    np.testing.assert_array_equal(flat.water_vector(*arguments), whole.v)
    assert whole.by_camera.shape == (2, 10001, 3, 3) and whole.by_index.shape == (2, 10001, 3)
    one = wet[1, 9000] if isinstance(wet, np.ndarray) else wet
    single = flat.incidence(ABOVE, ground[1, 9000], tilted, 4.0 - ground[1, 9000, 2], 1.34, one)
    for name in ("v", "by_camera", "by_ground", "by_level", "by_index"):
        np.testing.assert_allclose(getattr(whole, name)[1, 9000], getattr(single, name), rtol=1e-13, atol=1e-13)
