"""Large blocks keep their normal matrix near the minimum: the same solution, by steps that gain enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adjustment.water_jobs import shore, st_thomas
from altered import with_options
from musatpy import read_deck
from musatpy.adjustment import adjust, kernels, normals, simultaneous, triangulation
from musatpy.adjustment.ground import at_their_best
from musatpy.adjustment.iteration import AT_REST, Kept, Linearisation, Near, Outcome, Step, Until, iterate
from musatpy.adjustment.job import Job
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import NormalMatrix
from musatpy.adjustment.pattern import Pattern
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.model import Block, Program, Refraction, Solution

FIXTURES = Path(__file__).parents[2] / "fixtures"
DECKS = ("st_thomas/st_thomas.crd", "verdict/iia_same_deck.crd")
PROGRAMS = [
    (Program.IIIA, Refraction.RIGOROUS),
    (Program.IIA, Refraction.RIGOROUS),
    (Program.IIA, Refraction.WATPT),
]


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """f(x) = a (x - 1) + b (x - 1)^2 / 2 of one unknown, observed as 0: a matrix of another place gains little."""

    b: float
    fresh: list[float]
    renewable: bool = True

    def linearise(self, state: float) -> Linearisation:
        self.fresh.append(state)
        return self._line(state, None)

    def renewed(self, state: float, line: Linearisation) -> Linearisation:
        return self._line(state, line.matrix)

    def _line(self, state: float, kept: NormalMatrix | None) -> Linearisation:
        slope = 1.0 + self.b * (state - 1.0)
        one = Pattern.of(1, 1, [])
        matrix = kept or NormalMatrix(
            pattern=one, blocks=np.full((1, 1, 1), slope**2), border=np.zeros((1, 0)), corner=np.zeros((0, 0))
        )
        rhs = np.array([-slope * self.value(state)])
        return Linearisation(
            matrix=matrix, rhs=rhs, objective=self.evaluate(state, None), context=None, of_points=0.0, redundancy=1,
            renewable=self.renewable,
        )  # fmt: skip

    def value(self, x: float) -> float:
        return (x - 1.0) + 0.5 * self.b * (x - 1.0) ** 2

    def evaluate(self, state: float, context: Any) -> float:
        return self.value(state) ** 2

    def apply(self, state: float, step: FloatArray, context: Any) -> float:
        return state + float(step[0])

    def converged(self, step: FloatArray) -> bool:
        return True


@pytest.mark.parametrize(("b", "fresh", "kept"), [(1e-4, 2, 1), (0.01, 2, 3), (0.8, 7, 1)])
def test_the_matrix_is_taken_anew_where_steps_gain_too_little(b: float, fresh: int, kept: int) -> None:
    """A step with a kept matrix that gains too little is followed by one with a matrix of its own."""
    steps: list[Step] = []
    curve = Curve(b=b, fresh=[])
    outcome = iterate(curve, 30.0, 20, steps.append)
    assert not outcome.failure and abs(outcome.state - 1.0) < AT_REST**2
    assert (len(curve.fresh), len(steps) - len(curve.fresh)) == (fresh, kept)


def kept_of(b: float, share: float = 1.0) -> Kept:
    """Return the normals of a curve at its minimum, their matrix a share of the true one."""
    kept = iterate(Curve(b=b, fresh=[]), 1.001, 20).kept
    assert kept is not None
    factor = normals.factorised(replace(kept.line.matrix, blocks=share * kept.line.matrix.blocks))
    assert factor is not None
    return replace(kept, factor=factor)


STARTS = [  # where it begins, what it begins with, how many matrices it takes, and steps
    (1.1, lambda: None, 2, 2),
    (1.05, lambda: None, 1, 2),  # a first step of less than a tenth of a sigma
    (1.1, Near, 1, 2),
    (1.1, lambda: Near(kept=kept_of(0.01)), 0, 2),
    (1.001, lambda: None, 1, 1),
    (1.001, lambda: Near(kept=kept_of(0.01), proven=True), 0, 1),
    (1.001, lambda: Near(kept=kept_of(0.01)), 0, 2),
    (1.1, lambda: Near(kept=kept_of(0.01, 1.1)), 0, 4),  # each step leaves a tenth
    (1.00005, lambda: Near(kept=kept_of(0.01)), 0, 1),  # a hundredth of what an iteration leaves to be done
    (1.1, lambda: Near(kept=kept_of(0.01, 1.3)), 1, 3),
]


@pytest.mark.parametrize(("place", "start", "fresh", "count"), STARTS)
def test_an_iteration_near_its_minimum_may_start_with_a_kept_matrix(
    place: float, start: Callable[[], Near | None], fresh: int, count: int
) -> None:
    """The first step with one that is not proven ends it if it is tiny; one that gains too little is given up."""
    curve, steps = Curve(b=0.01, fresh=[]), list[Step]()
    outcome = iterate(curve, place, 20, steps.append, start())
    assert not outcome.failure and abs(outcome.state - 1.0) < 0.01 * AT_REST
    assert (len(curve.fresh), len(steps)) == (fresh, count)


@pytest.mark.parametrize(
    ("until", "place", "start", "count"),
    [
        (Until.FIT, 30.0, None, 1),
        (Until.CLOSE, 30.0, None, 2),
        (Until.REST, 30.0, None, 3),
        (Until.CLOSE, 10.0, Near(length=120.0), 1),
        (Until.CLOSE, 10.0, Near(length=10.0), 2),
        (Until.CLOSE, 1.001, None, 1),
    ],
)
def test_an_iteration_may_end_as_soon_as_its_steps_close_in(
    until: Until, place: float, start: Near | None, count: int
) -> None:
    """Only of a large problem; its limits end it sooner where they are reached."""
    for large in (True, False):
        steps: list[Step] = []
        outcome = iterate(Curve(b=0.003, fresh=[], renewable=large), place, 20, steps.append, start, until)
        assert not outcome.failure and (len(steps) == count or not large)
        assert outcome.rough == (large and until is not Until.REST and place > 2.0)
        assert outcome.rough or abs(outcome.state - 1.0) < 0.01 * AT_REST
        assert outcome.rough == np.isfinite(outcome.length)


@pytest.mark.parametrize("share", [None, 1.0, 1.1, 1.3, 2.0])
@pytest.mark.parametrize("place", [1.01, 3.0, 30.0])
def test_sums_of_squares_can_be_compared_a_tenth_of_a_sigma_from_the_minimum(
    place: float, share: float | None
) -> None:
    """A kept matrix that is too large makes steps shorter by one and the same share; the minimum is 0."""
    start, steps = None if share is None else Near(kept=kept_of(0.01, share)), list[Step]()
    outcome = iterate(Curve(b=0.01, fresh=[]), place, 20, steps.append, start, Until.COMPARED)
    assert not outcome.failure
    assert Curve(b=0.01, fresh=[]).evaluate(outcome.state, None) < 0.1**2
    assert len(steps) < 5


@pytest.mark.parametrize("share", [None, 1.0, 1.1, 1.3])
@pytest.mark.parametrize("place", [1.01, 3.0, 30.0])
def test_tests_are_judged_a_hundredth_of_a_sigma_from_the_minimum(place: float, share: float | None) -> None:
    start = Near() if share is None else Near(kept=kept_of(0.01, share))
    outcome = iterate(Curve(b=0.01, fresh=[]), place, 20, None, start, Until.TESTED)
    assert not outcome.failure
    assert abs(outcome.state - 1.0) < AT_REST


@pytest.mark.parametrize(("place", "count"), [(1.1, 1), (1.3, 1), (1.9, 2)])
def test_an_iteration_that_goes_on_foresees_how_its_kept_matrix_closes_in(place: float, count: int) -> None:
    """It leaves no more of its first step than that; where this is not told, two are taken."""
    before = iterate(Curve(b=0.01, fresh=[]), 2.5, 20, None, Near(), Until.TESTED)
    assert before.kept is not None and 0.01 < before.kept.closing < 0.1
    for closing, expected in ((before.kept.closing, count), (0.0, 2)):
        curve, steps = Curve(b=0.01, fresh=[]), list[Step]()
        start = Near(kept=replace(before.kept, closing=closing))
        outcome = iterate(curve, place, 20, steps.append, start, Until.TESTED)
        assert not outcome.failure and not curve.fresh
        assert abs(outcome.state - 1.0) < AT_REST
        assert len(steps) == expected


class Misfit(Curve):
    """A curve with something left at its minimum."""

    def evaluate(self, state: float, context: Any) -> float:
        return super().evaluate(state, context) + 1e-3


@pytest.mark.parametrize(("place", "ends"), [(1.04, False), (1.02, True)])
def test_weights_may_stay_after_a_step_that_gains_less_than_it_leaves(place: float, ends: bool) -> None:
    """The minimum is 0.001, of which the roots are 0.03; limits of steps are 0.01."""
    outcome = iterate(Misfit(b=0.01, fresh=[], renewable=False), place, 1, None, None, Until.WEIGHED)
    assert (not outcome.failure) == ends


def solved(monkeypatch: pytest.MonkeyPatch, deck: str, program: Program, refraction: Refraction, large: int) -> Any:
    """Return the solution of a deck, blocks of more than so many photos large, and how often it was factorised."""
    factorise, count = normals.factorise, [0]

    def counted(*arguments: Any) -> Any:
        count[0] += 1
        return factorise(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(simultaneous, "LARGE", large)
        patch.setattr(triangulation, "LARGE", large)
        patch.setattr(normals, "factorise", counted)
        block = read_deck(FIXTURES / deck)
        # to where the passes of WATPT lead: within the millimetre of the card it matters how they come there
        options = replace(block.options, program=program, refraction=refraction, water_limit=1e-6)
        return adjust(replace(block, options=options)), count[0]


# strips in which points turn from pass to pass, or stand on a water line
SHORES = [(shore, 9), *(pytest.param(shore, seed, marks=pytest.mark.slow) for seed in (1, 7, 12, 28, 34, 104))]


@pytest.mark.parametrize(("job", "seed"), [*SHORES, pytest.param(st_thomas, 2, marks=pytest.mark.slow)])
@pytest.mark.parametrize("program", list(Program))
def test_early_looks_at_the_water_line_lead_to_the_same_states(
    monkeypatch: pytest.MonkeyPatch, program: Program, job: Callable[[int], Block], seed: int
) -> None:
    block = with_options(job(seed), program=program, refraction=Refraction.RIGOROUS)
    monkeypatch.setattr(simultaneous, "LARGE", 0)
    monkeypatch.setattr(triangulation, "LARGE", 0)
    a = adjust(block)
    monkeypatch.undo()
    assert_same(a, adjust(block))


@pytest.mark.parametrize("seed", [12, 28])
def test_points_that_change_their_side_early_go_on_from_their_best_positions(
    monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """Those of the other side would take steps of the whole block, which closes in before them."""
    monkeypatch.setattr(simultaneous, "LARGE", 0)
    networks, moves, iterated = list[Network](), list[float](), Job.iterate

    def recorded(job: Job, problem: Any, network: Network, state: State, *more: Any) -> Outcome:
        if len(networks) == 1:
            changed = network.changed(networks[0])
            moved = at_their_best(network, state, changed).ground - state.ground
            moves.extend(np.abs(moved[changed]).max(axis=1).tolist())
        networks.append(network)
        return iterated(job, problem, network, state, *more)

    monkeypatch.setattr(Job, "iterate", recorded)
    assert adjust(with_options(shore(seed), program=Program.IIIA, refraction=Refraction.RIGOROUS)).converged
    assert len(moves) > 3 and max(moves) < 1e-3


def assert_same(a: Solution, b: Solution) -> None:
    """Two solutions are one minimum, to a hundredth of what the last steps may change."""
    assert a.converged and b.converged
    assert a.sum_of_squares == pytest.approx(b.sum_of_squares, rel=1e-7)
    sigma = np.sqrt(np.einsum("pii->pi", b.points.covariance))
    height = np.abs(a.points.position[:, 2] - b.points.position[:, 2]) / sigma[:, 2]
    assert np.nanmax(height) < 0.01 * AT_REST


@pytest.mark.parametrize("kind", [kernels.NUMPY, pytest.param(kernels.NUMBA, marks=pytest.mark.slow)])
@pytest.mark.parametrize("deck", DECKS)
@pytest.mark.parametrize(("program", "refraction"), PROGRAMS)
def test_solutions_are_the_same(
    monkeypatch: pytest.MonkeyPatch, kind: str, deck: str, program: Program, refraction: Refraction
) -> None:
    monkeypatch.setenv(kernels.VARIABLE, kind)
    (kept, less), (plain, more) = (solved(monkeypatch, deck, program, refraction, large) for large in (0, 1000))
    assert less < more
    assert_same(kept, plain)
