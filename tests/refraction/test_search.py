"""The search for refraction points: none is lost, none is invented, many rays at once are as one at a time."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.refraction import fermat
from musatpy.refraction.all_refraction_points import disc, search
from musatpy.refraction.stationary import Rays, path, stationary
from musatpy.refraction.surface import Gridded, Surface
from musatpy.refraction.waves import Trochoid, sinusoidal, stokes

N = 1.34
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


def some_rays(count: int, seed: int, deepest: float = 200.0) -> Rays:
    """Return rays at depths from 5 m, evenly in their logarithm, inclined by 0 to 60 degrees."""
    rng = np.random.default_rng(seed)
    ground = np.column_stack(
        [rng.uniform(-9.0, 9.0, (count, 2)), -np.exp(rng.uniform(np.log(5.0), np.log(deepest), count))]
    )
    out, azimuth = 1500.0 * np.tan(np.radians(rng.uniform(0.0, 60.0, count))), rng.uniform(0.0, 6.28, count)
    camera = np.column_stack([out * np.cos(azimuth), out * np.sin(azimuth), np.full(count, 1500.0)])
    return Rays.of(camera, ground, N, 0.0)


def by_force(surface: Surface, ray: Rays) -> np.ndarray:
    """Return the refraction points (k, 2) of a ray that Newton reaches from a net over its reach.

    Neither the disc nor the bounds of the search are asked: only where Snell's law lets a ray go.
    """
    reach = float(ray.reach(surface).radius[0])
    nodes = np.linspace(-reach, reach, int(np.ceil(2.0 * reach / surface.limits.length * 6.0)))
    start = ray.ground[0, :2] + np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2)
    many = ray.some(np.zeros(len(start), dtype=int))
    # only from where the path is as even as a wave makes it: from elsewhere the method goes nowhere, and slowly
    gradient = np.linalg.norm(path(surface, many, start).gradient, axis=1)
    even = gradient < 0.25 * surface.limits.slope
    xy, reached = stationary(surface, many.some(even), start[even])
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
        force = by_force(surface, rays.some(slice(i, i + 1)))
        assert len(mine) == len(force)
        apart = np.linalg.norm(mine[:, None] - force, axis=-1)
        # Newton's method leaves 1e-9 of the water leg, more where two points are about to meet
        assert (apart.min(axis=1) < 1e-6).all() and (apart.min(axis=0) < 1e-6).all()
        several += len(mine) > 1
    assert several >= 1


@pytest.mark.slow
@pytest.mark.parametrize("name", HARD)
def test_many_rays_at_once_are_as_one_at_a_time(name: str) -> None:
    surface, rays = HARD[name], some_rays(12, seed=6, deepest=60.0)
    together = search(surface, rays)
    for i in range(len(rays.index)):
        alone, mine = search(surface, rays.some(slice(i, i + 1))), together.ray == i
        np.testing.assert_allclose(together.xy[mine], alone.xy, rtol=0.0, atol=1e-9)  # rounding of 1500 m
        assert (together.minimum[mine] == alone.minimum).all() and together.complete[i] == alone.complete[0]
        assert (np.diff(together.path[mine]) >= 0.0).all()  # the principal one first


@pytest.mark.parametrize("name", ["sinusoidal", "stokes", "trochoidal", "crossing"])
def test_to_200_m_all_are_found_and_are_refraction_points(name: str) -> None:
    surface, rays = HARD[name], some_rays(60, seed=7)
    found = search(surface, rays)
    assert found.complete.all() and len(found.ray) > 100
    at = path(surface, rays.some(found.ray), found.xy)
    np.testing.assert_allclose(at.gradient, 0.0, atol=1e-11)  # Snell's law; rounding of 1500 m over some metres
    assert disc(surface, rays).has(found.xy, found.ray).all()


@pytest.mark.parametrize("name", HARD)
def test_the_disc_is_small(name: str) -> None:
    """It is what makes the search quick: a fraction of where Snell's law alone lets a ray go."""
    rays = some_rays(40, seed=8, deepest=60.0)
    assert np.median(disc(HARD[name], rays).radius / rays.reach(HARD[name]).radius) < 0.5


def test_parts_of_many_rays_fit_together(monkeypatch: pytest.MonkeyPatch) -> None:
    rays = some_rays(50, seed=9)
    whole = fermat.incidence(HARD["crossing"], rays.camera, rays.ground, N)
    monkeypatch.setattr(fermat, "_PART", 7)
    parts = fermat.incidence(HARD["crossing"], rays.camera, rays.ground, N)
    assert (whole.number == parts.number).all()
    np.testing.assert_allclose(parts.v, whole.v, rtol=0.0, atol=1e-9)  # rounding of 1500 m
