"""Water surfaces estimated from points on them: truth without noise, covariance, partials, rejection, coverage."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from musatpy.refraction.waves import Harmonic, sinusoidal
from musatpy.sea.stereo import grid as splines
from musatpy.sea.stereo.estimate import SurfaceFit, fit_fourier, fit_grid
from musatpy.sea.stereo.fourier import FourierSurface, shape_partials
from musatpy.sea.stereo.grid import GridSurface, estimate, mesh
from musatpy.sea.stereo.spectrum import band, spectrum
from musatpy.sea.stereo.surface_points import SurfacePoints, height_sigma, intersection_covariance
from studies.stereo import intersected

CAMERAS = np.array([[0.0, 0.0, 490.0], [264.0, 0.0, 490.0]])
SEA = sinusoidal(amplitude=[0.49, 0.15], length=[92.0, 40.0], azimuth=[0.5, 1.2], crest=[3.0, 4.0], level=0.1)
SIGMA = 5e-3 / 152.0  # rad: 5 um


def places(count: int, seed: int = 1, low: tuple = (0.0, -330.0), high: tuple = (330.0, 330.0)) -> np.ndarray:
    return np.random.default_rng(seed).uniform(low, high, (count, 2))


def bare(position: np.ndarray, covariance: np.ndarray | None = None) -> SurfacePoints:
    ids = tuple(map(str, range(len(position))))
    given = np.tile(np.eye(3), (len(ids), 1, 1)) if covariance is None else covariance
    return SurfacePoints(ids=ids, position=position, covariance=given)


def points_on(sea: Harmonic, count: int, noise: float = 0.0, seed: int = 1) -> SurfacePoints:
    """Return points with the covariance of the pair, and errors of `noise` times that."""
    xy = places(count, seed)
    position = np.column_stack([xy, sea.relief(xy).height])
    covariance = intersection_covariance(CAMERAS, position, SIGMA)
    errors = np.random.default_rng(seed + 1000).normal(size=position.shape)
    position = position + noise * np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), errors)
    return SurfacePoints(ids=tuple(f"W{i}" for i in range(count)), position=position, covariance=covariance)


def shape_of(surface, xy: np.ndarray) -> np.ndarray:
    relief = surface.relief(xy)
    return np.column_stack([relief.height, relief.gradient])


def errors_and_sigmas(fit: SurfaceFit, sea: Harmonic, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    at = xy - fit.fitted.origin
    variance = np.diagonal(fit.fitted.shape_covariance(at[:, None]), axis1=1, axis2=2)
    return shape_of(fit.fitted.surface, at) - shape_of(sea, xy), np.sqrt(variance)


# --- waves ---


def test_waves_are_found_without_any_knowledge() -> None:
    """k and -k cannot be told apart by one exposure: the azimuth lies within a right angle of x."""
    back = fit_fourier(points_on(sinusoidal(amplitude=0.3, length=60.0, azimuth=2.5, crest=7.0), 120)).fitted
    assert isinstance(back, FourierSurface)
    assert back.described[0][0, 2] == pytest.approx(2.5 - np.pi, abs=1e-9)
    fit = fit_fourier(points_on(SEA, 150))
    assert isinstance(fit.fitted, FourierSurface) and fit.fitted.count == 2
    error, _ = errors_and_sigmas(fit, SEA, places(50, 9))
    assert np.abs(error).max() < 1e-9  # rounding: heights of 1 m, and wave vectors from coordinates of 300 m
    described, _ = fit.fitted.described
    np.testing.assert_allclose(described[:, 0], [0.49, 0.15], atol=1e-9)
    np.testing.assert_allclose(described[:, 1], [92.0, 40.0], rtol=1e-9)
    np.testing.assert_allclose(described[:, 2], [0.5, 1.2], atol=1e-9)


def test_noise_alone_is_no_wave() -> None:
    calm = sinusoidal(amplitude=0.0, length=50.0, azimuth=0.0, level=0.3)
    found = [fit_fourier(points_on(calm, 80, noise=1.0, seed=seed)).fitted for seed in range(10)]
    # the risk is 1 % each: 0.1 waves are expected in ten seas
    assert sum(one.count for one in found if isinstance(one, FourierSurface)) <= 1


def test_partials_of_the_waves() -> None:
    q = np.array([0.2, 0.3, -0.2, 0.06, 0.03, 0.1, 0.15, -0.1, 0.2])
    xy, step = places(6, 3, (-100.0, -100.0), (100.0, 100.0)), 1e-6

    def shape(p: np.ndarray) -> np.ndarray:
        fitted = FourierSurface(origin=np.zeros(2), parameters=p, covariance=np.eye(9), area=np.zeros((2, 2)))
        return shape_of(fitted.surface, xy)

    numeric = np.stack([(shape(q + step * e) - shape(q - step * e)) / (2.0 * step) for e in np.eye(9)], axis=-1)
    # of x cos k.x with x up to 100 m and a step of 1e-6 rad/m: (x step)^2 / 6 of 100 is 2e-7
    np.testing.assert_allclose(shape_partials(q, xy), numeric, atol=1e-6)


def test_sigmas_of_what_describes_waves() -> None:
    """Amplitude, length, azimuth and phase by a, b, kx, ky: the sigmas of a covariance through differences."""
    q = np.array([0.2, 0.3, -0.2, 0.06, 0.03])
    C = np.diag([1.0, 2.0, 3.0, 1e-4, 2e-4]) + 1e-6
    make = partial(FourierSurface, origin=np.zeros(2), covariance=C, area=np.zeros((2, 2)))
    step = 1e-7
    ends = [[make(parameters=q + sign * step * e).described[0][0] for sign in (1, -1)] for e in np.eye(5)]
    J = np.stack([(after - before) / (2 * step) for after, before in ends], axis=-1)
    expected = np.sqrt(np.diag(J @ C @ J.T))
    np.testing.assert_allclose(make(parameters=q).described[1][0], expected, rtol=1e-6)  # differences by 1e-7


def test_the_spectrum_is_that_of_dense_least_squares() -> None:
    points = points_on(SEA, 60, noise=1.0)
    xy, z = points.position[:, :2], points.position[:, 2]
    w = 1.0 / points.covariance[:, 2, 2]
    found = spectrum(xy, z, w, band(xy))
    inside = np.argwhere(found.power > 0.0)
    level = z - w @ z / w.sum()
    for i, j in inside[:: len(inside) // 20]:
        angle = xy @ [found.x[i], found.y[j]]
        design = np.column_stack([np.ones(len(z)), np.cos(angle), np.sin(angle)]) * np.sqrt(w)[:, None]
        left = z * np.sqrt(w) - design @ np.linalg.lstsq(design, z * np.sqrt(w), rcond=None)[0]
        expected = 1.0 - left @ left / (w @ level**2)
        assert found.power[i, j] == pytest.approx(expected, abs=1e-9)  # rounding of products of 60 numbers


@pytest.mark.parametrize("length", [60.0, 46.0, 42.0])
def test_an_alias_is_not_preferred_on_a_regular_grid(length: float) -> None:
    """At 3 to 2.1 points to a wave length; aliases are shorter, and fit as well."""
    x, y = np.meshgrid(np.arange(12) * 20.0, np.arange(14) * 20.0, indexing="ij")
    xy = np.column_stack([x.reshape(-1), y.reshape(-1)])
    sea = sinusoidal(amplitude=0.4, length=length, azimuth=1.4)
    position = np.column_stack([xy, sea.relief(xy).height])
    fit = fit_fourier(bare(position, np.tile(0.02**2 * np.eye(3), (len(xy), 1, 1))))
    assert isinstance(fit.fitted, FourierSurface)
    np.testing.assert_allclose(fit.fitted.described[0][:, 1], [length], rtol=1e-6)  # sigmas are 1e-3 of it
    kx, ky = 2.0 * np.pi / length * np.array([np.cos(1.4), np.sin(1.4)])
    other = 2.0 * np.pi / np.hypot(kx, ky - 2.0 * np.pi / 20.0)
    note = next(note for note in fit.notes if "are a regular grid" in note)
    # within 1/8 of what the extent resolves, by which the grid of wave vectors misses the lattice
    assert float(note.split("a wave of ")[1].split()[0]) == pytest.approx(other, rel=0.02)


def test_one_point_far_off_is_noted() -> None:
    good = points_on(SEA, 60)
    position = good.position.copy()
    position[0, :2] = -1e5
    far = replace(good, position=position)
    assert not any("far off" in note for note in fit_fourier(good).notes)
    assert any("far off" in note for note in fit_fourier(far, most=0).notes)


# --- grid ---


def test_the_surface_of_a_grid_is_the_spline_of_its_coefficients() -> None:
    fit = fit_grid(points_on(SEA, 200, noise=1.0))
    assert isinstance(fit.fitted, GridSurface)
    xy = places(40, 9, (-150.0, -300.0), (150.0, 300.0))
    for order, values in (((0, 0), 0), ((1, 0), 1), ((0, 1), 2)):
        at = splines.rows(fit.fitted.x, fit.fitted.y, xy, *order)
        expected = np.sum(at.factor * fit.fitted.coefficients[at.index], axis=1)
        # rounding; the surface interpolates heights that came from the coefficients
        np.testing.assert_allclose(shape_of(fit.fitted.surface, xy)[:, values], expected, atol=1e-9)


def test_the_grid_agrees_with_dense_least_squares() -> None:
    """Observations of heights and of curvature stacked, solved by numpy's lstsq; covariance by the inverse."""
    points, curvature = only_in_height(points_on(SEA, 60, noise=1.0)), 0.004
    origin = np.array([165.0, 0.0])
    xy, z = points.position[:, :2] - origin, points.position[:, 2]
    grid = mesh(xy, 60.0, curvature)
    found = estimate(points, origin, grid)
    nodes = splines.node_places(grid.x, grid.y)
    weight = 1.0 / np.sqrt(points.covariance[:, 2, 2])
    bent = [
        splines.rows(grid.x, grid.y, nodes, *order).matrix(grid.count).toarray() * factor / curvature
        for order, factor in (((2, 0), 1.0), ((0, 2), 1.0), ((1, 1), np.sqrt(2.0)))
    ]
    A = np.concatenate([splines.rows(grid.x, grid.y, xy).matrix(grid.count).toarray() * weight[:, None], *bent])
    c = np.linalg.lstsq(A, np.concatenate([z * weight, np.zeros(3 * grid.count)]), rcond=None)[0]
    C = np.linalg.inv(A.T @ A)
    # normal equations lose the square of the condition, 1e4 here, of 16 digits; what is left of a slope of 1e-6 in
    # the errors in plan is less
    np.testing.assert_allclose(found.coefficients, c, atol=1e-6)
    np.testing.assert_allclose(found.covariance, C, atol=1e-6 * np.abs(C).max())


