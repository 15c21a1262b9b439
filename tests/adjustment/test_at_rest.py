"""Converged: nothing adjusted changes any more, in its own sigmas, whatever the limits of the cards say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adjustment.water_jobs import deep, held_cameras, shallow
from altered import altered, with_options
from musatpy import read_deck
from musatpy.adjustment import adjust
from musatpy.adjustment.iteration import AT_REST, Linearisation
from musatpy.adjustment.job import in_digits
from musatpy.model import INDEX_RANGE, Block, Control, ControlKind, Refraction, Solution
from reference import compare, networks
from reference.networks import Plan


def in_sigmas(one: Solution, other: Solution) -> float:
    """The largest difference of two solutions of a block, stations and points, in the sigmas of the second."""
    stations, points = compare.apart(one, other)
    free = compare.sigmas(other.points.covariance) > 1e-9
    return max(float(np.abs(stations).max()), float(np.abs(points[free]).max(initial=0.0)))


def tighter(block: Block) -> Block:
    """The block with limits far below every sigma; still smaller ones would ask for less than rounding."""
    limits = {"rotation_limit": 1e-12, "translation_limit": 1e-7, "water_limit": 1e-7}
    return with_options(block, max_iterations=60, max_passes=60, **limits)


def test_held_cameras_do_not_end_a_run_whose_points_still_move() -> None:
    """The stations stay at once below every limit: with these alone points were 29 m off, sigma0 115."""
    block = held_cameras(2)
    solution = adjust(block)
    assert solution.converged, solution.reason
    assert in_sigmas(solution, adjust(tighter(block))) < AT_REST


def fixed_under_water(seed: int) -> Block:
    """A strip whose only points are submerged control held fixed: no point of it can move."""
    simulated = networks.simulate(Plan(submerged=True, seed=seed))
    block, truth = simulated.block, simulated.truth
    wet = np.flatnonzero(block.points.bathymetric)
    control = Control(
        point=wet,
        kind=np.full(len(wet), ControlKind.FULL),
        fixed=np.ones(len(wet), dtype=bool),
        position=truth.points[wet],
        sigma=np.full((len(wet), 3), np.nan),
    )
    used = block.plates.triangulated & block.points.bathymetric[block.plates.point]
    return altered(block, control=control, plates={"triangulated": used})


def test_passes_go_on_while_images_change_though_no_point_moves() -> None:
    """Control held fixed is at rest from the start; the corrections of its images follow the stations."""
    block = fixed_under_water(5)
    solution = adjust(with_options(block, refraction=Refraction.WATPT))
    assert solution.converged, solution.reason
    assert len(solution.passes) > 1
    assert solution.passes[0].movement == 0.0
    assert solution.passes[0].image_change > AT_REST > solution.passes[-1].image_change
    after_one = adjust(with_options(block, refraction=Refraction.WATPT, max_passes=1))
    assert not after_one.converged
    assert "the corrected image of point" in after_one.reason
    rigorous = adjust(with_options(block, refraction=Refraction.RIGOROUS))
    assert in_sigmas(solution, rigorous) < in_sigmas(after_one, rigorous)


@pytest.mark.slow
@pytest.mark.parametrize("refraction", [Refraction.WATPT, Refraction.RIGOROUS])
def test_what_converged_stays_where_it_is(refraction: Refraction) -> None:
    block = with_options(deep(2), refraction=refraction)
    solution = adjust(block)
    assert solution.converged, solution.reason
    # WATPT ends by the changes from pass to pass: what is left of their geometric series is a third of the last
    assert in_sigmas(solution, adjust(tighter(block))) < AT_REST


def test_change_bounds_every_function_of_the_unknowns() -> None:
    """sqrt(d'N d) against the changes of random functions in their sigmas; N of a small regular problem."""
    rng = np.random.default_rng(3)
    A = rng.normal(size=(12, 5))
    N, rhs = A.T @ A, rng.normal(size=5)
    step = np.linalg.solve(N, rhs)
    line = Linearisation(matrix=None, rhs=rhs, objective=9.0, context=None, redundancy=7)
    f = np.concatenate([rng.normal(size=(5, 200)), (N @ step)[:, None]], axis=1)
    sizes = np.abs(f.T @ step) / np.sqrt(np.einsum("ij,ik,kj->j", f, np.linalg.inv(N), f) * 9.0 / 7.0)
    assert sizes.max() == pytest.approx(line.change(step))
    assert (sizes[:-1] < line.change(step)).all()
    # images better than their sigmas do not make a change larger
    assert replace(line, objective=0.07).change(step) == pytest.approx(np.sqrt(step @ rhs))
    # and points that are not at their best count
    assert replace(line, of_points=4.0).change(step) > line.change(step)


def test_a_reason_names_what_is_above_its_limit_and_how_much() -> None:
    block = held_cameras(2)
    reasons = [adjust(with_options(block, max_iterations=most)).reason for most in (1, 2)]
    for reason in reasons:
        assert "point 20 still moves" in reason
        assert "sigmas" in reason
        assert "photo" not in reason.split(";")[0]  # the stations are at rest


@pytest.mark.parametrize(
    ("size", "text"), [(3.78341, "3.7834"), (0.0123, "0.0123"), (0.0000123, "0.000012"), (0.0, "0.0000")]
)
def test_sizes_are_never_printed_as_nothing(size: float, text: str) -> None:
    assert in_digits(size, 4) == text


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_an_index_that_nothing_determines_stays_in_its_range_and_ends_the_run(seed: int) -> None:
    """Depths below a metre at 3000 m: indices of 2.15 and -0.05 would fit best."""
    solution = adjust(shallow(seed))
    assert not solution.converged
    assert "refractive index would go to" in solution.reason
    assert INDEX_RANGE[0] <= solution.water.index <= INDEX_RANGE[1]


def test_a_sum_of_squares_that_is_not_finite_has_not_converged() -> None:
    """A point behind its camera has no residual: "converged, sigma0 inf" was printed where the stations rested."""
    solution = adjust(read_deck(Path(__file__).parents[2] / "fixtures/verdict/sigma0_inf_converged.crd"))
    assert not solution.converged
    assert "behind" in solution.reason
