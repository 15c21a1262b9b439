"""Water that has a sigma and is not adjusted: its errors in all sigmas, in those of depths, and in the tests."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from adjustment.test_musat3a import WATER, sea_block, with_options
from musatpy.adjustment import adjust
from musatpy.model import Block, Program, Refraction, Solution, Treatment, WaterLevel
from musatpy.model.control import Distances, HeightDifferences
from reference import compare, finite_difference_bundle

UNKNOWN = {"water_level": WaterLevel.DAY, "water_tilt": Treatment.ADJUST, "water_index": Treatment.ADJUST}
_PROGRAMS: dict[str, dict[str, Any]] = {
    "IIA": {"program": Program.IIA, "refraction": Refraction.RIGOROUS},
    "WATPT": {"program": Program.IIA, "refraction": Refraction.WATPT, "water_limit": 1e-6, "max_passes": 40},
}


def without_ties(block: Block) -> Block:
    """The block without what IIA cannot use."""
    none = {"point": np.zeros((0, 2), dtype=int), "sigma": []}
    return replace(
        block, distances=Distances(length=[], **none), height_differences=HeightDifferences(difference=[], **none)
    )


def labels(block: Block) -> np.ndarray:
    """Return which common error (n,) the tides have: of the group, else the day, else the photo."""
    photos = block.photos
    words = [
        f"g{group}" if group else f"d{day}" if day else f"p{name}"
        for group, day, name in zip(photos.tide_group, photos.tide_day, photos.ids, strict=True)
    ]
    return np.array(words)


def dense(solution: Solution) -> finite_difference_bundle.Joint:
    """Return the joint covariance of a solution and what was considered, of the reference."""
    block, options = solution.block, solution.block.options
    water = block.water
    assert water is not None and solution.water is not None
    wide, sigma, level = block, {}, options.water_level
    if level is WaterLevel.KNOWN:
        level = WaterLevel.GROUP
        names = labels(block)
        wide = replace(wide, photos=replace(block.photos, tide_group=names))
        of = [np.sqrt(np.mean(np.square(block.photos.tide_sigma[names == one]))) for one in np.unique(names)]
        sigma["tides"] = np.array(of)
    if options.water_tilt is not Treatment.ADJUST:
        sigma["tilt"] = np.full(2, water.tilt_sigma)
    if options.water_index is not Treatment.ADJUST:
        sigma["index"] = np.array([water.sigma])
    wide = with_options(wide, **(UNKNOWN | {"water_level": level}))
    problem = finite_difference_bundle.Problem(wide)
    x = problem.start(solution.stations.position, solution.stations.attitude, solution.points.position)
    x[problem.part["levels"]] = solution.levels
    x[problem.part["tides"]] = 0.0 if "tides" in sigma else solution.water.correction
    x[problem.part["tilt"]], x[problem.part["index"]] = solution.water.tilt, solution.water.index
    return finite_difference_bundle.considered(wide, x, sigma, solution.sum_of_squares, solution.degrees_of_freedom)


def assert_sigmas(solution: Solution, joint: finite_difference_bundle.Joint) -> None:
    """Sigmas of everything within 1e-4: the central differences are good to 1e-6, WATPT stands a little off."""
    assert solution.water is not None
    n, p = len(solution.block.photos.ids), len(solution.block.points.ids)
    assert solution.unit_sigma == pytest.approx(joint.unit_sigma, rel=1e-4)
    stations, points = solution.stations.covariance, solution.points.covariance
    np.testing.assert_allclose(compare.sigmas(stations), joint.sigma("stations", n, 6), rtol=1e-4)
    np.testing.assert_allclose(compare.sigmas(points), joint.sigma("points", p, 3), rtol=1e-4)
    np.testing.assert_allclose(solution.level_sigmas, joint.sigma("levels", -1), rtol=1e-4)
    depths = solution.bathymetric
    np.testing.assert_allclose(depths.depth_sigma, joint.depth_sigmas()[depths.point], rtol=1e-4)
    for sigma, kind in ((solution.water.correction_sigma, "tides"), (solution.water.tilt_sigma, "tilt")):
        if np.isfinite(sigma).any():
            np.testing.assert_allclose(sigma, joint.sigma(kind, -1), rtol=1e-4)


@pytest.mark.parametrize("name", list(WATER))
def test_sigmas_of_the_simultaneous_adjustment_are_those_of_the_dense_bundle(name: str) -> None:
    solution = adjust(sea_block(**WATER[name]))
    assert solution.converged, solution.reason
    assert_sigmas(solution, dense(solution))


@pytest.mark.parametrize("program", list(_PROGRAMS))
def test_sigmas_of_musat2a_are_those_of_the_dense_bundle(program: str) -> None:
    solution = adjust(with_options(without_ties(sea_block()), **_PROGRAMS[program]))
    assert solution.converged, solution.reason
    assert_sigmas(solution, dense(solution))
