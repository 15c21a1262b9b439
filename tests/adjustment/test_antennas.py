"""Antenna positions: turned axes, exact recovery, free blocks, systems of decks, errors against sigmas."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import musatpy
from altered import altered, put
from blocks import converged, simulation
from musatpy.adjustment.iteration import with_turned_axes
from musatpy.adjustment.job import prepared
from musatpy.adjustment.kinds.gnss import ANTENNA
from musatpy.errors import AdjustmentError
from musatpy.formats.job_tables import card_family
from musatpy.formats.musat import check_deck, deck_bytes
from musatpy.geometry.collinearity import attitude_from_matrix
from musatpy.jobs.agreement import Part
from musatpy.jobs.extract import extracted
from musatpy.jobs.merge import MergeOptions, merged
from musatpy.model import EllipsoidSpec, Grade, Solution, SystemSpec
from musatpy.model.block import in_order_of_ids
from musatpy.model.tables import columns
from musatpy.simulation import Simulation
from musatpy.statistics import Statistics

CONTROL = [{"kind": "full", "number": 4, "sigma": 0.03, "error": 0.03}]
ALL = {
    "error": [0.05, 0.05, 0.08],
    "sigma": [0.05, 0.05, 0.08],
    "lever_arm": [0.3, -0.2, 1.5],
    "lever_arm_error": [0.1] * 3,
    "lever_arm_sigma": [0.1] * 3,
    "shift": [0.3] * 3,
    "shift_sigma": [0.3] * 3,
    "drift": [0.01] * 3,
    "drift_sigma": [0.01] * 3,
}


def flown(seed: int, antenna: dict[str, Any] | None = None, **tables: Any) -> Simulation:
    """Two strips of four photos with antenna positions."""
    return simulation(
        seed,
        **{
            "job": {"system": "LOCL"},
            "flight": {
                "strips": 2,
                "photos": 4,
                "height": 1000.0,
                "reverse_alternate": True,
                "attitude_scatter": [2.0, 2.0, 3.0],
                "station_scatter": [10.0, 10.0, 10.0],
            },
            "terrain": {"relief": 30.0},
            "points": {"extra": [{"number": 20}]},
            "measurement": {"noise": 5.0, "sigma": 5.0},
            "stations": {"position_error": 2.0, "attitude_error": 0.05},
            "control": CONTROL,
            "antenna": {name: value for name, value in (ALL | (antenna or {})).items() if value is not None},
            "options": {"program": "IIIA"},
        }
        | tables,
    )


def deviations(simulated: Simulation, solution: Solution) -> np.ndarray:
    """Adjusted minus true of all parameters, in sigmas with the a priori unit weight."""
    table = solution.parameters
    assert table is not None
    true = {(of.owner, of.name): of.value for of in simulated.truth.parameters}
    error = [true[key] for key in zip(table.owner.tolist(), table.parameter.tolist(), strict=True)]
    return (table.value - np.array(error)) / table.spread * solution.unit_sigma


def test_what_is_without_errors_comes_out() -> None:
    """Shift, drift and lever arm, each free where the others leave it, to the rounding of the cards."""
    for free in ("shift", "lever_arm"):
        exact = {"error": [0.0] * 3, "lever_arm_error": [0.0] * 3, "shift_sigma": None, "drift_sigma": None}
        exact |= {"lever_arm_sigma": None, f"{free}_free": True}
        exact |= {"drift_free": True} if free == "shift" else {"shift": [0.0] * 3, "drift": [0.0] * 3}
        simulated = flown(
            3,
            exact,
            control=[{"kind": "full", "number": 6, "sigma": 0.001}],
            measurement={"noise": 0.0, "sigma": 1.0},
        )
        block = simulated.block
        if free == "lever_arm":  # from another start
            block = altered(block, lever_arms={"offset": np.zeros((1, 3))})
        table = converged(block).parameters
        assert table is not None and table.count == (12 if free == "shift" else 3)
        true = {(of.owner, of.name): of.value for of in simulated.truth.parameters}
        for owner, name, value in zip(table.owner, table.parameter, table.value, strict=True):
            assert value == pytest.approx(true[str(owner), str(name)], abs=2e-4), (owner, name)


def test_signs_are_those_of_the_manual() -> None:
    """observed = station + M' lever + shift + drift (t - mean t): by the truth alone, without an adjustment."""
    simulated = flown(5, {"error": [0.0] * 3})
    block, truth = simulated.block, simulated.truth
    value = {(of.owner, of.name): of.value for of in truth.parameters}
    omega, phi, kappa = truth.attitude.T
    for photo in range(block.photos.count):
        line = str(block.antenna_positions.line[photo])
        of_line = block.antenna_positions.line == line
        t = block.exposure_times.time - block.exposure_times.time[of_line].mean()
        M = np.eye(3)
        for axis, angle in ((0, omega[photo]), (1, phi[photo]), (2, kappa[photo])):
            turn, (a, b) = np.eye(3), [k for k in range(3) if k != axis]
            c, s = np.cos(angle), np.sin(angle) * (-1.0 if axis == 1 else 1.0)
            turn[[a, a, b, b], [a, b, a, b]] = c, s, -s, c
            M = turn @ M
        expected = truth.stations.xyz[photo] + M.T @ [value["CAM1", f"ARM {axis}"] for axis in "XYZ"]
        expected = expected + [
            value[line, f"SHIFT {axis}"] + value[line, f"DRIFT {axis}"] * t[photo] for axis in "ENU"
        ]
        np.testing.assert_allclose(block.antenna_positions.position[photo], expected, atol=1e-4)


