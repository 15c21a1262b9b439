"""Decks that say the wrong thing of the water: program IIIA finds index, tides and tilt as they are."""

import numpy as np
import pytest

from altered import added, altered
from musatpy.adjustment import adjust
from musatpy.formats.musat import deck_bytes, read_deck
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import PointStatus
from musatpy.simulation import Simulation, simulate, spec_from_table, truth_record
from musatpy.units import ARC_SECOND

CENTRES = {"GEOG": [18.0, -65.0], "GEOC": [18.0, -65.0], "LOCL": [5000.0, 7000.0]}
TILT = [60.0, -40.0]
POINTS = 3e-4  # m: 0.5e-6 mm of plate are 5e-6 m on the ground, and points of two near photos have 20 times that


def simulated(system: str = "GEOG", **tables: object) -> Simulation:
    """Two strips of three photos over deep water, without noise but where the tables say so."""
    table: dict[str, object] = {
        "seed": 7,
        "job": {"system": system, "centre": CENTRES[system]},
        "flight": {"strips": 2, "photos": 3, "height": 1500.0, "station_scatter": 10.0, "attitude_scatter": 2.0},
        "terrain": {"level": 40.0, "relief": 30.0},
        "water": {"tide_scatter": 0.2},
        "shoal": [{"share": 0.6, "depth": [1.0, 30.0]}],
        "points": {"per_site": 2, "extra": [{"number": 60}]},
        "control": [{"kind": "full", "number": 10, "sigma": 0.02}],
        "measurement": {"noise": 0.0, "sigma": 5.0},
        "options": {"program": "IIIA"},
    }
    for name, keys in tables.items():
        below = table.get(name)
        table[name] = {**below, **keys} if isinstance(keys, dict) and isinstance(below, dict) else keys
    return simulate(spec_from_table(table))


def largest_error(simulation: Simulation, position: np.ndarray, known: np.ndarray) -> float:
    """Return the largest error (m) of points in the system of the deck."""
    xyz = Ellipsoid("clrk66").geocentric(position) if simulation.truth.spec.job.system == "GEOG" else position
    return float(np.linalg.norm(xyz[known] - simulation.truth.points.xyz[known], axis=1).max())


