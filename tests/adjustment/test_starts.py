"""Starts: of oblique photographs, of poor stations, of waves given too high."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from adjustment.oblique_blocks import Oblique, drawn, make_oblique
from altered import altered, with_options
from musatpy import listing, read_deck, verdict
from musatpy.adjustment import adjust, ground
from musatpy.adjustment.job import prepared
from musatpy.model import Grade, Program, Solution
from musatpy.units import ARC_SECOND, DEGREE
from reference import compare
from reference.networks import Plan, simulate
from reference.wave_scenes import scene

PAIR = Path(__file__).parent / "starts" / "oblique_pair.crd"


def told(solution: Solution) -> str:
    """Return what the listing says of two starts, in one line."""
    text = " ".join(listing(solution).split())
    return text[text.index("Two starts") :][:200] if "Two starts" in text else ""


def test_an_oblique_pair_converges_from_its_straight_rays() -> None:
    block = read_deck(PAIR)
    solution = adjust(block)
    assert verdict(solution).grade is Grade.ACCEPTED
    other = adjust(with_options(block, program=Program.IIA, refraction="NONE"))
    assert solution.sum_of_squares == pytest.approx(other.sum_of_squares, rel=1e-6)  # both stop within their limits
    assert "from the points where straight rays meet; from level ground it does not converge" in told(solution)
    assert sum(iteration.number == 1 for iteration in solution.iterations) == 1  # those of one start


@pytest.mark.slow
def test_the_lower_of_two_starts_is_taken_and_the_other_told() -> None:
    made = make_oblique(Oblique(tilt=45.0 * DEGREE, seed=3))
    assert not adjust(made.block).start  # the first one does
    wild = with_options(made.block, plate_sigma=0.001)  # sigma0 10: both starts come to rest in one minimum
    solution = adjust(wild)
    assert solution.converged
    assert solution.unit_sigma == pytest.approx(10.0, rel=0.2)  # of 100 degrees of freedom and more
    assert solution.start.startswith("level ground; from the points where straight rays meet the sum of squares is")
    assert f"{solution.sum_of_squares:.2f}" in told(solution)
    assert not adjust(
        with_options(wild, plate_sigma_is="GUESS", sigma0_limit=20.0)
    ).start  # a guess may be so far off


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 35, 39, 111, 115, 121, 135, 4, 8])  # all but two failed from level ground
def test_drawn_oblique_blocks_converge(seed: int) -> None:
    made = drawn(seed)
    started, true = adjust(made.started), adjust(made.block)
    assert started.converged, started.reason
    assert started.sum_of_squares == pytest.approx(true.sum_of_squares, rel=1e-4)
    assert started.unit_sigma < 1.6  # of 20 and more degrees of freedom


@pytest.mark.slow
def test_waves_given_far_too_high_are_found() -> None:
    made = scene(74)
    cards = made.block.waves
    high = made.waves.values[:, 0] + 2.6 * cards.height_sigma
    solution = adjust(altered(made.block, waves={"height": high}))
    assert solution.converged
    assert solution.unit_sigma < 1.3
    np.testing.assert_allclose(solution.water.waves.value[:, 0], made.waves.values[:, 0], rtol=0.05)


CLOSE_PAIR = {"photos": 2, "base": 0.15, "control": 4}  # narrow and hardly held
LOW = {"height": 1000.0}  # 500 m are half of it
TIGHT = {"rotation_limit": 1e-3 * ARC_SECOND, "translation_limit": 1e-5, "max_iterations": 20}


def assert_same_minimum(one: Solution, other: Solution) -> None:
    """Assert that both converged, to stations within 1e-3 sigma of each other: the limits leave less than that."""
    assert one.converged, one.reason
    assert other.converged, other.reason
    assert np.abs(compare.station_difference(one, other.stations)).max() < 1e-3


SHAPES = {
    "pair": (CLOSE_PAIR, 2),
    "low strip": (LOW, 3),
    "convergent pairs": ({**CLOSE_PAIR, "convergent": True}, 1),
}
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
    assert_same_minimum(adjust(with_options(made.started, **TIGHT)), adjust(with_options(made.block, **TIGHT)))


def test_a_restarted_triangulation_says_so() -> None:
    plan = Oblique(tilt=60.0 * DEGREE, program=Program.IIA, heading=3.5, seed=5, **CLOSE_PAIR)
    solution = adjust(make_oblique(plan).started)
    assert solution.converged
    assert [text for text in solution.warnings if text.endswith("started again from a simultaneous adjustment")]


def test_points_reach_the_level_ground_however_flat_their_rays() -> None:
    """Rays up to the horizon and above it end at the typical height, and not for ever far off."""
    plan = Oblique(tilt=60.0 * DEGREE, seed=4)
    job, state = prepared(make_oblique(plan).started, None)
    raised = replace(state, attitude=state.attitude + np.array([25.0 * DEGREE, 0.0, 0.0]))
    start = ground.level_start(job.network, raised)
    network = job.network
    points = np.unique(network.point[~network.priors.known[network.point, 2]])
    typical = float(np.nanmedian(network.priors.given[:, 2]))
    np.testing.assert_allclose(network.frame.height(start.ground[points]), typical, atol=1e-6)  # rounding
    # ten flying heights at the cosine of 0.1, and the stations are within one of the middle
    assert np.linalg.norm(start.ground[points], axis=1).max() < 11.0 * plan.height


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
