"""Control with covariances: a dense bundle with the whole matrix, differences, three sigmas, draws."""

import json
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from adjustment.test_equivalence import assert_covariances_equal, assert_equals_bundle, simulated
from adjustment.test_musat3a import TIGHT, exact_where_known, sea_block
from altered import added, altered, with_options
from blocks import converged, simulation
from musatpy import adjust, listing
from musatpy.adjustment.ground import point_normals, prior_rows
from musatpy.adjustment.job import prepared
from musatpy.model import (
    Block,
    CauseKind,
    ControlKind,
    CoordinateSystem,
    Editing,
    ObservationKind,
    Program,
    Refraction,
)
from musatpy.reports.record import dumps, record
from musatpy.simulation import Simulation
from musatpy.statistics import Statistics
from musatpy.statistics.quality import DETECTABLE
from reference import compare, dense_bundle
from reference.networks import Plan

FULL, HORIZONTAL, VERTICAL, CHECK = ControlKind
CORRELATIONS = np.array([[0.8, -0.5, -0.7], [-0.3, 0.9, 0.0], [0.0, 0.0, 0.95]])
SIGMAS = np.array([0.05, 0.2, 0.6])  # m
PLANS = {
    "local": Plan(photos_per_strip=4, seed=31),
    "geographic, kinds, level": Plan(
        system=CoordinateSystem.GEOGRAPHIC, photos_per_strip=4, kinds=(FULL, HORIZONTAL, CHECK, VERTICAL),
        fixed_every=5, equal_elevation=True, seed=32,
    ),
    "geocentric, submerged": Plan(
        system=CoordinateSystem.GEOCENTRIC, submerged=True, sea_control=True, kinds=(FULL, HORIZONTAL), seed=33
    ),
}  # fmt: skip


def correlated(block: Block) -> Block:
    """The block whose control has covariances, where it may."""
    k = len(block.control.point)
    sigma = np.where(
        np.isnan(block.control.sigma), np.nan, np.resize(np.concatenate([SIGMAS, SIGMAS[::-1]]), (k, 3))
    )
    may = (block.control.kind != VERTICAL) & ~block.control.fixed
    sigma[may] = np.where(np.isnan(sigma[may]), 0.1, sigma[may])
    correlation = np.where(may[:, None], np.resize(CORRELATIONS, (k, 3)), np.nan)
    return altered(block, control={"sigma": sigma, "correlation": correlation})


@lru_cache
def case(name: str) -> tuple[Block, dense_bundle.Result]:
    plan = PLANS[name]
    block = correlated(simulated(plan).block)
    return block, dense_bundle.solve(block, simulated(plan).truth, refraction=plan.submerged)


@pytest.mark.parametrize("program", list(Program))
@pytest.mark.parametrize("name", PLANS)
def test_equals_the_dense_bundle_with_the_whole_matrix(name: str, program: Program) -> None:
    block, result = case(name)
    refraction = Refraction.RIGOROUS if PLANS[name].submerged else Refraction.NONE
    solution = converged(block, program=program, refraction=refraction)
    assert_equals_bundle(solution, result)
    assert_covariances_equal(solution, result)


def test_kept_points_and_levels_equal_the_dense_bundle() -> None:
    """Distances to control, whose coordinates stay unknowns, and control in a group of one level."""
    block = sea_block()
    control, groups = block.control, block.equal_elevations
    seen = control.point[(np.bincount(block.plates.point, minlength=len(block.points.ids)) >= 2)[control.point]]
    ends = replace(block.distances, point=np.array([seen[:2], seen[1:3], seen[2:4]]))
    given = compare.beside(converged(block)).points[ends.point]
    ends = replace(ends, length=np.linalg.norm(given[:, 1] - given[:, 0], axis=1))
    level = replace(groups, group=np.append(groups.group, 0), point=np.append(groups.point, seen[4]))
    sigma = np.append(groups.sigma[1:], 50.0)  # that of the first group, so that it bends nothing
    block = correlated(exact_where_known(block))
    block = altered(block, distances=ends, equal_elevations=replace(level, sigma=sigma[::-1]))
    assert block.control.correlated[np.isin(control.point, seen[:5])].any()
    solution = converged(block)
    result = dense_bundle.solve(block, compare.beside(solution), refraction=True)
    assert_equals_bundle(solution, result)
    assert_covariances_equal(solution, result)


