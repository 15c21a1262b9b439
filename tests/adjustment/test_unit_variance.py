"""Errors are as large as their sigmas say: of all unknowns, of guessed plates, of depths."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import cycle, islice, product
from typing import Any

import numpy as np
import pytest

import musatpy
from adjustment.test_equivalence import simulated
from altered import altered, with_options
from blocks import converged
from musatpy.adjustment import adjust
from musatpy.adjustment.job import plate_component, with_plate_sigmas
from musatpy.model import Block, Grade, PlateSigma, Program, Refraction, Solution, Treatment, WaterLevel
from musatpy.model.tables import taken
from musatpy.statistics.verdict import verdict
from reference.dense_bundle import Network, starting_state
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
def repeated(level: WaterLevel) -> dict[str, np.ndarray]:
    """Return what N blocks gave, a priori: sigma0 squared (N,), and degrees of freedom.

    Errors (N, w) of level corrections, tilts and index over their sigmas; e' Q^-1 e of the six parameters of
    stations (N, n) and the three coordinates of points (N, p).
    """
    rng = np.random.default_rng(list(GROUPS).index(level))
    truth = exact().truth
    found: dict[str, list[Any]] = defaultdict(list)
    for _ in range(BLOCKS):
        solution = converged(drawn(level, rng))
        unit, stations, points = solution.sigma0**2, solution.stations, solution.points
        found["variance"].append(unit)
        found["freedom"].append(solution.degrees_of_freedom)
        found["water"].append(water_errors(solution))
        off = np.hstack([stations.position - truth.position, stations.attitude - truth.attitude])
        found["stations"].append(normalised(off, stations.covariance / unit))
        used = np.unique(solution.block.plates.point[solution.plates.triangulated])
        off = (points.position - truth.points)[used]
        found["points"].append(normalised(off, points.covariance[used] / unit))
    return {name: np.array(values) for name, values in found.items()}


@pytest.mark.slow
@pytest.mark.parametrize("level", list(GROUPS))
def test_errors_of_water_stations_and_points_have_unit_variance(level: WaterLevel) -> None:
    """Of chi-square with c degrees of freedom the mean is c and the variance 2 c."""
    found = repeated(level)
    assert np.abs(found["water"].mean(axis=0)).max() < LIMIT / np.sqrt(BLOCKS)
    for squares, c in ((np.square(found["water"]), 1), (found["stations"], 6), (found["points"], 3)):
        off = (squares.mean(axis=0) - c) / np.sqrt(2.0 * c / BLOCKS)
        assert np.abs(off).max() < LIMIT


@pytest.mark.slow
def test_errors_of_all_blocks_together_have_unit_variance() -> None:
    """A prior of the water taken twice, say, would leave two thirds of its variance at the most."""
    found = [repeated(level) for level in GROUPS]
    water = np.concatenate([of_level["water"][:, [0, -3, -2, -1]] for of_level in found])
    error = np.sqrt(2.0 / len(water))
    squares = np.square(water).mean(axis=0)
    np.testing.assert_allclose(squares, 1.0, atol=3.5 * error)  # of four
    # stations and points of a block are correlated: their means are at least as good as one of them
    for name, c in (("stations", 6.0), ("points", 3.0), ("variance", 1.0)):
        mean = np.concatenate([of_level[name] for of_level in found]).mean()
        freedom = found[0]["freedom"][0] if name == "variance" else c
        assert mean / c == pytest.approx(1.0, abs=3.5 * error / np.sqrt(freedom)), name


SHARE = 3.0  # of the true plate sigma in the guess: a third


def guessed(made: Simulated, program: Program = Program.IIIA, **options: float) -> Block:
    block = with_plate_sigmas(made.block, 1.0 / SHARE)
    limits = {"rotation_limit": 1e-7, "translation_limit": 1e-4, "max_iterations": 30} | options
    return with_options(block, program=program, plate_sigma_is=PlateSigma.GUESS, **limits)


def squared_errors(made: Simulated, solution: Solution) -> dict[str, np.ndarray]:
    """Return squared errors over stated variances, of stations, points and control."""
    station = solution.stations.position - made.truth.position
    point = solution.points.position - made.truth.points
    of_stations = np.diagonal(solution.stations.covariance, axis1=1, axis2=2)[:, :3]
    of_points = np.diagonal(solution.points.covariance, axis1=1, axis2=2)
    known = np.isin(np.arange(len(point)), solution.block.control.point)
    points = point**2 / of_points
    return {"stations": station**2 / of_stations, "points": points[~known], "control": points[known]}


@pytest.mark.slow
def test_plates_alone_are_weighed_until_their_component_is_one() -> None:
    made = simulate(Plan(submerged=True, station_sigma=0.05, photos_per_strip=4, seed=3))
    block = guessed(made)
    solution = musatpy.adjust(block)
    assert plate_component(solution) == pytest.approx(1.0, abs=1e-4)
    assert solution.plate_factor == pytest.approx(SHARE, rel=0.25)  # of 30 degrees of freedom
    np.testing.assert_allclose(solution.block.plate_sigmas, block.plate_sigmas * solution.plate_factor, rtol=1e-12)
    for name in ("control", "photos"):
        assert getattr(solution.block, name) is getattr(block, name)
    # the same sigmas known give the same answer, and the estimate does not depend on the guess
    known = musatpy.adjust(with_options(solution.block, plate_sigma_is=PlateSigma.KNOWN))
    np.testing.assert_array_equal(known.points.position, solution.points.position)
    np.testing.assert_array_equal(known.points.covariance, solution.points.covariance)
    better = musatpy.adjust(with_plate_sigmas(block, 2.0))
    assert better.plate_factor == pytest.approx(solution.plate_factor / 2.0, rel=1e-3)
    other = musatpy.adjust(guessed(made, Program.IIA))
    assert other.plate_factor == pytest.approx(solution.plate_factor, rel=1e-4)  # one minimum
    assert known.plate_factor == 1.0


def test_errors_of_considered_water_are_not_those_of_plates() -> None:
    made = simulate(Plan(submerged=True, photos_per_strip=4, seed=3))
    solution = adjust(made.block)
    assert solution.observed is not None
    plain = plate_component(solution)
    variances = np.where(solution.observed.sigma > 0.0, 0.1 * np.square(solution.observed.sigma), 0.0)
    considered = replace(solution, observed=replace(solution.observed, considered=variances))
    assert plain is not None
    assert plate_component(considered) < plain


@pytest.mark.slow
def test_plates_that_nothing_checks_or_that_fail_keep_their_guess() -> None:
    made = simulate(Plan(photos_per_strip=3, seed=2))
    short = musatpy.adjust(guessed(made, max_iterations=1))
    assert not short.converged
    assert short.plate_factor == 1.0
    solution = adjust(guessed(made))
    unchecked = altered(solution, observed={"redundancy": np.zeros_like(solution.observed.redundancy)})
    assert plate_component(unchecked) is None
    exact = simulate(Plan(photos_per_strip=3, seed=2, noise=0.0))  # residuals are rounding: no sigma at all
    assert musatpy.adjust(guessed(exact)).converged


@pytest.mark.slow
def test_errors_are_as_large_as_their_sigmas_say() -> None:
    squares: dict[str, list[np.ndarray]] = {"stations": [], "points": [], "control": []}
    for seed in range(12):
        made = simulate(Plan(submerged=True, station_sigma=0.05, photos_per_strip=4, seed=seed))
        for name, values in squared_errors(made, adjust(guessed(made))).items():
            squares[name].append(values)
    ratios = {name: float(np.sqrt(np.nanmean(np.concatenate(values)))) for name, values in squares.items()}
    # 12 strips that correlate within: 0.08; sigma0 for all alike gives 0.54 for stations and 0.61 for control
    assert ratios == pytest.approx({"stations": 1.0, "points": 1.0, "control": 1.0}, abs=0.16)


@pytest.mark.slow
@pytest.mark.parametrize("program", list(Program))
def test_large_blocks_find_their_plate_sigma(program: Program) -> None:
    made = simulate(Plan(photos_per_strip=72, strips=3, seed=1))
    solution = adjust(guessed(made, program))
    assert solution.converged
    assert solution.plate_factor == pytest.approx(SHARE, rel=0.03)  # of some thousand degrees of freedom


_DRAWS = 24  # three of each combination
_TIDE, _INDEX = 0.30, 0.004  # m, and of the index
_IIIA: dict[str, Any] = {"program": Program.IIIA}
PROGRAMS: dict[str, dict[str, Any]] = {
    "IIA": {"program": Program.IIA, "refraction": Refraction.RIGOROUS},
    "IIIA": _IIIA,
    "IIIA, levels and index adjusted": {
        **_IIIA,
        "water_level": WaterLevel.GROUP,
        "water_index": Treatment.ADJUST,
    },
}


@lru_cache
def scene(tide: float = _TIDE) -> Simulated:
    """A strip of four photos over control on land and points under water, exact, at its true stations."""
    plan = Plan(
        submerged=True, photos_per_strip=4, noise=0.0, control_errors=False, start_error=(0.0, 0.0),
        plate_sigma=0.003, seed=31,
    )  # fmt: skip
    simulation = simulated(plan)
    tides = {"tide_sigma": np.full(4, tide), "tide_group": np.array(["A", "A", "B", "B"])}
    return altered(simulation, block={"photos": tides, "water": {"sigma": _INDEX}})


def draws(count: int, tide_sigma: float = _TIDE) -> Iterator[tuple[Block, np.ndarray]]:
    """Yield blocks with errors of everything that has a sigma, and the true depths (p,) at the true tides."""
    simulation, rng = scene(tide_sigma), np.random.default_rng(5)
    block, truth = simulation.block, simulation.truth
    control, plates = block.control, block.plates
    rays = np.bincount(plates.point, minlength=len(block.points.ids))
    plate_sigma = np.where(np.isnan(plates.sigma), block.options.plate_sigma, plates.sigma)
    for signs in islice(cycle(product((-1.0, 1.0), repeat=3)), count):
        tide = block.photos.tide + tide_sigma * np.array(signs)[[0, 0, 1, 1]]
        index = block.water.index + _INDEX * signs[2]
        true = Network(altered(block, water={"index": index}, photos={"tide": tide}), refraction=True)
        rows = np.arange(len(plates.photo))
        state = starting_state(true, truth)
        xy = true.project(state, plates.photo, plates.point, np.zeros((len(rows), 13)), true.wet(rows))
        given = control.position + rng.normal(size=control.position.shape) * np.nan_to_num(control.sigma)
        noisy = np.real(xy) + rng.normal(size=xy.shape) * plate_sigma
        level = np.bincount(plates.point, weights=tide[plates.photo], minlength=len(rays)) / rays
        yield (
            replace(block, plates=replace(plates, xy=noisy), control=replace(control, position=given)),
            level - truth.points[:, 2],
        )


def ratio(options: dict[str, Any], count: int) -> tuple[float, float, float]:
    """Return the RMS of the errors of depths over their sigmas, that over sigmas of heights, and mean sigma0."""
    sums, number, sigma0 = np.zeros(2), 0, []
    for block, depth in draws(count):
        solution = converged(replace(block, options=replace(block.options, **options)))
        found = solution.bathymetric
        off = found.depth - depth[found.point]
        of_height = np.sqrt(solution.points.covariance[found.point, 2, 2])
        sums += np.nansum(np.square([off / found.depth_sigma, off / of_height]), axis=1)
        number += np.isfinite(off).sum()
        sigma0.append(solution.unit_sigma)
    return *np.sqrt(sums / number).tolist(), float(np.mean(sigma0))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["IIA", "IIIA"])
def test_errors_of_poor_tides_are_no_reason_to_doubt_a_run_that_knows_them(name: str) -> None:
    """Tides that are off by metres bend the images by several of their sigmas, and the blocks are accepted."""
    sums = []
    for block, _ in draws(8, 2.0):
        options = replace(block.options, **PROGRAMS[name])
        known = adjust(replace(block, options=options))
        blank = {"tide_sigma": np.full(4, np.nan)}
        trusted = adjust(altered(block, options=options, photos=blank, water={"sigma": None}))
        assert trusted.sigma0 == known.sigma0
        sums.append((known.sigma0, known.unit_sigma, verdict(known).grade, verdict(trusted).grade))
    sigma0, unit_sigma, known_grades, trusted_grades = zip(*sums, strict=True)
    assert set(known_grades) == {Grade.ACCEPTED}
    assert trusted_grades.count(Grade.ACCEPTED) < 6 and max(sigma0) > 1.5
    assert np.sqrt(np.mean(np.square(unit_sigma))) == pytest.approx(1.0, abs=0.1)  # two standard errors


@pytest.mark.slow
@pytest.mark.parametrize("name", ["IIA", "IIIA, levels and index adjusted"])
def test_errors_of_depths_are_as_large_as_their_sigmas(name: str) -> None:
    depths, heights, unit = ratio(PROGRAMS[name], _DRAWS)
    assert depths == pytest.approx(1.0, abs=0.17)  # two and a half standard errors and more
    assert heights > 1.3 * depths
    assert unit == pytest.approx(1.0, abs=0.042)
