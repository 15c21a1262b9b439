"""Kinds of observations: partials, weights, the border; turned axes; order of whole numbers."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from adjustment.test_musat3a import WATER, sea_block
from altered import altered, with_options
from blocks import FIXTURES
from musatpy import adjust, verdict
from musatpy.adjustment.iteration import State, stated_partials
from musatpy.adjustment.job import prepared
from musatpy.adjustment.kinds import DIRECT, MEASURED, direct_rows, direct_squares, state_after
from musatpy.adjustment.network import Network, kept_axes
from musatpy.adjustment.normals import NormalEquations
from musatpy.formats.musat import read_deck
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.model import (
    AirBases,
    AntennaLines,
    AntennaPositions,
    Block,
    ExposureTimes,
    Grade,
    InertialAttitudes,
    InertialConvention,
    LensUnknowns,
    LeverArms,
    Misalignments,
    ObservationKind,
    Ports,
    Program,
    Solution,
)
from musatpy.model.tables import Table
from musatpy.units import DEGREE
from reference.rays import rotation

STEP = 1e-3  # m, rad; lengths bend by step / length, a millionth here
CASES = ("all by days", "all by photos", "unknown waves")


def antennas(block: Block) -> dict[str, Table]:
    """Antenna positions of a line with covariances and of photos of none; all that can be unknown of them is."""
    n = block.photos.count
    some, sigma, correlation = np.arange(n), np.full((n, 3), 0.1), np.full((n, 3), np.nan)
    sigma[0], correlation[0] = [0.1, 0.2, 0.3], [0.5, -0.3, 0.6]
    return {
        "antenna_positions": AntennaPositions(
            photo=some,
            line=np.where(some < n - 1, "A", ""),
            position=block.photos.position + np.array([1e-7, 2e-7, 3.0]),
            sigma=sigma,
            correlation=correlation,
        ),
        "exposure_times": ExposureTimes(photo=some, time=5.0 * some**1.1),
        "lever_arms": LeverArms(
            camera=[0], offset=[[0.3, -0.2, 1.4]], sigma=[[0.1, np.nan, np.nan]], free=np.array([True])
        ),
        "antenna_lines": AntennaLines(
            line=np.array(["A"]), shift_sigma=np.array([[np.nan, 0.2, 0.3]]), drift_sigma=np.full((1, 3), 0.01),
            shift_free=np.array([True]),
        ),
    }  # fmt: skip


def inertial(block: Block) -> dict[str, object]:
    """An inertial unit whose attitudes are up to two radians off, its misalignment partly unknown."""
    photos = block.photos.count
    angles = np.random.default_rng(3).uniform(-1.0, 1.0, (photos, 3)) + block.photos.attitude
    return {
        "inertial_convention": InertialConvention(angles="OPK"),
        "inertial_attitudes": InertialAttitudes(
            photo=np.arange(photos), angles=angles, sigma=np.full((photos, 3), 1e-3)
        ),
        "misalignments": Misalignments(
            camera=[0], angles=[[0.4, -0.7, 2.5]], sigma=[[0.1, np.nan, np.nan]], free=np.array([True])
        ),
    }


@lru_cache
def at_start(name: str) -> tuple[Network, State]:
    """Network and first state of a block with everything that can be observed."""
    if name in WATER:
        block = sea_block(**WATER[name])
        bases = AirBases(photo=[[0, 1], [3, 1]], length=[900.0, 1800.0], sigma=[0.1, 0.2])
        attitude = np.full_like(block.photos.attitude, 1e-4)
        sigma = np.array([0.1, 0.2, 0.3])
        lens = LensUnknowns(
            camera=np.zeros(3, dtype=int), parameter=np.array(["F", "B1", "PD"]), value=sigma + 152.0, sigma=sigma
        )
        block = altered(block, air_bases=bases, photos={"attitude_sigma": attitude}, lens_unknowns=lens)
        window = Ports(camera=[0], distance=[152.0], thickness=[10.0], glass_index=[1.5], water_index=[1.0])
        block = replace(block, **antennas(block), **inertial(block), ports=window)
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
    # rounding of sums of a few terms, some of which cancel to zero
    np.testing.assert_allclose(found.times(np.eye(size(network))), matrix, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(right, rhs, rtol=1e-12, atol=1e-9)
    assert direct_squares(network, state) == pytest.approx(squares, rel=1e-12)


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


DECK = Path(__file__).parent / "starts" / "phi_90.crd"
NOISE = np.random.default_rng(90).normal(0.0, 0.01, (6, 2))  # mm


def looking(turn: float, north: float = 0.0) -> Block:
    """Return the job of the deck turned about the north by an angle (rad), images with noise."""
    block = read_deck(DECK)
    R = rotation(np.array([0.0, turn, north]))
    M = attitude_matrix(block.photos.attitude) @ R.T
    return altered(
        block,
        plates={"xy": block.plates.xy + NOISE},
        photos={"position": block.photos.position @ R.T, "attitude": attitude_from_matrix(M)},
        control={"position": block.control.position @ R.T},
    )


def turned_back(solution: Solution, turn: float) -> np.ndarray:
    return solution.stations.position @ rotation(np.array([0.0, turn, 0.0]))


@pytest.mark.parametrize("program", list(Program))
@pytest.mark.parametrize("degrees", [0.0, 1e-9, 1e-6, 1e-3, 1.0, -1.0])
def test_a_phi_of_90_degrees_converges_as_any(program: Program, degrees: float) -> None:
    solution = adjust(with_options(looking(degrees * DEGREE), program=program))
    aside = adjust(with_options(looking(30.0 * DEGREE), program=program))
    assert solution.converged
    assert verdict(solution).grade is Grade.ACCEPTED
    assert len(solution.iterations) <= len(aside.iterations) + 1
    assert solution.sum_of_squares == pytest.approx(aside.sum_of_squares, rel=1e-5)
    places = turned_back(solution, degrees * DEGREE), turned_back(aside, 30.0 * DEGREE)
    np.testing.assert_allclose(*places, atol=1e-6)  # the limits of the iterations
    R = rotation(np.array([0.0, (degrees - 30.0) * DEGREE, 0.0]))
    expected = R @ aside.stations.covariance[0, :3, :3] @ R.T
    np.testing.assert_allclose(solution.stations.covariance[0, :3, :3], expected, rtol=1e-4, atol=1e-10)
    assert np.isfinite(solution.stations.covariance).all()


def test_stated_partials_are_those_by_differences() -> None:
    job, state = prepared(looking(1.0 * DEGREE), None)
    network = job.network
    assert network.turned.tolist() == [True]

    def of(attitude: np.ndarray) -> np.ndarray:
        M = attitude_matrix(attitude) @ state.axes
        return attitude_from_matrix(M @ np.swapaxes(network.frame.axes(network.position), 1, 2))[0]

    partials = stated_partials(network, state)[0]
    for angle in range(3):
        step = 1e-6 * np.eye(3)[angle]
        by_difference = (of(state.attitude + step) - of(state.attitude - step)) / 2e-6
        np.testing.assert_allclose(partials[3:6, 3 + angle], by_difference, rtol=1e-5, atol=1e-6)
    east_north_up = network.frame.axes(network.position)[0] @ network.axes[0].T
    np.testing.assert_array_equal(partials[:3, :3], east_north_up)
    assert not partials[:3, 3:].any()


@pytest.mark.slow
def test_sigmas_are_those_without_turned_axes(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 86 degrees both ways work: stations, sigmas and tests of observed positions and attitudes are the same."""
    block = looking(4.0 * DEGREE)
    held = {"position_sigma": np.array([[0.02, 0.03, 0.04]]), "attitude_sigma": np.full((1, 3), 2.0 * DEGREE)}
    for sigmas in ({}, {"position_sigma": held["position_sigma"]}):
        observed = altered(block, photos=sigmas)
        turned = adjust(observed)
        with monkeypatch.context() as without:
            without.setattr("musatpy.adjustment.job.with_turned_axes", lambda network: network)
            plain = adjust(observed)
        np.testing.assert_allclose(turned.stations.position, plain.stations.position, atol=1e-6)
        np.testing.assert_allclose(turned.stations.attitude, plain.stations.attitude, atol=1e-7)
        np.testing.assert_allclose(turned.stations.covariance, plain.stations.covariance, rtol=1e-4, atol=1e-12)
        np.testing.assert_allclose(turned.points.covariance, plain.points.covariance, rtol=1e-4, atol=1e-12)
        for name in ("kind", "row", "component"):
            np.testing.assert_array_equal(getattr(turned.observed, name), getattr(plain.observed, name))
        assert turned.held is not None and plain.held is not None
        np.testing.assert_allclose(turned.held.sigmas, plain.held.sigmas, rtol=1e-3, atol=1e-6)
        for name in ("residual", "redundancy", "sigma"):
            values = getattr(turned.observed, name), getattr(plain.observed, name)
            np.testing.assert_allclose(*values, rtol=1e-4, atol=1e-7)
    both = adjust(altered(block, photos=held))
    assert both.converged
    assert np.isfinite(both.stations.covariance).all()
