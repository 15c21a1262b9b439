"""Rays of the simulation: Snell on planes and on the ellipsoid, level and tilted."""

import numpy as np
import pyproj
import pytest

from musatpy.geometry.geodesy import Ellipsoid
from musatpy.simulation import simulate, spec_from_table
from musatpy.simulation.raytrace import RayTraceError, trace
from musatpy.units import ARC_SECOND

EARTH = Ellipsoid("clrk66")
AXIS, E2 = pyproj.Geod(ellps="clrk66").a, pyproj.Geod(ellps="clrk66").es
INDEX = 1.34


def scene(rays=400, steepest=75.0):
    """Cameras 100 to 10000 m above the water, points 0.1 mm to 100 m below it, anywhere between 80 N and 80 S."""
    rng = np.random.default_rng(7)
    ground = np.column_stack(
        [
            np.deg2rad(rng.uniform(-80, 80, rays)),
            np.deg2rad(rng.uniform(-180, 180, rays)),
            rng.uniform(-50, 5, rays),
        ]
    )
    level = ground[:, 2] + 10.0 ** rng.uniform(-4, 2, rays)
    height, angle = 10.0 ** rng.uniform(2, 4, rays), np.deg2rad(rng.uniform(0, steepest, rays))
    azimuth = rng.uniform(0, 2 * np.pi, rays)
    offset = np.stack([np.tan(angle) * np.cos(azimuth), np.tan(angle) * np.sin(azimuth), np.ones(rays)], axis=-1)
    foot = np.column_stack([ground[:, :2], level])
    camera = EARTH.geocentric(foot) + np.einsum("kji,kj->ki", EARTH.frame(foot), offset * height[:, None])
    return camera, ground, level


def tangential(vectors, normal):
    return vectors - np.sum(vectors * normal, axis=1)[:, None] * normal


def assert_joined(rays, camera, point) -> None:
    """Assert Snell's law about the normals, and that the legs join camera and point."""
    left = tangential(rays.air - INDEX * rays.water, rays.normal)
    assert np.abs(left).max() < 1e-14  # a few units in the last place of sines
    down = np.linalg.norm(point - rays.incidence, axis=1)[:, None]
    up = np.linalg.norm(camera - rays.incidence, axis=1)[:, None]
    np.testing.assert_allclose(rays.incidence + down * rays.water, point, rtol=0, atol=1e-8)  # 1e-9 m coordinates
    np.testing.assert_allclose(camera + up * rays.air, rays.incidence, rtol=0, atol=1e-8)


@pytest.mark.parametrize("steepness", [0.0, 1.0])
def test_rays_obey_snell_on_the_surface_and_join_camera_and_point(steepness: float) -> None:
    """By PROJ, on water that is level, or rises along a slope from the foot of each point."""
    camera, ground, level = scene()
    foot = EARTH.geocentric(np.column_stack([ground[:, :2], level]))
    for chosen in np.array_split(np.arange(len(level)), 8 if steepness else 1):
        frame = EARTH.frame(ground[chosen[0]])  # the slope is horizontal there, and leans elsewhere
        slope = steepness * np.array([3e-4, -2e-4, 0.0]) @ frame
        rows = chosen[:1] if steepness else chosen
        rays = trace(camera[rows], ground[rows], level[rows], INDEX, (AXIS, E2), slope)
        place = EARTH.geographic(rays.incidence)
        above = (rays.incidence - foot[rows]) @ slope
        np.testing.assert_allclose(place[:, 2] - level[rows], above, rtol=0, atol=1e-8)  # 1e-9 m coordinates
        normal = EARTH.frame(place)[:, 2] - slope  # the gradient of height less slope . W
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        assert np.abs(normal - rays.normal).max() < 1e-14  # 1e-9 m of 6e6 m
        assert_joined(rays, camera[rows], EARTH.geocentric(ground[rows]))


def test_camera_in_the_water_is_refused():
    with pytest.raises(RayTraceError, match="camera"):
        trace(np.array([[50.0, 0.0, -1.0]]), np.array([[0.0, 0.0, -5.0]]), np.zeros(1), INDEX)


def test_a_tilted_plane_obeys_snell() -> None:
    rng, slope = np.random.default_rng(11), np.array([0.015, -0.01, 0.0])
    camera = np.column_stack([rng.uniform(-3000, 3000, (50, 2)), rng.uniform(500, 4000, 50)])
    ground = np.column_stack([rng.uniform(-2000, 2000, (50, 2)), rng.uniform(-40, -1, 50)])
    level = 0.5 + ground @ slope  # of planes through (0, 0, 0.5)
    ground[:, 2] += level
    rays = trace(camera, ground, level, INDEX, slope=slope)
    np.testing.assert_allclose(rays.incidence[:, 2], 0.5 + rays.incidence @ slope, rtol=0, atol=1e-10)  # of km
    up = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1.0 + slope @ slope)
    np.testing.assert_allclose(rays.normal, np.tile(up, (50, 1)), rtol=0, atol=1e-13)
    assert_joined(rays, camera, ground)


@pytest.mark.parametrize("system", ["GEOG", "LOCL"])
def test_surface_stands_at_the_tide_in_the_middle_of_the_stations_and_rises_from_there(system):
    """Points dry where the tilted surface is below them, though the tide at their photos is above them."""
    centre = [18.0, -65.0] if system == "GEOG" else [0.0, 0.0]
    table = {
        "job": {"system": system, "centre": centre},
        "flight": {"photos": 5, "height": 1500.0},
        "shoal": [{"depth": [0.01, 0.5]}],
        "measurement": {"noise": 0.0},
    }
    simulation = simulate(spec_from_table({**table, "water": {"tilt": [60.0, 0.0]}}))
    truth, point = simulation.truth, simulation.truth.seen
    np.testing.assert_array_equal(truth.middle, np.rint(truth.stations.xyz.mean(axis=0)))
    east = truth.stations.vertical[2, 0]  # of the middle photo
    rise = 60.0 * ARC_SECOND * (truth.points.xyz - truth.middle) @ east
    wet = truth.points.natural[:, 2] < rise
    assert wet.any() and not wet.all()
    clear = np.abs(truth.points.natural[:, 2] - rise) > 0.002  # the middle is rounded to a metre: 0.3 mm of rise
    np.testing.assert_array_equal(truth.refracted[clear[point]], wet[point][clear[point]])
