"""Waves, known and unknown: the truth is found, partials, sigmas, and what does not show is named."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.optimize import least_squares

import musatpy
from altered import altered
from musatpy.adjustment.iteration import State
from musatpy.adjustment.job import prepared
from musatpy.adjustment.network import Network
from musatpy.adjustment.sightings import condition_rays, images
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import IntArray
from musatpy.errors import AdjustmentError
from musatpy.model import (
    Block,
    CoordinateSystem,
    Datum,
    ObservationKind,
    Program,
    Solution,
    WaterLevel,
    Waves,
)
from musatpy.model.tables import empty
from musatpy.refraction.waves import Harmonic, Trains, Trochoid, sinusoidal, superposed
from musatpy.units import ARC_SECOND, MICROMETRE
from reference import compare
from reference.rays import rotation
from studies.strip import Photographed, Strip, photographed
from studies.unknown_waves import Guess, run, summary
from wave_strip import strip


@lru_cache
def through_waves(system: CoordinateSystem, **sigmas: tuple[float, float]) -> tuple[Network, State, IntArray]:
    """Return the network of the strip through waves, those with sigmas unknown, at its start, and its wet rays."""
    block, _ = strip(system)
    block = altered(block, waves=sigmas, options={"water_level": WaterLevel.ONE} if sigmas else {})
    job, state = prepared(block, None)
    wet = block.points.bathymetric[job.network.point]
    return job.network.with_plates(job.network.xy, wet), state, np.flatnonzero(wet)


@pytest.mark.parametrize("system", list(CoordinateSystem))
def test_partials_of_images_and_rays_are_those_of_their_functions(system: CoordinateSystem) -> None:
    """By station and ground point; central differences of 1 mm leave 2e-6 of the largest element."""
    network, state, rays = through_waves(system)
    ground = state.ground[network.point[rays]]
    at = images(network, state, rays, ground)
    bent = condition_rays(network, state, rays, network.xy[rays], ground)
    scale, ray_scale = np.abs(at.by_ground).max(), np.abs(bent.by_station[:, :, :3]).max()
    for axis in range(3):
        step = 1e-3 * np.eye(3)[axis]
        fore, aft = (images(network, state, rays, ground + sign * step).xy for sign in (1.0, -1.0))
        np.testing.assert_allclose(at.by_ground[..., axis], (fore - aft) / 2e-3, atol=2e-6 * scale)
        shift = 1e-3 * network.axes[:, axis]
        moved = [replace(state, position=state.position + sign * shift) for sign in (1.0, -1.0)]
        fore, aft = (images(network, one, rays, ground).xy for one in moved)
        np.testing.assert_allclose(at.by_station[..., axis], (fore - aft) / 2e-3, atol=2e-6 * scale)
        rows = [condition_rays(network, one, rays, network.xy[rays], ground) for one in moved]
        fore, aft = (np.concatenate([one.origin, one.direction], axis=-1) for one in rows)
        np.testing.assert_allclose(bent.by_station[..., axis], (fore - aft) / 2e-3, atol=2e-6 * ray_scale)


@pytest.mark.parametrize("system", list(CoordinateSystem))
def test_partials_of_images_by_waves_are_those_of_their_function(system: CoordinateSystem) -> None:
    """Central differences of 3e-5 leave 1e-6 of the largest element: an azimuth moves far crests by much more."""
    nan = np.nan
    unknown = {"height_sigma": (1.0, nan), "length_sigma": (nan, 1.0), "azimuth_sigma": (1.0, nan)}
    network, state, rays = through_waves(system, **unknown, crest_sigma=(1.0, 1.0))
    ground = state.ground[network.point[rays]]
    at = images(network, state, rays, ground).by_water
    known = np.isnan(network.sea.sea.sigma)
    assert known.sum() == 3
    for number, (wave, of) in enumerate(np.argwhere(~known)):
        step = np.zeros((2, 4))
        step[wave, of] = 3e-5
        fore, aft = (images(network, replace(state, waves=state.waves + s), rays, ground).xy for s in (step, -step))
        want = (fore - aft) / 6e-5
        np.testing.assert_allclose(at[..., 4 + number], want, atol=1e-6 * np.abs(want).max())


@pytest.mark.slow
def test_a_calm_sea_is_level_water() -> None:
    block, _ = strip(CoordinateSystem.GEOGRAPHIC)
    calm, level = altered(block, waves={"height": (0.0, 0.0)}), replace(block, waves=empty(Waves), wave_origin=None)
    with_sea, without = musatpy.adjust(calm), musatpy.adjust(level)
    moved = compare.enu_difference(block, with_sea.points.position[:20], without.points.position[:20])
    assert np.nanmax(np.abs(moved)) < 1e-6  # where the iteration stops
    assert with_sea.sigma0 == pytest.approx(without.sigma0, rel=1e-6)


FINE = {"rotation_limit": 1e-6 * ARC_SECOND, "translation_limit": 1e-8}
EXACT = Strip(rows=4, columns=5, control=4, noise=1e-6, control_sigma=1e-9)
SIGMA = np.array([[0.6, 5.0, 0.1, 5.0]])


@lru_cache
def scene(strip: Strip) -> Photographed:
    return photographed(strip, 11.0, np.random.default_rng(4))


def sea_of(scene: Photographed, change, depth: float = 10.0, sigma: np.ndarray = SIGMA) -> Sea:
    """Return the sea of a scene, its waves changed by (4,) and unknown."""
    trains = Trains.of(scene.waves, depth)
    surface = trains.with_values(trains.values + change).surface
    return Sea(surface=surface, time=scene.times, origin=np.zeros(3), sigma=sigma, depth=depth)


def adjusted(scene: Photographed, sea: Sea | None, **options) -> Solution:
    block = replace(scene.block, options=replace(scene.block.options, **options))
    solution = musatpy.adjust(block, sea=sea)
    assert solution.converged, solution.reason
    return solution


@pytest.mark.slow
@pytest.mark.parametrize(
    ("interval", "change"),
    [
        (0.0, [-0.2, 1.5, -0.03, 4.0]),
        (3.0, [-0.2, 1.5, -0.03, 4.0]),
        # guessed to be none: nothing else shows at first; its sign, and half a length of the crest, may turn
        (3.0, [None, 0.5, -0.01, 2.0]),
    ],
    ids=["simultaneous", "every 3 s", "guessed to be none"],
)
def test_the_truth_is_found_without_errors(interval: float, change: list[float | None]) -> None:
    at = scene(replace(EXACT, interval=interval))
    want = Trains.of(at.waves).values
    found = adjusted(at, sea_of(at, [-want[0, 0] if one is None else one for one in change]), **FINE)
    # what errors of 1e-6 um in the images leave: a sigma of 4e-7 m of the crest, the least known
    assert np.abs(found.water.waves.value - want).max() < 1e-6
    assert np.abs(found.points.position - at.points).max() < 1e-6
    assert found.water.waves.speed[0] == pytest.approx(at.waves.frequency[0] / np.linalg.norm(at.waves.vector[0]))
    assert set(found.water.waves.verdicts.ravel()) == {"determined"} and not found.warnings


def test_only_what_has_a_sigma_is_unknown() -> None:
    at = scene(EXACT)
    sigma = np.array([[0.6, np.nan, np.nan, 5.0]])
    found = adjusted(at, sea_of(at, [-0.2, 0.0, 0.0, 4.0], sigma=sigma), **FINE).water.waves
    want = Trains.of(at.waves).values
    np.testing.assert_allclose(found.value, want, atol=1e-6)
    assert (np.isnan(found.sigma) == np.isnan(sigma)).all() and (np.isnan(found.inflation) == np.isnan(sigma)).all()
    np.testing.assert_array_equal(found.value[np.isnan(sigma)], want[np.isnan(sigma)])


def _entries(waves: Harmonic, C: np.ndarray, G: np.ndarray, time: np.ndarray, n: float) -> np.ndarray:
    """Return where rays (r, 3) enter the water: Snell's law by differences of the height of the waves alone."""

    def place(xy: np.ndarray) -> np.ndarray:
        return np.column_stack([xy, waves.relief(xy, time).height])

    def snell(xy: np.ndarray) -> np.ndarray:
        W, h = place(xy), 1e-4
        slope = [(waves.relief(xy + step, time).height - waves.relief(xy - step, time).height) / (2.0 * h)
                 for step in h * np.eye(2)]  # fmt: skip
        a, b = W - C, G - W
        a, b = a / np.linalg.norm(a, axis=1)[:, None], b / np.linalg.norm(b, axis=1)[:, None]
        return np.cross(np.column_stack([-slope[0], -slope[1], np.ones(len(C))]), a - n * b)[:, :2]

    xy = G[:, :2] + 0.7 * (C - G)[:, :2] * (-G[:, 2:] / (C - G)[:, 2:])
    for _ in range(5):
        at = snell(xy)
        J = np.stack([(snell(xy + step) - snell(xy - step)) / 2e-4 for step in 1e-4 * np.eye(2)], axis=2)
        xy = xy - np.linalg.solve(J, at[..., None])[..., 0]
    return place(xy)


