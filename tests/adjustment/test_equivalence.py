"""Program IIA against the bundle, and how far WATPT is from it."""

import re
from dataclasses import replace
from functools import lru_cache
from operator import attrgetter

import numpy as np
import pytest

from altered import with_options
from blocks import converged, deep
from musatpy.adjustment import adjust
from musatpy.adjustment.watpt import FAR
from musatpy.model import Block, Control, ControlKind, CoordinateSystem, Program, Refraction, Solution, Weights
from musatpy.units import ARC_SECOND, DEGREE
from reference import compare, dense_bundle, networks
from reference.networks import Plan, Simulated

FULL, HORIZONTAL, VERTICAL, CHECK = ControlKind
GEOGRAPHIC, GEOCENTRIC, LOCAL = CoordinateSystem

LAND = {
    "local strip": Plan(),
    "two photos": Plan(photos_per_strip=2),
    "fixed control": Plan(photos_per_strip=4, fixed_every=1, seed=2),
    "horizontal and vertical control": Plan(kinds=(VERTICAL, HORIZONTAL, CHECK), photos_per_strip=5, seed=3),
    "geographic, everything": Plan(
        system=GEOGRAPHIC,
        photos_per_strip=4,
        kinds=(VERTICAL, HORIZONTAL, CHECK, VERTICAL),
        fixed_every=3,
        station_sigma=2.0,
        attitude_sigma=120 * ARC_SECOND,
        equal_elevation=True,
        air_base=True,
        keep_out=4,
        seed=4,
    ),
    "geographic block": Plan(system=GEOGRAPHIC, strips=2, kinds=(VERTICAL, HORIZONTAL), seed=5),
    "geocentric": Plan(system=GEOCENTRIC, kinds=(VERTICAL, HORIZONTAL), fixed_every=4, air_base=True, seed=6),
    "level group on loose points": Plan(equal_elevation=True, kinds=(CHECK,), heading=2.0, seed=7),
}
SEA = {
    "local strip": Plan(submerged=True, photos_per_strip=4),
    "fixed and partial control": Plan(
        submerged=True, sea_control=True, kinds=(VERTICAL, HORIZONTAL), fixed_every=3, photos_per_strip=4, seed=2
    ),
    "geographic, everything": Plan(
        system=GEOGRAPHIC,
        submerged=True,
        sea_control=True,
        photos_per_strip=4,
        kinds=(VERTICAL, HORIZONTAL, CHECK),
        fixed_every=5,
        station_sigma=1.0,
        attitude_sigma=60 * ARC_SECOND,
        equal_elevation=True,
        air_base=True,
        keep_out=3,
        seed=3,
    ),
    "geographic block": Plan(
        system=GEOGRAPHIC, submerged=True, wet_every=3, strips=2, kinds=(VERTICAL, HORIZONTAL), seed=4
    ),
    "geocentric, sea control": Plan(
        system=GEOCENTRIC, submerged=True, sea_control=True, kinds=(FULL, VERTICAL), seed=5
    ),
    "low over the water": Plan(submerged=True, height=900.0, base=390.0, photos_per_strip=4, seed=6),
}
EVERY = {f"land, {name}": plan for name, plan in LAND.items()} | {
    f"sea, {name}": plan for name, plan in SEA.items()
}


@lru_cache
def simulated(plan: Plan) -> Simulated:
    return networks.simulate(plan)


@lru_cache
def reference(plan: Plan) -> dense_bundle.Result:
    return dense_bundle.solve(simulated(plan).block, simulated(plan).truth, refraction=plan.submerged)


@lru_cache
def solved(plan: Plan, refraction: Refraction, weights: Weights = Weights.FULL, program: str = "IIA") -> Solution:
    options = {"program": Program(program), "refraction": refraction, "weights": weights}
    return converged(simulated(plan).block, **options)


def assert_equals_bundle(solution: Solution, result: dense_bundle.Result) -> None:
    # 1e-6 sigma is what full weights promise; the iteration limits of the plans are far below it
    assert np.abs(compare.station_difference(solution, result)).max() < 1e-6
    determined = np.isfinite(result.points).all(axis=1)
    assert np.abs(compare.point_difference(solution, result)[determined]).max() < 1e-6
    np.testing.assert_array_equal(solution.plates.triangulated, result.triangulated)
    seen = np.isfinite(result.residual)
    difference = np.abs(solution.plates.residual - result.residual)[seen]
    assert difference.max() < 1e-6 * solution.block.options.plate_sigma
    assert solution.degrees_of_freedom == result.degrees_of_freedom
    assert sum(solution.observations.values()) - sum(solution.unknowns.values()) == result.degrees_of_freedom
    # at the minimum the sum of squares moves with the square of the differences: only rounding is left
    assert solution.sum_of_squares == pytest.approx(result.sum_of_squares, rel=1e-8)
    assert solution.sigma0 == pytest.approx(result.sigma0, rel=1e-8)
    used = result.level_sigmas > 0.0
    assert np.abs((solution.levels - result.levels)[used] / result.level_sigmas[used]).max(initial=0.0) < 1e-6
    np.testing.assert_allclose(solution.level_sigmas[used], result.level_sigmas[used], rtol=1e-4)


