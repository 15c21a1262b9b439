"""Simulated blocks: what was asked for is in them, the truth explains them, and they are the same every time."""

import dataclasses
import json
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from musatpy.errors import SpecError
from musatpy.formats.musat import deck_bytes, read_deck
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import ControlKind
from musatpy.simulation import Simulation, load_spec, simulate, spec_from_table, truth_json, truth_record
from musatpy.units import ARC_SECOND, DEGREE, dms_from_radians

SPECS = Path(__file__).parent / "specs"
EARTH = Ellipsoid("clrk66")


@pytest.fixture(scope="module")
def strip() -> Simulation:
    return simulate(SPECS / "strip.toml")


@pytest.fixture(scope="module")
def block() -> Simulation:
    return simulate(SPECS / "block.toml")


def local_strip(**tables: Any) -> Simulation:
    return simulate(spec_from_table({"job": {"system": "LOCL", "centre": [5000.0, 7000.0]}, **tables}))


def measurements_of(simulation: Simulation, name: str) -> np.ndarray:
    """Return which plate measurements (m,) are those of a point."""
    return simulation.block.points.ids[simulation.block.plates.point] == name


def enu(simulation: Simulation, places: str, rows: np.ndarray | slice, given: np.ndarray) -> np.ndarray:
    """Return given minus true places along east, north and up."""
    true = getattr(simulation.truth, places)
    return np.einsum("kij,kj->ki", true.vertical[rows], EARTH.geocentric(given) - true.xyz[rows])


@pytest.mark.parametrize("name", ["strip", "bad_start", "block"])
def test_the_same_seed_makes_the_same_deck_which_holds_the_block(name: str) -> None:
    path = SPECS / f"{name}.toml"
    one, again, other = simulate(path), simulate(path), simulate(path, seed=411)
    deck = deck_bytes(one.block)
    back = read_deck(deck)
    assert deck == deck_bytes(again.block) == deck_bytes(back) != deck_bytes(other.block)
    assert truth_json(again) == truth_json(one) and other.truth.spec.seed == 411
    for table, field in (("photos", "position"), ("photos", "attitude"), ("photos", "tide"), ("plates", "xy")):
        there, here = (getattr(getattr(given, table), field) for given in (back, one.block))
        np.testing.assert_array_equal(there, here)


def test_noise_does_not_depend_on_blunders(block: Simulation) -> None:
    spec = load_spec(SPECS / "block.toml")
    clean, log = (
        simulate(dataclasses.replace(spec, blunders=dataclasses.replace(spec.blunders, **keys)))
        for keys in ({"number": 0}, {"log": True})
    )
    same = np.all(clean.block.plates.xy == block.block.plates.xy, axis=1)
    assert np.count_nonzero(~same) == len(block.truth.blunders) == 7
    assert [(one.photo, one.point) for one in log.truth.blunders] == [
        (one.photo, one.point) for one in block.truth.blunders
    ]
    sizes = np.abs([one.added for one in (*log.truth.blunders, *block.truth.blunders)]).max(axis=1)
    assert np.all((sizes >= 0.2) & (sizes <= 0.9)) and set(sizes[:7]) != set(sizes[7:])


# --- the truth ---


def test_without_errors_the_deck_is_the_truth_on_the_grid_of_the_cards(strip: Simulation) -> None:
    block, truth = strip.block, strip.truth
    for places in (truth.stations, truth.points):
        seconds = dms_from_radians(places.job[:, :2], 9)[2] * 1e5
        np.testing.assert_allclose(seconds, np.rint(seconds), atol=1e-3)  # radians end at 1e-16 of 1e0
        height = places.job[:, 2] * 1e4
        np.testing.assert_allclose(height, np.rint(height), atol=1e-6)  # 1e-16 of 3e7
    np.testing.assert_array_equal(block.photos.position, truth.stations.job)
    np.testing.assert_array_equal(block.photos.attitude, truth.attitude)
    given, true = block.control.position, truth.points.job[block.control.point]
    np.testing.assert_array_equal(given[~np.isnan(given)], true[~np.isnan(given)])
    assert np.abs(block.plates.xy - truth.images).max() <= 0.5000001e-6  # rounded to F12.6