@pytest.mark.slow
def test_a_dense_adjustment_by_a_library_finds_the_same() -> None:
    """Unknowns and covariance of scipy's least squares on a pair, its refraction by a root finder."""
    strip = Strip(photos=2, rows=2, columns=4, control=4)
    at = scene(strip)
    sea = sea_of(at, [0.1, 1.0, 0.02, -3.0], depth=np.nan)
    found = adjusted(at, sea, **FINE)
    block, n, p = at.block, 2, len(at.points)
    f, pp = block.cameras.focal_length[0], block.cameras.principal_point[0]
    prior, plate = Trains.of(sea.surface).values[0], strip.noise * MICROMETRE
    speed = sea.surface.frequency[0] / np.linalg.norm(sea.surface.vector[0])
    wet = block.points.bathymetric[block.plates.point]

    def residuals(x: np.ndarray) -> np.ndarray:
        stations, ground, wave = x[: 6 * n].reshape(n, 6), x[6 * n : 6 * n + 3 * p].reshape(p, 3), x[-4:]
        H, L, a, c = wave
        waves = sinusoidal(amplitude=0.5 * H, length=L, azimuth=0.5 * np.pi - a, speed=speed, crest=c)
        C, G = stations[block.plates.photo, :3], ground[block.plates.point]
        v = G - C
        v[wet] = _entries(waves, C[wet], G[wet], at.times[block.plates.photo[wet]], strip.index) - C[wet]
        U, V, S = np.einsum("rij,rj->ir", rotation(stations[:, 3:])[block.plates.photo], v)
        rows = [((pp - f * np.column_stack([U, V]) / S[:, None] - block.plates.xy) / plate).ravel()]
        rows.append(((ground[block.control.point] - block.control.position) / block.control.sigma).ravel())
        rows.append((wave - prior) / SIGMA[0])
        return np.concatenate(rows)

    start = [found.stations.position, found.stations.attitude]
    x = np.concatenate([np.hstack(start).ravel(), found.points.position.ravel(), prior])
    x[:-4] += np.random.default_rng(1).normal(0.0, 1e-3, len(x) - 4)
    scale = np.concatenate([np.tile([1.0] * 3 + [1e-3] * 3, n), np.ones(3 * p), [0.1, 1.0, 0.01, 1.0]])
    dense = least_squares(residuals, x, jac="3-point", x_scale=scale, xtol=1e-10, max_nfev=12)
    Q = np.linalg.inv(dense.jac.T @ dense.jac)
    waves, sigma0 = found.water.waves, found.sigma0
    sigma = np.sqrt(np.diagonal(Q))[-4:]
    assert 2.0 * dense.cost == pytest.approx(found.sum_of_squares, rel=1e-6)  # slopes by differences of 1e-4 m
    np.testing.assert_array_less(np.abs(dense.x[-4:] - waves.value[0]), 1e-4 * sigma)
    np.testing.assert_allclose(waves.sigma[0] / sigma0, sigma, rtol=1e-4)  # as above, in the Jacobian
    np.testing.assert_allclose(waves.kept[0], sigma / SIGMA[0], rtol=1e-4)
    inflation = np.diagonal(dense.jac.T @ dense.jac)[-4:] * sigma**2
    np.testing.assert_allclose(waves.inflation[0], inflation, rtol=1e-3)
    correlation = Q / np.sqrt(np.outer(np.diagonal(Q), np.diagonal(Q)))
    names = [f"wave 1 {one}" for one in ("height", "length", "azimuth", "crest")]
    for first, second, value in zip(waves.first, waves.second, waves.correlation, strict=True):
        row = len(x) - 4 + names.index(first)
        if second in names:
            assert value == pytest.approx(correlation[row, len(x) - 4 + names.index(second)], abs=1e-4)
        else:  # the height of the station that is correlated most
            of_heights = correlation[row, [2, 8]]
            assert value == pytest.approx(of_heights[np.argmax(np.abs(of_heights))], abs=1e-4)
    depths = 6 * n + 3 * np.arange(p) + 2
    got = np.sqrt(found.points.covariance[:, 2, 2]) / sigma0
    np.testing.assert_allclose(got, np.sqrt(np.diagonal(Q))[depths], rtol=1e-4)


