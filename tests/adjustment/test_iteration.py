"""Damped Gauss-Newton on a problem of one unknown: where it ends, how it is damped, what it says when it fails."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from musatpy.adjustment.iteration import (
    AT_REST,
    Linearisation,
    SingularNormalsError,
    Step,
    iterate,
    not_raised,
)
from musatpy.adjustment.normals import NormalMatrix
from musatpy.adjustment.sparse import Pattern
from musatpy.arrays import FloatArray

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


def test_a_linear_problem_takes_one_step_and_one_that_changes_nothing() -> None:
    """From a tenth of what may still change the first step ends it."""
    for place, count in ((30.0, 2), (1.0 + 0.1 * AT_REST, 1)):
        steps: list[Step] = []
        outcome = iterate(Curve(), place, 20, steps.append)
        assert not outcome.failure and outcome.state == pytest.approx(1.0, abs=1e-12)
        assert [step.number for step in steps] == list(range(1, count + 1))
        assert outcome.change < AT_REST and outcome.factor is not None


def test_the_limits_of_the_problem_count_beside_the_sigmas() -> None:
    steps: list[Step] = []
    assert not iterate(Curve(limit=1e-6), 1.0 + 0.1 * AT_REST, 20, steps.append).failure
    assert len(steps) == 2


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


def test_too_few_iterations_are_told_with_what_still_changes() -> None:
    outcome = iterate(Curve(b=0.8), 30.0, 2)
    assert outcome.failure == "limits not reached in 2 iterations"
    assert outcome.change > AT_REST and outcome.last_step.size == 1


class Blind(Curve):
    """A point behind its camera on the far side of zero, from where steps lead nowhere."""

    def evaluate(self, state: float, context: Any) -> float:
        return super().evaluate(state, context) if state > 0.0 else np.inf

    def apply(self, state: float, step: FloatArray, context: Any) -> float:
        return state if state <= 0.0 else super().apply(state, step, context)


def test_points_that_stay_behind_their_cameras_are_lost() -> None:
    steps: list[Step] = []
    outcome = iterate(Blind(), -5.0, 20, steps.append)
    assert outcome.lost and outcome.failure == "points stay behind their cameras"
    assert len(steps) == 3 and outcome.state == -5.0


def test_normals_that_leave_something_free_raise() -> None:
    """Two unknowns of which only the sum is observed."""

    class Sum(Curve):
        def linearise(self, state: float) -> Linearisation:
            blocks, none = np.ones((1, 2, 2)), np.zeros((2, 0))
            matrix = NormalMatrix(pattern=Pattern.of(1, 2, []), blocks=blocks, border=none, corner=np.zeros((0, 0)))
            return Linearisation(matrix=matrix, rhs=np.ones(2), objective=1.0, context=None, redundancy=1)

    with pytest.raises(SingularNormalsError):
        iterate(Sum(), 2.0, 5)
