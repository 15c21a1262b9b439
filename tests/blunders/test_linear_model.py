"""What hypotheses explain in the linear model is what the adjustment with them loses."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest

from altered import added, altered
from drivers.causes_study import strip
from musatpy.adjustment.ground import point_squares
from musatpy.blunders.explanation import Case, first_case, with_hypothesis
from musatpy.blunders.hypotheses import Hypothesis, hypotheses
from musatpy.blunders.linear_model import dropped, linear_model, put_in_again
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


def test_points_apart_have_the_squares_that_they_have_together() -> None:
    """Each of them twice, the second time with its images 10 um to the right; all groups in one network."""
    case = wrong()
    network, state = case.scene.network, case.state
    moved = network.with_plates(network.xy + np.array([0.01, 0.0]), network.refracted)
    twice = [group.part(np.repeat(np.arange(len(group.point)), 2)) for group in network.groups]
    xy = [network.xy[group.rays] for group in twice]
    for of_group in xy:
        of_group[1::2, :, 0] += 0.01
    refracted = np.concatenate([network.refracted[group.rays].reshape(-1) for group in twice])
    alone, every = network.apart(twice, np.concatenate([of_group.reshape(-1, 2) for of_group in xy]), refracted)
    assert alone.points == 2 * sum(len(group.point) for group in network.groups)
    for group, of_both in zip(network.groups, every, strict=True):
        ground = state.ground[group.point]
        squares = point_squares(alone, state, of_both, np.repeat(ground, 2, axis=0))
        moved_squares = point_squares(moved, state, group, ground)
        np.testing.assert_allclose(squares[::2], point_squares(network, state, group, ground), rtol=1e-12)
        np.testing.assert_allclose(squares[1::2], moved_squares, rtol=1e-12)
        assert (np.abs(moved_squares - squares[::2]) > 1e-3).all()


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


def test_a_group_that_nothing_checks_explains_nothing() -> None:
    """One observation of one unknown: adjusted it is as observed, its redundancy nought."""
    drop = dropped(np.array([[0.3]]), np.array([[4.0]]), np.array([[[0.25]]]), 0.01)
    assert drop.parameters.tolist() == [0]
    assert drop.squares[0] == 0.0
    assert np.isnan(drop.sigma[0, 0])


def test_the_drop_of_two_observations_is_that_of_leaving_them_out() -> None:
    """Five levels of one height: without two of them the sum of squares is that of the other three."""
    observed, weight = np.array([1.0, 1.2, 0.9, 5.0, 4.0]), np.array([1.0, 2.0, 1.0, 4.0, 1.0])
    mean = np.average(observed, weights=weight)
    v = mean - observed
    rows = np.array([3, 4])
    Q = np.full((2, 2), 1.0 / weight.sum())
    drop = dropped(v[None, rows], weight[None, rows], Q[None], 0.01)
    rest = observed[:3] - np.average(observed[:3], weights=weight[:3])
    left = float(weight[:3] @ np.square(rest))
    assert drop.squares[0] == pytest.approx(float(weight @ np.square(v)) - left)
    assert drop.parameters.tolist() == [2]
    np.testing.assert_allclose(drop.error[0], observed[rows] - np.average(observed[:3], weights=weight[:3]))


def test_what_others_predict_becomes_what_the_adjustment_with_it_would_say() -> None:
    """Five levels of one height: the last two, predicted by the first three, are put in again."""
    observed, weight = np.array([1.0, 1.2, 0.9, 5.0, 4.0]), np.array([1.0, 2.0, 1.0, 4.0, 1.0])
    predicted = np.average(observed[:3], weights=weight[:3]) - observed[3:]
    Q = np.full((1, 2, 2), 1.0 / weight[:3].sum())
    v, cofactor = put_in_again(predicted[None], weight[None, 3:], Q)
    np.testing.assert_allclose(v[0], np.average(observed, weights=weight) - observed[3:])
    np.testing.assert_allclose(cofactor[0], np.full((2, 2), 1.0 / weight.sum()))