def assert_covariances_equal(solution: Solution, result: dense_bundle.Result) -> None:
    # 1e-4: normals formed from conditions and from the bundle differ by second order terms of the residuals
    stations = compare.covariance_difference(solution.stations.covariance, result.covariance)
    assert np.abs(stations).max() < 1e-4
    determined = np.isfinite(result.points).all(axis=1)
    points = compare.covariance_difference(
        solution.points.covariance[determined], result.point_covariance[determined]
    )
    assert np.abs(points).max() < 1e-4


@pytest.mark.parametrize("program", ["IIA", pytest.param("IIIA", marks=pytest.mark.slow)])
@pytest.mark.parametrize("plan", EVERY.values(), ids=EVERY)
def test_equals_the_bundle(plan: Plan, program: str) -> None:
    solution = solved(plan, Refraction.RIGOROUS if plan.submerged else Refraction.NONE, program=program)
    assert_equals_bundle(solution, reference(plan))
    assert_covariances_equal(solution, reference(plan))


@pytest.mark.slow
@pytest.mark.parametrize("plan", SEA.values(), ids=SEA)
def test_watpt_is_near_rigorous_and_as_sure(plan: Plan) -> None:
    """Within a twentieth of sigma over the stations' unknowns, with up to half of the points submerged.

    The rest is of the method: its normal equations have the partials of straight rays (a quarter off in height).
    These would make depths look 1.34 times as sure; errors are propagated through refracted ones. 3 %: the two
    solutions differ a little.
    """
    solution, rigorous = solved(plan, Refraction.WATPT), solved(plan, Refraction.RIGOROUS)
    difference = compare.station_difference(solution, reference(plan))
    assert np.sqrt(np.mean(difference**2)) < 0.05
    assert solution.degrees_of_freedom == reference(plan).degrees_of_freedom
    assert solution.passes[-1].movement < solution.block.options.water_limit
    of_stations = (compare.sigmas(one.stations.covariance) for one in (solution, rigorous))
    np.testing.assert_allclose(*of_stations, rtol=0.03)
    np.testing.assert_allclose(solution.bathymetric.depth_sigma, rigorous.bathymetric.depth_sigma, rtol=0.03)


def test_modes_are_bit_identical_on_land() -> None:
    plan = LAND["geographic, everything"]
    plain, *others = (solved(plan, refraction) for refraction in Refraction)
    for other in others:
        for of in ("stations.position", "stations.attitude", "stations.covariance", "points.position", "sigma0",
                   "plates.residual"):  # fmt: skip
            np.testing.assert_array_equal(*map(attrgetter(of), (plain, other)))


@pytest.mark.slow
@pytest.mark.parametrize("weights", [Weights.DIAGONAL, Weights.EQUAL])
@pytest.mark.parametrize("plan", [LAND["geographic block"], SEA["geographic block"]], ids=["land", "sea"])
def test_simple_weights_are_near_but_not_the_bundle(plan: Plan, weights: Weights) -> None:
    refraction = Refraction.RIGOROUS if plan.submerged else Refraction.NONE
    solution = solved(plan, refraction, weights)
    difference = np.abs(compare.station_difference(solution, reference(plan))).max()
    # known from experiments: 0.55 sigma with diagonal weights, 2.3 to 2.8 with equal ones
    assert 1e-2 < difference < 5.0
    assert solution.degrees_of_freedom == reference(plan).degrees_of_freedom


@pytest.mark.slow
def test_legacy_residuals_of_submerged_points_shrink_pass_by_pass() -> None:
    plan = SEA["geographic block"]
    block = with_options(simulated(plan).block, refraction=Refraction.LEGACY, max_passes=8)
    legacy = adjust(block)
    rms = np.array([water_pass.rms_residual for water_pass in legacy.passes])
    assert len(rms) >= 5
    assert (np.diff(rms) < 0.0).all()
    watpt = solved(plan, Refraction.WATPT)
    assert rms[-1] < 0.7 * watpt.passes[-1].rms_residual


def held_at_the_tide(block: Block, point: int, tide: float) -> Block:
    """The block with the height of a point known to be that of the water."""
    control = block.control
    held = Control(
        point=np.append(control.point, point),
        kind=np.append(control.kind, VERTICAL),
        fixed=np.append(control.fixed, True),
        position=np.vstack([control.position, [[np.nan, np.nan, tide]]]),
        sigma=np.vstack([control.sigma, np.full((1, 3), np.nan)]),
    )
    return replace(block, control=held)


