"""Initial values from plates and control alone: the adjustment from them is that from good starts."""

from dataclasses import replace

import numpy as np
import pytest

from altered import added, altered
from blocks import simulation
from musatpy.adjustment import adjust
from musatpy.adjustment.initial import initial_photos, placed
from musatpy.errors import AdjustmentError
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import Block, ControlKind, CoordinateSystem, Initial, Solution
from musatpy.orientation.strips import models_of, sights_of
from musatpy.pipeline import adjust as searched
from musatpy.simulation import Simulation
from orientation.flights import HEIGHT, Flight, fly, strip

SCATTER = {"station_scatter": 20.0, "attitude_scatter": 2.0}
CONTROL = [{"kind": "full", "number": 12, "sigma": 0.1, "error": 0.1}]
GROSS = {"share": 0.02, "size": [100.0, 5000.0]}


def simulated(**tables: object) -> Simulation:
    return simulation(7, **{"control": CONTROL, **tables})


def bare(block: Block, initial: Initial = Initial.COMPUTE) -> Block:
    """Return the block without anything of its stations."""
    unknown = np.full((len(block.photos.ids), 3), np.nan)
    photos = dict.fromkeys(("position", "attitude", "position_sigma", "attitude_sigma"), unknown)
    return altered(block, photos=photos, options={"initial": initial})


def assert_same_solution(one: Solution, other: Solution) -> None:
    """Assert that both converged to the same minimum, to 1e-3 of the sigmas of the stations."""
    assert one.converged, one.reason
    assert other.converged, other.reason
    turn = one.stations.attitude - other.stations.attitude
    turn -= 2.0 * np.pi * np.rint(turn / (2.0 * np.pi))
    frame = Ellipsoid("clrk66") if one.block.options.system is CoordinateSystem.GEOGRAPHIC else None
    places = [s.stations.position if frame is None else frame.geocentric(s.stations.position) for s in (one, other)]
    sigma = np.sqrt(np.einsum("nii->ni", one.stations.covariance))
    shift = np.linalg.norm(places[0] - places[1], axis=1)
    assert (shift < 1e-3 * sigma[:, :3].min(axis=1)).all()
    assert (np.abs(turn) < 1e-3 * sigma[:, 3:]).all()


def tight(block: Block) -> Block:
    """Return the block with limits that stop an iteration only at the minimum."""
    return altered(block, options={"rotation_limit": 1e-9, "translation_limit": 1e-5, "water_limit": 1e-5})


BLOCKS = {
    "strip": {"flight": {"photos": 6, **SCATTER}, "points": {"extra": [{"number": 40}]}},
    "pair": {"flight": {"photos": 2, **SCATTER}, "points": {"extra": [{"number": 12}]}},
    "block with blunders": {
        "flight": {"strips": 4, "photos": 10, "reverse_alternate": True, "azimuth": 20.0, **SCATTER},
        "points": {"extra": [{"number": 300}]},
        "blunders": GROSS,
    },
    "three points at each site": {
        "flight": {"strips": 4, "photos": 10, "reverse_alternate": True, **SCATTER},
        "points": {"per_site": 1},
    },
    "shoal": {
        "flight": {"strips": 2, "photos": 6, "height": 1500.0, **SCATTER},
        "points": {"extra": [{"number": 100}]},
        "water": {"tide_scatter": 0.2},
        "shoal": [{"share": 0.7, "depth": [1.0, 15.0]}],
    },
    "shoal of IIIA": {  # its first stations bend the block: points are dry for them that later stand under water
        "flight": {"strips": 5, "photos": 12, "height": 1500.0, **SCATTER},
        "points": {"per_site": 1, "extra": [{"number": 240}]},
        "water": {"tide_scatter": 0.2},
        "shoal": [{"share": 0.5, "depth": [0.5, 15.0]}],
        "options": {"program": "IIIA"},
    },
    "local": {
        "job": {"system": "LOCL", "centre": [5000.0, 7000.0]},
        "flight": {"strips": 2, "photos": 6, **SCATTER},
        "points": {"extra": [{"number": 80}]},
    },
    "geocentric": {
        "job": {"system": "GEOC", "centre": [60.0, 20.0]},
        "flight": {"strips": 2, "photos": 6, **SCATTER},
        "points": {"extra": [{"number": 80}]},
    },
}


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.slow
def test_the_adjustment_without_stations_is_that_with_good_ones(name: str) -> None:
    block = tight(simulated(**BLOCKS[name]).block)
    one, other = adjust(bare(block)), adjust(block)
    assert_same_solution(one, other)
    if name == "shoal of IIIA":  # both end at the minimum to the limits of the iteration, 10 um
        assert np.nanmax(np.abs(one.points.position[:, 2] - other.points.position[:, 2])) < 1e-5


