"""Image rays through wavy water: the first meeting, and the flat surface as the limit."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.refraction import bending, flat
from musatpy.refraction.surface import Plane
from musatpy.refraction.waves import sinusoidal
from refraction.seas import SEAS

CAMERA = np.array([10.0, -20.0, 300.0])
N = 1.34


def _direction(*vector: float) -> np.ndarray:
    return np.array(vector) / np.linalg.norm(vector)


def test_calm_water_is_the_flat_surface() -> None:
    u = np.array([_direction(0.3, -0.4, -1.0), _direction(0.0, 0.0, -1.0)])
    bent = bending.refracted_ray(Plane(level=2.0), CAMERA, u, N)
    level = flat.refracted_ray(np.broadcast_to(CAMERA, (2, 3)), u, np.array([0.0, 0.0, 1.0]), 298.0, N)
    for name in ("origin", "direction", "origin_by_camera", "direction_by_index", "origin_by_level"):
        # rounding of 300 m
        np.testing.assert_allclose(getattr(bent, name), getattr(level, name), atol=1e-12, err_msg=name)
    # they differ along the ray, where the length of a unit vector does not change: compare across it
    across = np.eye(3) - u[:, :, None] * u[:, None, :]
    np.testing.assert_allclose(
        bent.direction_by_direction @ across, level.direction_by_direction @ across, atol=1e-12
    )
    assert not bent.direction_by_camera.any() and not bent.direction_by_level.any()


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
    sea = SEAS["superposed"]
    with pytest.raises(ValueError, match="does not go down"):
        bending.refracted_ray(sea, CAMERA, _direction(1.0, 0.0, 0.1), N)
    with pytest.raises(ValueError, match="camera is not above the water"):
        bending.refracted_ray(sea, np.array([0.0, 0.0, -1.0]), _direction(0.0, 0.0, -1.0), N)
    with pytest.raises(ValueError, match="not known where a ray meets it"):
        bending.refracted_ray(SEAS["gridded"], CAMERA, _direction(3.0, 0.0, -1.0), N)