@pytest.mark.parametrize("name", PLANS)
def test_partials_are_those_of_differences(name: str) -> None:
    job, state = prepared(case(name)[0], None)
    network, step = job.network, 1e-2  # m
    for group in network.control_groups:
        normals = point_normals(network, state, group, state.ground[group.point])
        assert normals.priors is not None
        for axis in range(3):
            move = step * normals.axes[:, axis]
            there, back = (
                prior_rows(network, state, group.point, state.ground[group.point] + sign * move).deviation
                for sign in (1.0, -1.0)
            )
            known = (normals.priors.weight > 0.0) & normals.priors.free[:, axis, None]
            # nanometres of geocentric coordinates over a step of centimetres, and the curvature of the level
            np.testing.assert_allclose(
                np.where(known, normals.priors.by_point[:, :, axis], 0.0),
                np.where(known, (back - there) / (2.0 * step), 0.0),
                atol=2e-5,
            )


@pytest.mark.parametrize("program", list(Program))
def test_no_correlation_is_three_sigmas(program: Program) -> None:
    """To rounding: points of covariances go by numpy, others by compiled loops."""
    plain = with_options(simulated(PLANS["local"]).block, program=program, **TIGHT)
    whole = altered(plain, control={"correlation": np.zeros_like(plain.control.sigma)})
    one, other = converged(plain), converged(whole)
    np.testing.assert_allclose(other.stations.position, one.stations.position, rtol=1e-12)
    np.testing.assert_allclose(other.points.position, one.points.position, rtol=1e-12, atol=1e-9)
    assert other.sum_of_squares == pytest.approx(one.sum_of_squares, rel=1e-9)
    assert one.observed is not None and other.observed is not None
    np.testing.assert_allclose(other.observed.redundancy, one.observed.redundancy, atol=1e-9)


def test_the_tests_of_components_are_those_of_baarda() -> None:
    """w = (P v) / sqrt(P Qvv P) of correlated observations, by the dense Jacobian; what these find."""
    block, _ = case("local")
    solution = converged(block, program=Program.IIIA, **TIGHT)
    network = dense_bundle.Network(block, refraction=False)
    state = dense_bundle.starting_state(network, compare.beside(solution))
    J, v = network.jacobian(state), network.misclosures(state)
    Qvv = np.eye(len(v)) - J @ np.linalg.solve(J.T @ J, J.T)
    first = sum(int(kind.used.sum()) for kind in network.kinds[:1])
    statistics, observed, row = Statistics(solution), solution.observed, first
    found, expected, detectable = [], [], []
    assert network.kinds[1].name == "control" and observed is not None
    for card in range(len(block.control.point)):
        rows = np.arange(row, row + 3)
        row += 3
        C = block.control.covariance[card]
        values, vectors = np.linalg.eigh(C)
        root = vectors @ np.diag(values**-0.5) @ vectors.T  # P = root root; whitened v = root v
        Pv, PQP = root @ v[rows], root @ Qvv[np.ix_(rows, rows)] @ root
        of = (observed.kind == ObservationKind.CONTROL) & (observed.row == card)
        assert observed.component[of].tolist() == [0, 1, 2]
        expected.append(Pv / np.sqrt(np.diagonal(PQP)))
        found.append(statistics.standardised[of])
        detectable.append(statistics.detectable[of] / DETECTABLE * np.sqrt(np.diagonal(PQP)))
    checked = np.isfinite(found)
    assert checked.sum() > 10
    np.testing.assert_allclose(np.array(found)[checked], np.array(expected)[checked], atol=1e-6)
    np.testing.assert_allclose(np.array(detectable)[checked], 1.0, atol=1e-6)


