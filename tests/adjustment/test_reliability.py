"""Redundancy numbers, influences, inflation, correlations: dense matrices, refits and repeated simulation."""

from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np
import pytest

from adjustment.test_equivalence import LAND, SEA, simulated, solved
from adjustment.test_musat3a import TIGHT, WATER, sea_block, simultaneous
from altered import added, altered, with_options
from musatpy.model import Block, ObservationKind, Program, Refraction, Solution, Weights
from reference import considered, dense_bundle
from reference.networks import Plan

BLOCKS = 40


@lru_cache
def with_all_water(name: str = "all by days") -> tuple[Solution, np.ndarray, np.ndarray]:
    """The sea block with all unknowns of the water, its dense Jacobian, and (J'J)^-1."""
    block = sea_block(**WATER[name])
    solution, network = simultaneous(block), dense_bundle.Network(block, refraction=True)
    J = network.jacobian(considered.state_of(network, solution))
    return solution, J, considered.cofactors(J)


EVERY: dict[str, Callable[[], Solution]] = {
    **{f"{name}, {program}": partial(solved, LAND[name], Refraction.NONE, program=program)
       for name in LAND for program in Program},
    **{f"{name}, {refraction}, {weights}": partial(solved, SEA[name], refraction, weights)
       for name in SEA for refraction in (Refraction.WATPT, Refraction.RIGOROUS) for weights in Weights},
    **{f"{name} water": lambda name=name: simultaneous(sea_block(**WATER[name])) for name in WATER},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("solution", EVERY.values(), ids=EVERY)
def test_redundancy_numbers_add_up(solution: Callable[[], Solution]) -> None:
    """On land, under water and where it is unknown, by both programs."""
    observed = solution().observed
    assert observed.redundancy.sum() == pytest.approx(solution().degrees_of_freedom, abs=1e-6)
    assert len(observed.kind) == sum(solution().observations.values())


@pytest.mark.slow
def test_redundancy_numbers_are_those_of_the_dense_inverse() -> None:
    solution, J, inverse = with_all_water()
    observed = solution.observed
    dense = 1.0 - np.einsum("ij,jk,ik->i", J, inverse, J)
    ties = np.isin(observed.kind, (ObservationKind.DISTANCE, ObservationKind.HEIGHT_DIFFERENCE))
    water = np.isin(observed.kind, (6, 7, 8))
    order = np.concatenate([np.flatnonzero(~ties & ~water), np.flatnonzero(ties), np.flatnonzero(water)])
    # the inverse loses some digits
    np.testing.assert_allclose(observed.redundancy[order], dense, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["all by days", "all by photos"])
def test_inflation_and_correlations_are_those_of_the_dense_matrix(name: str) -> None:
    """Levels of photos stand with the six unknowns of these, and before the other ones of the water."""
    solution, J, inverse = with_all_water(name)
    found, block = solution.dependence, solution.block
    n, p = len(block.photos.ids), len(block.points.ids)
    inflation = np.diag(J.T @ J) * np.diag(inverse)
    np.testing.assert_allclose(found.station_inflation, inflation[: 6 * n].reshape(n, 6), rtol=1e-4)
    first = 6 * n + 3 * p
    globals_ = np.arange(first, len(inverse))
    if name == "all by photos":
        assert found.names[:n].tolist() == [f"photo {photo} water level" for photo in block.photos.ids]
        g = len(solution.levels)
        globals_ = first + np.array([*range(g, g + n), *range(g), *range(g + n, len(globals_))])
    sigma = np.sqrt(np.diag(inverse))
    np.testing.assert_allclose(found.inflation[: len(globals_)], inflation[globals_], rtol=1e-4)
    np.testing.assert_allclose(found.sigma[: len(globals_)], sigma[globals_] * solution.sigma0, rtol=1e-4)
    R = inverse / np.outer(sigma, sigma)
    chosen = np.concatenate([np.arange(6 * n), globals_])
    strong = np.abs(np.triu(R[np.ix_(chosen, chosen)], 1))
    ends = [end.startswith("point ") for end in (*found.first.tolist(), *found.second.tolist())]
    without_kept = ~np.array(ends).reshape(2, -1).any(axis=0)
    assert np.count_nonzero(without_kept) == np.count_nonzero(strong >= 0.95)
    listed = np.sort(np.abs(found.correlation[without_kept]))
    np.testing.assert_allclose(listed, np.sort(strong[strong >= 0.95]), atol=1e-5)


def changed(block: Block, kind: ObservationKind, row: int, component: int, error: float) -> Block:
    """The block with an error in one observation."""
    name, at = {
        ObservationKind.PLATE: ("xy", (row, component)),
        ObservationKind.CONTROL: ("position", (row, component)),
        ObservationKind.STATION_POSITION: ("position", (row, component)),
        ObservationKind.DISTANCE: ("length", row),
        ObservationKind.HEIGHT_DIFFERENCE: ("difference", row),
    }[kind]
    return altered(block, **{kind.attribute: {name: added(at, error)}})


@pytest.mark.parametrize(
    "kind",
    [
        ObservationKind.PLATE,
        ObservationKind.CONTROL,
        ObservationKind.STATION_POSITION,
        ObservationKind.DISTANCE,
        ObservationKind.HEIGHT_DIFFERENCE,
    ],
)
@pytest.mark.slow
def test_an_error_moves_residual_and_position_as_said(kind: ObservationKind) -> None:
    """Put in, and adjusted again: the residual takes the share r with it, the position moves by the influence."""
    block = sea_block()
    before = simultaneous(block)
    observed = before.observed
    for i in np.flatnonzero(observed.kind == kind)[::18]:
        row, component, sigma = int(observed.row[i]), int(observed.component[i]), float(observed.sigma[i])
        after = simultaneous(changed(block, kind, row, component, 0.1 * sigma))
        moved = after.observed.residual[i] - observed.residual[i]
        # a tenth of a sigma: what the curvature of the model leaves is a thousandth of it
        assert moved == pytest.approx(-0.1 * sigma * observed.redundancy[i], abs=2e-4 * sigma)
        if kind is ObservationKind.STATION_POSITION:
            shift = (after.stations.position - before.stations.position)[row]
        else:
            point = {
                ObservationKind.PLATE: block.plates.point,
                ObservationKind.CONTROL: block.control.point,
                ObservationKind.DISTANCE: block.distances.point[:, 1],
                ObservationKind.HEIGHT_DIFFERENCE: block.height_differences.point[:, 1],
            }[kind][row]
            shift = (after.points.position - before.points.position)[point]
        expected = 0.1 * sigma * observed.influence[i]
        np.testing.assert_allclose(shift, expected, atol=2e-3 * np.abs(expected).max() + 1e-6)


@pytest.mark.slow
def test_redundancy_numbers_are_those_of_40_blocks() -> None:
    """The mean of v^2 / sigma^2 is the redundancy number, with a standard error of r sqrt(2/40)."""
    plan = Plan(submerged=True, wet_every=3, noise=0.0, station_sigma=5.0, photos_per_strip=3, seed=21)
    block = with_options(simulated(plan).block, program=Program.IIIA, **TIGHT)
    exact = simultaneous(block)
    rng = np.random.default_rng(4)
    plate = np.where(np.isnan(block.plates.sigma), block.options.plate_sigma, block.plates.sigma)
    squares = []
    for _ in range(BLOCKS):
        noisy = altered(
            block,
            plates={"xy": block.plates.xy + rng.normal(0.0, plate)},
            control={"position": block.control.position + rng.normal(0.0, block.control.sigma)},
            photos={
                "position": exact.stations.position + rng.normal(0.0, block.photos.position_sigma),
                "attitude": exact.stations.attitude,
            },
        )
        observed = simultaneous(noisy).observed
        squares.append(np.square(observed.residual / observed.sigma))
    start = simultaneous(altered(block, photos={"position": exact.stations.position}))
    r, dof = start.observed.redundancy, start.degrees_of_freedom
    checked = r > 0.01
    off = (np.mean(squares, axis=0) - r)[checked] / (r[checked] * np.sqrt(2.0 / BLOCKS))
    assert np.abs(off).max() < 5.0  # of some hundred normal deviates
    assert 0.7 < off.std() < 1.3
    total = np.sum(squares, axis=1)
    assert total.mean() == pytest.approx(dof, abs=4.0 * np.sqrt(2.0 * dof / BLOCKS))
