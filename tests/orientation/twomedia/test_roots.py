"""Exact solutions of minimum sets, and solutions that no camera over the water can have taken."""

from dataclasses import replace

import numpy as np
import pytest

from musatpy.orientation.twomedia.helmert import adjust, misfits
from musatpy.orientation.twomedia.oriented import OrientationError, orient
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Sights, WaterPlane, problem_of, redundancy_of, without
from musatpy.orientation.twomedia.solutions import REASONS, exact_roots, rejections
from orientation.twomedia.geometries import (
    ANGLES,
    KINDS,
    METHODS,
    control_of,
    dry,
    geometry,
    points_of,
    scene,
    sights_of,
    stations_of,
    truth_of,
)

_LEAST = {"SINGLE-RAY": 5, "PAIR-INDEPENDENT": 8, "PAIR-SUCCESSIVE": 8}  # points; of the last control without Y


def minimum_set(method: str, seed: int) -> Sights:
    """Return as few points of the laboratory as a method can do with."""
    sights = sights_of(geometry("lab", method), control_of(METHODS[method]))
    kept = np.random.default_rng(seed).choice(len(sights.points), _LEAST[method], replace=False)
    control = sights.control.copy()
    control[kept[-1], 1] = np.nan
    left = np.isin(np.arange(len(sights.points)), kept)
    return without(replace(sights, control=control), ~left)


def roots_of(method: str, seed: int) -> Orientation:
    """Return the exact solutions of a minimum set, the true one first."""
    problem = problem_of(minimum_set(method, seed), METHODS[method], WaterPlane())
    assert redundancy_of(problem) == 0
    return exact_roots(problem, adjust(problem, truth_of(geometry("lab", method))))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["SINGLE-RAY", "PAIR-SUCCESSIVE"])
def test_a_minimum_set_has_other_exact_solutions(method):
    """All fulfil the conditions to a thousandth of a sigma, and differ by what a level of the water shows."""
    sights, true = minimum_set(method, 1), truth_of(geometry("lab", method))
    problem, roots = problem_of(sights, METHODS[method], WaterPlane()), roots_of(method, 1)
    assert len(roots.level) >= 3
    assert misfits(problem, roots).max() < 1e-3
    np.testing.assert_allclose(roots.vector[0], true.vector[0], atol=1e-9)
    assert len(np.unique(np.round(roots.level, 6))) == len(roots.level)
    result = orient(sights, METHODS[method], WaterPlane(), KINDS["lab"].B)
    others = result.other_roots()
    values = np.concatenate([result.at.vector[None], others.vector])
    assert np.abs(values - true.vector).max(axis=1).min() < 1e-6  # the truth is one of them, whichever was taken


def test_with_redundancy_there_are_no_other_roots():
    result = orient(sights_of(geometry("lab", "SINGLE-RAY"), 20), METHODS["SINGLE-RAY"], WaterPlane())
    assert not len(result.other_roots().level)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda at: replace(at, level=at.level + 5.0), REASONS[0]),
        (lambda at: replace(at, attitude=at.attitude + np.radians([80.0, 0.0, 0.0])), REASONS[1]),
        (lambda at: replace(at, attitude=at.attitude + np.radians([180.0, 0.0, 0.0])), REASONS[2]),
        (lambda at: replace(at, level=at.level - 3.0), REASONS[3]),
        (lambda at: replace(at, level=at.level + 1.0), REASONS[4]),
    ],
)
def test_reasons_of_rejection(change, reason):
    kind = KINDS["lab"]
    true = scene(kind, dry(kind, points_of(kind, 11), 6), stations_of(kind, 1), ANGLES[:1])
    problem = problem_of(sights_of(true, 20), METHODS["SINGLE-RAY"], WaterPlane())
    adjusted = adjust(problem, truth_of(true))
    assert not rejections(problem, adjusted).any()
    impossible = rejections(problem, replace(adjusted, at=change(adjusted.at)))[0]
    assert reason in [REASONS[row] for row in np.flatnonzero(impossible)]


@pytest.mark.parametrize("rise", [-1.2, 1.2])
def test_the_same_water_by_other_tides_is_as_possible(rise):
    """Its level lower by what it rises under the photo; dry points stand .04 m over it, the camera 2 m."""
    kind = KINDS["lab"]
    true = scene(kind, dry(kind, points_of(kind, 11), 6), stations_of(kind, 1), ANGLES[:1])
    at = truth_of(true)
    problem = problem_of(sights_of(true, 20), METHODS["SINGLE-RAY"], WaterPlane(rise=np.array([rise])))
    adjusted = adjust(problem, replace(at, level=at.level - rise))
    assert adjusted.at.level == pytest.approx(at.level - rise, abs=1e-9)
    assert not rejections(problem, adjusted).any()


@pytest.mark.slow
def test_flags_that_contradict_the_control_are_named():
    """Wet points flagged dry and dry ones wet: nothing fits, and nothing is given."""
    kind = KINDS["lab"]
    true = scene(kind, dry(kind, points_of(kind, 11), 6), stations_of(kind, 1), ANGLES[:1])
    sights = sights_of(true, 20)
    with pytest.raises(OrientationError):
        orient(replace(sights, wet=~sights.wet), METHODS["SINGLE-RAY"], WaterPlane())