@pytest.mark.slow
def test_sigmas_are_honest() -> None:
    """RMS of 40 normal deviates is 1 within 0.45 in all but one of 10000 cases; heights are many more."""
    found = summary(run(Strip(rows=4, columns=6, control=8), Guess().times(0.4), seed) for seed in range(10))
    assert found.failed == 0
    assert np.sqrt(np.mean(np.square(found.parameter_honesty))) == pytest.approx(1.0, abs=0.45)
    assert found.height_honesty == pytest.approx(1.0, abs=0.3)  # of neighbours, the errors are correlated
    assert found.removed[1] > 0.7 and found.level[1] > 3.0 * found.known[1]


@pytest.mark.slow
def test_what_does_not_show_is_named() -> None:
    """On a sea that is as good as calm nobody can tell where its crests are, nor how long they are."""
    calm = Strip(rows=3, columns=5, control=4, deep_height=2e-4)
    at = scene(calm)
    found = adjusted(at, sea_of(at, 0.0, sigma=np.array([[np.nan, 5.0, 0.1, 5.0]])))
    waves = found.water.waves
    assert list(waves.verdicts[0]) == ["", *["not determined: does not show"] * 3]
    assert waves.kept[0, 1:].min() > 0.99
    assert "the crest of wave 1 is not determined: does not show" in found.warnings
    assert "not determined: does not show" in musatpy.listing(found)


