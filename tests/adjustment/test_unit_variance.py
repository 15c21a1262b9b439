"""Wrong tides, tilts and indices, drawn from their priors: the estimated sigmas are those of the errors.

Every block has other errors in everything that was observed. The mean of sigma0 squared must be 1, and errors over
their covariances must have the expectation of chi-square: where a prior has the wrong weight or is taken twice, or
a partial by the water is wrong, they have not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest

from altered import altered
from musatpy.adjustment import adjust
from musatpy.model import Block, Program, Solution, Treatment, WaterLevel
from musatpy.model.tables import taken
from reference.networks import Plan, Simulated, simulate

BLOCKS = 15  # of each kind, 45 together
TIDE, TILT, INDEX = 0.10, 2e-4, 0.003  # sigmas of the priors: m, rad, 1
DEEP = -1.5  # m; a point nearer to the water could be thrown over it by its errors
LIMIT = 4.5  # standard errors: one in 10^5 of normal deviates is farther off, and here are some hundred of them
GROUPS = {
    WaterLevel.ONE: np.array(["A", "A", "A"]),
    WaterLevel.GROUP: np.array(["A", "B", "A"]),
    WaterLevel.PHOTO: np.array(["A", "B", "C"]),
}


@dataclass(frozen=True, kw_only=True)
class Errors:
    """What N blocks gave, a priori: the covariances without sigma0."""

    variance: np.ndarray  # (N,) sigma0 squared
    freedom: int
    water: np.ndarray  # (N, w) errors of level corrections, tilts and index over their sigmas
    stations: np.ndarray  # (N, n) e' Q^-1 e of the six parameters of each
    points: np.ndarray  # (N, p) e' Q^-1 e of the three coordinates of each


@lru_cache
def exact() -> Simulated:
    """A block without any error, with land and deep water."""
    plan = Plan(submerged=True, sea_control=True, noise=0.0, start_error=(0.0, 0.0), seed=5)
    simulated = simulate(plan)
    block, truth = simulated.block, simulated.truth.points
    plates = block.plates
    shallow = block.points.bathymetric & (truth[:, 2] > DEEP)
    once = np.bincount(plates.point, minlength=len(truth)) == 1
    kept = plates.triangulated & ~(shallow | once)[plates.point]
    control = block.control
    known = ~(shallow | once)[control.point]
    return altered(simulated, block={"plates": {"triangulated": kept}, "control": taken(control, known)})


def drawn(level: WaterLevel, rng: np.random.Generator) -> Block:
    """Return the block with errors in its images, control, tides, tilt and index, drawn from their sigmas."""
    block = exact().block
    sigma = np.where(np.isnan(block.plates.sigma), block.options.plate_sigma, block.plates.sigma)
    groups = GROUPS[level]
    _, number = np.unique(groups, return_inverse=True)
    tilt = rng.normal(0.0, TILT, 2)
    control = block.control
    return altered(
        block,
        options={"program": Program.IIIA, "water_level": level}
        | dict.fromkeys(("water_tilt", "water_index"), Treatment.ADJUST),
        water={
            "index": block.water.index + rng.normal(0.0, INDEX),
            "sigma": INDEX,
            "tilt_east": float(tilt[0]),
            "tilt_north": float(tilt[1]),
            "tilt_sigma": TILT,
        },
        photos={
            "tide": block.photos.tide + rng.normal(0.0, TIDE, number.max() + 1)[number],
            "tide_sigma": np.full(len(groups), TIDE),
            "tide_group": groups,
        },
        plates={"xy": block.plates.xy + rng.normal(0.0, sigma)},
        control=replace(control, position=control.position + rng.normal(0.0, control.sigma)),
    )


def normalised(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return e' Q^-1 e (k,) of errors (k, c) with covariances (k, c, c)."""
    scale = np.sqrt(np.einsum("kii->ki", covariance))
    whitened = np.linalg.solve(covariance / scale[:, :, None] / scale[:, None, :], (error / scale)[..., None])
    return np.einsum("ki,ki->k", error / scale, whitened[..., 0])