SHORE = Plan(submerged=True, photos_per_strip=4, kinds=(VERTICAL, HORIZONTAL))
LONGER = Plan(
    system=GEOGRAPHIC,
    submerged=True,
    photos_per_strip=5,
    kinds=(VERTICAL, HORIZONTAL),
    start_error=(100.0, 2.0 * DEGREE),
)


@lru_cache
def reference_at_the_tide(plan: Plan, name: str, photo: str) -> tuple[int, float, dense_bundle.Result]:
    """Point, tide and bundle of a strip of which the bundle without held points has no smooth minimum."""
    block, truth = simulated(plan).block, simulated(plan).truth
    point = int(np.flatnonzero(block.points.ids == name)[0])
    tide = float(block.photos.tide[block.photos.ids == photo][0])
    with pytest.raises(RuntimeError, match="not converged"):
        dense_bundle.solve(block, truth, refraction=True, max_iterations=12)
    return point, tide, dense_bundle.solve(held_at_the_tide(block, point, tide), truth, refraction=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plan", "name", "photo", "refraction"),
    [
        (replace(SHORE, seed=104), "P004", "838", Refraction.WATPT),
        (replace(SHORE, sea_control=True, seed=109), "P004", "838", Refraction.WATPT),
        (replace(LONGER, seed=302), "P006", "838", Refraction.RIGOROUS),
    ],
)
def test_point_at_the_water_line(plan: Plan, name: str, photo: str, refraction: Refraction) -> None:
    """The sum of squares of these strips is least with a point exactly at one photo's tide, where it has a kink.

    Taken as wet the point comes out dry and the other way round. Either way is good for a tenth of a sigma; the
    reference holds the point at the tide.
    """
    point, tide, result = reference_at_the_tide(plan, name, photo)
    solution = solved(plan, refraction)
    difference = compare.station_difference(solution, result)
    assert np.sqrt(np.mean(difference**2)) < 0.1
    height = solution.points.position[point, 2]
    assert abs(height - tide) < np.sqrt(solution.points.covariance[point, 2, 2])


MOST = 0.6  # sigmas: 40 strips (seeds 0 to 39) had 0.53 at most, 0.24 in the median; of points 0.29 at most


def warned(solution: Solution) -> list[float]:
    found = (re.search(r"is (\d+\.\d\d) sigma from that of RIGOROUS", warning) for warning in solution.warnings)
    return [float(one[1]) for one in found if one]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))  # 1 below 0.3 sigma, 2 above
def test_watpt_over_deep_water_is_as_far_from_rigorous_as_it_says(seed: int) -> None:
    modes = (Refraction.WATPT, Refraction.RIGOROUS)
    watpt, rigorous = (adjust(with_options(deep(seed), refraction=mode)) for mode in modes)
    assert watpt.converged and rigorous.converged
    away = np.abs(compare.station_difference(rigorous, watpt.stations))
    assert away.max() < MOST
    assert np.sqrt(np.mean(away**2)) < 0.2
    # 0.01: the two decimals of the warning, and the second order of the one step behind it
    if away.max() > FAR + 0.01:
        assert warned(watpt) == [pytest.approx(away.max(), abs=0.01)]
        photo, parameter = np.unravel_index(away.argmax(), away.shape)
        name = ("east", "north", "up", "X-tilt", "Y-tilt", "heading")[parameter]
        assert any(w.endswith(f"{name} of photo {watpt.block.photos.ids[photo]}") for w in watpt.warnings)
    elif away.max() < FAR - 0.01:
        assert warned(watpt) == []
    assert warned(rigorous) == []


@pytest.mark.slow
@pytest.mark.parametrize(("name", "farthest"), [("local strip", "photo"), ("geocentric, sea control", "point")])
def test_legacy_says_that_it_is_far_off(name: str, farthest: str) -> None:
    """It creeps towards the solution of the land points alone, which is 1 to 2 sigmas off in these strips."""
    block = with_options(simulated(SEA[name]).block, refraction=Refraction.LEGACY, max_passes=100)
    solution = converged(block)
    rigorous = adjust(with_options(block, refraction=Refraction.RIGOROUS))
    _, points = compare.apart(rigorous, solution)
    of_points = np.nanmax(np.abs(points[compare.sigmas(solution.points.covariance) > 1e-9]))
    away = {"photo": np.abs(compare.station_difference(rigorous, solution.stations)).max(), "point": of_points}
    # the step starts sigmas away: what is left of the distance is of the second order
    assert warned(solution) == [pytest.approx(away[farthest], rel=0.1)]
    assert away[farthest] == max(away.values()) > 1.0
    assert any(f"of {farthest} " in warning for warning in solution.warnings if "RIGOROUS" in warning)
