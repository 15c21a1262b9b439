"""A flat port: Fermat, partials, limits, and rays against the vectors of the simulation."""

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from musatpy.refraction import flat, port
from musatpy.refraction.port import Port
from musatpy.simulation.raytrace import through_port


def ports(seed: int, count: int, tilt: float = 20.0) -> Port:
    """Ports of cameras 1 cm to 1 dm behind glass of 2 mm to 3 cm, tilted by up to `tilt` degrees."""
    rng = np.random.default_rng(seed)
    return Port(
        distance=rng.uniform(0.01, 0.1, count),
        thickness=rng.uniform(0.002, 0.03, count),
        glass=rng.uniform(1.4, 1.9, count),
        water=rng.uniform(1.3, 1.4, count),
        tilt=np.radians(tilt) * rng.uniform(-1.0, 1.0, (count, 2)),
    )


def scene(seed: int, count: int) -> np.ndarray:
    """Points 1 to 3 m before a camera, to 45 degrees off its axis in the water."""
    rng = np.random.default_rng(seed)
    depth, tangent = rng.uniform(1.0, 3.0, count), np.tan(np.radians(rng.uniform(0.0, 45.0, count)))
    azimuth = rng.uniform(0.0, 2.0 * np.pi, count)
    return depth[:, None] * np.column_stack([tangent * np.cos(azimuth), tangent * np.sin(azimuth), -np.ones(count)])


@pytest.mark.parametrize("tilt", [0.0, 20.0])
def test_the_optical_path_is_stationary(tilt: float) -> None:
    """Fermat: where a ray crosses a face may move by 0.1 um; its length changes by rounding."""
    glass, points = ports(1, 300, tilt), scene(2, 300)
    n, u = glass.normal[0], port.direction(points, glass)
    first = u * (glass.distance / np.sum(u * n, axis=1))[:, None]
    second, w = port.ray(u, glass)
    np.testing.assert_allclose(np.cross(points - second, w), 0.0, atol=1e-14)  # m: the ray goes to the point
    crossing = port.axis_point(points, glass)
    np.testing.assert_allclose(np.cross(crossing, n), 0.0, atol=1e-16)
    np.testing.assert_allclose(np.cross(points - crossing, w), 0.0, atol=1e-14)  # and comes from there

    def path(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        lengths = (np.linalg.norm(leg, axis=1) for leg in (a, b - a, points - b))
        in_air, in_glass, in_water = lengths
        return in_air + glass.glass * in_glass + glass.water * in_water

    along = np.cross(n, [1.0, 0.0, 0.0])
    along /= np.linalg.norm(along, axis=1)[:, None]
    for axis in (along, np.cross(n, along)):
        size = 1e-7 * axis
        np.testing.assert_allclose(path(first + size, second) - path(first - size, second), 0.0, atol=3e-15)
        np.testing.assert_allclose(path(first, second + size) - path(first, second - size), 0.0, atol=3e-15)


@pytest.mark.parametrize("of", [port.direction, port.axis_point])
@pytest.mark.parametrize("tilt", [0.0, 20.0])
def test_partials_are_those_of_differences(tilt: float, of: Callable[[np.ndarray, Port], np.ndarray]) -> None:
    """Central differences: to 1e-8 of the largest partial; on the normal of the glass, too."""
    glass, points = ports(3, 200, tilt), scene(4, 200)
    points[0] = 2.0 * glass.normal[0][0]
    (u, *partials), size = port.seen(points, glass), 1e-6
    np.testing.assert_array_equal(u, port.direction(points, glass))
    by_point, by_port = partials if of is port.direction else port.axis_partials(points, glass)
    for axis in range(3):
        step = size * np.eye(3)[axis]
        slope = (of(points + step, glass) - of(points - step, glass)) / (2.0 * size)
        np.testing.assert_allclose(by_point[..., axis], slope, atol=1e-8 * np.abs(slope).max())
    steps = [{field.name: size} for field in fields(Port)[:4]] + [{"tilt": size * axis} for axis in np.eye(2)]
    for column, step in enumerate(steps):
        ends = [
            of(points, replace(glass, **{name: getattr(glass, name) + s * by for name, by in step.items()}))
            for s in (1, -1)
        ]
        slope = (ends[0] - ends[1]) / (2.0 * size)
        np.testing.assert_allclose(by_port[..., column], slope, atol=2e-8 * np.abs(slope).max())


def test_a_port_of_air_is_none() -> None:
    glass, points = ports(5, 100), scene(6, 100)
    one = np.ones(100)
    u = port.direction(points, replace(glass, glass=one, water=one))
    z = np.sum(points * glass.normal[0], axis=1)
    np.testing.assert_allclose(u, points / z[:, None], rtol=1e-15, atol=1e-15)


def test_without_thickness_it_is_the_surface_of_the_water() -> None:
    """The camera looks down: glass without thickness is the water surface of two media photogrammetry."""
    glass, points = replace(ports(7, 100, 0.0), thickness=np.zeros(100)), scene(8, 100)
    u = port.direction(points, glass)
    depth = -points[:, 2] - glass.distance
    v = flat.water_vector(np.zeros((100, 3)), points, np.array([0.0, 0.0, 1.0]), depth, glass.water)
    np.testing.assert_allclose(u * glass.distance[:, None], v, rtol=1e-13)
    everywhere = replace(ports(7, 100), thickness=np.zeros(100))
    np.testing.assert_array_equal(
        port.direction(points, everywhere), port.direction(points, replace(everywhere, glass=np.full(100, 1.7)))
    )


def test_the_simulation_traces_the_same_rays() -> None:
    """Snell's law in vectors, with nothing in common: directions to 1e-12."""
    points = scene(9, 200)
    for row in range(5):
        glass = Port(**{field.name: getattr(ports(10, 5), field.name)[row] for field in fields(Port)})
        u = port.direction(points, glass)
        sizes = (1e3 * glass.distance, 1e3 * glass.thickness, glass.glass, glass.water)
        traced = through_port(points, *map(float, sizes), *np.degrees(glass.tilt).tolist())
        size = np.linalg.norm(u, axis=1)[:, None]
        np.testing.assert_allclose(u / size, traced / np.linalg.norm(traced, axis=1)[:, None], atol=1e-12)
    behind = through_port(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -0.01]]), 20.0, 5.0, 1.5, 1.33, 0.0, 0.0)
    assert np.isnan(behind).all()