def test_partials_of_photos_along_turned_axes() -> None:
    """A block on its side: photos near a phi of 90 degrees are adjusted along other axes."""
    block = flown(2).block
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    network = prepared(block, None)[0].network
    state = prepared(block, None)[1]
    side = with_turned_axes(replace(network, attitude=attitude_from_matrix(state.M @ turn.T)))
    assert side.turned.all()
    state = replace(state, axes=side.axes, attitude=side.attitude + 0.01)
    part = ANTENNA.deviations(side, state)

    def residual(step: np.ndarray) -> np.ndarray:
        position = state.position + np.einsum("nji,j->ni", side.axes, step[:3])
        moved = replace(state, position=position, attitude=state.attitude + step[3:])
        return ANTENNA.deviations(side, moved).residual

    for k, step in enumerate(1e-4 * np.eye(6)):
        by_difference = (residual(step) - residual(-step)) / 2e-4
        np.testing.assert_allclose(part.by_station[:, :, k], by_difference, atol=1e-7)


def test_covariances_weigh_as_their_inverses() -> None:
    """The weighted squares of components along principal axes are v' C^-1 v along east, north, up."""
    block = flown(7, {"correlation": [0.6, -0.3, 0.2]}).block
    job, state = prepared(block, None)
    rows = ANTENNA.rows(job.network, state)
    v = ANTENNA.values(block, job.network, state)
    C = block.antenna_positions.covariance
    expected = np.einsum("ai,aij,aj->a", v, np.linalg.inv(C), v)
    np.testing.assert_allclose((rows.weight * rows.residual**2).reshape(-1, 3).sum(axis=1), expected, rtol=1e-9)
    left = ANTENNA.without(block, np.arange(block.photos.count) == 2)  # as EDIT drops a card
    assert 2 not in left.antenna_positions.photo and left.antenna_positions.count == block.photos.count - 1


@pytest.mark.slow
def test_free_shifts_of_all_lines_leave_a_block_undetermined() -> None:
    """Without control the cards are refused with words; where nobody reads them, the motions are named."""
    free = {"shift_sigma": None, "shift_free": True}
    block = flown(4, free, control=[]).block
    _, problems = check_deck(deck_bytes(block, card_family()), card_family())
    assert any("free shifts and drifts of lines leave nothing" in problem.message for problem in problems)
    with pytest.raises(AdjustmentError, match="free in shift east, shift north, shift up"):
        musatpy.adjust(block)
    held = altered(block, antenna_lines={"shift_free": put([0], False)})
    assert check_deck(deck_bytes(held, card_family()), card_family())[0] is not None
    assert converged(held).parameters is not None


def test_a_free_network_gives_no_numbers_for_free_shifts() -> None:
    free = {"shift_sigma": None, "shift_free": True}
    block = flown(4, free, control=[], options={"program": "IIIA", "datum": "FREE"}).block
    solution = converged(block)
    table = solution.parameters
    assert table is not None
    shifts = np.array([name.startswith("SHIFT") for name in table.parameter.tolist()])
    assert np.isnan(table.sigma[shifts]).all() and np.isfinite(table.sigma[~shifts]).all()
    verdict = musatpy.verdict(solution)
    assert verdict.grade is Grade.DOUBTFUL and "SHIFT E of line L1" in str(verdict)
    assert solution.sigma0 == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(("number", "grade"), [(2, Grade.DOUBTFUL), (3, Grade.ACCEPTED)])
def test_little_control_does_not_determine_free_shifts(number: int, grade: Grade) -> None:
    """By two points two lines are known to metres, by three to decimetres."""
    free = {"shift_sigma": None, "shift_free": True, "drift_sigma": None, "drift_free": True}
    control = [{"kind": "full", "number": number, "sigma": 0.03, "error": 0.03}]
    solution = converged(flown(4, free, control=control).block)
    assert musatpy.verdict(solution).grade is grade and solution.parameters is not None
    assert np.isnan(solution.parameters.sigma).any() == (grade is Grade.DOUBTFUL)


