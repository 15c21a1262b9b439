"""Every partial derivative of the conditions, against complex step or central differences, in one test.

A case is a function of one flat argument and the closed-form Jacobian at a point. Complex step is exact to rounding
(1e-12 of the largest element); central differences with h = eps^(1/3) leave about 1e-9, and more where the function
bends (2e-8 allowed).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest

from musatpy.geometry import collinearity
from musatpy.geometry.collinearity import attitude_matrix, attitude_matrix_partials, coplanarity, scale_restraint
from musatpy.refraction import bending, fermat, flat
from musatpy.refraction.waves import Trains
from refraction.seas import CHOP, SEAS, Tilted

F, PP, N = 152.3, np.array([0.12, -0.07]), 1.34
ATTITUDE = np.array([0.05, -0.08, 2.1])
CAMERA = np.array([120.0, -80.0, 1500.0])
UP = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])


@dataclass(frozen=True)
class Case:
    function: Callable[[np.ndarray], np.ndarray]
    at: np.ndarray
    jacobian: np.ndarray  # (outputs, inputs)
    complex_step: bool


def _parts(x: np.ndarray, *sizes: int) -> list[np.ndarray]:
    return list(np.split(x, np.cumsum(sizes)[:-1]))


def image_case() -> Case:
    v = np.array([300.0, -200.0, -1480.0])

    def function(x: np.ndarray) -> np.ndarray:
        v_, attitude = _parts(x, 3, 3)
        return collinearity.image(v_, attitude_matrix(attitude), F, PP)

    M, dM = attitude_matrix(ATTITUDE), attitude_matrix_partials(ATTITUDE)
    image, by_v, by_attitude = collinearity.image_partials(v, M, dM, F, PP)
    np.testing.assert_array_equal(image, collinearity.image(v, M, F, PP))  # the same operations
    for alone, together in zip(collinearity.image_by_vector(v, M, F, PP), (image, by_v), strict=True):
        np.testing.assert_array_equal(alone, together)
    return Case(function, np.concatenate([v, ATTITUDE]), np.hstack([by_v, by_attitude]), True)


def ray_case() -> Case:
    xy = np.array([61.0, -40.0])

    def function(x: np.ndarray) -> np.ndarray:
        attitude, xy_ = _parts(x, 3, 2)
        return collinearity.ray(xy_, attitude_matrix(attitude), F, PP)

    M, dM = attitude_matrix(ATTITUDE), attitude_matrix_partials(ATTITUDE)
    ray, by_attitude, by_xy = collinearity.ray_partials(xy, M, dM, F, PP)
    np.testing.assert_array_equal(ray, collinearity.ray(xy, M, F, PP))
    return Case(function, np.concatenate([ATTITUDE, xy]), np.hstack([by_attitude, by_xy]), False)


def _rays(m: int) -> np.ndarray:
    origins = np.array([[0.0, 5.0, 1500.0], [900.0, -8.0, 1490.0], [1800.0, 3.0, 1510.0]])[:m]
    rays = np.array([700.0, 300.0, 2.0]) + np.array([[0.3, 0, 0], [0, -0.5, 0], [0.2, 0, 0.4]])[:m] - origins
    return np.concatenate([origins, rays / np.linalg.norm(rays, axis=1)[:, None]], axis=1)


def coplanarity_case() -> Case:
    rays = _rays(2)

    def function(x: np.ndarray) -> np.ndarray:
        pair = x.reshape(2, 6)
        return np.atleast_1d(coplanarity(pair[:, :3], pair[:, 3:])[0])

    _, partials = coplanarity(rays[:, :3], rays[:, 3:])
    return Case(function, rays.reshape(-1), partials.reshape(1, 12), True)


def scale_restraint_case() -> Case:
    rays = _rays(3)

    def function(x: np.ndarray) -> np.ndarray:
        triple = x.reshape(3, 6)
        return np.atleast_1d(scale_restraint(triple[:, :3], triple[:, 3:])[0])

    _, partials = scale_restraint(rays[:, :3], rays[:, 3:])
    return Case(function, rays.reshape(-1), partials.reshape(1, 18), True)


def _incidence_case(offset: tuple[float, float], depth: float) -> Case:
    """Incidence point by camera, ground point, water level and index; the level moves along `UP`."""
    ground = np.array([*offset, 0.0]) + CAMERA - 1500.0 * UP

    def function(x: np.ndarray) -> np.ndarray:
        camera, ground_, level, index = _parts(x, 3, 3, 1, 1)
        below = level[0] - UP @ ground_
        return flat.incidence(camera, ground_, UP, below, index[0]).v

    level = float(UP @ ground) + depth
    result = flat.incidence(CAMERA, ground, UP, depth, N)
    jacobian = np.hstack([result.by_camera, result.by_ground, result.by_level[:, None], result.by_index[:, None]])
    return Case(function, np.concatenate([CAMERA, ground, [level, N]]), jacobian, False)


def refracted_ray_case() -> Case:
    direction = np.array([0.3, -0.4, -1.0]) / np.linalg.norm([0.3, -0.4, -1.0])

    def function(x: np.ndarray) -> np.ndarray:
        camera, u, level, index = _parts(x, 3, 3, 1, 1)
        bent = flat.refracted_ray(camera, u, UP, UP @ camera - level[0], index[0])
        return np.concatenate([bent.origin, bent.direction])

    level = float(UP @ CAMERA) - 1480.0
    bent = flat.refracted_ray(CAMERA, direction, UP, 1480.0, N)
    zero, line = np.zeros((3, 3)), np.zeros((3, 1))
    jacobian = np.block(
        [
            [bent.origin_by_camera, bent.origin_by_direction, bent.origin_by_level[:, None], line],
            [zero, bent.direction_by_direction, line, bent.direction_by_index[:, None]],
        ]
    )
    return Case(function, np.concatenate([CAMERA, direction, [level, N]]), jacobian, False)


def _wave_incidence_case(name: str) -> Case:
    """Incidence point on a wavy surface by camera, ground point, level, index and slope of the surface there."""
    sea, camera, ground = SEAS[name], np.array([60.0, -40.0, 400.0]), np.array([20.0, 30.0, -12.0])
    result = fermat.incidence(sea, camera, ground, N, 1.5)
    about = camera[:2] + result.v[:2]

    def function(x: np.ndarray) -> np.ndarray:
        camera_, ground_, level, index, slope = _parts(x, 3, 3, 1, 1, 2)
        moved = Tilted(surface=sea, about=about, slope=slope, level=level[0])
        return fermat.incidence(moved, camera_, ground_, index[0], 1.5).v

    jacobian = np.hstack(
        [result.by_camera, result.by_ground, result.by_level[:, None], result.by_index[:, None], result.by_slope]
    )
    return Case(function, np.concatenate([camera, ground, [0.0, N, 0.0, 0.0]]), jacobian, False)


def _wave_ray_case(name: str) -> Case:
    sea, camera = SEAS[name], np.array([60.0, -40.0, 400.0])
    u = np.array([-0.1, 0.15, -1.0]) / np.linalg.norm([-0.1, 0.15, -1.0])
    bent = bending.refracted_ray(sea, camera, u, N, 1.5)

    def function(x: np.ndarray) -> np.ndarray:
        camera_, u_, level, index, slope = _parts(x, 3, 3, 1, 1, 2)
        moved = Tilted(surface=sea, about=bent.origin[:2], slope=slope, level=level[0])
        ray = bending.refracted_ray(moved, camera_, u_, index[0], 1.5)
        return np.concatenate([ray.origin, ray.direction])

    jacobian = np.block(
        [
            [bent.origin_by_camera, bent.origin_by_direction, bent.origin_by_level[:, None], np.zeros((3, 1)),
             bent.origin_by_slope],
            [bent.direction_by_camera, bent.direction_by_direction, bent.direction_by_level[:, None],
             bent.direction_by_index[:, None], bent.direction_by_slope],
        ]
    )  # fmt: skip
    return Case(function, np.concatenate([camera, u, [0.0, N, 0.0, 0.0]]), jacobian, False)


def _trains_case(depth: float, steady: bool = False) -> Case:
    """Height and gradient of waves by their heights, lengths, azimuths and crests."""
    trains, xy = Trains.of(CHOP, depth, steady), np.array([31.0, -17.0])
    height, gradient = trains.by_parameters(xy, 1.5)

    def function(x: np.ndarray) -> np.ndarray:
        relief = trains.with_values(x.reshape(-1, 4)).surface.relief(xy, 1.5)
        return np.concatenate([[relief.height], relief.gradient])

    jacobian = np.vstack([height.reshape(1, -1), gradient.reshape(2, -1)])
    return Case(function, trains.values.reshape(-1), jacobian, False)


def _unknown_wave_case() -> Case:
    """Incidence point by the parameters of the waves, through height and gradient of the surface."""
    trains = Trains.of(CHOP, 12.0)
    camera, ground = np.array([60.0, -40.0, 400.0]), np.array([20.0, 30.0, -12.0])
    at = fermat.incidence(trains.surface, camera, ground, N, 1.5)
    height, gradient = trains.by_parameters(camera[:2] + at.v[:2], 1.5)

    def function(x: np.ndarray) -> np.ndarray:
        return fermat.incidence(trains.with_values(x.reshape(-1, 4)).surface, camera, ground, N, 1.5).v

    jacobian = np.outer(at.by_level, height.reshape(-1)) + at.by_slope @ gradient.reshape(2, -1)
    return Case(function, trains.values.reshape(-1), jacobian, False)


CASES = {
    "image by vector and attitude": image_case,
    "ray by attitude and image": ray_case,
    "coplanarity by both rays": coplanarity_case,
    "scale restraint by three rays": scale_restraint_case,
    "incidence, 8 m deep": lambda: _incidence_case((400.0, -300.0), 8.0),
    "incidence, 2 mm deep": lambda: _incidence_case((400.0, -300.0), 0.002),
    "incidence, oblique and 60 m deep": lambda: _incidence_case((9000.0, 2000.0), 60.0),
    "incidence, above the water": lambda: _incidence_case((400.0, -300.0), -3.0),
    "incidence, near the nadir": lambda: _incidence_case((0.3, 0.1), 8.0),
    "refracted ray by camera, ray in air, level and index": refracted_ray_case,
    **{f"incidence on {name} water": partial(_wave_incidence_case, name) for name in SEAS},
    **{f"ray through {name} water": partial(_wave_ray_case, name) for name in SEAS},
    **{f"waves, depth {depth}": partial(_trains_case, depth) for depth in (np.nan, 12.0, np.inf)},
    "waves that keep their period": partial(_trains_case, np.nan, True),
    "incidence on unknown waves": _unknown_wave_case,
}


def numerical(case: Case) -> np.ndarray:
    columns = []
    for i, value in enumerate(case.at):
        step = np.zeros(len(case.at))
        if case.complex_step:
            step[i] = 1e-30
            columns.append(case.function(case.at + 1j * step).imag / 1e-30)
        else:
            step[i] = np.cbrt(np.finfo(float).eps) * max(1.0, 1e-1 * abs(value))
            columns.append((case.function(case.at + step) - case.function(case.at - step)) / (2.0 * step[i]))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("name", CASES)
def test_partials(name: str) -> None:
    case = CASES[name]()
    want = numerical(case)
    scale = np.abs(case.jacobian).max()
    tolerance = 1e-12 if case.complex_step else 2e-8
    np.testing.assert_allclose(case.jacobian, want, rtol=0.0, atol=tolerance * scale)