def test_land_images_are_straight(strip: Simulation) -> None:
    block, truth = strip.block, strip.truth
    assert 0.2 < truth.refracted.mean() < 0.6
    photo, point = block.plates.photo[~truth.refracted], block.plates.point[~truth.refracted]
    rays = EARTH.geocentric(truth.points.job[point]) - EARTH.geocentric(truth.stations.job[photo])
    local = np.einsum("kij,kj->ki", EARTH.frame(truth.stations.job[photo]), rays)
    image = np.einsum("kij,kj->ki", attitude_matrix(truth.attitude)[photo], local)
    xy = -152.0 * image[:, :2] / image[:, 2:]
    np.testing.assert_allclose(truth.images[~truth.refracted], xy, atol=1e-9)  # 1e-9 m at 1 : 20000 and more


def test_submerged_images_move_towards_the_straight_image_of_a_higher_point() -> None:
    """A vertical photo over a plane: the image is that of the apparent point, found by bisection on Snell."""
    points = [{"id": str(i), "local": [5000.0 + 150.0 * i, 7000.0, -9.0], "bathymetric": True} for i in range(1, 8)]
    tables = {"water": {"index": 1.34, "level": 0.5}, "flight": {"photos": 2}, "points": {"per_site": 0}}
    simulation = local_strip(point=points, **tables)
    block, truth = simulation.block, simulation.truth
    for row in range(len(truth.images)):
        C, G = truth.stations.xyz[block.plates.photo[row]], truth.points.xyz[block.plates.point[row]]
        D, H, h = np.hypot(*(G - C)[:2]), C[2] - 0.5, 9.5
        Q = brentq(lambda Q, D=D, H=H, h=h: Q / np.hypot(Q, H) - 1.34 * (D - Q) / np.hypot(D - Q, h), 0, D)
        expected = 152.0 * Q / H * (G - C)[:2] / D
        np.testing.assert_allclose(truth.images[row], expected, atol=1e-9)  # brentq stops at 2e-12 m
    assert np.all(truth.refracted)


def test_point_between_tides_is_refracted_on_some_photos_only() -> None:
    simulation = local_strip(
        point=[{"id": "ROCK", "local": [5000.0, 7000.0, 0.1], "bathymetric": True}],
        water={"tides": [0.3, -0.2, 0.2]},
    )
    assert simulation.truth.refracted[measurements_of(simulation, "ROCK")].tolist() == [True, False, True]


def test_a_photo_sees_points_along_its_heading() -> None:
    """Flown west, +x of the plate points west."""
    point = {"id": "WEST", "local": [4400.0, 7000.0, 0.0]}
    simulation = local_strip(flight={"azimuth": 270.0}, point=[point])
    rows = measurements_of(simulation, "WEST") & (simulation.block.plates.photo == 1)
    assert simulation.truth.images[rows][0] == pytest.approx([152.0 * 600.0 / 3050.0, 0.0], abs=1e-9)


# --- what the deck says ---


