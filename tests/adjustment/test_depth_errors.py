"""Depths of many blocks whose tides and index are wrong: their errors over the sigmas that the program gives them.

All depths have the errors of two tides and of the index in common, so that the mean of their squares over blocks by
chance settles slowly: 150 leave 6 % of the RMS. They are one sigma up or down here, in all eight combinations as
often, whose second moments are those of the sigmas without any chance. Images and control have errors by chance,
which leave 3 % of the RMS of 48 blocks, 4.4 % where they find the levels.

`python -m adjustment.test_depth_errors 2000`, in tests/, draws so many blocks for every program and prints the RMS
of the errors of their depths over the sigmas of depths, over those of heights, and the mean standard deviation of
unit weight.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import cycle, islice, product
from typing import Any

import numpy as np
import pytest

from adjustment.test_equivalence import simulated
from altered import altered
from musatpy.adjustment import adjust
from musatpy.model import Block, Grade, Program, Refraction, Solution, Treatment, WaterLevel
from musatpy.statistics.verdict import verdict
from reference.dense_bundle import Network, starting_state
from reference.networks import Plan, Simulated

_DRAWS = 24  # three of each combination
_TIDE, _INDEX = 0.30, 0.004  # m, and of the index
_IIIA: dict[str, Any] = {"program": Program.IIIA}
PROGRAMS: dict[str, dict[str, Any]] = {
    "IIA": {"program": Program.IIA, "refraction": Refraction.RIGOROUS},
    "WATPT": {"program": Program.IIA, "refraction": Refraction.WATPT},
    "IIIA": _IIIA,
    "IIIA, levels adjusted": {**_IIIA, "water_level": WaterLevel.GROUP},
    "IIIA, levels and index adjusted": {
        **_IIIA,
        "water_level": WaterLevel.GROUP,
        "water_index": Treatment.ADJUST,
    },
}


@lru_cache
def scene(tide: float = _TIDE) -> Simulated:
    """A strip of four photos over control on land and points under water, exact, at its true stations."""
    plan = Plan(
        submerged=True, photos_per_strip=4, noise=0.0, control_errors=False, start_error=(0.0, 0.0),
        plate_sigma=0.003, seed=31,
    )  # fmt: skip
    simulation = simulated(plan)
    tides = {"tide_sigma": np.full(4, tide), "tide_group": np.array(["A", "A", "B", "B"])}
    return altered(simulation, block={"photos": tides, "water": {"sigma": _INDEX}})


def draws(count: int, tide_sigma: float = _TIDE) -> Iterator[tuple[Block, np.ndarray]]:
    """Yield blocks with errors of everything that has a sigma, and the true depths (p,) at the true tides."""
    simulation, rng = scene(tide_sigma), np.random.default_rng(5)
    block, truth = simulation.block, simulation.truth
    control, plates = block.control, block.plates
    rays = np.bincount(plates.point, minlength=len(block.points.ids))
    plate_sigma = np.where(np.isnan(plates.sigma), block.options.plate_sigma, plates.sigma)
    for signs in islice(cycle(product((-1.0, 1.0), repeat=3)), count):
        tide = block.photos.tide + tide_sigma * np.array(signs)[[0, 0, 1, 1]]
        index = block.water.index + _INDEX * signs[2]
        true = Network(altered(block, water={"index": index}, photos={"tide": tide}), refraction=True)
        rows = np.arange(len(plates.photo))
        state = starting_state(true, truth)
        xy = true.project(state, plates.photo, plates.point, np.zeros((len(rows), 9)), true.wet(rows))
        given = control.position + rng.normal(size=control.position.shape) * np.nan_to_num(control.sigma)
        noisy = np.real(xy) + rng.normal(size=xy.shape) * plate_sigma
        level = np.bincount(plates.point, weights=tide[plates.photo], minlength=len(rays)) / rays
        yield (
            replace(block, plates=replace(plates, xy=noisy), control=replace(control, position=given)),
            level - truth.points[:, 2],
        )


def errors(solution: Solution, depth: np.ndarray) -> np.ndarray:
    """Return the errors (s,) of depths in their sigmas."""
    found = solution.bathymetric
    return (found.depth - depth[found.point]) / found.depth_sigma


def ratio(options: dict[str, Any], count: int) -> tuple[float, float, float]:
    """Return the RMS of the errors of depths over their sigmas, that over sigmas of heights, and mean sigma0."""
    sums, number, sigma0 = np.zeros(2), 0, []
    for block, depth in draws(count):
        solution = adjust(replace(block, options=replace(block.options, **options)))
        assert solution.converged, solution.reason
        off = errors(solution, depth)
        wrong = (
            off
            * solution.bathymetric.depth_sigma
            / np.sqrt(solution.points.covariance[solution.bathymetric.point, 2, 2])
        )
        sums += np.nansum(np.square([off, wrong]), axis=1)
        number += np.isfinite(off).sum()
        sigma0.append(solution.unit_sigma)
    return *np.sqrt(sums / number).tolist(), float(np.mean(sigma0))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["IIA", "IIIA"])
def test_errors_of_poor_tides_are_no_reason_to_doubt_a_run_that_knows_them(name: str) -> None:
    """Tides that are off by metres bend the images by several of their sigmas, and the blocks are accepted."""
    sums = []
    for block, _ in draws(8, 2.0):
        options = replace(block.options, **PROGRAMS[name])
        known = adjust(replace(block, options=options))
        blank = {"tide_sigma": np.full(4, np.nan)}
        trusted = adjust(altered(block, options=options, photos=blank, water={"sigma": None}))
        assert trusted.sigma0 == known.sigma0
        sums.append((known.sigma0, known.unit_sigma, verdict(known).grade, verdict(trusted).grade))
    sigma0, unit_sigma, known_grades, trusted_grades = zip(*sums, strict=True)
    assert set(known_grades) == {Grade.ACCEPTED}
    assert trusted_grades.count(Grade.ACCEPTED) < 6 and max(sigma0) > 1.5
    assert np.sqrt(np.mean(np.square(unit_sigma))) == pytest.approx(1.0, abs=0.1)  # two standard errors


@pytest.mark.slow
@pytest.mark.parametrize("name", ["IIA", "IIIA, levels and index adjusted"])
def test_errors_of_depths_are_as_large_as_their_sigmas(name: str) -> None:
    depths, heights, unit = ratio(PROGRAMS[name], _DRAWS)
    assert depths == pytest.approx(1.0, abs=0.17)  # two and a half standard errors and more
    assert heights > 1.3 * depths
    assert unit == pytest.approx(1.0, abs=0.042)


if __name__ == "__main__":
    for program, choice in PROGRAMS.items():
        print(f"{program:<34}", *(f"{value:8.4f}" for value in ratio(choice, int(sys.argv[1]))), flush=True)
