"""The iteration, when it is at rest, and simulated strips by it."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from altered import altered, put, with_options
from blocks import converged, deep, held_cameras, shallow
from musatpy.adjustment import adjust
from musatpy.adjustment.iteration import AT_REST, Linearisation, Step, iterate, not_raised
from musatpy.adjustment.normals import NormalMatrix
from musatpy.adjustment.sparse import Pattern
from musatpy.arrays import FloatArray
from musatpy.errors import AdjustmentError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import INDEX_RANGE, Block, Control, ControlKind, PointStatus, Refraction, Solution, Weights
from musatpy.model.tables import taken
from musatpy.simulation import Simulation, simulate
from reference import compare, networks
from reference.networks import Plan

ONE = Pattern.of(1, 1, [])


def normal_matrix(value: float) -> NormalMatrix:
    blocks = np.full((1, 1, 1), value)
    return NormalMatrix(pattern=ONE, blocks=blocks, border=np.zeros((1, 0)), corner=np.zeros((0, 0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """f(x) = (x - 1) + b (x - 1)^2 / 2, observed as 0; its slope is taken `steep` times too small."""

    b: float = 0.0
    steep: float = 1.0
    limit: float = np.inf
    tried: list[float] = field(default_factory=list)

    def linearise(self, state: float) -> Linearisation:
        slope = (1.0 + self.b * (state - 1.0)) / self.steep
        value = (state - 1.0) + 0.5 * self.b * (state - 1.0) ** 2
        objective = self.evaluate(state, None)
        rhs = np.array([-slope * value])
        matrix = normal_matrix(slope**2)
        return Linearisation(matrix=matrix, rhs=rhs, objective=objective, context=None, redundancy=1)

    def evaluate(self, state: float, context: Any) -> float:
        return ((state - 1.0) + 0.5 * self.b * (state - 1.0) ** 2) ** 2

    def apply(self, state: float, step: FloatArray, context: Any) -> float:
        self.tried.append(state + float(step[0]))
        return self.tried[-1]

    def converged(self, step: FloatArray) -> bool:
        return abs(float(step[0])) < self.limit


def test_a_step_ends_within_what_it_leaves() -> None:
    """Of a curve, a step that changes AT_REST leaves half its square times b."""
    outcome = iterate(Curve(b=0.8), 30.0, 20)
    assert not outcome.failure
    assert abs(outcome.state - 1.0) < AT_REST**2


def test_a_step_that_raises_the_objective_is_damped_until_it_does_not() -> None:
    """Steps three times too long: 2 lambda = 1 and more are taken, each damping is let go tenfold."""
    steps: list[Step] = []
    problem = Curve(steep=3.0)
    outcome = iterate(problem, 2.0, 50, steps.append)
    assert steps[0].damping == pytest.approx(1.0)
    assert len(problem.tried) > len(steps)
    assert all(not_raised(later.objective, before.objective) for before, later in pairwise(steps))
    assert abs(outcome.state - 1.0) < 0.1


class Uphill(Curve):
    """A right side of the wrong sign."""

    def linearise(self, state: float) -> Linearisation:
        line = super().linearise(state)
        line.rhs[:] *= -1.0
        return line


def test_where_no_step_lowers_the_objective_the_state_stays() -> None:
    outcome = iterate(Uphill(), 3.0, 20)
    assert outcome.failure == "no step lowers the sum of squares"
    assert outcome.state == 3.0 and not outcome.lost and outcome.factor is None


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
    solution = converged(block)
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
    solution = converged(block, refraction=Refraction.WATPT)
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
    solution = converged(block)
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


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_an_index_that_nothing_determines_stays_in_its_range_and_ends_the_run(seed: int) -> None:
    """Depths below a metre at 3000 m: indices of 2.15 and -0.05 would fit best."""
    solution = adjust(shallow(seed))
    assert not solution.converged
    assert "refractive index would go to" in solution.reason
    assert INDEX_RANGE[0] <= solution.water.index <= INDEX_RANGE[1]


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


@pytest.mark.parametrize(
    ("name", "options"),
    [
        *(
            pytest.param(name, {"refraction": refraction}, marks=pytest.mark.slow)
            for name in ("strip", "bad_start")
            for refraction in (Refraction.WATPT, Refraction.RIGOROUS)
        ),
        ("bad_start", {"weights": Weights.DIAGONAL}),
        ("bad_start", {"weights": Weights.EQUAL}),
    ],
)
def test_noise_free_strips_give_the_truth_below_a_millimetre(name: str, options: dict[str, Any]) -> None:
    """Starts of 100 m and 2 degrees among them. What is left is the rounding of the cards, 1e-6 mm of plate."""
    simulation = simulated(name)
    solution = converged(simulation.block, **options)
    assert max(largest_errors(simulation, solution)) < 1e-3


@pytest.mark.parametrize(
    ("block", "options", "reason"),
    [
        *((lambda: held_cameras(2), {"max_iterations": most}, r"^(?![^;]*photo).*point 20 still moves.* sigmas")
          for most in (1, 2)),  # the stations are at rest
        (lambda: simulated("bad_start").block, {"max_iterations": 2, "refraction": Refraction.NONE},
         r"limits not reached in 2 iterations: photo 10"),
        (lambda: simulated("strip").block, {"max_passes": 1}, "water points not at rest in 1 pass: point "),
    ],
)  # fmt: skip
def test_a_run_that_does_not_converge_says_what_still_moves_and_how_much(
    block: Callable[[], Block], options: dict[str, Any], reason: str
) -> None:
    solution = adjust(with_options(block(), **options))
    assert not solution.converged
    assert re.search(reason, solution.reason)
    if "photo 10" in reason:
        assert f"still moves {solution.iterations[-1].translation:.4f} m" in solution.reason
    assert np.isfinite(solution.stations.position).all()


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
