"""Points read on two photos, and the tests of their y-parallaxes."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from altered import with_options
from compilation.scenes import INDEX, at_depth, compiled_again, flat_images, grid, pair, readings_at
from musatpy import model, read_deck
from musatpy.adjustment.job import adjust
from musatpy.arrays import FloatArray
from musatpy.as11_runs import of_solution
from musatpy.compilation.compiled import Compiled, parallax_tests
from musatpy.compilation.triangulation import AdjustedRun
from musatpy.compilation.true_points import CompiledPoints, true_points
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.probability import student_as_normal
from musatpy.refraction.flat import air_tangent


def test_points_are_the_same_whatever_the_chunk(monkeypatch: pytest.MonkeyPatch) -> None:
    run = pair(3000.0, 1810.0, (0.4, -0.3))
    places = at_depth(grid((200.0, 1600.0), 1700.0, 5), 5.0)
    readings = readings_at(flat_images(run, places))
    whole = true_points(run, (0, 1), readings)
    monkeypatch.setattr("musatpy.compilation.true_points._CHUNK", 7)
    parts = true_points(run, (0, 1), readings)
    np.testing.assert_allclose(parts.position, whole.position, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(whole.position, places, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(parts.covariance, whole.covariance, rtol=1e-12)


FIXTURES = Path(__file__).parents[2] / "fixtures"
POINTING = 0.005
# m and rad, of a station: what both have in common (a datum that little control holds), and what is each one's own.
COMMON = np.array([5.0, 5.0, 5.0, 3e-4, 3e-4, 3e-4])
OWN = np.array([0.05, 0.05, 0.05, 3e-5, 3e-5, 3e-5])
INDEX_SIGMA = 0.002


def uncertain() -> AdjustedRun:
    """Return a run of two photographs with errors of their stations and of the index."""
    run = pair(3000.0, 1810.0)
    common = np.diag(np.square(COMMON))
    options = replace(run.block.options, water_index=model.Treatment.ADJUST)
    return replace(
        run,
        block=replace(run.block, options=options, water=model.Water(index=INDEX, sigma=INDEX_SIGMA)),
        covariance=np.repeat((common + np.diag(np.square(OWN)))[None], 2, axis=0),
        pairs=model.StationPairs(photo=np.array([[0, 1]]), covariance=common[None]),
        water=model.WaterPrecision(
            names=("index",), covariance=np.array([[INDEX_SIGMA**2]]), stations=np.zeros((2, 6, 1)),
            levels=np.zeros((0, 1)),
        ),
    )  # fmt: skip


def images(run: AdjustedRun, points: FloatArray, errors: FloatArray, index: FloatArray) -> FloatArray:
    """Return the images (n, k, 2, 2) of points (k, 3) on stations that are off by errors (n, 2, 6), by scalars."""
    photos, f = run.block.photos, run.block.cameras.focal_length[0]
    station = (photos.position + errors[..., :3])[:, None]
    gap = points[:, None] - station
    D = np.linalg.norm(gap[..., :2], axis=-1)
    tangent = air_tangent(station[..., 2], -points[:, None, 2], D, index[:, None, None])
    ray = np.concatenate([gap[..., :2] / D[..., None] * tangent[..., None], -np.ones((*D.shape, 1))], axis=-1)
    ray = np.einsum("nmij,nkmj->nkmi", attitude_matrix(photos.attitude + errors[..., 3:]), ray)
    return np.asarray(-f * ray[..., :2] / ray[..., 2:])


@pytest.mark.parametrize("submerged", [True, False])
def test_the_test_value_has_the_variance_one(submerged: bool) -> None:
    """By 1,500 draws of two stations, the index and pointing, at four places: within three of its deviations."""
    run, number, draws = uncertain(), 1500, np.random.default_rng(17)
    height = np.array([-4.0, -12.0, -25.0, -30.0]) if submerged else np.array([1.0, 5.0, 20.0, 40.0])
    points = np.column_stack([[300.0, 900.0, 1300.0, 1600.0], [-1500.0, -200.0, 500.0, 1600.0], height])
    errors = COMMON * draws.normal(size=(number, 1, 6)) + OWN * draws.normal(size=(number, 2, 6))
    index = INDEX + INDEX_SIGMA * draws.normal(size=number)
    xy = images(run, points, errors, index if submerged else np.ones(number)).reshape(-1, 2, 2)
    readings = readings_at(xy + POINTING * draws.normal(size=xy.shape), submerged, POINTING)
    found = true_points(run, (0, 1), readings)
    test = (found.y_parallax / found.y_parallax_sigma).reshape(number, 4)
    assert np.mean(found.pointing_share) < 0.7  # or the stations would not be tested
    np.testing.assert_allclose(np.mean(np.square(test), axis=0), 1.0, atol=3.0 * np.sqrt(2.0 / number))


def of_share(run_share: float, freedom: float, off: FloatArray, sigma: FloatArray, own: bool) -> FloatArray:
    """Return the tests of y-parallaxes `off` with told sigmas, in which stations have a share."""
    share = 1.0 - run_share * np.ones(len(off))
    points = SimpleNamespace(y_parallax=off, y_parallax_sigma=sigma, pointing_share=share)
    return parallax_tests(cast(CompiledPoints, points), np.full(len(off), np.nan), freedom, sigma_of_run=own)


@pytest.mark.parametrize("freedom", [6, 12])
@pytest.mark.parametrize("own", [False, True])
def test_few_degrees_of_freedom_flag_no_more_than_many(freedom: int, own: bool) -> None:
    """The sigma0 of the run scales the share of its stations, a half; `own`: that of pointing as well."""
    number, draws = 200_000, np.random.default_rng(4)
    scale = draws.chisquare(freedom, number) / freedom
    off, told = np.sqrt(2.0) * draws.normal(size=number), scale + (scale if own else 1.0)
    share = scale / told
    points = of_share(0.5, freedom, off, np.sqrt(told), own) if own else None
    if points is None:
        points = np.concatenate(
            [
                of_share(float(share[part].mean()), freedom, off[part], np.sqrt(told[part]), own)
                for part in np.array_split(np.argsort(share), 2000)
            ]
        )
    plain = np.mean(np.abs(off) > 3.29 * np.sqrt(told))
    assert 0.0004 < np.mean(np.abs(points) > 3.29) < 0.0016 < plain  # .001 is meant
    assert np.mean(np.abs(points) > 1.96) == pytest.approx(0.05, abs=0.007)


def again(solution: model.Solution, pointing: float, shift: float = 0.0) -> tuple[Compiled, np.ndarray]:
    """Return points of two rays without control, and the left plates of the run, which they are read as.

    But for a shift (mm).
    """
    block = solution.block
    rays = np.bincount(block.plates.point, minlength=len(block.points.ids))
    two = (rays == 2) & ~of_solution(solution).control
    return compiled_again(solution, block.plates.xy + shift, pointing, two)


@pytest.mark.parametrize("pointing", [np.nan, 0.003])
def test_readings_that_made_the_stations_are_tested_as_residuals_of_the_run(pointing: float) -> None:
    """A point of two rays has one redundancy: its y-parallax is in the adjustment what every residual of it is."""
    block = read_deck(FIXTURES / "st_thomas/st_thomas.crd")
    solution = adjust(with_options(block, program=model.Program.IIIA, refraction=model.Refraction.RIGOROUS))
    result, plates = again(solution, pointing)
    observed = solution.observed
    assert observed is not None
    images = np.flatnonzero(observed.kind == model.ObservationKind.PLATE)
    tau = observed.residual / (observed.sigma * np.sqrt(observed.redundancy) * solution.unit_sigma)
    expected = np.array([np.abs(tau[images[observed.row[images] == row]]) for row in plates])
    freedom = np.full(len(plates), float(solution.degrees_of_freedom))
    known = np.isfinite(result.y_parallax_test)
    assert known.sum() >= 5
    np.testing.assert_allclose(expected[known], expected[known][:, :1].repeat(2, axis=1), rtol=1e-6)
    np.testing.assert_allclose(
        np.abs(result.y_parallax_test)[known], student_as_normal(expected[:, 0], freedom)[known], rtol=1e-5
    )
    fresh, _ = again(solution, pointing, 1e-5)  # other readings: pointing and stations add up
    np.testing.assert_allclose(
        fresh.y_parallax_test,
        student_as_normal(
            fresh.points.y_parallax / fresh.points.y_parallax_sigma,
            freedom if np.isnan(pointing) else freedom / np.square(1.0 - fresh.points.pointing_share),
        ),
        rtol=1e-12,
    )  # fmt: skip
    if np.isnan(pointing):
        assert (np.abs(fresh.y_parallax_test) < np.abs(result.y_parallax_test))[known].all()