@pytest.mark.parametrize(
    "options",
    [
        {"water_level": "PHOTO", "water_tilt": "ADJUST", "water_index": "ADJUST"},
        {"water_level": "ONE"},
        {"editing": "LIST"},  # the search has a level for each photo
    ],
)
@pytest.mark.slow
def test_a_computed_start_where_the_water_is_unknown(options: dict[str, str]) -> None:
    made = simulated(
        flight={"strips": 2, "photos": 5, "height": 1500.0, **SCATTER},
        water={"tide_scatter": 0.2, "tide_sigma": 0.2, "tilt_sigma": 10.0, "index_sigma": 0.004},
        shoal=[{"share": 0.5, "depth": [0.5, 15.0]}],
        points={"extra": [{"number": 60}]},
        options={"program": "IIIA", **options},
    )
    block = tight(made.block)
    assert_same_solution(searched(bare(block)), searched(block))


def oblique(strips: list[tuple[np.ndarray, np.ndarray]], tilt: tuple[float, float], **keys: float) -> Flight:
    """Return a flight whose cameras are built in with a tilt about the axes of the plate, rad."""
    C, heading = (np.concatenate(parts) for parts in zip(*strips, strict=True))
    rng = np.random.default_rng(len(C))
    level = attitude_matrix(np.column_stack([np.zeros((len(C), 2)), heading]))
    built_in = np.column_stack([np.full((len(C), 2), tilt) + rng.normal(0.0, 0.03, (len(C), 2)), np.zeros(len(C))])
    return fly(C, attitude_from_matrix(attitude_matrix(built_in) @ level), **keys)


