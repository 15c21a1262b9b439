"""The kinds of observations: their partial derivatives against differences, and what they say of themselves."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from adjustment.test_musat3a import WATER, sea_block
from altered import altered
from musatpy.adjustment.job import prepared
from musatpy.adjustment.kinds import (
    DIRECT,
    KINDS,
    MEASURED,
    UNKNOWNS,
    direct_rows,
    direct_squares,
    state_after,
)
from musatpy.adjustment.kinds.measured import kept_axes
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.unknowns import State
from musatpy.formats.musat import read_deck
from musatpy.model import AirBases, Block, ObservationKind

FIXTURES = Path(__file__).parents[2] / "fixtures"
STEP = 1e-3  # m, rad; lengths bend by step / length, a millionth here
CASES = ("all by days", "all by photos", "unknown waves")


@lru_cache
def at_start(name: str) -> tuple[Network, State]:
    """Network and first state of a block with everything that can be observed."""
    if name in WATER:
        block = sea_block(**WATER[name])
        bases = AirBases(photo=[[0, 1], [3, 1]], length=[900.0, 1800.0], sigma=[0.1, 0.2])
        attitude = np.full_like(block.photos.attitude, 1e-4)
        block = altered(block, air_bases=bases, photos={"attitude_sigma": attitude})
    else:
        block = read_deck(FIXTURES / "waves" / "unknown.crd")
    job, state = prepared(block, None)
    return job.network, stepped(job.network, state, np.linspace(-1e-3, 1e-3, size(job.network)))


def size(network: Network) -> int:
    """The number of unknowns."""
    return network.photos * network.pattern.size + network.border.size


def stepped(network: Network, state: State, step: np.ndarray) -> State:
    """The state after a step of all unknowns, kept points too."""
    kept = network.border.kept
    local = step[size(network) - 3 * len(kept) :].reshape(-1, 3)
    ground = state.ground.copy()
    ground[kept] += np.einsum("kij,ki->kj", kept_axes(network, ground[kept]), local)
    return replace(state_after(network, state, step), ground=ground)


def jacobian(rows, count: int) -> np.ndarray:
    """The partials as a dense matrix."""
    J = np.zeros((len(rows.row), count))
    np.add.at(J, (np.arange(len(rows.row))[:, None], rows.index), rows.partials)
    return J


@pytest.mark.parametrize("name", CASES)
def test_the_partials_are_those_of_differences(name: str) -> None:
    network, state = at_start(name)
    steps = STEP * np.eye(size(network))
    sides = [
        [dict(direct_rows(network, stepped(network, state, sign * step))) for step in steps] for sign in (1, -1)
    ]
    for kind, rows in direct_rows(network, state):
        there, back = (np.stack([each[kind].residual for each in side], axis=1) for side in sides)
        # rounding of coordinates of kilometres leaves 1e-12 / 1e-3
        np.testing.assert_allclose(jacobian(rows, len(steps)), (there - back) / (2.0 * STEP), atol=1e-6)


def test_every_direct_kind_is_in_one_of_the_cases() -> None:
    assert {kind for name in CASES for kind, _ in direct_rows(*at_start(name))} == set(DIRECT)


@pytest.mark.parametrize("name", CASES)
def test_the_normal_equations_are_those_of_the_dense_matrix(name: str) -> None:
    network, state = at_start(name)
    normals = NormalEquations(network.pattern, network.border.size)
    matrix, rhs, squares = np.zeros((size(network),) * 2), np.zeros(size(network)), 0.0
    for _, rows in direct_rows(network, state):
        normals.add_rows(rows.index, rows.partials, rows.weight, rows.residual)
        J = jacobian(rows, size(network))
        matrix += J.T @ (rows.weight[:, None] * J)
        rhs -= J.T @ (rows.weight * rows.residual)
        squares += float(rows.weight @ np.square(rows.residual))
    # what nothing observes gets a diagonal of one
    np.fill_diagonal(matrix, np.where(np.diagonal(matrix) == 0.0, 1.0, np.diagonal(matrix)))
    found, right = normals.finished()
    # rounding of sums of a few terms
    np.testing.assert_allclose(found.times(np.eye(size(network))), matrix, rtol=1e-12)
    np.testing.assert_allclose(right, rhs, rtol=1e-12, atol=1e-9)
    assert direct_squares(network, state) == pytest.approx(squares, rel=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_weights_are_taken_off_by_the_table(name: str) -> None:
    block = sea_block(**WATER[name]) if name in WATER else read_deck(FIXTURES / "waves" / "unknown.crd")
    network = prepared(block, None)[0].network
    for kind in KINDS:
        if kind.searched:
            weight = kind.weights(network, block)
            halved = kind.weighted(network, block, np.full_like(weight, 0.5))
            np.testing.assert_array_equal(kind.weights(halved, block), 0.5 * weight)


def test_the_columns_of_the_border_are_those_of_the_kinds() -> None:
    network, _ = at_start("all by days")
    border = network.border
    assert [kind.observed for kind in UNKNOWNS] == list(border.columns)
    numbers = np.concatenate([border.numbers(kind.observed) for kind in UNKNOWNS])
    np.testing.assert_array_equal(numbers, np.arange(border.first_kept))
    assert len(border.names([str(point) for point in range(network.points)])) == border.size


def test_every_kind_but_the_images_has_a_file() -> None:
    assert [kind.observed for kind in KINDS] == [
        each for each in ObservationKind if each is not ObservationKind.PLATE
    ]


@pytest.mark.parametrize("kind", MEASURED, ids=lambda kind: kind.cause)
def test_what_was_measured_has_its_names_in_the_lists(kind) -> None:
    assert kind.cause.listed == kind.cause.value and kind.cause.cards and kind.cause.advice


def test_ends_of_what_takes_no_part() -> None:
    """The quantity of a row whose end has no position is not a number; others are those of the positions."""
    block: Block = sea_block()
    job, state = prepared(block, None)
    ground = state.ground.copy()
    ground[block.distances.point[0, 0]] = np.nan
    (kind,) = [each for each in MEASURED if each.observed is ObservationKind.DISTANCE]
    values = kind.values(block, job.network, replace(state, ground=ground))
    touched = (block.distances.point == block.distances.point[0, 0]).any(axis=1)
    assert np.isnan(values[touched]).all() and np.isfinite(values[~touched]).all()
