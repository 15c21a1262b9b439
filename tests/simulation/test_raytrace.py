"""Rays of the simulation: Snell, Fermat by minimisation, planes, spheres, tilted water."""

import numpy as np
import pyproj
import pytest
from scipy.optimize import minimize

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


def test_rays_obey_snell_on_the_surface_and_join_camera_and_point():
    camera, ground, level = scene()
    rays = trace(camera, ground, level, INDEX, (AXIS, E2))
    left = tangential(rays.air - INDEX * rays.water, rays.normal)
    assert np.abs(left).max() < 1e-14  # a few units in the last place of sines
    found = EARTH.geographic(rays.incidence)
    assert np.abs(found[:, 2] - level).max() < 1e-8  # geocentric coordinates end at 1e-9 m
    assert np.abs(EARTH.frame(found)[:, 2] - rays.normal).max() < 1e-14  # 1e-9 m of 6e6 m
    point = EARTH.geocentric(ground)
    down = np.linalg.norm(point - rays.incidence, axis=1)[:, None]
    up = np.linalg.norm(camera - rays.incidence, axis=1)[:, None]
    np.testing.assert_allclose(rays.incidence + down * rays.water, point, rtol=0, atol=1e-8)  # 1e-9 m coordinates
    np.testing.assert_allclose(camera + up * rays.air, rays.incidence, rtol=0, atol=1e-8)


def test_nadir_ray_goes_straight_down():
    foot = np.array([[np.deg2rad(-35.0), np.deg2rad(12.0), -1.0]])
    ground, level = foot - [0.0, 0.0, 8.0], np.array([-1.0])
    up = EARTH.frame(foot)[:, 2]
    rays = trace(EARTH.geocentric(foot) + 4000.0 * up, ground, level, INDEX, (AXIS, E2))
    np.testing.assert_allclose(rays.incidence, EARTH.geocentric(foot), rtol=0, atol=1e-8)  # 1e-9 m coordinates
    np.testing.assert_allclose(rays.water, -up, rtol=0, atol=1e-12)  # 1e-9 m in 4000 m


def test_camera_in_the_water_is_refused():
    with pytest.raises(RayTraceError, match="camera"):
        trace(np.array([[50.0, 0.0, -1.0]]), np.array([[0.0, 0.0, -5.0]]), np.zeros(1), INDEX)


SLOPE = np.array([3e-4, -2e-4, 0.0])


def local_scene():
    rng = np.random.default_rng(11)
    camera = np.column_stack([rng.uniform(-3000, 3000, (50, 2)), rng.uniform(500, 4000, 50)])
    ground = np.column_stack([rng.uniform(-2000, 2000, (50, 2)), rng.uniform(-40, -1, 50)])
    return camera, ground


@pytest.mark.parametrize("steepness", [1.0, 50.0])
def test_tilted_plane_is_the_level_plane_of_a_turned_system(steepness):
    """A turn that brings the normal of the tilted planes to +Z: the level trace must give the same rays turned."""
    slope = steepness * SLOPE
    camera, ground = local_scene()
    level = 0.5 + ground @ slope  # planes through (0, 0, 0.5)
    ground[:, 2] += level
    up = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1.0 + slope @ slope)
    east = np.cross([0.0, 1.0, 0.0], up)
    east /= np.linalg.norm(east)
    turn = np.stack([east, np.cross(up, east), up])
    height = (turn @ [0.0, 0.0, 0.5])[2]
    tilted = trace(camera, ground, level, INDEX, slope=slope)
    turned = trace(camera @ turn.T, ground @ turn.T, np.full(50, height), INDEX)
    # both solve to 1e-13 of the depth; coordinates of thousands of metres end at 1e-12 m
    np.testing.assert_allclose(tilted.incidence @ turn.T, turned.incidence, rtol=0, atol=1e-10)
    np.testing.assert_allclose(tilted.air @ turn.T, turned.air, rtol=0, atol=1e-13)
    np.testing.assert_allclose(tilted.normal @ turn.T, turned.normal, rtol=0, atol=1e-13)


def ellipsoidal_scene(depth):
    foot = np.array([np.deg2rad(18.34), np.deg2rad(-64.93), 0.4])
    frame = EARTH.frame(foot)
    camera = EARTH.geocentric(foot) + np.array([1500.0, -900.0, 2400.0]) @ frame
    return foot, camera, foot - [0.0, 0.0, depth], SLOPE @ frame


@pytest.mark.parametrize("steepness", [0.0, 1.0])
@pytest.mark.parametrize("depth", [0.5, 5.0, 30.0])
def test_fermat_by_direct_minimisation(depth, steepness):
    """The light path over W on level or tilted water, found by PROJ and a fixed-point for its height, minimised."""
    foot, camera, ground, slope = ellipsoidal_scene(depth)
    slope = steepness * slope
    start, point = EARTH.geocentric(foot), EARTH.geocentric(ground)

    def surface(offset):
        place = foot + np.array([offset[1] / 6.38e6, offset[0] / 6.38e6, 0.0])
        for _ in range(4):  # each pass multiplies the error by the slope
            place[2] = foot[2] + (EARTH.geocentric(place) - start) @ slope
        return EARTH.geocentric(place)

    def path(offset):
        W = surface(offset)
        return np.linalg.norm(W - camera) + INDEX * np.linalg.norm(point - W) - 3000.0

    best = minimize(
        path, [0.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-13, "maxiter": 2000}
    )
    rays = trace(camera[None], ground[None], foot[2:], INDEX, (AXIS, E2), slope)
    # a minimum is flat: path lengths are good to 1e-9 m, so W to the root of 1e-9 m times the depth
    assert np.linalg.norm(rays.incidence[0] - surface(best.x)) < 3.0 * np.sqrt(1e-9 * depth)


@pytest.mark.parametrize("depth", [0.5, 30.0])
def test_incidence_point_lies_on_the_tilted_surface_and_snell_holds_there(depth):
    foot, camera, ground, slope = ellipsoidal_scene(depth)
    rays = trace(camera[None], ground[None], foot[2:], INDEX, (AXIS, E2), slope)
    place = EARTH.geographic(rays.incidence[0])
    above = (rays.incidence[0] - EARTH.geocentric(foot)) @ slope
    assert abs(place[2] - foot[2] - above) < 1e-8  # geocentric coordinates end at 1e-9 m
    normal = EARTH.frame(place)[2] - slope  # the gradient of height less slope . W
    normal /= np.linalg.norm(normal)
    assert np.abs(rays.normal[0] - normal).max() < 1e-14  # 1e-9 m of 6e6 m
    bend = rays.air[0] - INDEX * rays.water[0]
    assert np.abs(bend - (bend @ normal) * normal).max() < 1e-14  # a few units in the last place of sines


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