def only_in_height(points: SurfacePoints) -> SurfacePoints:
    """Return the points with next to no errors in plan, so that the slope has no say in their weights."""
    return replace(points, covariance=points.covariance[:, 2, 2][:, None, None] * np.diag([1e-12, 1e-12, 1.0]))


@pytest.mark.slow
def test_a_hole_among_the_points_is_a_hole_of_the_surface() -> None:
    points = points_on(SEA, 500)
    away = np.hypot(*(points.position[:, :2] - [165.0, 100.0]).T) > 60.0
    fitted = fit_grid(points.some(away)).fitted
    centre, side = np.array([165.0, 100.0]) - fitted.origin, np.array([165.0, -200.0]) - fitted.origin
    assert not fitted.covers(centre) and fitted.covers(side)
    sigma = height_sigma(fitted, np.stack([centre, side]))
    assert sigma[0] > 3.0 * sigma[1]


# --- rejection ---


@pytest.mark.parametrize("model", [fit_fourier, fit_grid])
def test_gross_errors_are_rejected_with_their_reason(model) -> None:
    swell = sinusoidal(amplitude=0.49, length=92.0, azimuth=0.5, crest=3.0)
    clean = points_on(swell, 300, noise=1.0)
    position = clean.position.copy()
    bad = {10: 0.9, 77: -2.5, 200: 6.0}
    position[list(bad), 2] += list(bad.values())
    fit = model(replace(clean, position=position))
    assert set(bad) <= set(fit.reasons)
    assert len(fit.reasons) <= len(bad) + 3  # a good point in a thousand goes too
    assert "times its sigma, allowed 3.29" in fit.reasons[77]
    xy = places(60, 9, (30.0, -300.0), (300.0, 300.0))
    error, sigma = errors_and_sigmas(fit, swell, xy)
    known = fit.fitted.covers(xy - fit.fitted.origin)
    assert np.abs(error / sigma)[known, 0].max() < 4.0  # of 60 deviates; a gross error of 6 m has left nothing


