"""Decks punched of solutions: the same job from where it came to rest, or its results as new observations."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
import pytest

from adjustment.test_musat3a import sea_block
from altered import added, altered, with_options
from jobs.decks import cards, cayman, photos, reread, rich, st_thomas
from musatpy import model
from musatpy.errors import AdjustmentError
from musatpy.formats.musat import check_deck, deck_bytes
from musatpy.geometry.geodesy import frame_of
from musatpy.jobs.agreement import Part
from musatpy.jobs.extract import extracted, photos_named
from musatpy.jobs.merge import MergeOptions, merged
from musatpy.jobs.punch import Content, Punch, PunchedPoints, punched, restart
from musatpy.model import Block, ControlKind, CoordinateSystem, Program, Refraction, Solution, Treatment, WaterLevel
from musatpy.pipeline import adjust
from musatpy.units import ARC_SECOND
from reference.networks import Plan, simulate

RESULT = Punch(content=Content.RESULT)
# The positions of a restart and of the run before are two iterates nearer to the minimum than the limit of 1 mm,
# and the iteration converges so fast that the last step leaves less than a thousandth of it.
SLOW = partial(pytest.param, marks=pytest.mark.slow)
SAME = 1e-6


def solved(block: Block) -> Solution:
    solution = adjust(block)
    assert solution.converged, solution.reason
    return solution


def again(solution: Solution) -> Solution:
    """The solution of the deck that is punched for a restart."""
    return solved(reread(restart(solution)[0]))


def apart(one: Solution, other: Solution) -> float:
    """The largest distance (m) between stations, and between points, of two solutions."""
    frame, ids = frame_of(one.block.options.system, one.block.ellipsoid), other.block.points.ids.tolist()
    rows = [ids.index(name) for name in one.block.points.ids.tolist()]
    assert one.block.photos.ids.tolist() == other.block.photos.ids.tolist()
    there = np.isfinite(one.points.position).all(axis=1)
    stations = frame.working(one.stations.position) - frame.working(other.stations.position)
    points = frame.working(one.points.position[there]) - frame.working(other.points.position[rows][there])
    return float(np.abs(np.concatenate([stations, points])).max())


@lru_cache
def cayman_solved() -> Solution:
    return solved(cayman())


def land(plan: Plan, **options: Any) -> Block:
    return with_options(simulate(plan).block, rotation_limit=0.1 * ARC_SECOND, translation_limit=0.001, **options)


def free() -> Block:
    """A free network, whose control only checks."""
    options = {"program": Program.IIIA, "datum": model.Datum.FREE}
    block = with_options(
        simulate(Plan(photos_per_strip=4)).block, rotation_limit=1e-9, translation_limit=1e-6, **options
    )
    return altered(block, control={"kind": np.full(len(block.control.kind), ControlKind.CHECK)})


def without_stations() -> Block:
    unknown = dict.fromkeys(("position", "attitude"), np.full((3, 3), np.nan))
    return altered(st_thomas(), photos=unknown, options={"initial": model.Initial.COMPUTE})


def with_blunder() -> Block:
    return altered(cayman(), plates={"xy": added(3, 0.5)}, options={"editing": model.Editing.EDIT})


GROUPS = Plan(strips=2, equal_elevation=True, air_base=True, keep_out=2)
# The block, and how many iterations its restart takes at most. Levels of groups start at the mean of their
# points, as rays alone put these, and take a step more. IIA begins without refraction, wherever
# it starts. A free network lies about the points as they start: those of straight rays from the stations.
RESTARTS: dict[str, tuple[Callable[[], Block], int]] = {
    **{
        f"land, {system}, {program}": (partial(land, Plan(system=system, photos_per_strip=4), program=program), 2)
        for system in CoordinateSystem
        for program in Program
    },
    **{f"groups, {program}": (partial(land, GROUPS, program=program), 3) for program in Program},
    "IIA, no refraction": (lambda: with_options(cayman(), refraction=Refraction.NONE), 1),
    **{
        f"IIA, {mode}": (lambda mode=mode: with_options(cayman(), refraction=mode), 99)
        for mode in (Refraction.WATPT, Refraction.RIGOROUS)
    },
    **{
        f"IIIA, {deck.__name__}": (lambda deck=deck: with_options(deck(), program=Program.IIIA), 2)
        for deck in (cayman, st_thomas)
    },
    "free network": (free, 99),
    "computed initial values": (without_stations, 99),
    "an image that is a blunder": (with_blunder, 99),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RESTARTS)
def test_a_restart_comes_to_rest_where_the_run_did(name: str) -> None:
    block, most = RESTARTS[name]
    first = solved(reread(block()))
    second = again(first)
    is_free = name == "free network"
    assert apart(first, second) < (0.05 if is_free else SAME)
    assert second.sigma0 == pytest.approx(first.sigma0, rel=1e-9)  # quadratic in SAME over centimetres
    assert len(second.iterations) <= most and (most < 99 or len(second.iterations) <= len(first.iterations))
    assert len(second.passes) == len(first.passes) or block is with_blunder
    options = second.block.options
    assert (options.initial, options.editing) == (model.Initial.GIVEN, model.Editing.NONE)
    assert bool(first.findings) == (block is with_blunder) and not second.findings


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {},
        SLOW({"water_level": WaterLevel.PHOTO}),
        {"water_level": WaterLevel.GROUP, "water_tilt": Treatment.ADJUST, "water_index": Treatment.ADJUST},
    ],
    ids=["known", "tides", "all"],
)
def test_observed_stations_and_water_with_priors_stay_as_given(options: dict[str, Any]) -> None:
    block = reread(sea_block(**options))
    solution = solved(block)
    punched, notes = restart(solution)
    for name in ("position", "position_sigma", "attitude_sigma", "tide", "tide_sigma"):
        np.testing.assert_array_equal(getattr(punched.photos, name), getattr(block.photos, name))
    assert punched.water == block.water
    assert not np.array_equal(punched.photos.attitude, block.photos.attitude)
    assert notes == ("tilted water turns about the middle of the given stations, which a restart moves a little",)
    assert apart(solution, again(solution)) < SAME


@pytest.mark.slow
@pytest.mark.parametrize("level", [WaterLevel.ONE, SLOW(WaterLevel.PHOTO), WaterLevel.GROUP])
def test_tides_without_prior_start_as_adjusted(level: WaterLevel) -> None:
    block = sea_block(water_level=level)
    sigma = np.full(4, np.nan)
    if level is not WaterLevel.ONE:
        sigma[2] = 0.3
    water = replace(block.water, tilt_east=None, tilt_north=None, tilt_sigma=None)
    block = reread(replace(block, water=water, photos=replace(block.photos, tide_sigma=sigma)))
    solution = solved(block)
    assert solution.water is not None
    tide = restart(solution)[0].photos.tide
    given = {WaterLevel.ONE: [], WaterLevel.PHOTO: [2], WaterLevel.GROUP: [2, 3]}[
        level
    ]  # with B, whose prior it is
    for row in range(4):
        assert tide[row] == (block.photos.tide if row in given else solution.water.tide)[row]
    assert np.abs(solution.water.tide - block.photos.tide).min() > 1e-3
    assert apart(solution, again(solution)) < SAME


@pytest.mark.slow
def test_water_without_prior_starts_as_adjusted() -> None:
    block = sea_block(water_index=Treatment.ADJUST, water_tilt=Treatment.ADJUST)
    block = reread(replace(block, water=replace(block.water, sigma=None, tilt_sigma=None, liquid="SPIRIT")))
    solution = solved(block)
    assert solution.water is not None
    water = restart(solution)[0].water
    assert water is not None
    assert (water.index, water.tilt_east, water.tilt_north) == (solution.water.index, *solution.water.tilt)
    # the stations are all observed, so the water still turns about the same place
    assert apart(solution, again(solution)) < SAME


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sigma"),
    [
        ("position", [np.nan, np.nan, 0.5]),
        SLOW("position", [0.5, 0.5, np.nan]),
        ("attitude", [np.nan, np.nan, 20 * ARC_SECOND]),
        SLOW("attitude", [60 * ARC_SECOND] * 3),
    ],
)
def test_partly_observed_stations_keep_their_observations(name: str, sigma: list[float]) -> None:
    block, found, rng = cayman(), cayman_solved(), np.random.default_rng(5)
    values = np.array(getattr(block.photos, name))
    observed = np.isfinite(sigma)
    scale = np.array([6.37e6, 6.0e6, 1.0]) if name == "position" else np.ones(3)  # m of a radian there
    error = rng.normal(size=(10, 3)) * np.where(observed, sigma, 0.0) / scale
    values[:, observed] = (getattr(found.stations, name) + error)[:, observed]
    changes = {name: values, f"{name}_sigma": np.tile(sigma, (10, 1))}
    first = solved(reread(replace(block, photos=replace(block.photos, **changes))))
    second = again(first)
    assert second.observations == first.observations
    # Heights of cards are round to 0.1 mm, angles to 0.0001 seconds. An angle is observed in the vertical of its
    # station, and the stations start up to 60 m from where they were given: verticals turn by 1e-5.
    assert apart(first, second) < 1e-4
    kinds = [model.ObservationKind.STATION_POSITION, model.ObservationKind.STATION_ATTITUDE]
    one, other = (s.observed.residual / s.observed.sigma for s in (first, second))
    there = np.isin(first.observed.kind, kinds)
    assert there.sum() == 10 * observed.sum()
    np.testing.assert_allclose(other[there], one[there], atol=1e-3)  # likewise, in sigmas of 0.5 m and 20 seconds


def test_the_points_of_a_restart_are_check_points() -> None:
    solution = solved(st_thomas())
    block, _ = punched(solution, Punch(points=PunchedPoints.ALL))
    cards_before, control = solution.block.control, block.control
    assert len(control.point) == len(block.points.ids) == 22
    assert (control.kind[len(cards_before.point) :] == ControlKind.CHECK).all()
    assert apart(solution, solved(reread(block))) < SAME
    assert cards(punched(solution, Punch())[0]) - cards(block) == {}


# --- results ---


@pytest.mark.slow
def test_a_result_has_the_adjusted_values_and_their_sigmas() -> None:
    solution = cayman_solved()
    block, notes = punched(solution, RESULT)
    again = reread(block)
    assert notes == ()
    assert len(again.plates.photo) == 0
    frame = frame_of(block.options.system, block.ellipsoid)
    shift = frame.working(again.photos.position) - frame.working(solution.stations.position)
    assert np.abs(shift).max() < 2.2e-4  # half of 0.00001 seconds of latitude and longitude, 0.05 mm of height
    turn = again.photos.attitude - solution.stations.attitude
    assert np.abs(turn).max() <= 0.5001e-4 * ARC_SECOND
    sigma = np.sqrt(np.diagonal(solution.stations.covariance, axis1=1, axis2=2))
    digits = {"atol": 0.5001e-4, "rtol": 0.5e-3}  # of five columns with a point: four below 1, then four in all
    np.testing.assert_allclose(again.photos.position_sigma, sigma[:, :3], **digits)
    np.testing.assert_allclose(again.photos.attitude_sigma / ARC_SECOND, sigma[:, 3:] / ARC_SECOND, **digits)
    np.testing.assert_allclose(again.control.sigma, block.control.sigma, **digits)
    rows = [solution.block.points.ids.tolist().index(name) for name in again.points.ids]
    shift = frame.working(again.control.position) - frame.working(solution.points.position[rows])
    assert np.abs(shift[again.control.point]).max() < 2.2e-4
    took_part = solution.points.status[rows][again.control.point] == model.PointStatus.TRIANGULATED
    assert (took_part == (again.control.kind == ControlKind.FULL)).all()
    assert 90 < took_part.sum() < len(took_part) == np.isfinite(solution.points.position).all(axis=1).sum()
    assert again.points.bathymetric.sum() == 12


def test_control_that_is_fixed_or_only_checks_keeps_its_card() -> None:
    block = st_thomas()
    block = replace(block, control=replace(block.control, fixed=np.array([True] + [False] * 5)))
    found, _ = punched(solved(block), RESULT)
    given = {card for card in cards(block) if card.startswith("CTG 10")}
    assert {card[4:7] for card in given & set(cards(found))} == {"101", "106"}


@pytest.mark.slow
def test_what_a_result_leaves_out_is_noted() -> None:
    solution = solved(with_options(reread(rich()), program=Program.IIIA))
    block, notes = punched(solution, replace(RESULT, plates=True))
    assert notes == (
        "equal elevations are left out: 1",
        "air bases are left out: 2",
        "distances are left out: 2",
        "height differences are left out: 2",
        "the plate coordinates are in the sigmas of the result already: do not adjust both together",
    )
    assert not {card[:3] for card in cards(block)} & {"EQL", "BAS", "DIS", "HDF"}
    assert len(block.plates.photo) == 48
    loose = replace(solution, converged=False, reason="so")
    assert punched(loose, RESULT)[1][0] == "the run has not converged: these are not results to use"


def test_tides_and_water_of_a_result() -> None:
    options = {"water_level": WaterLevel.GROUP, "water_tilt": Treatment.ADJUST, "water_index": Treatment.ADJUST}
    solution = solved(sea_block(**options))
    block, water = punched(solution, RESULT)[0], solution.water
    assert water is not None and block.water is not None
    assert block.photos.tide.tolist() == water.tide.tolist()
    sigma = dict(zip(water.correction_ids.tolist(), water.correction_sigma.tolist(), strict=True))
    assert block.photos.tide_sigma.tolist() == [sigma[name] for name in "AABB"]
    assert (block.water.index, block.water.sigma) == (water.index, water.index_sigma)
    assert (block.water.tilt_east, block.water.tilt_north) == tuple(water.tilt)
    assert block.water.tilt_sigma == water.tilt_sigma.max()


@pytest.mark.slow
def test_a_result_is_control_of_the_strip_that_goes_on() -> None:
    """The east of a strip by itself lacks control; with the result of the west it can be adjusted."""
    block = cayman()
    west = extracted(block, photos_named(block, ["837-842"])).block
    control = block.control
    east = extracted(block, photos_named(block, ["841-846"])).block
    bare = replace(east, control=replace(east.control, kind=np.full(len(east.control.kind), ControlKind.CHECK)))
    with pytest.raises(AdjustmentError):
        adjust(bare)
    found, _ = punched(solved(west), RESULT)
    found = replace(found, titles=())
    parts = [Part(name="east", block=bare), Part(name="result", block=reread(found))]
    both = merged(parts, MergeOptions(join_photos=True, prefer=1)).block
    joined = extracted(both, photos(both, *east.photos.ids.tolist())).block
    checked, problems = check_deck(deck_bytes(joined))
    assert checked is not None, problems
    solution = solved(checked)
    # The whole strip knows more: both agree within the sigmas of the strip that leans on the west.
    whole = cayman_solved()
    rows = [whole.block.photos.ids.tolist().index(name) for name in joined.photos.ids.tolist()]
    frame = frame_of(block.options.system, block.ellipsoid)
    shift = np.abs(frame.working(whole.stations.position[rows]) - frame.working(solution.stations.position))
    sigma = np.sqrt(np.diagonal(solution.stations.covariance, axis1=1, axis2=2))[:, :3]
    assert shift.max() < 3.0 * sigma.max()
    assert len(control.point) == 42


@pytest.mark.parametrize(
    "options", [{"points": PunchedPoints.CONTROL}, {"kind": ControlKind.FULL}], ids=["control", "kind"]
)
def test_a_restart_has_the_control_as_it_was_given(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="a restart"):
        Punch(**options)
