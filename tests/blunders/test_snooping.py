"""The statistics behind the search: against those of the adjustment, refits, and identities."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from altered import added, altered, put
from benchmarks.large_blocks import simulated
from musatpy.adjustment import adjust, kernels
from musatpy.blunders.scene import Effort, StagedBlock, settled, sizes, staged
from musatpy.blunders.snooping import Judgement, factors_of, judged, snooped, units_of
from musatpy.model import AirBases, Block, ObservationKind, WaterLevel
from musatpy.statistics import Statistics

K = ObservationKind


def land_block(photos: int = 8) -> Block:
    """A block on land with weighted control and two air bases."""
    block, truth = simulated(photos, seed=3)
    k = len(block.control.point)
    control = replace(block.control, fixed=np.zeros(k, dtype=bool), sigma=np.full((k, 3), 0.3))
    ends = np.array([[0, 1], [2, 3]])
    length = np.linalg.norm(truth.station[ends[:, 1]] - truth.station[ends[:, 0]], axis=1)
    return replace(
        block,
        control=replace(control, position=control.position + np.random.default_rng(1).normal(0.0, 0.3, (k, 3))),
        air_bases=AirBases(photo=ends, length=length, sigma=[0.05, 0.05]),
    )


def judgement_without(block: Block, *rows: tuple[ObservationKind, int]) -> tuple[StagedBlock, Judgement]:
    """Return the tests with some rows of the tables out."""
    scene, state = staged(block, None, None, Effort(left=math.inf))
    out = {kind: np.zeros_like(weight) for kind, weight in scene.weight.items()}
    for kind, row in rows:
        out[kind][row] = 1.0
    factors = factors_of(out, sizes(scene, state))
    scene, state, factor = settled(scene, factors, state)
    units = units_of(scene)
    taken = np.zeros(len(units.first), dtype=bool)
    for kind, row in rows:
        taken[units.unit[(units.kind == kind) & (units.row == row)]] = True
    return scene, judged(scene, state, units, taken, factors, factor)


def values_of(judgement: Judgement, kind: ObservationKind, row: int) -> np.ndarray:
    units = judgement.units
    return judgement.test[(units.kind == kind) & (units.row == row)]


def test_the_tests_of_a_sound_block_are_those_of_its_solution() -> None:
    block = land_block()
    _, judgement = judgement_without(block)
    quality = Statistics(adjust(block))
    observed, units = quality.observed, judgement.units
    for name in ("kind", "row", "component"):
        np.testing.assert_array_equal(getattr(units, name), getattr(observed, name))
    checked = np.isfinite(judgement.test) & quality.checked
    assert checked.mean() > 0.7  # nothing checks the x of points on two photos
    # both at the minimum, but for the limits of the steps: a tenth of an arc second, a millimetre
    np.testing.assert_allclose(judgement.test[checked], quality.test[checked], atol=2e-3)


def test_a_wrong_control_card_has_no_say_in_which_image_of_its_point_is_wrong() -> None:
    """The card is 30 m off, one of its images 2 mm: a card that counted would leave none that fits."""
    block, truth = simulated(12, seed=3)
    seen = np.bincount(block.plates.point, minlength=len(block.points.ids))
    seen[block.control.point] = 0
    point = int(np.argmax(seen))
    wrong = int(np.flatnonzero(block.plates.point == point)[0])
    assert seen[point] >= 4
    position = truth.ground[int(block.points.ids[point])] + (0.0, 0.0, 30.0)
    spoilt = altered(
        block,
        control={"point": put(0, point), "position": put(0, position)},
        plates={"xy": added(wrong, (2.0, 0.0))},
    )
    scene, state = staged(spoilt, None, None, Effort(left=math.inf))
    first = {kind: np.zeros_like(weight) for kind, weight in scene.weight.items()}
    first[K.CONTROL][0] = first[K.PLATE][wrong] = 1.0
    found = snooped(scene, state, first, False)
    assert np.flatnonzero(found.rows_out(K.CONTROL)).tolist() == [0]
    assert np.flatnonzero(found.rows_out(K.PLATE)).tolist() == [wrong]


@pytest.mark.parametrize(("kind", "row"), [(K.AIR_BASE, 0), (K.AIR_BASE, 1)])
def test_one_observation_is_tested_alike_in_and_out(kind: ObservationKind, row: int) -> None:
    """v/(sigma sqrt r) in, and the prediction over the root of both variances out, are one statistic."""
    block = land_block()
    _, inside = judgement_without(block)
    _, outside = judgement_without(block, (kind, row))
    f = sum(adjust(block).observations.values()) - sum(adjust(block).unknowns.values())
    (t,) = values_of(inside, kind, row)
    tau = t / np.sqrt((f - 1 + t * t) / f)  # Pope's value of Student's
    (w,) = values_of(outside, kind, row)
    assert w * outside.sigma0 == pytest.approx(tau * inside.sigma0, rel=2e-3)


def test_the_error_of_an_image_that_is_out_is_that_of_a_refit_without_it() -> None:
    block = land_block()
    rays = np.bincount(block.plates.point)
    row = int(np.flatnonzero(rays[block.plates.point] >= 4)[10])
    judgement = judgement_without(block, (K.PLATE, row))[1]
    refit = adjust(altered(block, plates={"triangulated": put(row, False)}))
    units = judgement.units
    mine = (units.kind == K.PLATE) & (units.row == row)
    # a millionth of its weight is left, and the steps end at a micrometre on the plate or so
    np.testing.assert_allclose(judgement.error[mine], -refit.plates.residual[row], atol=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("submerged", [0.0, 0.4])
def test_both_kernels_judge_alike(monkeypatch: pytest.MonkeyPatch, submerged: float) -> None:
    """Images, weighted control, stations, tides and air bases, some of each out."""
    block = land_block() if not submerged else simulated(12, submerged=submerged, seed=5)[0]
    scene, state = staged(block, None, None, Effort(left=math.inf))
    units = units_of(scene)
    out = np.zeros(len(units.first), dtype=bool)
    out[units.unit[units.row == 1]] = True
    factors = {kind: np.ones(weight.shape) for kind, weight in scene.weight.items()}
    for kind, rows in units.of_kinds.items():
        factors[kind].reshape(-1)[units.element[rows]] = np.where(out[units.unit[rows]], 1e-6, 1.0)
    judgements = []
    for kernel in (kernels.NUMPY, kernels.NUMBA):
        monkeypatch.setenv(kernels.VARIABLE, kernel)
        judgements.append(judged(replace(scene, network=replace(scene.network)), state, units, out, factors, None))
    a, b = judgements
    assert np.isfinite(a.test).mean() > 0.7
    np.testing.assert_allclose(b.test, a.test, rtol=1e-10, atol=1e-10)  # by redundancy numbers of 0.01 and more
    np.testing.assert_allclose(b.error, a.error, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(b.covariance, a.covariance, rtol=1e-10, atol=1e-13)  # differences of larger terms


@pytest.mark.slow
def test_a_common_error_of_the_tides_is_estimated_as_an_unknown_level_is() -> None:
    block, _ = simulated(12, submerged=0.4, seed=5, depth=40.0)
    block = altered(block, photos={"tide": block.photos.tide + 8.0})
    scene, state = staged(block, None, None, Effort(left=math.inf))
    found = snooped(scene, state)
    (common,) = found.tides
    water = adjust(altered(block, options={"water_level": WaterLevel.ONE})).water
    # the search holds control by a small sigma and each tide by centimetres; the estimate has a sigma of decimetres
    assert common.error[0] == pytest.approx(-water.correction[0], abs=0.1 * water.correction_sigma[0])
    test = math.sqrt(common.squares) / found.judgement.sigma0
    assert test == pytest.approx(abs(water.correction[0]) / water.correction_sigma[0], rel=0.1)
