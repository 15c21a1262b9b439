"""Free networks: inner constraints against a dense pseudo-inverse, and what they must leave alone."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from musatpy.adjustment import adjust
from musatpy.errors import AdjustmentError
from musatpy.model import (
    Block,
    ControlKind,
    CoordinateSystem,
    Datum,
    Distances,
    Program,
    Refraction,
    Solution,
)
from reference import compare, dense_bundle
from reference.networks import Plan, simulate

TIGHT = {"rotation_limit": 1e-9, "translation_limit": 1e-6, "max_iterations": 40}


def free_block(plan: Plan, kinds: tuple[ControlKind, ...] = ()) -> Block:
    """The block of a plan without control but that of `kinds`, as a free network of IIIA."""
    block = simulate(plan).block
    kept = np.isin(block.control.kind, kinds)
    control = replace(block.control, kind=np.where(kept, block.control.kind, ControlKind.CHECK))
    options = replace(
        block.options, program=Program.IIIA, datum=Datum.FREE, refraction=Refraction.RIGOROUS, **TIGHT
    )
    return replace(block, control=control, options=options)


@lru_cache
def solved(plan: Plan, kinds: tuple[ControlKind, ...] = ()) -> Solution:
    solution = adjust(free_block(plan, kinds))
    assert solution.converged, solution.reason
    return solution


def dense_cofactors(solution: Solution, defect: int) -> tuple[np.ndarray, dense_bundle.Network]:
    """Q under the inner constraints over the points, from the eigenvectors of the dense normal matrix."""
    block = solution.block
    network = dense_bundle.Network(block, refraction=True)
    stations, points = solution.stations, solution.points
    start = dense_bundle.Start(
        position=stations.position, attitude=in_given_frame(solution), points=points.position
    )
    J = network.jacobian(dense_bundle.starting_state(network, start))
    scale = np.linalg.norm(J, axis=0)
    values, vectors = np.linalg.eigh((J / scale).T @ (J / scale))
    assert values[defect] > 1e4 * abs(values[defect - 1])  # the defect is what it should be
    H = vectors[:, :defect] / scale[:, None]
    Q = (vectors[:, defect:] / values[defect:]) @ vectors[:, defect:].T / np.outer(scale, scale)
    E = H.copy()
    E[: 6 * len(block.photos.ids)] = 0.0
    S = np.eye(len(Q)) - H @ np.linalg.solve(E.T @ H, E.T)
    return S @ Q @ S.T, network


def in_given_frame(solution: Solution) -> np.ndarray:
    """Attitudes of a local job need no turning."""
    assert solution.block.options.system is CoordinateSystem.LOCAL
    return solution.stations.attitude


@pytest.mark.parametrize(
    ("plan", "defect"),
    [
        (Plan(photos_per_strip=4), 7),
        (Plan(photos_per_strip=4, air_base=True), 6),
        (Plan(photos_per_strip=4, attitude_sigma=1e-4), 4),
    ],
    ids=["nothing known", "a base gives the scale", "attitudes known"],
)
def test_covariances_are_those_of_a_dense_pseudo_inverse(plan: Plan, defect: int) -> None:
    solution = solved(plan)
    assert solution.observations["inner constraints"] == defect
    Q, network = dense_cofactors(solution, defect)
    n = len(solution.block.photos.ids)
    stations = Q[: 6 * n, : 6 * n].reshape(n, 6, n, 6)[np.arange(n), :, np.arange(n)]
    index = network.ground_index[network.determined]
    points = Q[index[:, :, None], index[:, None, :]]
    unit = solution.sigma0**2
    # the eigenvectors of the defect are good to about 1e-7 of the motions
    for ours, theirs in (
        (solution.stations.covariance / unit, stations),
        (solution.points.covariance[network.determined] / unit, points),
    ):
        assert np.abs(compare.covariance_difference(ours, theirs)).max() < 1e-5


def test_images_are_those_of_any_datum() -> None:
    """Residuals, sigma0 and redundancy do not change when the given stations say something else."""
    free = solved(Plan(photos_per_strip=4))
    rng = np.random.default_rng(5)
    photos = free.block.photos
    elsewhere = photos.position + rng.normal(0.0, 30.0, photos.position.shape)
    again = adjust(replace(free.block, photos=replace(photos, position=elsewhere)))
    np.testing.assert_allclose(again.plates.residual, free.plates.residual, atol=1e-9)  # mm; limits of the steps
    assert again.sigma0 == pytest.approx(free.sigma0, rel=1e-9)
    assert again.degrees_of_freedom == free.degrees_of_freedom


def test_known_tides_are_no_datum_for_the_scale() -> None:
    """Heights and tilts come from the water; the scale, which it hardly holds, from the given stations."""
    plan = Plan(photos_per_strip=4, submerged=True, start_error=(5.0, 1e-3))
    solution = solved(plan)
    assert solution.observations["inner constraints"] == 4
    assert any("1 of its 4 free motions" in warning for warning in solution.warnings)
    truth = simulate(plan).truth.points
    known = np.isfinite(solution.points.position).all(axis=1)
    assert truth is not None
    # 5 m and 1 mrad of the given stations, through rays that meet at 24 degrees
    assert np.abs(solution.points.position - truth)[known].max() < 60.0


def test_points_stay_about_where_the_given_stations_put_them() -> None:
    """Shifted stations shift the whole result, and nothing else."""
    free = solved(Plan(photos_per_strip=4))
    photos = free.block.photos
    shifted = adjust(
        replace(free.block, photos=replace(photos, position=photos.position + np.array([30.0, -20.0, 5.0])))
    )
    known = np.isfinite(free.points.position).all(axis=1)
    move = (shifted.points.position - free.points.position)[known]
    np.testing.assert_allclose(move, np.broadcast_to([30.0, -20.0, 5.0], move.shape), atol=1e-6)  # rounding


def test_a_distance_gives_the_scale() -> None:
    plan = Plan(photos_per_strip=4)
    block = free_block(plan)
    known = np.flatnonzero(np.isfinite(solved(plan).points.position).all(axis=1))
    ends = solved(plan).points.position[known[[0, -1]]]
    length = float(np.linalg.norm(ends[1] - ends[0])) * 1.001
    measured = Distances(point=known[None, [0, -1]], length=[length], sigma=[0.01])
    solution = adjust(replace(block, distances=measured))
    assert solution.converged
    assert solution.observations["inner constraints"] == 6
    assert solution.distances[0] == pytest.approx(length, abs=1e-6)  # nothing else speaks of the scale
    assert solution.degrees_of_freedom == solved(plan).degrees_of_freedom


def test_a_datum_by_control_of_a_free_block_is_refused() -> None:
    block = free_block(Plan(photos_per_strip=4))
    with pytest.raises(AdjustmentError, match="the block as a whole is free in shift east"):
        adjust(replace(block, options=replace(block.options, datum=Datum.CONTROL)))


def test_control_makes_the_option_do_nothing() -> None:
    plan = Plan(photos_per_strip=4, kinds=(ControlKind.FULL,))
    held = free_block(plan, (ControlKind.FULL,))
    free, usual = adjust(held), adjust(replace(held, options=replace(held.options, datum=Datum.CONTROL)))
    np.testing.assert_array_equal(free.points.position, usual.points.position)
    np.testing.assert_array_equal(free.stations.covariance, usual.stations.covariance)
