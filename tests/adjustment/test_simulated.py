"""The adjustment on simulated strips, whose images come from a ray trace that shares nothing with it."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from altered import altered, put, with_options
from musatpy.adjustment import adjust
from musatpy.errors import AdjustmentError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import Block, ControlKind, PointStatus, Refraction, Solution, Weights
from musatpy.model.tables import taken
from musatpy.simulation import Simulation, simulate

SPECS = Path(__file__).resolve().parents[1] / "simulation" / "specs"
CLARKE = Ellipsoid("clrk66")


@lru_cache
def simulated(name: str) -> Simulation:
    return simulate(SPECS / f"{name}.toml")


def largest_errors(simulation: Simulation, solution: Solution) -> tuple[float, float]:
    """Return the largest errors of stations and of triangulated points, m, against the truth."""
    true = simulation.truth
    known = solution.points.status == PointStatus.TRIANGULATED
    stations = CLARKE.geocentric(solution.stations.position) - true.stations.xyz
    points = CLARKE.geocentric(solution.points.position[known]) - true.points.xyz[known]
    return float(np.linalg.norm(stations, axis=1).max()), float(np.linalg.norm(points, axis=1).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["strip", "bad_start"])
@pytest.mark.parametrize("refraction", [Refraction.WATPT, Refraction.RIGOROUS])
def test_noise_free_strips_give_the_truth_below_a_millimetre(name: str, refraction: Refraction) -> None:
    """Starts of 100 m and 2 degrees among them. What is left is the rounding of the cards, 1e-6 mm of plate."""
    simulation = simulated(name)
    solution = adjust(with_options(simulation.block, refraction=refraction))
    assert solution.converged, solution.reason
    stations, points = largest_errors(simulation, solution)
    assert stations < 1e-3
    assert points < 1e-3


@pytest.mark.parametrize("weights", [Weights.DIAGONAL, Weights.EQUAL])
def test_simple_weights_find_the_truth_of_noise_free_strips_from_bad_starts(weights: Weights) -> None:
    simulation = simulated("bad_start")
    solution = adjust(with_options(simulation.block, weights=weights))
    assert solution.converged, solution.reason
    assert max(largest_errors(simulation, solution)) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_starts_of_100_m_and_2_degrees_in_any_direction(seed: int) -> None:
    simulation = simulated("strip")
    block, rng = simulation.block, np.random.default_rng(seed)
    n = len(block.photos.ids)
    position = block.photos.position + rng.choice([-1, 1], (n, 3)) * [100 / 6.37e6, 100 / 6.0e6, 100.0]
    attitude = block.photos.attitude + rng.choice([-1, 1], (n, 3)) * np.radians(2.0)
    solution = adjust(altered(block, photos={"position": position, "attitude": attitude}))
    assert solution.converged, solution.reason
    assert max(largest_errors(simulation, solution)) < 1e-3


def test_a_run_that_does_not_converge_says_what_still_moves() -> None:
    block = simulated("bad_start").block
    solution = adjust(with_options(block, max_iterations=2, refraction=Refraction.NONE))
    assert not solution.converged
    assert "limits not reached in 2 iterations: photo 10" in solution.reason
    last = solution.iterations[-1]
    assert f"still moves {last.translation:.4f} m" in solution.reason
    assert np.isfinite(solution.stations.position).all()


def test_water_points_that_do_not_come_to_rest_are_said() -> None:
    solution = adjust(with_options(simulated("strip").block, max_passes=1))
    assert not solution.converged
    assert "water points not at rest in 1 pass: point " in solution.reason


def test_progress_reports_every_iteration() -> None:
    seen = []
    solution = adjust(simulated("strip").block, seen.append)
    assert tuple(seen) == solution.iterations


def problems(block: Block) -> str:
    with pytest.raises(AdjustmentError) as caught:
        adjust(with_options(block, refraction=Refraction.NONE))
    return "\n".join(problem.headline() for problem in caught.value.problems)


NOT_HELD = ": the control does not hold it"


@pytest.mark.parametrize(
    ("kind", "points", "texts"),
    [
        (
            ControlKind.FULL,
            0,
            [
                "free in shift east, shift north, shift up, rotation about east, rotation about north, ",
                "rotation about up, scale" + NOT_HELD,
            ],
        ),
        (ControlKind.HORIZONTAL, None, ["free in shift up" + NOT_HELD]),
        (ControlKind.VERTICAL, None, ["free in shift east, shift north, rotation about up" + NOT_HELD]),
        (ControlKind.FULL, 2, ["the block as a whole is free in one motion", "rotation about"]),
    ],
    ids=["no control", "horizontal", "vertical", "two points: the turn about their line"],
)
def test_what_control_leaves_free_is_named(kind: ControlKind, points: int | None, texts: list[str]) -> None:
    block = simulated("strip").block
    complete = (np.isfinite(block.control.position) & np.isfinite(block.control.sigma)).all(axis=1)
    kinds = np.full(len(complete), ControlKind.CHECK)
    kinds[np.flatnonzero(complete)[:points]] = kind
    found = problems(altered(block, control={"kind": kinds}))
    assert all(text in found for text in texts)


def test_a_photo_with_two_rays_is_named_with_its_free_unknowns() -> None:
    block = simulated("strip").block
    text = problems(
        altered(block, plates={"triangulated": put(np.flatnonzero(block.plates.photo == 0)[2:], False)})
    )
    assert "not determined, alone or against each other: photo 101 " in text
    assert "photo 102" not in text


def test_a_photo_without_rays_stays_where_it_is_and_is_listed() -> None:
    block = simulated("strip").block
    triangulated = block.plates.triangulated & (block.plates.photo != 0)
    solution = adjust(altered(block, plates={"triangulated": triangulated}))
    assert "photo 101 has no usable measurement: it stays where it was given" in solution.warnings
    # to and fro between geographic and geocentric coordinates: a few nanometres
    np.testing.assert_allclose(solution.stations.position[0], block.photos.position[0], rtol=0.0, atol=1e-7)
    assert np.isnan(solution.stations.covariance[0]).all()
    assert np.isfinite(solution.stations.covariance[1:]).all()


def test_control_without_value_or_sigma_is_refused_by_name() -> None:
    block = simulated("strip").block
    point = block.points.ids[block.control.point[0]]
    text = problems(altered(block, control={"sigma": put((0, 1), np.nan)}))
    assert text == f"control point {point}: its sigmas are not all given"


def test_water_must_be_known_where_points_are_submerged() -> None:
    block = simulated("strip").block
    tide = block.photos.tide.copy()
    tide[1] = np.nan
    with pytest.raises(AdjustmentError) as caught:
        adjust(altered(block, water=None, photos={"tide": tide}))
    text = str(caught.value)
    assert "no refractive index of the water" in text
    assert "photo 102 shows submerged points, but its tide is not given" in text
    dry = with_options(replace(block, water=None), refraction=Refraction.NONE)
    assert np.isfinite(adjust(dry).sigma0)


def test_points_that_cannot_be_used_are_listed_with_their_reason() -> None:
    block = simulated("strip").block
    row = int(np.flatnonzero(np.bincount(block.plates.point)[block.plates.point] == 2)[0])
    point = int(block.plates.point[row])
    if point in block.control.point:
        pytest.fail("the strip changed: choose a point without control")
    plates = taken(block.plates, np.arange(len(block.plates.point)) != row)
    solution = adjust(replace(block, plates=plates))
    assert solution.points.status[point] == PointStatus.NOT_DETERMINED
    assert solution.points.reasons[point] == "measured on one photo only, and without control"
    assert np.isnan(solution.points.position[point]).all()
