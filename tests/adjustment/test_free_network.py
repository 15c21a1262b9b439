"""Free networks: inner constraints against a dense pseudo-inverse, and what they must leave alone."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from altered import altered
from blocks import converged
from musatpy import model, read_deck, write_deck
from musatpy.adjustment import adjust
from musatpy.adjustment import ground as ground_points
from musatpy.adjustment.collinear import Simultaneous
from musatpy.adjustment.datum import freedom
from musatpy.adjustment.initial import initial_photos
from musatpy.adjustment.job import prepared
from musatpy.errors import AdjustmentError
from musatpy.geometry import similarity
from musatpy.model.tables import empty
from musatpy.statistics import metric_differences
from orientation.flights import FOCAL_LENGTH, HEIGHT, Flight, fly, strip
from reference import compare, dense_bundle
from reference.networks import Plan, simulate

TIGHT = {"rotation_limit": 1e-9, "translation_limit": 1e-6, "max_iterations": 40}


def free_block(plan: Plan, kinds: tuple[model.ControlKind, ...] = ()) -> model.Block:
    """The block of a plan without control but that of `kinds`, as a free network of IIIA."""
    block = simulate(plan).block
    kept = np.isin(block.control.kind, kinds)
    options = replace(
        block.options,
        program=model.Program.IIIA,
        datum=model.Datum.FREE,
        refraction=model.Refraction.RIGOROUS,
        **TIGHT,
    )
    return altered(
        block, control={"kind": np.where(kept, block.control.kind, model.ControlKind.CHECK)}, options=options
    )


@lru_cache
def solved(plan: Plan, kinds: tuple[model.ControlKind, ...] = ()) -> model.Solution:
    return converged(free_block(plan, kinds))


def dense_cofactors(solution: model.Solution, defect: int) -> tuple[np.ndarray, dense_bundle.Network]:
    """Q under the inner constraints over the points, from the eigenvectors of the dense normal matrix."""
    block = solution.block
    network = dense_bundle.Network(block, refraction=True)
    assert block.options.system is model.CoordinateSystem.LOCAL  # where attitudes need no turning
    J = network.jacobian(dense_bundle.starting_state(network, compare.beside(solution)))
    return compare.free_cofactors(J, np.s_[6 * len(block.photos.ids) :], defect), network


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


@pytest.mark.slow
def test_known_tides_are_no_datum_for_the_scale() -> None:
    """Heights and tilts come from the water; the scale, which it hardly holds, from the given stations."""
    plan = Plan(photos_per_strip=4, submerged=True, start_error=(5.0, 1e-3))
    solution = solved(plan)
    assert solution.observations["inner constraints"] == 4
    assert any("1 of its 4 free motions" in warning for warning in solution.warnings)
    truth = simulate(plan).truth.points
    known = np.isfinite(solution.points.position).all(axis=1)
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


def test_control_makes_the_option_do_nothing() -> None:
    plan = Plan(photos_per_strip=4, kinds=(model.ControlKind.FULL,))
    held = free_block(plan, (model.ControlKind.FULL,))
    free, usual = adjust(held), adjust(altered(held, options={"datum": model.Datum.CONTROL}))
    np.testing.assert_array_equal(free.points.position, usual.points.position)
    np.testing.assert_array_equal(free.stations.covariance, usual.stations.covariance)


# --- nothing known of the stations either ---


def unplaced(block: model.Block, known: tuple[int, ...] = ()) -> model.Block:
    """The block to be computed as a free network, without its stations and all control but that of rows `known`."""
    unknown = np.full((len(block.photos.ids), 3), np.nan)
    photos = dict.fromkeys(("position", "attitude", "position_sigma", "attitude_sigma"), unknown)
    kind = np.full(len(block.control.point), int(model.ControlKind.CHECK))
    kind[list(known)] = block.control.kind[list(known)]
    options = {"program": model.Program.IIIA, "datum": model.Datum.FREE, "initial": model.Initial.COMPUTE, **TIGHT}
    return altered(block, photos=photos, control={"kind": kind}, options=options)


def placed(block: model.Block, motions: int) -> model.Solution:
    """Return the solution of a block so many of whose motions are free."""
    solution = converged(block)
    assert solution.observations["inner constraints"] == motions
    return solution


def flown(**changes: Any) -> Flight:
    stations, headings = zip(*(strip(5, row * np.pi, (0.0, 3000.0 * row)) for row in range(2)), strict=True)
    tilts = np.random.default_rng(3).normal(0.0, 0.02, (10, 2))
    attitude = np.column_stack([tilts, np.concatenate(headings)])
    return fly(np.concatenate(stations), attitude, seed=4, **changes)


def assert_same_shape(solution: model.Solution, truth: np.ndarray, sigmas: float) -> np.ndarray:
    """Assert that the points are the true ones but for a similarity, and return its scale and shift."""
    known = np.isfinite(solution.points.position).all(axis=1)
    found = solution.points.position[known]
    move = similarity.fit(found, truth[known], np.ones(len(found)))
    off = np.linalg.norm(move.apply(found) - truth[known], axis=1)
    sigma = np.sqrt(np.einsum("kii->k", solution.points.covariance[known]))
    assert (off / (move.scale * sigma)).max() < sigmas
    return np.array([move.scale, *move.shift])


@pytest.mark.slow
def test_nothing_known_at_all() -> None:
    """Seven free motions; the photographs are at 1:10,000, the first station at 0, 0, the ground at 0."""
    truth = flown(control=2)
    solution = placed(unplaced(truth.block), 7)
    assert any("is arbitrary" in text for text in solution.warnings)
    scale, *_ = assert_same_shape(solution, truth.X, 5.0)  # of some hundred points the worst
    nominal = 10.0 * FOCAL_LENGTH  # m: 10,000 focal lengths
    assert scale == pytest.approx(HEIGHT / nominal, rel=0.1)  # relief and overlap of the photos
    assert np.linalg.norm(solution.stations.position[0, :2]) < 0.05 * nominal
    assert abs(np.median(solution.points.position[:, 2])) < 0.02 * nominal
    # the same images have the same misfits, whatever the datum
    held = adjust(replace(unplaced(truth.block), photos=solution.block.photos))
    assert solution.sum_of_squares == pytest.approx(held.sum_of_squares, rel=1e-9)
    assert solution.sigma0 == pytest.approx(1.0, abs=0.25)  # four standard errors of 140 degrees of freedom


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "off"), [(model.Distances, 2e-4), (model.AirBases, 1e-3)])  # noise of the ends
def test_a_length_scales_a_block_without_stations(kind: Any, off: float) -> None:
    truth = flown(control=2)
    field, places, table, ends = "distances", truth.X, "point", truth.block.control.point[:2]
    if kind is model.AirBases:
        field, places, table, ends = "air_bases", truth.C, "photo", np.array([0, 1])
    length = float(np.linalg.norm(places[ends[1]] - places[ends[0]]))
    measured = kind(**{table: ends[None]}, length=[length], sigma=[0.05])
    solution = placed(replace(unplaced(truth.block), **{field: measured}), 6)
    scale, *_ = assert_same_shape(solution, truth.X, 5.0)
    assert scale == pytest.approx(1.0, abs=off)


def test_a_scale_bar_in_millimetres_among_others_in_metres_is_named() -> None:
    truth = flown()
    ends = np.argsort(-np.bincount(truth.block.plates.point))[:4].reshape(2, 2)  # seen most often
    length = np.linalg.norm(truth.X[ends[:, 1]] - truth.X[ends[:, 0]], axis=1) * [1.0, 1000.0]
    bars = model.Distances(point=ends, length=length, sigma=np.full(2, 0.05))
    wrong = " and ".join(truth.block.points.ids[ends[1]])
    notes = initial_photos(replace(unplaced(truth.block), distances=bars)).notes
    assert f"the distance of points {wrong} is 1e+03 times as long as others say" in notes[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rows", "kind", "motions", "known", "off"),
    [
        ((3,), model.ControlKind.FULL, 4, slice(0, 3), 0.01),  # the three shifts: nothing contradicts it
        # height and tilts; the scale, which relief would hold, the nominal one replaces: sigmas of 0.1 m
        ((0, 1, 2, 3), model.ControlKind.VERTICAL, 3, slice(2, 3), 0.5),
    ],
    ids=["one point", "four heights"],
)
def test_control_too_weak_to_place_a_block_places_what_it_can(
    rows: tuple[int, ...], kind: model.ControlKind, motions: int, known: slice, off: float
) -> None:
    truth = flown()
    control = truth.block.control
    block = altered(truth.block, control={"kind": np.full(len(control.kind), kind)})
    solution = placed(unplaced(block, rows), motions)
    assert_same_shape(solution, truth.X, 5.0)
    used = control.point[list(rows)]
    np.testing.assert_allclose(solution.points.position[used, known], truth.X[used, known], atol=off)


@pytest.mark.slow
def test_submerged_points_put_an_unplaced_block_to_the_tide() -> None:
    plan = Plan(photos_per_strip=5, strips=2, submerged=True, wet_every=3, seed=9)
    simulated = simulate(plan)
    solution = placed(unplaced(simulated.block), 4)  # heights and tilts come from the water
    assert not [text for text in solution.warnings if "stands" in text]  # no submerged point ends above it
    deepest = np.nanmin(solution.points.position[simulated.block.points.bathymetric, 2])
    scale = 10.0 * plan.focal_length / plan.height
    assert deepest == pytest.approx(
        -30.0 * scale, rel=0.6
    )  # decimetres of water level and tilt, by one part in 200
    assert solution.sigma0 == pytest.approx(1.0, abs=0.25)  # four standard errors of 130 degrees of freedom


@pytest.mark.slow
@pytest.mark.parametrize("system", [model.CoordinateSystem.GEOGRAPHIC, model.CoordinateSystem.GEOCENTRIC])
def test_a_job_on_the_ellipsoid_needs_one_position(system: model.CoordinateSystem) -> None:
    simulated = simulate(Plan(photos_per_strip=4, system=system, seed=2))
    with pytest.raises(AdjustmentError, match=r"a GEO. job needs a position at least"):
        adjust(unplaced(simulated.block))
    rays = np.bincount(simulated.block.plates.point)
    row = int(np.flatnonzero(rays[simulated.block.control.point] > 2)[0])
    point = simulated.block.control.point[row]
    solution = placed(unplaced(simulated.block, (row,)), 4)
    off = metric_differences(simulated.block, solution.points.position, simulated.truth.points)[point]
    np.testing.assert_allclose(off, 0.0, atol=0.5)  # the sigmas of the control are 0.05 and 0.08 m


@pytest.mark.slow
def test_a_deck_of_plates_alone_passes_its_checks(tmp_path: Path) -> None:
    block = unplaced(flown(control=2).block)
    deck = tmp_path / "plates.crd"
    write_deck(replace(block, control=empty(model.Control)), deck)
    assert not {"STA", "CTL"} & {line[:3] for line in deck.read_text().splitlines()}
    placed(read_deck(deck), 7)


def test_equations_that_make_no_sense_have_no_free_motions() -> None:
    """As a triangulation with gross errors leaves them: the next one is to say that points have run away."""
    job, state = prepared(free_block(Plan()), None)
    state = ground_points.level_start(job.network, state)
    problem = Simultaneous(network=job.network, options=job.block.options)
    matrix = problem.linearise(problem.with_squares(state)).matrix
    assert freedom(job.network, state, matrix).count == 7
    assert freedom(job.network, state, replace(matrix, blocks=np.full_like(matrix.blocks, np.nan))).count == 0
