"""How much of what waves do to a map an estimated surface takes away, on simulated pairs whose truth is known.

A simultaneous pair images points on the water and points on a level bottom, through known waves; images get noise.
The surface is estimated from the surface points, and the bottom is intersected four times: as if the water were
level, through the true waves, through estimated waves, and through an estimated grid.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.draws import Draws
from musatpy.geometry.collinearity import cross, nearest_point
from musatpy.refraction import fermat
from musatpy.refraction.bending import refracted_ray
from musatpy.refraction.surface import PlanarSurface, Surface
from musatpy.refraction.waves import Harmonic, sinusoidal
from musatpy.sea.stereo.estimate import SurfaceFit, fit_fourier, fit_grid
from musatpy.sea.stereo.spectrum import mean_spacing
from musatpy.sea.stereo.surface_points import SurfacePoints, intersection_covariance
from musatpy.sea.stereo.through import intersection, true_points_of_apparent
from musatpy.sea.theory import linear_wave
from musatpy.units import DEGREE

METHODS = ("level", "true", "fourier", "grid")
_RIM = 0.1  # of the area, within which no bottom points lie: their rays meet the water beside them


@dataclass(frozen=True, kw_only=True)
class Setup:
    """A simulated pair; waves by linear theory at the depth.

    base, height (m): of the two stations above mean water; depth (m); periods (s), deep_heights (m, in deep water,
    from trough to crest) and azimuths (degrees) of the waves; surface_points on an area (m) along and across the
    base, at random places or on a regular grid; bottom_points; image_sigma (um) of a plate coordinate, focal length
    (mm); seed of all random numbers.
    """

    base: float = 264.0
    height: float = 490.0
    depth: float = 10.0
    index: float = 1.34
    periods: tuple[float, ...] = (10.0,)
    deep_heights: tuple[float, ...] = (1.0,)
    azimuths: tuple[float, ...] = (30.0,)
    surface_points: int = 400
    regular: bool = False
    area: tuple[float, float] = (330.0, 660.0)
    bottom_points: int = 200
    image_sigma: float = 5.0
    focal: float = 152.0
    seed: int = 1

    @property
    def angle(self) -> float:
        """Sigma of an image ray, rad."""
        return self.image_sigma * 1e-3 / self.focal

    @property
    def cameras(self) -> FloatArray:
        """(2, 3) m, the origin below the left one."""
        return np.array([[0.0, 0.0, self.height], [self.base, 0.0, self.height]])

    @property
    def waves(self) -> Harmonic:
        """The true water surface."""
        theory = linear_wave(self.periods, self.depth, deep_height=self.deep_heights)
        crest = theory.length / 7.0  # anywhere
        azimuth = np.array(self.azimuths) * DEGREE
        return sinusoidal(amplitude=theory.height / 2.0, length=theory.length, azimuth=azimuth, crest=crest)


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulation:
    """What is measured, and the true bottom (n, 3) m; image rays (n, 2, 3) of it, with noise and exact."""

    setup: Setup
    surface_points: SurfacePoints
    bottom: FloatArray
    rays: FloatArray
    exact: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """Errors of the bottom (m), by method: root mean squares in x, y, z (3,).

    rms: all errors; wave: those of the water surface alone, from exact images of the bottom. honesty: errors over
    sigmas in z, root mean square, of the estimated surfaces; covered: share of the bottom that they reach; waves:
    how many the search found; spacing: from one surface point to the next, m.
    """

    setup: Setup
    rms: dict[str, FloatArray]
    wave: dict[str, FloatArray]
    honesty: dict[str, float]
    covered: dict[str, float]
    waves: float
    spacing: float

    def removed(self, method: str) -> float:
        """Return the part of the wave error in height that a method takes away: 1 all of it, 0 nothing."""
        return 1.0 - float(self.wave[method][2] / self.wave["level"][2])


def intersected(ids: tuple[str, ...], cameras: FloatArray, direction: FloatArray, sigma: float) -> SurfacePoints:
    """Return the points where unit image rays (k, n, 3) of cameras (k, 3) meet in air; sigma (rad) of an image."""
    rays = np.swapaxes(direction, 0, 1)
    position = nearest_point(np.broadcast_to(cameras, rays.shape), rays)
    return SurfacePoints(ids=ids, position=position, covariance=intersection_covariance(cameras, position, sigma))


def simulate(setup: Setup) -> Simulation:
    """Return a simulated pair."""
    draws, waves, cameras = Draws(setup.seed), setup.waves, setup.cameras
    xy = _places(draws, setup)
    water = np.column_stack([xy, waves.relief(xy).height])
    width = np.array(setup.area)
    low = np.array([(setup.base - setup.area[0]) / 2.0, -setup.area[1] / 2.0])
    spot = low + width * (_RIM + (1.0 - 2.0 * _RIM) * draws.uniform("bottom", setup.bottom_points, 2))
    bottom = np.column_stack([spot, np.full(len(spot), -setup.depth)])
    bent = fermat.incidence(waves, cameras[:, None], bottom, setup.index)
    ids = tuple(f"W{i + 1}" for i in range(len(xy)))
    seen = _noisy(draws, "water", water - cameras[:, None], setup.angle)
    return Simulation(
        setup=setup,
        surface_points=intersected(ids, cameras, seen, setup.angle),
        bottom=bottom,
        rays=np.swapaxes(_noisy(draws, "images", bent.v, setup.angle), 0, 1),
        exact=np.swapaxes(bent.v / np.linalg.norm(bent.v, axis=-1, keepdims=True), 0, 1),
    )


def _places(draws: Draws, setup: Setup) -> FloatArray:
    """Return the places (n, 2) of the surface points: about as many as asked for where they are regular."""
    width = np.array(setup.area)
    low = np.array([(setup.base - width[0]) / 2.0, -width[1] / 2.0])
    if not setup.regular:
        return low + width * draws.uniform("places", setup.surface_points, 2)
    step = np.sqrt(np.prod(width) / setup.surface_points)
    counts = np.maximum(2, np.rint(width / step).astype(int))
    grids = np.meshgrid(*((np.arange(count) + 0.5) / count for count in counts), indexing="ij")
    return low + width * np.stack(grids, axis=-1).reshape(-1, 2)


def _noisy(draws: Draws, name: str, v: FloatArray, sigma: float) -> FloatArray:
    """Return unit vectors along v (..., 3), turned at random by sigma (rad) in both directions across."""
    u = v / np.linalg.norm(v, axis=-1, keepdims=True)
    first = cross(u, np.broadcast_to(np.array([0.0, 1.0, 0.0]), u.shape))
    first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    noise = sigma * draws.normal(name, *u.shape[:-1], 2)
    turned = u + noise[..., :1] * first + noise[..., 1:] * cross(u, first)
    return turned / np.linalg.norm(turned, axis=-1, keepdims=True)


def run(setup: Setup, seeds: Sequence[int] = (1, 2, 3)) -> Outcome:
    """Return the outcome of simulated pairs, pooled over seeds."""
    single = [_run_one(simulate(replace(setup, seed=seed))) for seed in seeds]

    def pooled(values: list[FloatArray]) -> FloatArray:
        return np.sqrt(np.mean(np.square(values), axis=0))

    estimated = ("fourier", "grid")
    return Outcome(
        setup=setup,
        rms={name: pooled([one.rms[name] for one in single]) for name in METHODS},
        wave={name: pooled([one.wave[name] for one in single]) for name in METHODS},
        honesty={name: float(pooled([np.array(one.honesty[name]) for one in single])) for name in estimated},
        covered={name: float(np.mean([one.covered[name] for one in single])) for name in estimated},
        waves=float(np.mean([one.waves for one in single])),
        spacing=float(np.mean([one.spacing for one in single])),
    )


def _run_one(simulation: Simulation) -> Outcome:
    setup, points = simulation.setup, simulation.surface_points
    fits: dict[str, SurfaceFit] = {"fourier": fit_fourier(points), "grid": fit_grid(points)}
    plain: dict[str, Surface] = {"level": PlanarSurface(level=0.0), "true": setup.waves}
    rms = {name: _rms(_error(simulation, surface, simulation.rays)) for name, surface in plain.items()}
    wave = {name: _rms(_error(simulation, surface, simulation.exact)) for name, surface in plain.items()}
    honesty, covered = {}, {}
    for name, fit in fits.items():
        error, sigma, known = through(simulation, fit)
        rms[name] = _rms(error[known])
        wave[name] = _rms(through(simulation, fit, exact=True)[0][known])
        honesty[name] = float(_rms(error[known] / sigma[known])[2])
        covered[name] = float(known.mean())
    waves = float(sum(step.is_taken for step in fits["fourier"].steps))
    spacing = mean_spacing(points.position[:, :2])
    return Outcome(setup=setup, rms=rms, wave=wave, honesty=honesty, covered=covered, waves=waves, spacing=spacing)


def through(
    simulation: Simulation, fit: SurfaceFit, exact: bool = False
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return errors (n, 3) m of the bottom through an estimated surface, their sigmas, where it is known (n,)."""
    setup, fitted = simulation.setup, fit.fitted
    shift = np.append(fitted.origin, 0.0)
    rays = simulation.exact if exact else simulation.rays
    apparent = nearest_point(np.broadcast_to(setup.cameras, rays.shape), rays)
    covariance = intersection_covariance(setup.cameras, apparent, setup.angle)
    found = true_points_of_apparent(fitted, setup.cameras - shift, apparent - shift, covariance, setup.index)
    return (
        found.position + shift - simulation.bottom,
        found.sigma,
        np.asarray(fitted.covers(found.meeting[..., :2]).all(axis=1)),
    )


def _error(simulation: Simulation, surface: Surface, rays: FloatArray) -> FloatArray:
    setup = simulation.setup
    bent = refracted_ray(surface, setup.cameras, rays, setup.index)
    return intersection(bent.origin, bent.direction)[0] - simulation.bottom


def _rms(values: FloatArray) -> FloatArray:
    return np.sqrt(np.mean(np.square(values), axis=0))