LEVELS = [
    ({"level_error": 0.5}, "ONE"),
    ({"group_size": 2}, "GROUP"),
    ({"day_size": 4}, "DAY"),
    ({"photo_level_error": 0.3, "level_error": -0.4}, "PHOTO"),
]
IN_COMMON = {"GROUP": [0.3, 0.3, -0.5, -0.5, 0.2, 0.2], "DAY": [0.3] * 4 + [-0.4] * 2}  # m, errors of tides
CASES = [
    ("GEOG", {"index_error": 0.01}, {"water_index": "ADJUST"}),
    *(("GEOG", water, {"water_level": level}) for water, level in LEVELS),
    ("GEOG", {"tilt": TILT}, {"water_tilt": "ADJUST"}),
    *(
        (
            system,
            {"tilt": TILT, "tilt_on_card": [10.0, 10.0], "index_error": -0.01, "level_error": 0.4},
            {"water_level": "ONE", "water_tilt": "ADJUST", "water_index": "ADJUST"},
        )
        for system in CENTRES
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("system", "water", "options"), CASES)
def test_unknown_water_is_found_as_it_is(system, water, options):
    """Plates end at 1e-6 mm: by the adjustment's own sigmas that leaves 4e-5 m, 0.013 arc seconds and 3e-6 at most.

    Tolerances are four of these. The index has 5e-6 more: the solver takes the water between a point and where its
    ray enters as flat, which 1 m of way at the sea's radius turns by 2e-7 (in the local job the error is 1e-6).
    """
    simulation = simulated(system, water=water, options={"program": "IIIA", **options})
    wrong = altered(
        simulation.block, photos={"tide": added(slice(None), IN_COMMON.get(options.get("water_level"), 0.0))}
    )
    truth, block = simulation.truth, read_deck(deck_bytes(wrong))
    solution = adjust(block)
    assert solution.converged, solution.reason
    assert solution.water is not None
    np.testing.assert_allclose(solution.water.tide, truth.tide, rtol=0, atol=1.6e-4)
    np.testing.assert_allclose(solution.water.tilt, truth.tilt, rtol=0, atol=0.052 * ARC_SECOND)
    assert abs(solution.water.index - truth.index) < 1.7e-5
    known = solution.points.status == PointStatus.TRIANGULATED
    assert largest_error(simulation, solution.points.position, known) < POINTS


def test_tilt_on_the_card_needs_no_unknown():
    simulation = simulated(water={"tilt": TILT, "tilt_on_card": TILT})
    solution = adjust(simulation.block)
    known = solution.points.status == PointStatus.TRIANGULATED
    assert largest_error(simulation, solution.points.position, known) < POINTS
    level = adjust(simulated(water={"tilt": TILT}).block)
    # a slope of 60 arc seconds is 0.3 m in a kilometre: a third of it in the depths below
    assert largest_error(simulation, level.points.position, known) > 0.05
    assert level.sigma0 > 100.0 * solution.sigma0


CHANGES = [
    {"water": {"level_error": 0.5}},
    {"water": {"index_error": 0.01, "tilt_on_card": [5.0, 5.0]}},
    {"water": {"photo_level_error": 0.3}},
    {"distance": [{"number": 3, "error": 0.1}]},
    {"height_difference": [{"number": 3, "error": 0.1}]},
    {"options": {"program": "IIIA", "water_level": "PHOTO", "submerged_factor": 1.5}},
    {"blunders": {"swapped": 2}},
    {"blunders": {"misnamed": 2}},
]


NOISY = {"noise": 5.0, "sigma": 5.0}


@pytest.mark.parametrize("change", CHANGES)
def test_plates_control_and_stations_stay_as_they_are(change):
    keys = {"measurement": NOISY, "stations": {"position_error": 10.0, "attitude_error": 0.1}}
    plain, other = simulated(**keys), simulated(**keys, **change)
    np.testing.assert_array_equal(other.block.plates.xy, plain.block.plates.xy)
    np.testing.assert_array_equal(other.block.photos.position, plain.block.photos.position)
    np.testing.assert_array_equal(other.truth.tide, plain.truth.tide)
    np.testing.assert_array_equal(other.truth.control_error, plain.truth.control_error)
    assert deck_bytes(other.block) != deck_bytes(plain.block)


def test_tilt_moves_the_images_and_not_their_noise():
    plain, tilted = simulated(measurement=NOISY), simulated(measurement=NOISY, water={"tilt": TILT})
    noise = [one.block.plates.xy - one.truth.images for one in (plain, tilted)]
    np.testing.assert_allclose(noise[1], noise[0], rtol=0, atol=1.1e-6)  # plates are rounded to 1e-6 mm
    moved = np.abs(tilted.truth.images - plain.truth.images).max(axis=1)
    assert np.all(moved[~plain.truth.refracted] == 0.0) and np.all(moved[plain.truth.refracted] > 0.0)


def test_a_deck_without_station_cards_is_adjusted_all_the_same():
    simulation = simulated(options={"program": "IIIA", "initial": "COMPUTE"})
    nothing = np.full((6, 3), np.nan)
    deck = deck_bytes(altered(simulation.block, photos={"position": nothing, "attitude": nothing}))
    assert not [line for line in deck.splitlines() if line.startswith((b"STA", b"STX", b"ATT"))]
    block = read_deck(deck)
    assert deck_bytes(block) == deck
    solution = adjust(block)
    known = solution.points.status == PointStatus.TRIANGULATED
    assert solution.converged and largest_error(simulation, solution.points.position, known) < POINTS


# --- water by its conditions ---

COLD = {"temperature": 4.5, "salinity": 34.25}


@pytest.mark.parametrize(
    ("conditions", "card"),
    [
        (COLD, "WTC    4.50   34.25           550.00 QUANFRY"),
        ({"temperature": 18.126, "salinity": 0.0}, "WTC   18.13    0.00           550.00 QUANFRY"),
    ],
)
def test_conditions_stand_on_their_card_and_make_the_true_index(conditions, card) -> None:
    """Beside them the card of the water has what is left."""
    simulation = simulated(water={"conditions": conditions, "index_sigma": 0.01, "tilt_on_card": [10.0, 0.0]})
    lines = {line[:3]: line for line in deck_bytes(simulation.block).decode().splitlines()}
    assert lines["WTC"][:72].rstrip() == card and lines["WTR"][:12].strip() == "WTR"  # no index
    assert (float(lines["WTR"][13:21]), float(lines["WTR"][22:31])) == (0.01, 10.0)
    water = read_deck(deck_bytes(simulation.block)).water
    assert water == simulation.block.water
    record = truth_record(simulation)
    assert record["index"] == round(water.index, 12) != 1.34  # it is rounded to so much
    assert record["spec"]["water"]["conditions"]["temperature"] == conditions["temperature"]
    assert simulate(spec_from_table(record["spec"])).truth.index == simulation.truth.index


def test_a_wrong_temperature_is_a_wrong_index() -> None:
    simulation = simulated(water={"conditions": COLD}, options={"water_index": "ADJUST"})
    warm = altered(simulation.block, water={"conditions": {"temperature": 24.5}})
    read = read_deck(deck_bytes(warm))
    # sea water of 24.5 degrees bends light less than that of 4.5, by about 0.002
    assert -0.003 < read.water.index - simulation.truth.index < -0.001
    assert abs(adjust(read).water.index - simulation.truth.index) < 1.7e-5  # by the rounding of plates, as above
