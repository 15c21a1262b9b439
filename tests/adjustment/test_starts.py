"""The second start of IIIA: oblique photographs that level ground leads astray, and runs that need the first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adjustment.oblique_blocks import Oblique, drawn, make_oblique
from altered import altered, with_options
from musatpy import listing, read_deck, verdict
from musatpy.adjustment import adjust
from musatpy.adjustment.job import prepared
from musatpy.adjustment.starts import straight_start
from musatpy.model import Grade, Program, Solution
from musatpy.units import DEGREE
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


def test_points_that_poor_stations_intersect_nowhere_start_as_far_as_the_control() -> None:
    job, state = prepared(drawn(111).started(), None)
    network = job.network
    start = straight_start(network, state)
    changed = (start.ground != state.ground).any(axis=1)
    assert 0 < changed.sum() < network.points // 2
    assert not changed[network.priors.known.all(axis=1)].any()
    away = start.ground[network.point] - state.position[network.photo]
    assert (np.einsum("mi,mi->m", away, state.M[network.photo][:, 2]) < 0.0).all()  # all in front


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 35, 39, 111, 115, 121, 135, 4, 8])  # all but two failed from level ground
def test_drawn_oblique_blocks_converge(seed: int) -> None:
    made = drawn(seed)
    started, true = adjust(made.started()), adjust(made.block)
    assert started.converged, started.reason
    assert started.sum_of_squares == pytest.approx(true.sum_of_squares, rel=1e-4)
    assert started.unit_sigma < 1.6  # of 20 and more degrees of freedom


@pytest.mark.slow
def test_waves_given_far_too_high_are_found_from_half_their_heights() -> None:
    made = scene(74)
    cards = made.block.waves
    high = made.waves.values[:, 0] + 2.6 * cards.height_sigma
    solution = adjust(altered(made.block, waves={"height": high}))
    assert solution.converged
    assert solution.start.startswith("the points where straight rays meet")
    assert solution.unit_sigma < 1.3
    np.testing.assert_allclose(solution.water.waves.value[:, 0], made.waves.values[:, 0], rtol=0.05)
