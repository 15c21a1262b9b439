"""What hypotheses explain in the linear model is what the adjustment with them loses."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest

from altered import added, altered
from drivers.causes_study import strip
from musatpy.blunders.explanation import Case, first_case, with_hypothesis
from musatpy.blunders.hypotheses import Hypothesis, hypotheses, revised
from musatpy.blunders.linear_model import dropped, linear_model
from musatpy.blunders.scene import Effort, staged
from musatpy.model import CauseKind

_K = CauseKind
SHIFT = 1.0  # m of control


@lru_cache(maxsize=1)
def wrong() -> Case:
    """A strip with observed stations, one control point a metre off, and a camera 0.05 mm too long."""
    block = strip(6, observed=True)
    block = altered(
        block, control={"position": added(1, SHIFT)}, cameras={"focal_length": block.cameras.focal_length + 0.05}
    )
    scene, state = staged(block, None, None, Effort(left=math.inf))
    return first_case(block, scene, state)


@lru_cache(maxsize=1)
def options() -> list[Hypothesis]:
    case = wrong()
    return hypotheses(linear_model(case.scene, case.factors(), case.state))


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    [_K.IMAGE, _K.IMAGES, _K.HORIZONTAL, _K.VERTICAL, _K.CONTROL, _K.POSITION, _K.FOCAL_LENGTH, _K.PRINCIPAL_POINT],
)
def test_the_squares_that_a_hypothesis_explains_are_lost_by_the_adjustment(kind: CauseKind) -> None:
    case = wrong()
    squares = linear_model(case.scene, case.factors(), case.state).squares
    best = next(one for one in options() if one.kind is kind)
    trial = with_hypothesis(case, best, None)
    # two percent: a metre is a thousandth of the flying height, and turns the rays by as much
    assert squares - trial.squares == pytest.approx(best.squares, rel=0.02, abs=0.01 * squares)


def test_errors_are_given_minus_true() -> None:
    """A flipped sign of any partial derivative would show here."""
    control = next(one for one in options() if one.kind is _K.CONTROL)
    case = wrong()
    assert control.point == (int(case.scene.block.control.point[1]),)
    focal = next(one for one in options() if one.kind is _K.FOCAL_LENGTH)
    trial = with_hypothesis(with_hypothesis(case, control, None), focal, None)
    size, sigma = trial.taken[-1].error[0], trial.taken[-1].sigma[0]
    assert size == pytest.approx(0.05, abs=4.0 * sigma)
    assert sigma < 0.0125  # the sign is certain
    again = hypotheses(linear_model(trial.scene, case.factors(), trial.state))
    found = next(one for one in again if one.kind is _K.CONTROL)
    assert found.key == control.key
    np.testing.assert_allclose(found.error, SHIFT, atol=4.0 * found.sigma.max())
    assert found.sigma.max() < 0.25 * SHIFT  # the signs are certain


def test_a_radial_distortion_is_given_minus_true() -> None:
    """One that is 0.03 mm larger at the farthest image is estimated as larger by that."""
    block = revised(wrong().block, Hypothesis(kind=_K.DISTORTION, value=-0.03))
    scene, state = staged(block, None, None, Effort(left=math.inf))
    model = linear_model(scene, wrong().factors(), state)
    sizes = [next(one for one in of if one.kind is _K.DISTORTION).error[0] for of in (options(), hypotheses(model))]
    assert sizes[1] - sizes[0] == pytest.approx(0.03, abs=0.003)


def test_a_group_that_nothing_checks_explains_nothing() -> None:
    """One observation of one unknown: adjusted it is as observed, its redundancy nought."""
    drop = dropped(np.array([[0.3]]), np.array([[4.0]]), np.array([[[0.25]]]), 0.01)
    assert drop.parameters.tolist() == [0]
    assert drop.squares[0] == 0.0
    assert np.isnan(drop.sigma[0, 0])
