"""Rays bent by waves, all of them found, and trains of waves."""

from dataclasses import replace

import numpy as np
import pytest

from musatpy.refraction import bending
from musatpy.refraction.all_refraction_points import disc, search
from musatpy.refraction.stationary import RayEnds, path, stationary
from musatpy.refraction.surface import Gridded, Surface
from musatpy.refraction.waves import LENGTH, Trains, Trochoid, sinusoidal, stokes
from musatpy.sea.theory import linear_wave
from refraction.seas import CHOP, SEAS, SWELL

CAMERA = np.array([10.0, -20.0, 300.0])
N = 1.34


def _direction(*vector: float) -> np.ndarray:
    return np.array(vector) / np.linalg.norm(vector)


@pytest.mark.parametrize("fall", [1.0, 0.3, 0.1, 0.05])
def test_a_ray_meets_the_first_crest_in_its_way(fall: float) -> None:
    """Against a scan along the ray in steps of a millimetre; flat rays would meet later crests too."""
    sea = sinusoidal(amplitude=0.6, length=18.0, azimuth=0.2, crest=4.0)
    camera, u = np.array([0.0, 0.0, 6.0]), _direction(1.0, 0.1, -fall)
    W = bending.refracted_ray(sea, camera, u, N).origin
    rho = np.arange(0.0, 7.0 / -u[2], 1e-3)
    ray = camera + rho[:, None] * u
    below = ray[:, 2] < sea.relief(ray[:, :2]).height
    first = rho[np.argmax(below)]
    assert first - 1.1e-3 <= (W - camera) @ u <= first  # one step of the scan


@pytest.mark.parametrize("name", SEAS)
def test_the_ray_in_water_is_a_unit_vector_that_obeys_snell(name: str) -> None:
    u = np.array([_direction(x, y, -1.0) for x in (-0.3, 0.0, 0.25) for y in (-0.2, 0.3)])
    bent = bending.refracted_ray(SEAS[name], CAMERA, u, N, 1.0)
    m = np.column_stack([-SEAS[name].relief(bent.origin[:, :2], 1.0).gradient, np.ones(6)])
    m /= np.linalg.norm(m, axis=1)[:, None]
    np.testing.assert_allclose(np.cross(m, u), N * np.cross(m, bent.direction), atol=1e-13)  # rounding
    np.testing.assert_allclose(np.linalg.norm(bent.direction, axis=1), 1.0, atol=1e-14)


def test_what_cannot_be_is_said() -> None:
    for name, camera, direction, message in (
        ("superposed", CAMERA, (1.0, 0.0, 0.1), "does not go down"),
        ("superposed", (0.0, 0.0, -1.0), (0.0, 0.0, -1.0), "camera is not above the water"),
        ("gridded", CAMERA, (3.0, 0.0, -1.0), "not known where a ray meets it"),
    ):
        with pytest.raises(ValueError, match=message):
            bending.refracted_ray(SEAS[name], np.array(camera), _direction(*direction), N)


CROSSING = sinusoidal(amplitude=[0.3, 0.2], length=[8.0, 6.0], azimuth=[0.4, 1.7], crest=[1.0, -2.0])
NODES = np.arange(-72.0, 73.0, 1.0)
HARD: dict[str, Surface] = {
    "sinusoidal": sinusoidal(amplitude=0.5, length=9.0, azimuth=0.7, crest=2.0),
    "stokes": stokes(amplitude=0.4, length=9.0, azimuth=-0.8, speed=0.0, depth=9.0, crest=1.0),
    "trochoidal": Trochoid(amplitude=0.5, length=9.0, azimuth=2.0, crest=3.0),
    "crossing": CROSSING,
    "gridded": Gridded(
        x=NODES, y=NODES, height=CROSSING.relief(np.stack(np.meshgrid(NODES, NODES, indexing="ij"), -1)).height
    ),
}  # fmt: skip


def some_rays(count: int, seed: int, deepest: float = 200.0) -> RayEnds:
    """Return rays at depths from 5 m, evenly in their logarithm, inclined by 0 to 60 degrees."""
    rng = np.random.default_rng(seed)
    ground = np.column_stack(
        [rng.uniform(-9.0, 9.0, (count, 2)), -np.exp(rng.uniform(np.log(5.0), np.log(deepest), count))]
    )
    out, azimuth = 1500.0 * np.tan(np.radians(rng.uniform(0.0, 60.0, count))), rng.uniform(0.0, 6.28, count)
    camera = np.column_stack([out * np.cos(azimuth), out * np.sin(azimuth), np.full(count, 1500.0)])
    return RayEnds.of(camera, ground, N, 0.0)


