"""Compiled points less those of the run: covariances of the differences, by chance and in their limits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from musatpy import model, read_deck
from musatpy.adjustment.job import adjust
from musatpy.compilation.against_run import AgainstRun, against_run
from musatpy.compilation.compiled import compiled
from musatpy.compilation.triangulation import of_solution
from musatpy.model.compilation import Compilation, StageReadings, StereomodelSpecs

FIXTURES = Path(__file__).parents[2] / "fixtures"


def start() -> model.Block:
    block = read_deck(FIXTURES / "st_thomas/st_thomas.crd")
    options = replace(block.options, program=model.Program.IIIA, refraction=model.Refraction.RIGOROUS)
    return replace(block, options=options)


def against(solution: model.Solution, xy: np.ndarray, sigma: float) -> AgainstRun:
    """Return the points on photos 21 and 22, of plate coordinates xy (m, 2), beside those of the run."""
    block = solution.block
    rows = [np.flatnonzero(block.plates.photo == photo) for photo in (0, 1)]
    common, left, right = np.intersect1d(*(block.plates.point[of] for of in rows), return_indices=True)
    read = np.stack([xy[rows[0][left]], xy[rows[1][right]]], axis=1)
    deck = Compilation(
        titles=(),
        models=StereomodelSpecs.of_photos(np.array(["M"]), np.array(["21"]), np.array(["22"]), sigma),
        stages=StageReadings.on_stages(
            model=np.zeros(len(common), dtype=int), ids=block.points.ids[common],
            kind=np.full(len(common), "R"), submerged=block.points.bathymetric[common], xy=read,
            sigma=np.full(len(common), np.nan),
        ),
    )  # fmt: skip
    result = compiled(of_solution(solution), deck)
    return against_run(result.models[0], np.ones(len(common), dtype=bool))


@pytest.fixture(scope="module")
def solution() -> model.Solution:
    return adjust(start())


def test_the_same_readings_of_two_rays_are_the_same_point(solution: model.Solution) -> None:
    """Without sigma; points of three photos differ by what the third one adds, control is not tested."""
    found = against(solution, solution.block.plates.xy, 0.005 * solution.unit_sigma)
    rays = np.bincount(solution.block.plates.point)[found.points]
    control = of_solution(solution).control[found.points]
    same = (rays == 2) & ~control
    assert found.shared.all() and same.sum() >= 5
    assert found.length[same].max() < 1e-6 and found.sigma[same].max() < 1e-5 and np.isnan(found.test[same]).all()
    three = (rays == 3) & ~control
    assert three.any() and (found.sigma[three] > 0.01).all() and (found.test[three] < 3.0).all()
    assert np.isnan(found.sigma[control]).all() and control.any()


def test_kept_out_points_of_the_same_readings_are_the_same_too() -> None:
    block = start()
    rays = np.bincount(block.plates.point)
    held = np.concatenate([block.control.point, block.equal_elevations.point])
    chosen = np.setdiff1d(np.flatnonzero(rays == 2), held)[::3]
    out = np.isin(block.plates.point, chosen)
    solution = adjust(replace(block, plates=replace(block.plates, triangulated=block.plates.triangulated & ~out)))
    found = against(solution, block.plates.xy, 0.005 * solution.unit_sigma)
    kept = np.isin(found.points, chosen)
    assert kept.any() and found.length[kept].max() < 1e-6 and found.sigma[kept].max() < 1e-5


def test_a_point_of_which_the_run_has_kept_out_one_reading_is_not_tested() -> None:
    block = start()
    three = np.flatnonzero(np.bincount(block.plates.point) == 3)
    held = np.concatenate([block.control.point, block.equal_elevations.point])
    point = np.setdiff1d(three, held)[0]
    out = (block.plates.point == point) & (block.plates.photo == 0)
    solution = adjust(replace(block, plates=replace(block.plates, triangulated=~out)))
    found = against(solution, block.plates.xy, 0.005 * solution.unit_sigma)
    assert np.isnan(found.test[found.points == point]).all() and np.isfinite(found.length).all()


@pytest.mark.slow
@pytest.mark.parametrize("again", [True, False])
def test_differences_are_as_large_as_their_covariances_say(solution: model.Solution, again: bool) -> None:
    """Twenty-five runs of noise in plates and control; readings made again, or those of the run."""
    block, draws, tests = solution.block, np.random.default_rng(5), []
    exact = block.plates.xy + solution.plates.residual
    control = block.control
    full = np.isfinite(control.position).all(axis=1)
    for _ in range(25):
        xy = exact + 0.005 * draws.normal(size=exact.shape)
        truth = solution.points.position[control.point]
        metres = control.sigma * draws.normal(size=control.sigma.shape) / [6.04e6, 6.35e6, 1.0]
        moved = truth + metres[:, [1, 0, 2]]
        given = np.where(full[:, None], moved, control.position)
        run = adjust(replace(block, plates=replace(block.plates, xy=xy), control=replace(control, position=given)))
        read = exact + 0.005 * draws.normal(size=exact.shape) if again else xy
        found = against(run, read, 0.005 * run.unit_sigma)
        tests.append(found.test[np.isfinite(found.test)])
    assert np.sqrt(np.mean(np.square(np.concatenate(tests)))) == pytest.approx(1.0, abs=0.12)