FLIGHTS = {
    "vertical cross flights": ([strip(5, 0.0, (0.0, 0.0)), strip(5, np.pi / 2.0, (0.0, 0.0))], (0.0, 0.0)),
    "forward oblique to and fro": (
        [strip(5, row * np.pi, (0.0, 3000.0 * row)) for row in range(2)],
        (0.0, 0.5),
    ),
    "side oblique": ([strip(6, 1.0, (0.0, 0.0))], (0.4, 0.0)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
def test_any_flight_is_found(name: str) -> None:
    strips, tilt = FLIGHTS[name]
    truth = oblique(strips, tilt, blunders=0.02)
    values = initial_photos(truth.block)
    assert values.problems == ()
    assert set(values.found.tolist()) == {"model"}
    # a thousandth of the flying height and 0.1 degrees: the refinement ends at the noise of 10 micrometres
    assert np.linalg.norm(values.photos.position - truth.C, axis=1).max() < 1e-3 * HEIGHT
    turn = values.photos.attitude - truth.attitude
    assert np.abs(turn - 2.0 * np.pi * np.rint(turn / (2.0 * np.pi))).max() < 2e-3


def test_any_headings_are_found() -> None:
    (C, _), rng = strip(8, 0.4, (0.0, 0.0)), np.random.default_rng(2)
    attitude = np.column_stack([rng.normal(0.0, 0.03, (8, 2)), rng.uniform(-np.pi, np.pi, 8)])
    truth = fly(C, attitude)
    values = initial_photos(truth.block)
    assert np.linalg.norm(values.photos.position - C, axis=1).max() < 1e-3 * HEIGHT  # as above


def with_kinds(block: Block, kinds: str) -> Block:
    """Return the block with control of the kinds given by letters, position blank where not known."""
    partial = altered(block.control, kind=np.array([ControlKind("FHVC".index(letter)) for letter in kinds]))
    return replace(block, control=altered(partial, position=lambda given: np.where(partial.known, given, np.nan)))


@pytest.mark.slow
@pytest.mark.parametrize("size", [30.0, 1000.0])
def test_wrong_control_does_not_draw_the_block(size: float) -> None:
    truth = oblique([strip(6, row % 2 * np.pi, (0.0, 3000.0 * row)) for row in range(3)], (0.0, 0.0))
    wrong = added(([2, 5], [0, 2]), [size, -size])
    values = initial_photos(altered(truth.block, control={"position": wrong}))
    assert np.linalg.norm(values.photos.position - truth.C, axis=1).max() < 2e-3 * HEIGHT  # as above


def test_a_photo_with_known_points_only_is_resected() -> None:
    truth = oblique([strip(4, 0.0, (0.0, 0.0))], (0.0, 0.0), control=30)
    plates, known = truth.block.plates, truth.block.control.point
    kept = (plates.photo != 0) | np.isin(plates.point, known)
    lonely = (plates.photo == 0) | ~np.isin(plates.point, plates.point[(plates.photo == 0) & kept])
    block = replace(truth.block, plates=replace(plates, triangulated=kept & lonely))
    values = initial_photos(block)
    assert values.found.tolist() == ["resection", "model", "model", "model"]
    assert np.linalg.norm(values.photos.position[0] - truth.C[0]) < 2e-3 * HEIGHT  # as above


def test_photos_that_cannot_be_found_are_listed_with_the_reason() -> None:
    truth = oblique([strip(4, 0.0, (0.0, 0.0))], (0.0, 0.0))
    plates = truth.block.plates
    block = replace(truth.block, plates=replace(plates, triangulated=plates.photo != 3))
    with pytest.raises(AdjustmentError) as caught:
        adjust(block)
    assert str(caught.value) == "no initial values of photo 3: nothing is measured on it"
    loose = with_kinds(truth.block, "FCCCCCCCCC")
    with pytest.raises(AdjustmentError) as caught:
        adjust(loose)
    assert len(caught.value.problems) == 1  # one reason of all four
    reason = "the 4 photos that it hangs together with show 1 horizontally and 1 vertically known points"
    assert f"no initial values of photos 0, 1, 2, 3: {reason}" in str(caught.value)


def test_observed_stations_place_a_block_without_control() -> None:
    truth = oblique([strip(3, row % 2 * np.pi, (0.0, 3000.0 * row)) for row in range(3)], (0.0, 0.0))
    observed = replace(truth.block.photos, position=truth.C, position_sigma=np.full(truth.C.shape, 0.5))
    block = replace(with_kinds(truth.block, "CCCCCCCCCC"), photos=observed)
    values = initial_photos(block)
    assert values.problems == ()
    np.testing.assert_array_equal(values.photos.position, truth.C)  # an observed station stays as given
    turn = values.photos.attitude - truth.attitude
    assert np.abs(turn - 2.0 * np.pi * np.rint(turn / (2.0 * np.pi))).max() < 5e-3  # stations alone hold it less


def test_check_names_the_photos_whose_values_are_wrong() -> None:
    block = simulated(flight={"photos": 5, **SCATTER}, points={"extra": [{"number": 40}]}).block
    position = added((4, 2), 1000.0)(block.photos.position)
    wrong = {"position": position, "attitude": added((2, 2), np.radians(90.0))}
    given = altered(block, photos=wrong, options={"initial": Initial.CHECK})
    values = initial_photos(given)
    assert values.beyond.tolist() == [False, False, True, False, True]
    assert set(values.found.tolist()) == {"given"}
    np.testing.assert_array_equal(values.photos.position, position)
    np.testing.assert_allclose(values.difference[2, 5], np.radians(90.0), atol=1e-3)  # the noise of the headings
    np.testing.assert_allclose(values.difference[4, 2], 1000.0, atol=3.0)  # a thousandth of the flying height
    solution = adjust(altered(given, photos={"attitude": block.photos.attitude}))
    assert len([text for text in solution.warnings if "the given station is" in text]) == 1
    assert "photo 5: the given station is" in solution.warnings[0]


def test_differences_of_a_computed_start_are_against_the_computed_values() -> None:
    block = simulated(flight={"photos": 3, **SCATTER}, points={"extra": [{"number": 20}]}).block
    solution = adjust(bare(block))
    np.testing.assert_array_equal(solution.block.photos.position, initial_photos(bare(block)).photos.position)


@pytest.mark.slow
@pytest.mark.parametrize("kinds", ["HHHHHHVVVVVV", "FFHHHVVVVVVV"])
def test_partial_control_of_a_geographic_job_follows_the_curved_earth(kinds: str) -> None:
    """Over a strip of 35 km the level surface leaves the plane by 24 m."""
    block = simulated(flight={"photos": 20, **SCATTER}, points={"extra": [{"number": 150}]}).block
    block = tight(with_kinds(block, kinds))
    assert_same_solution(adjust(bare(block)), adjust(block))


def test_a_model_on_a_slope_has_the_control_back_that_it_has_lost() -> None:
    control = [{"kind": "full", "number": 3, "sigma": 0.1, "error": 0.0}]
    made = simulated(**BLOCKS["local"] | {"control": control, "measurement": {"noise": 0.0}})
    steep = attitude_matrix([1.0, 0.3, 0.0])  # of all that is known: the ground is no level
    block = altered(bare(made.block), control={"position": made.block.control.position @ steep.T})
    sights = sights_of(block)
    (model,) = models_of(block, sights)
    kept = model.point != block.control.point[2]
    assert not kept.all()
    place = placed(block, sights, [replace(model, point=model.point[kept], X=model.X[kept])], "model")
    stations = made.truth.stations.xyz @ steep.T
    np.testing.assert_allclose(place.frame.system(place.C), stations, atol=5.0)  # .002 of the flying height