@pytest.mark.parametrize(
    ("path", "tables", "expected"),
    [
        ("photos.tide", {"water": {"tides": [0.1, 0.25, -0.3]}}, [0.1, 0.25, -0.3]),
        ("photos.tide", {"water": {"level": 1.0, "tide_trend": 0.05}}, [0.95, 1.0, 1.05]),
        ("photos.tide_sigma", {"water": {"tide_sigma": 0.02}}, [0.02] * 3),
        ("photos.tide_sigma", {"water": {}}, [np.nan] * 3),
        ("photos.tide_group", {"water": {"group_size": 2}}, ["G1", "G1", "G2"]),
        ("photos.tide_day", {"water": {"day_size": 2}}, ["D1", "D1", "D2"]),
        ("photos.position_sigma", {"stations": {"position_sigma": [1.0, 2.0, 3.0]}}, [[1.0, 2.0, 3.0]] * 3),
        ("photos.attitude_sigma", {"stations": {"attitude_sigma": 20.0}}, [[20.0 * ARC_SECOND] * 3] * 3),
        ("photos.position_sigma", {}, [[np.nan] * 3] * 3),
        ("water.index", {"water": {"index_error": -0.0031234567}}, 1.336877),
        ("water.tilt_east", {"water": {"tilt_on_card": [1.23456, -2.0]}}, 1.235 * ARC_SECOND),
        ("water.tilt_north", {"water": {"tilt_on_card": [1.23456, -2.0]}}, -2.0 * ARC_SECOND),
        ("water.tilt_sigma", {"water": {"tilt_sigma": 5.0}}, 5.0 * ARC_SECOND),
        ("control.fixed", {"control": [{"kind": "full", "number": 2, "fixed": True}]}, [True, True]),
        ("control.sigma", {"control": [{"kind": "check", "number": 1}]}, [[np.nan] * 3]),
        ("points.ids", {"points": {"per_site": 0}}, []),
    ],
)
def test_what_stands_on_cards(path: str, tables: dict[str, Any], expected: Any) -> None:
    simulation = local_strip(**tables)
    found = reduce(getattr, path.split("."), simulation.block)
    if not np.issubdtype(np.asarray(found).dtype, np.number):
        assert found.tolist() == expected
    else:
        np.testing.assert_allclose(found, expected, rtol=1e-12)  # arc seconds are radians


def test_options_go_into_the_deck() -> None:
    keys = {
        "program": "IIIA", "initial": "CHECK", "submerged_factor": 1.75, "water_level": "GROUP",
        "water_tilt": "ADJUST", "water_index": "ADJUST", "datum": "FREE", "editing": "LIST",
        "refraction": "RIGOROUS",
    }  # fmt: skip
    control = [{"kind": "full", "number": 4, "sigma": 0.1}]
    simulation = local_strip(options=keys, water={"group_size": 2}, shoal=[{"share": 0.5}], control=control)
    options = read_deck(deck_bytes(simulation.block)).options
    assert {name: getattr(options, name) for name in keys} == keys


def test_overlaps_and_spacing() -> None:
    spec = {
        "flight": {"strips": 2, "photos": 3, "height": 2000.0, "azimuth": 0.0},
        "camera": {"focal_length": 150.0},
    }
    stations, width = local_strip(**spec).truth.stations.xyz, 228.6 * 2000.0 / 150.0
    np.testing.assert_allclose(np.diff(stations[:3], axis=0), [[0.0, 0.4 * width, 0.0]] * 2, atol=1e-4)
    across = [0.7 * width, 0.0, 0.0]
    np.testing.assert_allclose(stations[3] - stations[0], across, atol=1e-4)  # rounded to 1e-4 m
    np.testing.assert_allclose(stations.mean(axis=0), [5000.0, 7000.0, 2050.0], atol=1e-4)


def test_alternate_strips_fly_back(block: Simulation) -> None:
    heading = block.truth.attitude[:, 2].reshape(4, 10) / DEGREE
    turn = np.abs(heading - np.array([[70.0], [-110.0], [70.0], [-110.0]]))
    assert turn.max() < 5.0  # scatter of 1 degree
    plan = block.truth.stations.job[:, 0].reshape(4, 10)
    assert np.all(np.sign(np.diff(plan, axis=1)) == np.array([[1], [-1], [1], [-1]]))


def test_plates_have_the_noise_and_the_blunders_asked_for(block: Simulation) -> None:
    plates, truth, ids = block.block.plates, block.truth, block.block.points.ids
    assert np.bincount(plates.point).min() >= 2
    assert np.abs(truth.images - [0.021, -0.034]).max() <= 228.6 / 2 - 5.0
    error, clean = plates.xy - truth.images, np.ones(len(plates.photo), dtype=bool)
    for blunder in truth.blunders:
        photo = block.block.photos.ids[plates.photo] == blunder.photo
        (row,) = np.flatnonzero(photo & (ids[plates.point] == blunder.point))
        assert np.abs(error[row] - blunder.added).max() < 5 * 0.012
        clean[row] = False
    sea = block.block.points.bathymetric[plates.point]
    for rows, sigma in ((clean & ~sea, 0.008), (clean & sea, 0.012)):
        # five standard deviations of a sample standard deviation
        assert error[rows].std() == pytest.approx(sigma, abs=5.0 * sigma / np.sqrt(4.0 * np.count_nonzero(rows)))
    np.testing.assert_array_equal(plates.sigma[sea], 0.012)
    assert np.isnan(plates.sigma[~sea]).all()
    kept = np.unique(plates.point[~plates.triangulated])
    assert len(kept) == 3 and not np.isin(kept, block.block.control.point).any()
    assert not plates.triangulated[np.isin(plates.point, kept)].any()


