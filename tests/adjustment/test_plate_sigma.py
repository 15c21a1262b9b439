"""A guessed plate sigma: its variance component, and errors against the sigmas that are stated with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from altered import altered, with_options
from musatpy import adjust
from musatpy.adjustment.job import plate_component, with_plate_sigmas
from musatpy.model import Block, PlateSigma, Program, Solution
from reference.networks import Plan, Simulated, simulate

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
    solution = adjust(block)
    assert plate_component(solution) == pytest.approx(1.0, abs=1e-4)
    assert solution.plate_factor == pytest.approx(SHARE, rel=0.25)  # of 30 degrees of freedom
    np.testing.assert_allclose(solution.block.plate_sigmas, block.plate_sigmas * solution.plate_factor, rtol=1e-12)
    for name in ("control", "photos"):
        assert getattr(solution.block, name) is getattr(block, name)
    # the same sigmas known give the same answer, and the estimate does not depend on the guess
    known = adjust(with_options(solution.block, plate_sigma_is=PlateSigma.KNOWN))
    np.testing.assert_array_equal(known.points.position, solution.points.position)
    np.testing.assert_array_equal(known.points.covariance, solution.points.covariance)
    better = adjust(with_plate_sigmas(block, 2.0))
    assert better.plate_factor == pytest.approx(solution.plate_factor / 2.0, rel=1e-3)
    other = adjust(guessed(made, Program.IIA))
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
    short = adjust(guessed(made, max_iterations=1))
    assert not short.converged
    assert short.plate_factor == 1.0
    solution = adjust(guessed(made))
    unchecked = altered(solution, observed={"redundancy": np.zeros_like(solution.observed.redundancy)})
    assert plate_component(unchecked) is None
    exact = simulate(Plan(photos_per_strip=3, seed=2, noise=0.0))  # residuals are rounding: no sigma at all
    assert adjust(guessed(exact)).converged


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