@pytest.mark.slow
@pytest.mark.parametrize("model", [fit_fourier, fit_grid])
@pytest.mark.parametrize("height", [1e300, 1e9, -1e9, 1e6, -1e4])
def test_a_height_of_no_water_goes_before_the_fit(model, height: float) -> None:
    good = points_on(SEA, 120, noise=1.0)
    position, covariance = good.position.copy(), good.covariance.copy()
    # near its place, or the rays all but parallel
    position[[7, 40]] = [[100.0, 20.0, height], [1e8, -1e8, -height]]
    covariance[40] *= 1e16  # that an intersection far away has, and the surface could always follow
    fit = model(replace(good, position=position, covariance=covariance))
    alone = model(good.some(~np.isin(np.arange(120), (7, 40))))
    xy = places(20, 9, (30.0, -300.0), (300.0, 300.0)) - fit.fitted.origin
    np.testing.assert_array_equal(shape_of(fit.fitted.surface, xy), shape_of(alone.fitted.surface, xy))
    assert fit.rejected[2:] == alone.rejected
    names, reasons = zip(*fit.rejected[:2], strict=True)
    assert names == ("W7", "W40")
    assert f"{height - np.median(position[:, 2]):.6g} m off the median height: no water" in reasons[0]


def test_good_points_high_seas_and_coarse_heights_stay() -> None:
    """What could be water goes to the fit, however unlikely: waves near breaking, and heights of 40 m sigma."""
    fit = fit_fourier(points_on(SEA, 300, noise=1.0))
    assert fit.kept.mean() > 0.98 and fit.sigma0 == pytest.approx(1.0, abs=0.15)  # 3 deviations of 1/(2 x 290)^1/2
    breaking = sinusoidal(amplitude=22.0, length=310.0, azimuth=0.5, crest=3.0)  # a seventh of the length high
    assert fit_fourier(points_on(breaking, 120), longest=600.0).impossible == {}
    good = points_on(SEA, 120)
    wide = np.tile(np.diag([40.0, 40.0, 40.0]) ** 2, (120, 1, 1))
    noise = np.random.default_rng(5).normal(0.0, 40.0, 120)
    coarse = replace(good, position=good.position + noise[:, None] * [0, 0, 1], covariance=wide)
    assert fit_fourier(coarse, most=0).rejected == ()