def by_force(surface: Surface, ray: RayEnds) -> np.ndarray:
    """Return the refraction points (k, 2) of a ray that Newton reaches from a net over its reach.

    Neither the disc nor the bounds of the search are asked: only where Snell's law lets a ray go.
    """
    reach = float(ray.reach(surface).radius[0])
    nodes = np.linspace(-reach, reach, int(np.ceil(2.0 * reach / surface.limits.length * 6.0)))
    start = ray.ground[0, :2] + np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2)
    many = ray[np.zeros(len(start), dtype=int)]
    # only from where the path is as even as a wave makes it: from elsewhere the method goes nowhere, and slowly
    gradient = np.linalg.norm(path(surface, many, start).gradient, axis=1)
    even = gradient < 0.25 * surface.limits.slope
    xy, reached = stationary(surface, many[even], start[even])
    xy = xy[reached & (np.linalg.norm(xy - ray.ground[0, :2], axis=1) <= reach)]
    kept: list[np.ndarray] = []
    for place in xy:
        if all(np.hypot(*(place - other)) > 1e-5 for other in kept):
            kept.append(place)
    return np.array(kept)


@pytest.mark.slow
@pytest.mark.parametrize("name", HARD)
def test_none_is_lost(name: str) -> None:
    surface, rays, several = HARD[name], some_rays(6, seed=2, deepest=40.0), 0
    found = search(surface, rays)
    assert found.complete.all()
    for i in range(len(rays.index)):
        mine = found.xy[found.ray == i]
        force = by_force(surface, rays[slice(i, i + 1)])
        assert len(mine) == len(force)
        apart = np.linalg.norm(mine[:, None] - force, axis=-1)
        # Newton's method leaves 1e-9 of the water leg, more where two points are about to meet
        assert (apart.min(axis=1) < 1e-6).all() and (apart.min(axis=0) < 1e-6).all()
        several += len(mine) > 1
    assert several >= 1


@pytest.mark.parametrize("name", ["sinusoidal", "stokes", "trochoidal", "crossing"])
def test_to_200_m_all_are_found_and_are_refraction_points(name: str) -> None:
    surface, rays = HARD[name], some_rays(60, seed=7)
    found = search(surface, rays)
    assert found.complete.all() and len(found.ray) > 100
    at = path(surface, rays[found.ray], found.xy)
    np.testing.assert_allclose(at.gradient, 0.0, atol=1e-11)  # Snell's law; rounding of 1500 m over some metres
    assert disc(surface, rays).has(found.xy, found.ray).all()


def test_what_is_no_wave_is_told() -> None:
    with pytest.raises(ValueError, match="positive"):
        Trains.of(SWELL, 0.0)
    trains = Trains.of(CHOP)
    assert trains.sensible
    for column, value in ((LENGTH, -1.0), (LENGTH, 0.3), (0, np.nan), (0, 10.0)):
        values = trains.values.copy()
        values[1, column] = value
        assert not trains.with_values(values).sensible


PLACES = np.array([[0.0, 0.0], [37.0, -80.0], [-400.0, 250.0]])


@pytest.mark.parametrize("depth", [np.nan, 10.0, np.inf])
def test_the_waves_of_a_surface_are_those_of_its_trains(depth: float) -> None:
    for sea in (SWELL, CHOP):
        got, want = Trains.of(sea, depth).surface.relief(PLACES, 4.0), sea.relief(PLACES, 4.0)
        for name in ("height", "gradient", "hessian"):  # rounding of angles of some ten cycles
            np.testing.assert_allclose(getattr(got, name), getattr(want, name), atol=1e-13)


@pytest.mark.parametrize("depth", [8.0, np.inf])
def test_the_speed_follows_the_length_as_in_linear_theory(depth: float) -> None:
    water = depth if np.isfinite(depth) else 1e4  # so deep that tanh kh is 1
    of = [linear_wave(period, water) for period in (9.0, 7.0)]
    sea = replace(SWELL, vector=np.array([[of[0].number, 0.0]]), frequency=np.array([2.0 * np.pi / 9.0]))
    trains = Trains.of(sea, depth)
    values = trains.values.copy()
    values[:, LENGTH] = of[1].length
    # rounding, and what the theory's iteration leaves
    assert trains.with_values(values).speed[0] == pytest.approx(float(of[1].speed), rel=1e-12)
    kept = Trains.of(sea).with_values(values)
    assert kept.speed[0] == pytest.approx(float(of[0].speed), rel=1e-12)
