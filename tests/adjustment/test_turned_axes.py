"""Cameras that look along the east-west line: a phi of 90 degrees is no reason to fail, and sigmas are the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from altered import altered, with_options
from musatpy import adjust, read_deck, verdict
from musatpy.adjustment.job import prepared
from musatpy.adjustment.unknowns import stated_partials, with_turned_axes
from musatpy.geometry.rotations import attitude_from_matrix, attitude_matrix
from musatpy.model import Block, Grade, Program, Solution
from musatpy.units import DEGREE
from reference.rays import rotation

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
        for name in ("residual", "redundancy", "sigma"):
            one, other = (
                {
                    (int(o.kind[i]), int(o.row[i]), int(o.component[i])): getattr(o, name)[i]
                    for i in range(len(o.kind))
                }
                for o in (turned.observed, plain.observed)
            )
            assert one.keys() == other.keys()
            for key, value in one.items():
                assert value == pytest.approx(other[key], rel=1e-4, abs=1e-7)
    both = adjust(altered(block, photos=held))
    assert both.converged
    assert np.isfinite(both.stations.covariance).all()


def test_other_photos_stay_as_they_are() -> None:
    job, _ = prepared(looking(6.0 * DEGREE), None)
    assert with_turned_axes(replace(job.network)).turned.size == 0