# --- the points themselves ---


def test_covariance_of_intersected_points_is_that_of_repeated_measurement() -> None:
    ground, rng = np.array([[100.0, 80.0, 0.2]]), np.random.default_rng(5)
    v = np.tile((ground - CAMERAS)[:, None], (1, 4000, 1))
    u = v / np.linalg.norm(v, axis=-1, keepdims=True)
    u = u + SIGMA * rng.normal(size=u.shape)
    u = u / np.linalg.norm(u, axis=-1, keepdims=True)
    found = intersected(tuple(map(str, range(4000))), CAMERAS, u, SIGMA).position
    expected = intersection_covariance(CAMERAS, ground, SIGMA)[0]
    size = np.sqrt(np.diag(expected))
    unit = np.outer(size, size)
    # 4000 repetitions tell variances to 2 % each; the two rays differ in length by 10 %, which weights them there
    np.testing.assert_allclose(np.cov(found.T) / unit, expected / unit, atol=0.1)


LINE = np.column_stack([np.arange(9.0), 5.0 - 2.0 * np.arange(9.0), np.zeros(9)])


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (lambda: fit_fourier(points_on(SEA, 7)), "7 surface points: at least 8 are needed"),
        (lambda: fit_grid(points_on(SEA, 7)), "7 surface points: at least 8 are needed"),
        (lambda: fit_fourier(bare(LINE)), "the surface points lie in a line"),
        (lambda: fit_grid(bare(LINE)), "the surface points lie in a line"),
        (lambda: fit_grid(points_on(SEA, 50), spacing=2.0), "at most 3000 are estimated"),
        (lambda: bare(np.zeros((1, 3)), np.zeros((1, 3, 3))), "not positive"),
        (lambda: bare(np.full((1, 3), np.nan)), "not finite"),
        (lambda: bare(np.zeros((2, 3)), np.eye(3)[None]), "one id"),
    ],
)
def test_points_that_make_no_surface(asked, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        asked()
