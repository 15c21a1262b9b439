"""Oblique photographs from poor stations, and bases very long and very short, find the minimum of good stations."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from adjustment.oblique_blocks import Oblique, make_oblique
from altered import with_options
from musatpy.adjustment import adjust, ground
from musatpy.adjustment.job import prepared
from musatpy.adjustment.simultaneous import Simultaneous
from musatpy.model import Program, Solution
from musatpy.units import ARC_SECOND, DEGREE
from reference import compare
from reference.networks import Plan, simulate

PAIR = {"photos": 2, "base": 0.15, "control": 4}  # narrow and hardly held
LOW = {"height": 1000.0}  # 500 m are half of it
TIGHT = {"rotation_limit": 1e-3 * ARC_SECOND, "translation_limit": 1e-5, "max_iterations": 20}


def assert_same_minimum(one: Solution, other: Solution) -> None:
    """Assert that both converged, to stations within 1e-3 sigma of each other: the limits leave less than that."""
    assert one.converged, one.reason
    assert other.converged, other.reason
    assert np.abs(compare.station_difference(one, other.stations)).max() < 1e-3


SHAPES = {"pair": (PAIR, 2), "low strip": (LOW, 3), "convergent pairs": ({**PAIR, "convergent": True}, 1)}
STEEP = [  # every two of shape, water and program together
    ("pair", False, Program.IIA),
    ("pair", True, Program.IIIA),
    ("low strip", True, Program.IIA),
    ("low strip", False, Program.IIIA),
    ("convergent pairs", False, Program.IIIA),
    ("convergent pairs", True, Program.IIA),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "submerged", "program", "degrees"),
    [
        *(pytest.param(*case, 45.0, marks=pytest.mark.slow) for case in product(SHAPES, (False, True), Program)),
        *((*case, 60.0) for case in STEEP),
    ],
)
def test_oblique_photographs_from_poor_stations(
    name: str, submerged: bool, program: Program, degrees: float
) -> None:
    shape, seed = SHAPES[name]
    tilt, heading = degrees * DEGREE, 0.7 * seed
    plan = Oblique(tilt=tilt, submerged=submerged, program=program, heading=heading, seed=seed, **shape)
    made = make_oblique(plan)
    assert_same_minimum(adjust(with_options(made.started(), **TIGHT)), adjust(with_options(made.block, **TIGHT)))


def test_a_restarted_triangulation_says_so() -> None:
    plan = Oblique(tilt=60.0 * DEGREE, program=Program.IIA, heading=3.5, seed=5, **PAIR)
    solution = adjust(make_oblique(plan).started())
    assert solution.converged
    assert [text for text in solution.warnings if text.endswith("started again from a simultaneous adjustment")]


def test_points_reach_the_level_ground_however_flat_their_rays() -> None:
    """Rays up to the horizon and above it end at the typical height, and not for ever far off."""
    plan = Oblique(tilt=60.0 * DEGREE, seed=4)
    job, state = prepared(make_oblique(plan).started(), None)
    raised = replace(state, attitude=state.attitude + np.array([25.0 * DEGREE, 0.0, 0.0]))
    start = ground.level_start(job.network, raised)
    network = job.network
    points = np.unique(network.point[~network.priors.known[network.point, 2]])
    typical = float(np.nanmedian(network.priors.given[:, 2]))
    np.testing.assert_allclose(network.frame.height(start.ground[points]), typical, atol=1e-6)  # rounding
    # ten flying heights at the cosine of 0.1, and the stations are within one of the middle
    assert np.linalg.norm(start.ground[points], axis=1).max() < 11.0 * plan.height


def test_a_step_damped_enough_lowers_the_sum_of_squares() -> None:
    """Points take their whole step, however short that of the stations is: alone it may raise the sum."""
    plan = Oblique(tilt=45.0 * DEGREE, submerged=True, height=1000.0, heading=0.7, seed=1)
    job, state = prepared(make_oblique(plan).started(), None)
    network = job.network.with_plates(job.network.xy, job.bathymetric[job.network.point])
    problem = Simultaneous(network=network, options=job.block.options)
    start = problem.with_squares(ground.level_start(network, state))
    line = problem.linearise(start)
    assert np.isfinite(line.objective)
    still = problem.apply(start, np.zeros(line.matrix.size), line.context)
    assert problem.evaluate(still, line.context) < line.objective


BASES = {
    "1.5 times the height": {"base": 4500.0, "focal_length": 88.0},  # with a lens that still sees an overlap
    "0.03 of the height": {"base": 90.0},
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("base", "submerged", "program"),
    [
        ("1.5 times the height", False, Program.IIA),
        ("1.5 times the height", True, Program.IIIA),
        ("0.03 of the height", False, Program.IIIA),
        ("0.03 of the height", True, Program.IIA),
    ],
)
def test_bases_very_long_and_very_short(base: str, submerged: bool, program: Program) -> None:
    plan = Plan(
        start_error=(50.0, 1.0 * DEGREE),
        photos_per_strip=3,
        submerged=submerged,
        wet_every=3,
        seed=3,
        **BASES[base],
    )
    simulated = simulate(plan)
    block = with_options(simulated.block, **TIGHT, program=program)
    truth = replace(
        block.photos, position=simulated.truth.position, attitude=simulated.truth.attitude
    )  # in a local job the axes are the same everywhere
    assert_same_minimum(adjust(block), adjust(replace(block, photos=truth)))