def test_a_given_blunder_and_the_least_count() -> None:
    table = {"points": {"first_id": 7}, "measurement": {"noise": 0.0}}
    simulation = local_strip(blunder=[{"photo": "2", "point": "7", "x": -50.0, "y": 120.0}], **table)
    error = simulation.block.plates.xy - simulation.truth.images
    (row,) = np.flatnonzero(np.abs(error).max(axis=1) > 1e-3)
    assert error[row] == pytest.approx([-0.05, 0.12], abs=1e-6)
    micrometres = local_strip(measurement={"least_count": 1.0}).block.plates.xy * 1000.0
    np.testing.assert_allclose(micrometres, np.rint(micrometres), atol=1e-9)  # representation of 0.001 mm steps


def test_bad_starts_have_their_sizes_in_the_frame_of_the_given_position() -> None:
    simulation = simulate(SPECS / "bad_start.toml")
    photos, truth = simulation.block.photos, simulation.truth
    shift = enu(simulation, "stations", slice(None), photos.position)
    np.testing.assert_allclose(np.abs(shift), 100.0, atol=1e-3)  # 0.00001 arc second is 0.3 mm
    # the vertical of the given position is 100 m / 6.4e6 m = 3 arc seconds off
    np.testing.assert_allclose(np.abs(photos.attitude - truth.attitude), 2.0 * DEGREE, atol=5.0 * ARC_SECOND)
    spec = load_spec(SPECS / "strip.toml")
    stations = dataclasses.replace(spec.stations, position_error=(5e4, 5e4, 0.0))
    far = simulate(dataclasses.replace(spec, stations=stations))
    given = attitude_matrix(far.block.photos.attitude) @ EARTH.frame(far.block.photos.position)
    true = attitude_matrix(far.truth.attitude) @ far.truth.stations.vertical
    np.testing.assert_allclose(given, true, atol=1e-9)  # attitudes are rounded to 0.0001 arc second


def test_shoals_shores_and_given_points(strip: Simulation, block: Simulation) -> None:
    heights = strip.truth.points.job[strip.block.points.bathymetric, 2]
    assert len(heights) == 18  # 0.4 of 15 ties and 30 extra points
    assert heights.min() >= -15.0 and heights.max() <= -0.5
    groups, levels = block.block.equal_elevations, block.truth.levels
    assert groups.ids.tolist() == ["SHORE"] and len(groups.point) == 5
    assert np.abs(block.truth.points.job[groups.point, 2] - levels[0]).max() < 5 * 0.05
    assert levels[0] == np.max(block.block.photos.tide)
    point = {"id": "HERE", "local": [5000.0, 7000.0, 3.0], "photos": ["1", "3"], "triangulated": False}
    given = local_strip(point=[point])
    plates, rows = given.block.plates, measurements_of(given, "HERE")
    assert plates.photo[rows].tolist() == [0, 2]
    assert not plates.triangulated[rows].any() and plates.triangulated[~rows].all()


def test_control_has_its_kinds_and_errors(block: Simulation) -> None:
    control, truth = block.block.control, block.truth
    assert np.bincount(control.kind).tolist() == [12, 0, 6]
    sea, full = block.block.points.bathymetric[control.point], control.kind == ControlKind.FULL
    assert sea[control.kind == ControlKind.VERTICAL].all() and not sea[full].any()
    np.testing.assert_array_equal(np.isnan(control.sigma), ~control.known)
    np.testing.assert_array_equal(np.isnan(control.position), ~control.known)
    away = enu(block, "points", control.point[full], control.position[full])
    np.testing.assert_allclose(away, truth.control_error[full], atol=5e-4)  # 0.00001 arc second is 0.3 mm
    assert 0.1 < truth.control_error[full].std() < 0.3