@pytest.mark.slow
def test_a_wave_that_fits_noise_is_named() -> None:
    """A height of less than five of its sigmas may be none; where its crests are then means nothing."""
    at = scene(Strip(rows=3, columns=5, control=4, deep_height=2e-4))
    waves = adjusted(at, sea_of(at, 0.0)).water.waves
    assert abs(waves.value[0, 0]) < 5.0 * waves.sigma[0, 0]
    assert waves.verdicts[0, 0] == "determined"
    assert all(one.startswith("not determined") for one in waves.verdicts[0, 1:])


@pytest.mark.slow
def test_what_cannot_be_told_apart_is_named() -> None:
    """Two waves of one shape: their heights and crests are only known together."""
    at = scene(Strip(rows=4, columns=5, control=6, noise=0.5))
    half = replace(at.waves, amplitude=0.5 * at.waves.amplitude)
    twins = superposed(half, half)
    sigma = np.array([[0.6, np.nan, np.nan, np.nan]] * 2)
    sea = Sea(surface=twins, time=at.times, origin=np.zeros(3), sigma=sigma)
    waves = adjusted(at, sea).water.waves
    assert waves.kept[:, 0].min() > 1.0 / np.sqrt(2.0) - 1e-9  # half of the variance is that of their difference
    row = np.flatnonzero((waves.first == "wave 1 height") & (waves.second == "wave 2 height"))
    assert waves.correlation[row[0]] < -0.95
    assert set(waves.verdicts[:, 0]) == {"weakly determined"}
    wide = np.array([[0.04, np.nan, np.nan, np.nan], [4.0, np.nan, np.nan, np.nan]])
    waves = adjusted(at, replace(sea, sigma=wide)).water.waves
    assert waves.verdicts[0, 0] == "not determined: not apart from others"
    assert waves.verdicts[1, 0] == "determined"


def test_observed_parameters_are_observations() -> None:
    at = scene(Strip(rows=3, columns=5, control=4))
    found = adjusted(at, sea_of(at, [0.1, 1.0, 0.0, 2.0]), water_level=WaterLevel.KNOWN)
    assert found.observations["water"] == found.unknowns["water"] == 4
    rows = found.observed.kind == ObservationKind.WAVE
    waves = found.water.waves
    np.testing.assert_allclose(found.observed.residual[rows], (waves.value - waves.prior)[0])
    np.testing.assert_allclose(found.observed.redundancy[rows], 1.0 - waves.kept[0] ** 2)  # 1 - weight x cofactor
    assert found.observed.redundancy.sum() == pytest.approx(found.degrees_of_freedom)
    names = list(found.dependence.names)
    assert [one for one in names if one.startswith("wave")] == [
        f"wave 1 {one}" for one in ("height", "length", "azimuth", "crest")
    ]


@pytest.mark.parametrize(
    ("changes", "sea", "message"),
    [
        ({"program": Program.IIA}, {}, "unknown waves need the simultaneous adjustment, the program IIIA"),
        ({"datum": Datum.FREE}, {}, "they cannot be combined with a free network"),
        ({}, {"surface": Trochoid(amplitude=0.4, length=40.0, azimuth=1.0)}, "only sinusoidal waves"),
        ({}, {"sigma": np.ones((2, 4))}, r"shape \(1, 4\)"),
        ({}, {"sigma": np.array([[0.1, 0.0, np.nan, 1.0]])}, "is positive, or not given"),
        ({}, {"depth": -5.0}, "is positive"),
    ],
)
def test_what_unknown_waves_need_is_said(changes, sea, message: str) -> None:
    at = scene(EXACT)
    block: Block = replace(at.block, options=replace(at.block.options, **changes))
    with pytest.raises(AdjustmentError, match=message):
        musatpy.adjust(block, sea=replace(sea_of(at, 0.0), **sea))