@pytest.mark.parametrize("component", range(3))
def test_an_error_of_a_component_moves_its_point_as_told(component: int) -> None:
    """By differences: a card that is a millimetre off in one component."""
    block = with_options(case("local")[0], program=Program.IIIA, **TIGHT)
    solution, card = converged(block), 3
    moved = converged(altered(block, control={"position": added((card, component), 1e-3)}))
    of = (solution.observed.kind == ObservationKind.CONTROL) & (solution.observed.row == card)
    (told,) = solution.observed.influence[of & (solution.observed.component == component)]
    point = block.control.point[card]
    change = moved.points.position[point] - solution.points.position[point]
    np.testing.assert_allclose(change / 1e-3, told, atol=1e-4)  # curvature


@pytest.mark.parametrize(
    ("component", "kind"), [("vertical", CauseKind.VERTICAL), ("horizontal", CauseKind.CONTROL)]
)
@pytest.mark.slow
def test_a_wrong_component_is_the_cause_with_its_own_error(component: str, kind: CauseKind) -> None:
    """The errors of a cause are those of east, north, up of the card, whatever is correlated with them."""
    made = strip(4, blunders={"control": [{"number": 1, "component": component, "size": [8.0, 8.0]}]})
    (row,) = np.flatnonzero(made.truth.gross_control.any(axis=1))
    solution = adjust(made.block)
    cause = solution.causes[0]
    assert cause.kind is kind and cause.points == (made.block.points.ids[made.block.control.point[row]],)
    gross = made.truth.control_error[row]
    assert np.abs(cause.size - gross[[2] if component == "vertical" else slice(None)]).max() < 3.0 * SIGMAS[2]
    edited = adjust(with_options(made.block, editing=Editing.EDIT))
    changed = edited.block.control.kind[edited.block.control.point == made.block.control.point[row]]
    assert changed.tolist() == [HORIZONTAL if component == "vertical" else CHECK]


def test_what_the_columns_are_is_noted_and_the_covariances_are_recorded() -> None:
    solution = adjust(strip(5).block)
    text, table = listing(solution), json.loads(dumps(record(solution)))["control"]
    assert text.count("Each test of control with covariances (CTC)") == 2
    assert table["given_correlation"][0] == [0.8, -0.5, -0.7]
    plain = altered(
        solution.block, control={"correlation": np.full((len(solution.block.control.point), 3), np.nan)}
    )
    assert "covariances" not in listing(adjust(plain))


def strip(seed: int, **tables: Any) -> Simulation:
    """A strip with correlated errors of its control."""
    return simulation(
        seed,
        job={"system": "LOCL"},
        flight={"photos": 4, "strips": 2, "height": 1000.0},
        points={"extra": [{"number": 6}]},
        control=[{"kind": "full", "number": 8, "sigma": SIGMAS.tolist(), "error": SIGMAS.tolist(),
                  "correlation": [0.8, -0.5, -0.7]}],
        stations={"position_error": 5.0, "attitude_error": 0.1},
        options={"program": "IIIA"},
        **tables,
    )  # fmt: skip


def draw(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors over sigmas of the points and stations of a strip with correlated errors of its control."""
    made = strip(seed)
    solution = converged(made.block)
    unscaled = 1.0 / solution.sigma0**2
    points = solution.points.position - made.truth.points.xyz
    L = np.linalg.cholesky(solution.points.covariance * unscaled)
    stations = (solution.stations.position - made.truth.stations.xyz)[:, None] @ np.linalg.inv(
        np.linalg.cholesky(solution.stations.covariance[:, :3, :3] * unscaled)
    ).swapaxes(1, 2)
    return np.linalg.solve(L, points[..., None]).ravel(), stations.ravel()


@pytest.mark.slow
def test_errors_of_correlated_draws_are_as_large_as_their_covariances() -> None:
    """150 draws: RMS of what the covariances of points and stations make of their errors."""
    for ratios in zip(*(draw(2000 + seed) for seed in range(150)), strict=True):
        assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.05)
