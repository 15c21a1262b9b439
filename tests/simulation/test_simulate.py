"""Simulated blocks: what was asked for is in them, the truth explains them, and they are the same every time."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from musatpy.errors import SpecError
from musatpy.formats.musat import deck_bytes, read_deck
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import ControlKind
from musatpy.simulation import load_spec, simulate, spec_from_table, truth_json
from musatpy.units import ARC_SECOND, DEGREE, dms_from_radians

SPECS = Path(__file__).parent / "specs"
EARTH = Ellipsoid("clrk66")


@pytest.fixture(scope="module")
def strip():
    return simulate(SPECS / "strip.toml")


@pytest.fixture(scope="module")
def block():
    return simulate(SPECS / "block.toml")


def local_strip(**tables):
    return simulate(spec_from_table({"job": {"system": "LOCL", "centre": [5000.0, 7000.0]}, **tables}))


def ids_of(simulation, rows):
    return [str(name) for name in simulation.block.points.ids[rows]]


class TestReproducibility:
    def test_same_seed_same_bytes(self, block):
        again = simulate(SPECS / "block.toml")
        assert deck_bytes(again.block) == deck_bytes(block.block)
        assert truth_json(again) == truth_json(block)

    def test_another_seed_another_deck(self, block):
        other = simulate(SPECS / "block.toml", seed=411)
        assert deck_bytes(other.block) != deck_bytes(block.block)
        assert other.truth.spec.seed == 411

    def test_noise_does_not_depend_on_blunders(self, block):
        spec = load_spec(SPECS / "block.toml")
        clean = simulate(dataclasses.replace(spec, blunders=dataclasses.replace(spec.blunders, number=0)))
        same = np.all(clean.block.plates.xy == block.block.plates.xy, axis=1)
        assert np.count_nonzero(~same) == len(block.truth.blunders) == 7

    @pytest.mark.parametrize("name", ["strip", "bad_start", "block"])
    def test_deck_holds_the_block_exactly(self, name):
        simulation = simulate(SPECS / f"{name}.toml")
        deck = deck_bytes(simulation.block)
        back = read_deck(deck)
        assert deck_bytes(back) == deck
        for table, fields in {"photos": ["position", "attitude", "tide"], "control": ["position"]}.items():
            for field in fields:
                there, here = getattr(getattr(back, table), field), getattr(getattr(simulation.block, table), field)
                np.testing.assert_array_equal(there, here)
        np.testing.assert_array_equal(back.plates.xy, simulation.block.plates.xy)


class TestTruth:
    def test_everything_true_is_on_the_grid_of_the_cards(self, strip):
        for places in (strip.truth.stations, strip.truth.points):
            seconds = dms_from_radians(places.job[:, :2], 9)[2] * 1e5
            np.testing.assert_allclose(seconds, np.rint(seconds), atol=1e-3)  # radians end at 1e-16 of 1e0
            height = places.job[:, 2] * 1e4
            np.testing.assert_allclose(height, np.rint(height), atol=1e-6)  # 1e-16 of 3e7

    def test_without_errors_the_deck_is_the_truth(self, strip):
        block, truth = strip.block, strip.truth
        np.testing.assert_array_equal(block.photos.position, truth.stations.job)
        np.testing.assert_array_equal(block.photos.attitude, truth.attitude)
        given = block.control.position
        true = truth.points.job[block.control.point]
        np.testing.assert_array_equal(given[~np.isnan(given)], true[~np.isnan(given)])
        assert np.abs(block.plates.xy - truth.images).max() <= 0.5000001e-6  # rounded to F12.6

    def test_land_images_are_straight(self, strip):
        block, truth = strip.block, strip.truth
        assert 0.2 < truth.refracted.mean() < 0.6
        photo, point = block.plates.photo[~truth.refracted], block.plates.point[~truth.refracted]
        rays = EARTH.geocentric(truth.points.job[point]) - EARTH.geocentric(truth.stations.job[photo])
        local = np.einsum("kij,kj->ki", EARTH.frame(truth.stations.job[photo]), rays)
        image = np.einsum("kij,kj->ki", attitude_matrix(truth.attitude)[photo], local)
        xy = -152.0 * image[:, :2] / image[:, 2:]
        np.testing.assert_allclose(truth.images[~truth.refracted], xy, atol=1e-9)  # 1e-9 m at 1 : 20000 and more

    def test_submerged_images_move_towards_the_straight_image_of_a_higher_point(self):
        """A vertical photo over a plane: the image is that of the apparent point, found by bisection on Snell."""
        points = [
            {"id": str(i), "local": [5000.0 + 150.0 * i, 7000.0, -9.0], "bathymetric": True} for i in range(1, 8)
        ]
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

    def test_point_between_tides_is_refracted_on_some_photos_only(self):
        simulation = local_strip(
            point=[{"id": "ROCK", "local": [5000.0, 7000.0, 0.1], "bathymetric": True}],
            water={"tides": [0.3, -0.2, 0.2]},
        )
        rows = np.array(ids_of(simulation, simulation.block.plates.point)) == "ROCK"
        assert simulation.truth.refracted[rows].tolist() == [True, False, True]


class TestFlight:
    def test_overlaps_and_spacing(self):
        spec = {
            "flight": {"strips": 2, "photos": 3, "height": 2000.0, "azimuth": 0.0},
            "camera": {"focal_length": 150.0},
        }
        stations = local_strip(**spec).truth.stations.xyz
        width = 228.6 * 2000.0 / 150.0
        np.testing.assert_allclose(np.diff(stations[:3], axis=0), [[0.0, 0.4 * width, 0.0]] * 2, atol=1e-4)
        np.testing.assert_allclose(
            stations[3] - stations[0], [0.7 * width, 0.0, 0.0], atol=1e-4
        )  # rounded to 1e-4 m
        np.testing.assert_allclose(stations.mean(axis=0), [5000.0, 7000.0, 2050.0], atol=1e-4)

    def test_alternate_strips_fly_back(self, block):
        heading = block.truth.attitude[:, 2].reshape(4, 10) / DEGREE
        turn = np.abs(heading - np.array([[70.0], [-110.0], [70.0], [-110.0]]))
        assert turn.max() < 5.0  # scatter of 1 degree
        plan = block.truth.stations.job[:, 0].reshape(4, 10)
        assert np.all(np.sign(np.diff(plan, axis=1)) == np.array([[1], [-1], [1], [-1]]))

    def test_photo_sees_points_along_its_heading(self):
        """Flown west, +x of the plate points west."""
        simulation = local_strip(
            flight={"azimuth": 270.0},
            point=[{"id": "WEST", "local": [4400.0, 7000.0, 0.0]}],
        )
        rows = np.array(ids_of(simulation, simulation.block.plates.point)) == "WEST"
        middle = simulation.truth.images[rows & (simulation.block.plates.photo == 1)][0]
        assert middle == pytest.approx([152.0 * 600.0 / 3050.0, 0.0], abs=1e-9)

    def test_tides_as_given(self):
        simulation = local_strip(water={"tides": [0.1, 0.25, -0.3], "tide_sigma": 0.02})
        assert simulation.block.photos.tide.tolist() == [0.1, 0.25, -0.3]
        assert simulation.block.photos.tide_sigma.tolist() == [0.02] * 3

    def test_tide_trend(self):
        simulation = local_strip(water={"level": 1.0, "tide_trend": 0.05})
        assert simulation.block.photos.tide.tolist() == [0.95, 1.0, 1.05]


class TestMeasurements:
    def test_every_point_is_on_two_photos_within_the_plate(self, block):
        plates = block.block.plates
        assert np.bincount(plates.point).min() >= 2
        assert np.abs(block.truth.images - [0.021, -0.034]).max() <= 228.6 / 2 - 5.0

    def test_noise_has_the_size_asked_for(self, block):
        plates, truth = block.block.plates, block.truth
        hit = {(blunder.photo, blunder.point) for blunder in truth.blunders}
        names = zip(block.block.photos.ids[plates.photo], block.block.points.ids[plates.point], strict=True)
        clean = np.array([name not in hit for name in names])
        error = (plates.xy - truth.images) * 1000.0
        sea = block.block.points.bathymetric[plates.point]
        for rows, sigma in ((clean & ~sea, 8.0), (clean & sea, 12.0)):
            number = 2 * np.count_nonzero(rows)
            # five standard deviations of a sample standard deviation
            assert error[rows].std() == pytest.approx(sigma, abs=5.0 * sigma / np.sqrt(2.0 * number))
        np.testing.assert_array_equal(plates.sigma[sea], 0.012)
        assert np.isnan(plates.sigma[~sea]).all()

    def test_blunders_are_recorded_as_made(self, block):
        plates, truth = block.block.plates, block.truth
        for blunder in truth.blunders:
            photo = block.block.photos.ids[plates.photo] == blunder.photo
            row = np.flatnonzero(photo & (block.block.points.ids[plates.point] == blunder.point))
            rest = plates.xy[row] - truth.images[row] - blunder.added
            assert np.abs(rest).max() < 5 * 0.012
            assert 0.2 <= np.abs(blunder.added).max() <= 0.9

    def test_given_blunder(self):
        table = {"points": {"first_id": 7}, "measurement": {"noise": 0.0}}
        simulation = local_strip(blunder=[{"photo": "2", "point": "7", "x": -50.0, "y": 120.0}], **table)
        error = simulation.block.plates.xy - simulation.truth.images
        (row,) = np.flatnonzero(np.abs(error).max(axis=1) > 1e-3)
        assert error[row] == pytest.approx([-0.05, 0.12], abs=1e-6)

    def test_least_count(self):
        simulation = local_strip(measurement={"least_count": 1.0})
        micrometres = simulation.block.plates.xy * 1000.0
        np.testing.assert_allclose(micrometres, np.rint(micrometres), atol=1e-9)  # representation of 0.001 mm steps

    def test_kept_out_points_carry_the_flag_on_all_photos(self, block):
        plates = block.block.plates
        kept = np.unique(plates.point[~plates.triangulated])
        assert len(kept) == 3
        assert not np.isin(kept, block.block.control.point).any()
        assert not plates.triangulated[np.isin(plates.point, kept)].any()


class TestStations:
    def test_sizes_of_bad_starts(self):
        simulation = simulate(SPECS / "bad_start.toml")
        block, truth = simulation.block, simulation.truth
        away = EARTH.geocentric(block.photos.position) - truth.stations.xyz
        shift = np.einsum("kij,kj->ki", truth.stations.vertical, away)
        np.testing.assert_allclose(np.abs(shift), 100.0, atol=1e-3)  # 0.00001 arc second is 0.3 mm
        turn = np.abs(block.photos.attitude - truth.attitude)
        # the vertical of the given position is 100 m / 6.4e6 m = 3 arc seconds off
        np.testing.assert_allclose(turn, 2.0 * DEGREE, atol=5.0 * ARC_SECOND)

    def test_attitudes_are_in_the_frame_of_the_given_position(self):
        spec = load_spec(SPECS / "strip.toml")
        far = dataclasses.replace(spec, stations=dataclasses.replace(spec.stations, position_error=(5e4, 5e4, 0.0)))
        simulation = simulate(far)
        photos, truth = simulation.block.photos, simulation.truth
        given = attitude_matrix(photos.attitude) @ EARTH.frame(photos.position)
        true = attitude_matrix(truth.attitude) @ truth.stations.vertical
        np.testing.assert_allclose(given, true, atol=1e-9)  # attitudes are rounded to 0.0001 arc second

    def test_sigmas_on_the_cards(self):
        simulation = local_strip(stations={"position_sigma": [1.0, 2.0, 3.0], "attitude_sigma": 20.0})
        np.testing.assert_array_equal(simulation.block.photos.position_sigma[1], [1.0, 2.0, 3.0])
        np.testing.assert_allclose(simulation.block.photos.attitude_sigma, 20.0 * ARC_SECOND)
        assert np.isnan(local_strip().block.photos.position_sigma).all()


class TestGround:
    def test_share_and_depth_of_shoals(self, strip):
        heights = strip.truth.points.job[strip.block.points.bathymetric, 2]
        assert strip.block.points.bathymetric.sum() == 18  # 0.4 of 15 ties and 30 extra points
        assert heights.min() >= -15.0 and heights.max() <= -0.5

    def test_shore_points_share_their_level(self, block):
        groups = block.block.equal_elevations
        assert groups.ids.tolist() == ["SHORE"] and len(groups.point) == 5
        heights = block.truth.points.job[groups.point, 2]
        assert np.abs(heights - block.truth.levels[0]).max() < 5 * 0.05
        assert block.truth.levels[0] == np.max(block.block.photos.tide)

    def test_given_points_and_their_photos(self):
        simulation = local_strip(
            point=[{"id": "HERE", "local": [5000.0, 7000.0, 3.0], "photos": ["1", "3"], "triangulated": False}]
        )
        plates = simulation.block.plates
        rows = np.array(ids_of(simulation, plates.point)) == "HERE"
        assert plates.photo[rows].tolist() == [0, 2]
        assert not plates.triangulated[rows].any() and plates.triangulated[~rows].all()


class TestControl:
    def test_kinds_numbers_and_known_components(self, block):
        control = block.block.control
        assert np.bincount(control.kind).tolist() == [12, 0, 6]
        sea = block.block.points.bathymetric[control.point]
        assert sea[control.kind == ControlKind.VERTICAL].all() and not sea[control.kind == ControlKind.FULL].any()
        np.testing.assert_array_equal(np.isnan(control.sigma), ~control.known)
        np.testing.assert_array_equal(np.isnan(control.position), ~control.known)

    def test_errors_are_given_minus_true(self, block):
        control, truth = block.block.control, block.truth
        full = control.kind == ControlKind.FULL
        away = EARTH.geocentric(control.position[full]) - truth.points.xyz[control.point[full]]
        shift = np.einsum("kij,kj->ki", truth.points.vertical[control.point[full]], away)
        np.testing.assert_allclose(shift, truth.control_error[full], atol=5e-4)  # 0.00001 arc second is 0.3 mm
        assert 0.1 < truth.control_error[full].std() < 0.3

    def test_fixed_and_check_control_need_no_sigma(self):
        simulation = local_strip(
            control=[{"kind": "full", "number": 2, "fixed": True}, {"kind": "check", "number": 1}]
        )
        assert simulation.block.control.fixed.tolist() == [True, True, False]
        assert np.isnan(simulation.block.control.sigma).all()
        assert not np.isnan(simulation.block.control.position).any()


def test_negative_seed_is_refused():
    with pytest.raises(SpecError, match="seed: -1 is below 0"):
        simulate(SPECS / "strip.toml", seed=-1)


def test_spec_without_points_gives_an_empty_block():
    simulation = local_strip(points={"per_site": 0})
    assert len(simulation.block.plates.photo) == len(simulation.block.points.ids) == 0


@pytest.mark.parametrize(
    ("tables", "what"),
    [
        ({"control": [{"kind": "full", "number": 500, "sigma": 1.0}]}, "500 points are asked for"),
        ({"control": [{"kind": "full", "points": ["nobody"], "sigma": 1.0}]}, "nobody"),
        ({"control": [{"kind": "full", "ids": ["2", "2"], "sigma": 1.0}]}, "used more than once: 2"),
        ({"blunder": [{"photo": "1", "point": "none", "x": 5.0}]}, "none is not measured on photo 1"),
        ({"blunders": {"number": 10000}}, "there are only"),
        ({"kept_out": {"measurements": [["8", "1"]]}}, "not measured on photo 8"),
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
)
def test_what_cannot_be_done_is_said(tables, what):
    with pytest.raises(SpecError, match=what):
        simulate(spec_from_table({"job": {"system": "LOCL"}, **tables}))
