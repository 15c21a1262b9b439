"""Points below an estimated surface: true places again, partials, and sigmas by simulation."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from musatpy.geometry.collinearity import nearest_point
from musatpy.refraction import fermat
from musatpy.refraction.apparent import Stations, true_points
from musatpy.refraction.surface import Plane, Surface
from musatpy.sea.stereo.estimate import fit_fourier, fit_grid
from musatpy.sea.stereo.surface_points import SurfacePoints, intersection_covariance
from musatpy.sea.stereo.through import (
    REASONS,
    Fault,
    correct,
    intersect_rays,
    true_points_of_apparent,
    true_points_of_rays,
)
from refraction.seas import CHOP, SEAS, Tilted
from studies.stereo import METHODS, Setup, run, simulate, through

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


@pytest.mark.parametrize("name", SEAS)
def test_rays_and_apparent_points_come_back_to_the_ground(name: str) -> None:
    rays = image_rays(SEAS[name])
    by_rays = true_points_of_rays(Known(SEAS[name]), CAMERAS, rays, N, 1e-5)
    assert np.abs(by_rays.position - GROUND).max() < 1e-8  # 1e-10 of 400 m, times the height over the base
    assert np.abs(by_rays.parallax).max() < 1e-8
    by_apparent = true_points_of_apparent(Known(SEAS[name]), CAMERAS, apparent_of(rays), np.zeros((3, 3, 3)), N)
    assert by_apparent.met.all()
    assert np.abs(by_apparent.position - GROUND).max() < 1e-8


def test_on_level_water_it_is_the_correction_of_musat_depth() -> None:
    apparent = apparent_of(image_rays(Plane(level=0.3)))
    stations = Stations(position=CAMERAS, level=np.full(2, 0.3))
    there = true_points(apparent, stations, N)
    here = true_points_of_apparent(Known(Plane(level=0.3)), CAMERAS, apparent, np.zeros((3, 3, 3)), N)
    # that one weights the rays by their lengths, 1 % apart here, and closes to 1e-6 m
    np.testing.assert_allclose(here.position, there.position, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", SEAS)
def test_partials_by_rays_and_by_apparent_points(name: str) -> None:
    sea, step = SEAS[name], 1e-6
    rays = image_rays(sea)
    found = intersect_rays(sea, CAMERAS, rays, N)
    for photo in range(2):
        for axis in range(3):
            moved = step * np.eye(3)[axis] * (np.arange(2) == photo)[:, None]
            ends = []
            for sign in (1.0, -1.0):
                turned = rays + sign * moved
                turned = turned / np.linalg.norm(turned, axis=-1, keepdims=True)  # only unit rays are rays
                ends.append(intersect_rays(sea, CAMERAS, turned, N).position)
            across = np.eye(3)[axis] - rays[:, photo, axis, None] * rays[:, photo]
            expected = np.einsum("nij,nj->ni", found.by_ray[:, :, photo], across)
            # metres per radian, up to 1e4: differences of points that are exact to 1e-11 m, over 2e-6
            np.testing.assert_allclose((ends[0] - ends[1]) / (2.0 * step), expected, atol=0.02, rtol=1e-6)
    A, zero, step = apparent_of(rays), np.zeros((3, 3, 3)), 1e-3
    by_apparent = true_points_of_apparent(Known(sea), CAMERAS, A, zero, N)
    for axis in range(3):
        high, low = (
            true_points_of_apparent(Known(sea), CAMERAS, A + sign * step * np.eye(3)[axis], zero, N).position
            for sign in (1.0, -1.0)
        )
        # 1e-10 m over 2e-3 m, and the third derivative of waves of 13 m over a millimetre
        np.testing.assert_allclose((high - low) / (2.0 * step), by_apparent.by_given[:, :, axis], atol=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sinusoidal", "superposed", "gridded"])
def test_partials_by_the_shape_of_the_surface(name: str) -> None:
    """The surface is raised and tilted where the left ray meets it, then where the right one does."""
    sea, rays = SEAS[name], image_rays(SEAS[name])
    A, zero = apparent_of(rays), np.zeros((3, 3, 3))
    plain = true_points_of_apparent(Known(sea), CAMERAS, A, zero, N)
    by_rays = intersect_rays(sea, CAMERAS, rays, N)
    for point in range(3):
        for photo in range(2):
            about = by_rays.meeting[point, photo, :2]
            for kind, step in enumerate((1e-4, 1e-5, 1e-5)):
                change = step * np.eye(3)[kind]
                ends = [
                    _with_bump(sea, sign * change, about, photo, by_rays.meeting[point], rays, A, point)
                    for sign in (1.0, -1.0)
                ]
                for which, partials in enumerate((by_rays.by_shape, plain.by_shape)):
                    numeric = (ends[0][which] - ends[1][which]) / (2.0 * step)
                    # metres per unit of slope, some 10: 1e-9 m over 2e-5
                    np.testing.assert_allclose(numeric, partials[point, :, 3 * photo + kind], atol=2e-3)


def _with_bump(sea, change, about, photo, meeting, rays, A, point):
    """Return one point by rays and by its apparent point, the surface changed on the side of one photo alone."""
    away = meeting[photo, :2] - meeting[1 - photo, :2]
    bump = OneSide(
        plain=sea,
        tilted=Tilted(surface=sea, about=about, slope=change[1:], level=change[0]),
        middle=meeting[:, :2].mean(axis=0),
        side=away,
    )
    by_rays = intersect_rays(bump, CAMERAS, rays[point : point + 1], N).position[0]
    zero = np.zeros((1, 3, 3))
    return by_rays, true_points_of_apparent(Known(bump), CAMERAS, A[point : point + 1], zero, N).position[0]


@dataclass(frozen=True)
class OneSide:
    """A surface that is another one on one side of a line."""

    plain: Surface
    tilted: Tilted
    middle: np.ndarray
    side: np.ndarray

    @property
    def limits(self):
        return replace(self.plain.limits, highest=self.plain.limits.highest + 0.1)

    def relief(self, xy, time=0.0):
        here = (xy - self.middle) @ self.side > 0.0
        first, second = self.plain.relief(xy, time), self.tilted.relief(xy, time)
        return replace(
            first,
            height=np.where(here, second.height, first.height),
            gradient=np.where(here[..., None], second.gradient, first.gradient),
            hessian=np.where(here[..., None, None], second.hessian, first.hessian),
        )

    def covers(self, xy, time=0.0):
        return self.plain.covers(xy, time)


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


def test_sigmas_of_surface_and_images_add_up() -> None:
    C = np.diag([0.01, 1e-4, 1e-4] * 2)
    rays = image_rays(CHOP)
    alone = true_points_of_rays(Known(CHOP), CAMERAS, rays, N, 1e-5)
    both = true_points_of_rays(Known(CHOP, C), CAMERAS, rays, N, 1e-5)
    assert (alone.surface_covariance == 0.0).all()
    np.testing.assert_allclose(both.covariance, alone.covariance + both.surface_covariance, rtol=1e-12)  # rounding
    assert (both.sigma > alone.sigma).all()


# --- files of points ---


def test_corrected_points_or_reasons() -> None:
    setup = Setup(bottom_points=20)
    pair = simulate(setup)
    fitted = fit_fourier(pair.surface_points).fitted
    apparent = nearest_point(np.broadcast_to(setup.cameras, pair.exact.shape), pair.exact)
    odd = np.array([[100.0, 0.0, 3.0], [3000.0, 0.0, -5.0], [100.0, 0.0, 600.0], [1e9, 0.0, -7.0]])
    position = np.concatenate([apparent, odd])
    ids = tuple(map(str, range(len(position))))
    given = SurfacePoints(ids=ids, position=position, covariance=np.tile(1e-4 * np.eye(3), (len(ids), 1, 1)))
    found = correct(fitted, setup.cameras, given, setup.index)
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


def test_a_camera_in_the_water_is_an_error() -> None:
    pair = simulate(Setup(bottom_points=3))
    fitted = fit_fourier(pair.surface_points).fitted
    with pytest.raises(ValueError, match="a camera is not above the water"):
        correct(fitted, np.array([[0.0, 0.0, 0.2], [264.0, 0.0, 490.0]]), pair.surface_points, N)
    with pytest.raises(ValueError, match="both cameras are at one place"):
        correct(fitted, np.array([[0.0, 0.0, 490.0], [0.0, 0.0, 490.0]]), pair.surface_points, N)


# --- the study ---


def test_the_study_is_deterministic_and_says_what_surfaces_take_away() -> None:
    setup = Setup(surface_points=300, bottom_points=60)
    first, second = run(setup, (1,)), run(setup, (1,))
    for name in METHODS:
        np.testing.assert_array_equal(first.rms[name], second.rms[name])
    assert first.wave["true"][2] < 1e-9  # rays of exact images through the true sea
    assert first.wave["level"][2] > 0.05
    assert first.removed("fourier") > 0.9 and first.removed("grid") > 0.5
    assert first.waves == 1.0
    assert (first.rms["true"] < first.rms["level"]).all()