def test_antenna_positions_need_no_unknowns() -> None:
    """Lines are named, and neither they nor anything else has an unknown of its own."""
    nothing = dict.fromkeys(name for name in ALL if name.startswith(("lever", "shift", "drift")))
    simulated = flown(3, nothing, control=[])
    block, truth = simulated.block, simulated.truth.stations.xyz
    assert not block.antenna_lines.count and set(block.antenna_positions.line.tolist()) == {"L1", "L2"}
    solution = converged(block)
    assert solution.parameters is None and musatpy.verdict(solution).grade is Grade.ACCEPTED
    assert np.abs(solution.stations.position - truth).max() < 0.3


@pytest.mark.parametrize("system", ["LOCL", "GEOG", "GEOC"])
def test_decks_of_every_system_give_the_same(system: str) -> None:
    block = flown(6, job={"system": system, "centre": [18.0, -65.0] if system != "LOCL" else [0.0, 0.0]}).block
    again, problems = check_deck(deck_bytes(block, card_family()), card_family())
    assert again is not None, problems
    tables = again.antenna_positions, block.antenna_positions
    np.testing.assert_allclose(tables[0].position, tables[1].position, rtol=1e-15, atol=1e-9)
    assert np.abs(deviations(flown(6, job={"system": system}), converged(again))).max() < 4.0


@pytest.mark.parametrize("sigmas", ["LOCL", "SYST"])
@pytest.mark.parametrize("kind", ["PROJ", "GEOC", "GEOG"])
def test_decks_in_other_words_come_back(kind: str, sigmas: str) -> None:
    """A projected system, geocentric axes: positions to the rounding of cards, covariances to that of sigmas."""
    block = flown(6, {"correlation": [0.5, -0.3, 0.2]}, job={"centre": [18.0, -65.0]}).block
    definition = "EPSG:32620" if kind == "PROJ" else ""
    spec = SystemSpec(kind=kind, definition=definition, sigmas=sigmas)
    block = replace(block, given_in=spec, ellipsoid=EllipsoidSpec(name="WGS84"))
    again, problems = check_deck(deck_bytes(block, card_family()), card_family())
    assert again is not None, problems
    off = (again.antenna_positions.position - block.antenna_positions.position) * [6.4e6, 6.4e6, 1.0]
    assert np.abs(off).max() < 1e-3
    matrices = again.antenna_positions.covariance, block.antenna_positions.covariance
    np.testing.assert_allclose(matrices[0], matrices[1], rtol=1e-4, atol=1e-7)


def test_parts_of_a_job_and_merged_jobs_keep_them() -> None:
    block = flown(6, {"correlation": [0.5, -0.3, 0.2]}).block
    first, rest = (extracted(block, photos).block for photos in (np.arange(8) < 4, np.arange(8) >= 2))
    assert first.antenna_lines.line.tolist() == ["L1"] and first.antenna_positions.count == 4
    parts = [Part(name="first", block=first), Part(name="rest", block=rest)]
    whole = merged(parts, MergeOptions(join_photos=True)).block
    for name in ("antenna_positions", "exposure_times", "antenna_lines", "lever_arms"):
        one, other = (in_order_of_ids(each).tables()[name] for each in (block, whole))
        for column in columns(type(one)):
            np.testing.assert_array_equal(getattr(one, column), getattr(other, column), err_msg=name)


@pytest.mark.slow
def test_errors_are_as_large_as_their_sigmas() -> None:
    """Fifty draws: RMS of errors over sigmas, within three of its own; the test of sigma0."""
    ratios, passes = [], 0
    for seed in range(50):
        simulated = flown(1000 + seed)
        solution = converged(simulated.block)
        ratios.append(deviations(simulated, solution))
        passes += bool(Statistics(solution).sigma0.accepted)
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    np.testing.assert_array_less(np.abs(rms - 1.0), 3.0 / np.sqrt(2 * 50))
    assert abs(np.sqrt(np.mean(np.square(ratios))) - 1.0) < 0.09
    assert 0.86 * 50 <= passes


def test_antenna_positions_place_a_block_that_nothing_else_does() -> None:
    """COMPUTE without control and without station cards."""
    computed = {"program": "IIIA", "initial": "COMPUTE"}
    simulated = flown(4, control=[], options=computed, points={"extra": [{"number": 60}]})
    text = deck_bytes(simulated.block, card_family()).decode()
    cards = [card for card in text.splitlines(keepends=True) if not card.startswith(("STX", "ATT"))]
    block, problems = check_deck("".join(cards).encode(), card_family())
    assert block is not None, problems
    solution = converged(block)
    assert musatpy.verdict(solution).grade is Grade.ACCEPTED
    assert np.abs(solution.stations.position - simulated.truth.stations.xyz).max() < 2.0
