"""Points below an estimated surface: true places again, partials, and sigmas by simulation."""

from dataclasses import dataclass

import numpy as np
import pytest

from musatpy.geometry.collinearity import nearest_point
from musatpy.refraction import fermat
from musatpy.refraction.apparent import REASONS, Fault
from musatpy.refraction.surface import Surface
from musatpy.sea.stereo.estimate import fit_fourier, fit_grid
from musatpy.sea.stereo.surface_points import intersection_covariance
from musatpy.sea.stereo.through import correct, true_points_of_apparent
from refraction.seas import CHOP, SEAS, Tilted
from studies.stereo import Setup, simulate, through

N = 1.34
CAMERAS = np.array([[0.0, 0.0, 400.0], [200.0, 15.0, 395.0]])
GROUND = np.array([[60.0, 30.0, -12.0], [90.0, -60.0, -8.0], [120.0, 45.0, -15.0]])


@dataclass(frozen=True)
class Known:
    """A surface that is known without error, but for what a test gives it."""

    surface: Surface
    covariance: np.ndarray | None = None

    @property
    def origin(self) -> np.ndarray:
        return np.zeros(2)

    def covers(self, xy):
        return self.surface.covers(xy)

    def shape_covariance(self, xy):
        return np.zeros((len(xy), 6, 6)) if self.covariance is None else np.tile(self.covariance, (len(xy), 1, 1))


def image_rays(sea: Surface, ground: np.ndarray = GROUND) -> np.ndarray:
    v = np.swapaxes(fermat.incidence(sea, CAMERAS[:, None], ground, N).v, 0, 1)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def apparent_of(rays: np.ndarray) -> np.ndarray:
    return nearest_point(np.broadcast_to(CAMERAS, rays.shape), rays)


def apparent_and_zero(sea: Surface) -> tuple[np.ndarray, np.ndarray]:
    return apparent_of(image_rays(sea)), np.zeros((len(GROUND), 3, 3))


@pytest.mark.parametrize("name", SEAS)
def test_apparent_points_come_back_to_the_ground(name: str) -> None:
    found = true_points_of_apparent(Known(SEAS[name]), CAMERAS, *apparent_and_zero(SEAS[name]), N)
    assert found.met.all()
    assert np.abs(found.position - GROUND).max() < 1e-8  # 1e-10 of 400 m, times the height over the base


@pytest.mark.parametrize("name", ["sinusoidal", "superposed", "gridded"])
def test_partials_by_the_shape_of_the_surface(name: str) -> None:
    """The surface is raised, and tilted about places left and right: heights and slopes where both rays meet it."""
    sea, (A, zero) = SEAS[name], apparent_and_zero(SEAS[name])
    found = true_points_of_apparent(Known(sea), CAMERAS, A, zero, N)
    for change in ((1e-4, 0.0, 0.0), (0.0, 1e-6, 0.0), (0.0, 0.0, 1e-6)):
        for about in ([0.0, 0.0], [200.0, 15.0]):
            ends = []
            for sign in (1.0, -1.0):
                level, *slope = sign * np.array(change)
                moved = Tilted(surface=sea, about=np.array(about), slope=np.array(slope), level=level)
                ends.append(true_points_of_apparent(Known(moved), CAMERAS, A, zero, N).position)
            height = change[0] + (found.meeting[..., :2] - about) @ change[1:]
            shape = np.stack([height, *(np.full(height.shape, value) for value in change[1:])], axis=-1)
            expected = np.einsum("nij,nj->ni", found.by_shape, shape.reshape(len(A), 6))
            # changes of 1e-4 m and some: 1e-9 m of rounding
            np.testing.assert_allclose((ends[0] - ends[1]) / 2.0, expected, atol=5e-9)


@pytest.mark.parametrize("model", [fit_fourier, fit_grid])
@pytest.mark.slow
def test_sigmas_below_an_estimated_surface_are_honest(model) -> None:
    """Images and surface points anew each time; the surface is the larger part with images of 5 um and a grid."""
    ratios = []
    for seed in range(4):
        pair = simulate(Setup(seed=seed, bottom_points=80))
        error, sigma, known = through(pair, model(pair.surface_points))
        ratios.append((error / sigma)[known])
    ratio = np.sqrt(np.mean(np.square(np.concatenate(ratios)), axis=0))
    # 4 seas of 80 points whose errors go together over a wave length: 15 %. The curvature of a grid is taken for
    # random, and that of a swell is the same everywhere: its sigmas come out up to a fifth too large
    least = 0.85 if model is fit_fourier else 0.7
    assert (least < ratio).all() and (ratio < 1.15).all(), ratio


def test_covariance_of_apparent_points_through_the_surface() -> None:
    """Repeated images of one point: their apparent points scatter as said, and so do the true ones."""
    rng, sigma = np.random.default_rng(4), 3e-5
    rays = np.tile(image_rays(CHOP)[:1], (3000, 1, 1))
    noisy = rays + sigma * rng.normal(size=rays.shape)
    noisy = noisy / np.linalg.norm(noisy, axis=-1, keepdims=True)
    apparent = apparent_of(noisy)
    C = intersection_covariance(CAMERAS, apparent, sigma)
    found = true_points_of_apparent(Known(CHOP), CAMERAS, apparent, C, N)
    size = found.sigma.mean(axis=0)
    scatter = found.position.std(axis=0)
    # 3000 repetitions tell a sigma to 1.3 %; rays of unequal length are weighted there and not here
    np.testing.assert_allclose(scatter, size, rtol=0.05)


# --- files of points ---


def test_corrected_points_or_reasons() -> None:
    setup = Setup(bottom_points=20)
    pair = simulate(setup)
    fitted = fit_fourier(pair.surface_points).fitted
    apparent = nearest_point(np.broadcast_to(setup.cameras, pair.exact.shape), pair.exact)
    odd = np.array([[100.0, 0.0, 3.0], [3000.0, 0.0, -5.0], [100.0, 0.0, 600.0], [1e9, 0.0, -7.0]])
    position = np.concatenate([apparent, odd])
    covariance = np.tile(1e-4 * np.eye(3), (len(position), 1, 1))
    found = correct(fitted, setup.cameras, position, covariance, setup.index)
    assert [REASONS[Fault(fault)] for fault in found.fault[20:]] == [
        "not below the water",
        "the surface is not known where its rays meet the water",
        "not below both cameras",
        "no parallax makes its rays meet under water",
    ]
    assert (found.fault[:20] == Fault.NONE).all()
    assert np.isnan(found.position[20:]).all() and np.isnan(found.sigma[20:]).all()
    error = found.position[:20] - pair.bottom
    assert np.sqrt(np.mean(error[:, 2] ** 2)) < 0.02  # of 0.11 m that the waves make
    assert (found.surface_sigma[:20] < found.sigma[:20, 2]).all()
    for x, z, message in (
        (264.0, 0.2, "a camera is not above the water"),
        (0.0, 490.0, "both cameras are at one place"),
    ):
        cameras = np.array([[0.0, 0.0, z], [x, 0.0, 490.0]])
        with pytest.raises(ValueError, match=message):
            correct(fitted, cameras, position, covariance, N)