def water_errors(solution: Solution) -> np.ndarray:
    """Return the errors of tides, tilts and index over their sigmas, a priori."""
    water, true = solution.water, exact().block
    first = np.unique(GROUPS[solution.block.options.water_level], return_index=True)[1]
    error = np.concatenate([(water.tide - true.photos.tide)[first], water.tilt, [water.index - true.water.index]])
    sigma = np.concatenate([water.correction_sigma, water.tilt_sigma, [water.index_sigma]])
    return error / sigma * solution.sigma0


@lru_cache
def repeated(level: WaterLevel) -> Errors:
    rng = np.random.default_rng(list(GROUPS).index(level))
    truth = exact().truth
    variance, water, stations, points, freedom = [], [], [], [], 0
    for _ in range(BLOCKS):
        solution = adjust(drawn(level, rng))
        assert solution.converged, solution.reason
        unit = solution.sigma0**2
        variance.append(unit)
        freedom = solution.degrees_of_freedom
        water.append(water_errors(solution))
        found = solution.stations
        off = np.hstack([found.position - truth.position, found.attitude - truth.attitude])
        stations.append(normalised(off, found.covariance / unit))
        used = np.unique(solution.block.plates.point[solution.plates.triangulated])
        off = (solution.points.position - truth.points)[used]
        points.append(normalised(off, solution.points.covariance[used] / unit))
    return Errors(
        variance=np.array(variance),
        freedom=freedom,
        water=np.array(water),
        stations=np.array(stations),
        points=np.array(points),
    )


@pytest.mark.slow
@pytest.mark.parametrize("level", list(GROUPS))
def test_the_variance_of_unit_weight_is_one(level: WaterLevel) -> None:
    found = repeated(level)
    error = np.sqrt(2.0 / (found.freedom * BLOCKS))  # of the mean of chi-square over its degrees of freedom
    assert found.variance.mean() == pytest.approx(1.0, abs=LIMIT * error)
    assert found.variance.std() == pytest.approx(np.sqrt(2.0 / found.freedom), rel=0.6)  # 30 are good to 13 %


@pytest.mark.slow
@pytest.mark.parametrize("level", list(GROUPS))
def test_errors_of_the_water_have_unit_variance(level: WaterLevel) -> None:
    water = repeated(level).water
    assert np.abs(water.mean(axis=0)).max() < LIMIT / np.sqrt(BLOCKS)
    assert np.abs(np.square(water).mean(axis=0) - 1.0).max() < LIMIT * np.sqrt(2.0 / BLOCKS)


@pytest.mark.slow
@pytest.mark.parametrize("level", list(GROUPS))
def test_errors_of_stations_and_points_have_unit_variance(level: WaterLevel) -> None:
    """Of chi-square with c degrees of freedom the mean is c and the variance 2 c."""
    found = repeated(level)
    for squares, c in ((found.stations, 6), (found.points, 3)):
        off = (squares.mean(axis=0) - c) / np.sqrt(2.0 * c / BLOCKS)
        assert np.abs(off).max() < LIMIT


@pytest.mark.slow
def test_errors_of_all_blocks_together_have_unit_variance() -> None:
    """A prior of the water taken twice, say, would leave two thirds of its variance at the most."""
    found = [repeated(level) for level in GROUPS]
    levels = np.concatenate([one.water[:, :1] for one in found])
    rest = np.concatenate([one.water[:, -3:] for one in found])
    error = np.sqrt(2.0 / len(levels))
    squares = np.concatenate([np.square(levels), np.square(rest)], axis=1).mean(axis=0)
    np.testing.assert_allclose(squares, 1.0, atol=3.5 * error)  # of four
    # stations and points of a block are correlated: their means are at least as good as one of them
    stations = np.concatenate([one.stations for one in found])
    points = np.concatenate([one.points for one in found])
    assert stations.mean() / 6.0 == pytest.approx(1.0, abs=3.5 * error / np.sqrt(6.0))
    assert points.mean() / 3.0 == pytest.approx(1.0, abs=3.5 * error / np.sqrt(3.0))
    variance = np.concatenate([one.variance for one in found])
    assert variance.mean() == pytest.approx(1.0, abs=3.5 * error / np.sqrt(found[0].freedom))