def test_errors_of_tides_have_the_sizes_asked_for() -> None:
    """Errors of 0.4 m of 400 photos about 2 m."""
    water = {"photo_level_error": 0.4, "level_error": 2.0}
    simulation = local_strip(flight={"strips": 4, "photos": 100}, water=water, points={"per_site": 0})
    error = simulation.truth.tide_error
    np.testing.assert_allclose(simulation.block.photos.tide, simulation.truth.tide + error, atol=1e-9)
    assert abs(error.mean() - 2.0) < 4.0 * 0.4 / 20.0  # four sigmas of the mean
    assert abs(error.std() - 0.4) < 4.0 * 0.4 / np.sqrt(800.0)


def test_the_record_has_what_the_deck_has_not() -> None:
    water = {"tilt": [60.0, -40.0], "index_error": 0.002, "level_error": 0.5}
    simulation = local_strip(water=water)
    record = truth_record(simulation)
    assert (record["index"], record["water"]["index_on_card"], record["tides"]["1"]) == (1.34, 1.342, 0.5)
    assert record["water"]["tilt"] == [60.0, -40.0] and record["water"]["tilt_on_card"] == [0.0, 0.0]
    assert record["water"]["tilted_about"] == simulation.truth.middle.tolist()
    true = [station["tide"] for station in record["stations"].values()]
    np.testing.assert_allclose(simulation.block.photos.tide, true + simulation.truth.tide_error, atol=1e-9)
    assert record["spec"]["water"]["tilt"] == [60.0, -40.0]
    assert json.loads(truth_json(simulation)) == record


@pytest.mark.parametrize(
    ("tables", "what"),
    [
        ({"control": [{"kind": "full", "number": 500, "sigma": 1.0}]}, "500 points are asked for"),
        ({"control": [{"kind": "full", "points": ["nobody"], "sigma": 1.0}]}, "nobody"),
        ({"control": [{"kind": "full", "ids": ["2", "2"], "sigma": 1.0}]}, "used more than once: 2"),
        ({"blunder": [{"photo": "1", "point": "none", "x": 5.0}]}, "none is not measured on photo 1"),
        ({"blunders": {"number": 10000}}, "there are only"),
        ({"blunders": {"swapped": 500}}, r"blunders\.swapped: 500 pairs of images are asked for"),
        (
            {"control": [{"kind": "full", "number": 4, "sigma": 0.1}],
             "blunders": {"control": [{"number": 5, "component": "horizontal"}]}},
            r"blunders\.control\[1\]: 5 horizontal control points are asked for, 4 can be had",
        ),
        ({"kept_out": {"measurements": [["8", "1"]]}}, "not measured on photo 8"),
        ({"distance": [{"points": ["1", "none"]}]}, r"distance\[1\]\.points: .*kept out: none"),
        ({"distance": [{}, {}]}, r"distance\[1\]: one of points, number is needed"),
        ({"height_difference": [{"number": 5000}]}, r"height_difference\[1\]\.number: .* points for 5000 pairs"),
        ({"water": {"level": 100.0}}, "below the highest tide"),
        ({"equal_elevation": [{"id": "S", "number": 50}]}, "only 9 tie points on land"),
        ({"air_base": [{"photos": ["1", "77"]}]}, "unknown photos: 77"),
        ({"job": {"centre": [10.0, 10.0], "ellipsoid": "krakatoa"}}, "krakatoa"),
        ({"flight": {"first_photo": 10**40}}, "flight.first_photo: 1000.* is beyond 4611686018427387904"),
        (
            {"job": {"system": "GEOG"}, "point": [{"id": "P", "geographic": [1000.0, 1000.0, 0.0]}]},
            "points lie beyond all numbers",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_said(tables: dict[str, Any], what: str) -> None:
    with pytest.raises(SpecError, match=what):
        simulate(spec_from_table({"job": {"system": "LOCL"}, **tables}))


def test_negative_seed_is_refused() -> None:
    with pytest.raises(SpecError, match="seed: -1 is below 0"):
        simulate(SPECS / "strip.toml", seed=-1)
