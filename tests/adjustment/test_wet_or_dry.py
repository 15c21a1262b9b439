"""Points at the water line: wet or dry, and the water over points."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import musatpy
import wave_strip
from adjustment.test_equivalence import SHORE, reference_at_the_tide, simulated
from altered import altered, with_options
from blocks import FIXTURES, converged, shore, st_thomas
from drivers.mutated_decks import decks
from musatpy import read_deck
from musatpy.adjustment import adjust
from musatpy.arrays import FloatArray
from musatpy.model import Block, CoordinateSystem, Program, Refraction, Solution
from musatpy.model.solution import Iteration
from reference import compare
from reference.networks import Plan, simulate

DECK = FIXTURES / "verdict/iiia_false_minimum.crd"


def both(block: Block) -> tuple[Solution, Solution]:
    """The solutions of IIA RIGOROUS and of IIIA."""
    options = {"refraction": Refraction.RIGOROUS}
    one, other = (adjust(with_options(block, program=program, **options)) for program in Program)
    assert one.converged, one.reason
    assert other.converged, other.reason
    return one, other


def assert_one_minimum(block: Block) -> None:
    """1e-3 of sigma0 is asked for; in the same states the programs have one minimum, to the last steps."""
    one, other = both(block)
    assert one.sigma0 == pytest.approx(other.sigma0, rel=1e-6)
    assert one.degrees_of_freedom == other.degrees_of_freedom
    sigma = compare.sigmas(one.points.covariance)[:, 2]
    height = one.points.position[:, 2] - other.points.position[:, 2]
    assert np.nanmax(np.abs(height / np.where(sigma > 0.0, sigma, np.nan))) < 0.01


def test_land_points_flagged_wet_lead_to_no_false_minimum() -> None:
    """Taken as submerged, two points on land bent the block: sigma0 4.31, points 5 m off, "converged"."""
    block = read_deck(DECK)
    assert block.options.program is Program.IIIA
    one, other = both(block)
    for solution in (one, other):
        assert solution.sigma0 == pytest.approx(0.7367, abs=5e-5)
    assert np.nanmax(np.abs(one.points.position - other.points.position)) < 1e-3
    assert any("point 112 is flagged as submerged" in warning for warning in other.warnings)


@pytest.mark.slow
def test_points_whose_rays_exchange_their_sides_come_to_rest(tmp_path: Path) -> None:
    """With x and y of an image exchanged, points flooded in one photo as they dried in another, for ever."""
    exchanged = ("-93.4590000 -79.7050000", "-79.7050000 -93.4590000")
    deck = tmp_path / "exchanged.crd"
    deck.write_text("\n".join(decks()["level"]).replace(*exchanged), encoding="ascii")

    def count(iteration: Iteration) -> None:
        assert iteration.outer_pass <= 6 * 21  # passes: six changes of each of the 21 points

    assert adjust(read_deck(deck), count).converged


# seeds in which the programs parted, or a point stands on a water line: by up to 0.73 of sigma0 before
QUICK = [(shore, seed) for seed in (9, 12)] + [(st_thomas, 1)]
MANY = [(shore, seed) for seed in (2, 23, 28, 34, *range(100, 125))] + [
    (st_thomas, seed) for seed in (10, 14, 25, *range(100, 125))
]


@pytest.mark.slow
@pytest.mark.parametrize(("job", "seed"), [*QUICK, *(pytest.param(*case, marks=pytest.mark.slow) for case in MANY)])
def test_programs_agree_on_wet_and_dry(job: Callable[[int], Block], seed: int) -> None:
    assert_one_minimum(job(seed))


@pytest.mark.slow
@pytest.mark.parametrize("program", list(Program))
def test_a_point_that_no_side_agrees_with_stands_on_the_water_line(program: Program) -> None:
    """Where the independent bundle holds it, to the rounding of the cards of that bundle."""
    plan = replace(SHORE, seed=104)
    point, tide, result = reference_at_the_tide(plan, "P004", "838")
    solution = converged(simulated(plan).block, program=program, refraction=Refraction.RIGOROUS)
    assert solution.points.position[point, 2] == pytest.approx(tide, abs=1e-6)
    assert np.abs(compare.station_difference(solution, result)).max() < 1e-4
    # it is held in the iteration only: its sigma is that of a point as free as others
    assert compare.sigmas(solution.points.covariance)[point, 2] > 0.1


TILT = (3e-4, -5e-4)  # of the water towards east and north


def waves(block: Block, xyz: FloatArray, time: FloatArray) -> FloatArray:
    """Return the sum (m,) of H/2 cos k (s - crest - c t), s counted along azimuths clockwise from north."""
    assert block.wave_origin is not None
    east, north, _ = (xyz - block.wave_origin.position).T
    height = np.zeros(len(xyz))
    length, speed = (wave_strip.swell_length(), 24.7), (wave_strip.swell_length() / 10.0, 6.17)
    for H, L, c, azimuth, crest in zip((1.1, 0.3), length, speed, (60.0, 115.0), (12.5, -4.0), strict=True):
        s = east * np.sin(np.radians(azimuth)) + north * np.cos(np.radians(azimuth))
        height += H / 2.0 * np.cos(2.0 * np.pi / L * (s - crest - c * time))
    return height


def lowest_and_highest(block: Block, water: FloatArray) -> FloatArray:
    """Return (p, 2) of the water (m,) over the points of measurements; NaN over points without."""
    out = np.full((2, len(block.points.ids)), np.nan)
    np.fmin.at(out[0], block.plates.point, water)
    np.fmax.at(out[1], block.plates.point, water)
    return out.T


def test_tides_and_waves_over_points() -> None:
    """Waves of a metre: with their sign turned the water is off by as much."""
    block, _ = wave_strip.strip(CoordinateSystem.LOCAL)
    points = musatpy.adjust(block).points
    photo, xyz = block.plates.photo, points.position[block.plates.point]
    expected = block.photos.tide[photo] + waves(block, xyz, block.photos.time[photo])
    assert np.nanmax(points.water[:, 1] - points.water[:, 0]) > 0.5
    np.testing.assert_allclose(points.water, lowest_and_highest(block, expected), rtol=0.0, atol=1e-4)


def test_a_tilt_lifts_the_water_to_its_side() -> None:
    """The water over points is a plane through their tides, and rises as the tilt says."""
    plan = Plan(submerged=True, noise=0.0)
    block = altered(simulate(plan).block, water={"tilt_east": TILT[0], "tilt_north": TILT[1]})
    points, tide = musatpy.adjust(block).points, block.photos.tide
    known = np.isfinite(points.water[:, 0])
    xy = points.position[known, :2] - block.photos.position[:, :2].mean(axis=0)
    assert known.sum() > 8 and (np.ptp(xy, axis=0) > 1000.0).all()
    of_tides = lowest_and_highest(block, tide[block.plates.photo])[known]
    for lifted in (points.water[known] - of_tides).T:
        plane = np.column_stack([xy, np.ones(len(xy))])
        rise, _, rank, _ = np.linalg.lstsq(plane, lifted, rcond=None)
        assert rank == 3 and rise[:2] == pytest.approx(TILT, rel=1e-6)
        np.testing.assert_allclose(plane @ rise, lifted, rtol=0.0, atol=1e-9)
