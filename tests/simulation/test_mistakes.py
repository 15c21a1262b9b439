"""Gross errors of all kinds: the deck has them, the truth says which, and nothing else changes."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from musatpy.adjustment import adjust
from musatpy.draws import Draws
from musatpy.formats.musat import deck_bytes, read_deck
from musatpy.model import CauseKind, ControlKind, ObservationKind
from musatpy.pipeline import adjust as adjust_and_search
from musatpy.simulation import Simulation, load_spec, simulate, spec_from_table, truth_record
from musatpy.simulation.mistakes import drawn_sizes

SPECS = Path(__file__).parent / "specs"


def block_with(name: str = "block", **tables: object) -> Simulation:
    """Return the simulation of a spec file with keys of its tables replaced."""
    spec = load_spec(SPECS / f"{name}.toml")
    changes: dict[str, object] = {}
    for table, keys in tables.items():
        part = getattr(spec, table)
        changes[table] = dataclasses.replace(part, **keys) if isinstance(keys, dict) else keys
    return simulate(dataclasses.replace(spec, **changes))


def local(**tables: object) -> Simulation:
    table = {
        "job": {"system": "LOCL"},
        "flight": {"photos": 5},
        "water": {},
        "shoal": [{"share": 0.5}],
        "control": [{"kind": "full", "number": 4, "sigma": 0.1}, {"kind": "vertical", "number": 2, "sigma": 0.1}],
        **tables,
    }
    return simulate(spec_from_table(table))


@pytest.fixture(scope="module")
def plain() -> Simulation:
    return block_with()


@pytest.fixture(scope="module")
def mixed() -> Simulation:
    return block_with(blunders={"swapped": 5, "misnamed": 6})


def controlled(**tables: object) -> dict[str, object]:
    """Return the table of a strip with 7 points of control and 2 check points, none without errors."""
    control = [
        {"kind": "full", "number": 5, "sigma": 0.1, "error": 0.1},
        {"kind": "vertical", "number": 2, "sigma": 0.1, "error": 0.1},
        {"kind": "check", "number": 2, "error": 0.1},
    ]
    return {"job": {"system": "LOCL"}, "flight": {"photos": 6}, "control": control, **tables}


@pytest.fixture(scope="module")
def wrong() -> Simulation:
    control = [
        {"number": 2, "component": "horizontal", "size": [2.0, 1000.0], "log": True},
        {"number": 3, "component": "vertical", "size": [5.0, 6.0]},
    ]
    return simulate(spec_from_table(controlled(blunders={"control": control})))


def test_logarithmic_sizes_are_even_in_their_logarithm() -> None:
    size = drawn_sizes(Draws(1), "sizes", 4000, (10.0, 10000.0), True)
    count = np.histogram(np.log10(size), bins=3, range=(1.0, 4.0))[0]
    assert np.all(np.abs(count - 4000 / 3) < 4.0 * np.sqrt(4000 * 2 / 9))  # four sigmas of a binomial count


def test_names_are_mixed_up_as_the_truth_says(mixed: Simulation, plain: Simulation) -> None:
    truth, plates, ids = mixed.truth, mixed.block.plates, mixed.block.points.ids
    first, second = truth.swapped.T
    rows = np.concatenate([first, second, truth.misnamed])
    np.testing.assert_array_equal(np.flatnonzero(plates.point != truth.seen), np.sort(rows))
    assert (len(first), len(truth.misnamed)) == (5, 6)
    # swapped images of one photo have each other's names; misnamed ones names that their photos lack
    np.testing.assert_array_equal(plates.photo[first], plates.photo[second])
    np.testing.assert_array_equal(plates.point[first], truth.seen[second])
    np.testing.assert_array_equal(plates.point[second], truth.seen[first])
    for row in truth.misnamed:
        assert plates.point[row] not in truth.seen[plates.photo == plates.photo[row]]
        assert np.count_nonzero(truth.seen == plates.point[row]) >= 2
    # no point has two of them, and no other gross error is among them
    points = np.concatenate([truth.seen[rows], plates.point[truth.misnamed]])
    assert len(set(points.tolist())) == len(points) == 2 * 5 + 2 * 6
    hit = set(zip(mixed.block.photos.ids[plates.photo[rows]], ids[truth.seen[rows]], strict=True))
    assert np.all(plates.triangulated[rows]) and not {(one.photo, one.point) for one in truth.blunders} & hit
    # images are those of the points that are seen
    np.testing.assert_array_equal(plates.xy, plain.block.plates.xy)
    np.testing.assert_array_equal(ids[truth.seen], plain.block.points.ids[plain.block.plates.point])
    record, names = (
        truth_record(mixed),
        {*zip(mixed.block.photos.ids[plates.photo], ids[plates.point], strict=True)},
    )
    for one in record["swapped"]:
        assert {(one["photo"], point) for point in one["points"]} <= names
    for one in record["misnamed"]:
        assert (one["photo"], one["name"]) in names and (one["photo"], one["point"]) not in names


def test_gross_errors_of_control_are_on_the_cards_beside_the_others(wrong: Simulation) -> None:
    gross, plain = wrong.truth.gross_control, simulate(spec_from_table(controlled()))
    horizontal, vertical = np.linalg.norm(gross[:, :2], axis=1), np.abs(gross[:, 2])
    assert np.count_nonzero(horizontal) == 2 and np.count_nonzero(vertical) == 3
    assert not np.any((horizontal > 0.0) & (vertical > 0.0))
    assert np.all((vertical == 0.0) | ((vertical >= 5.0) & (vertical <= 6.0)))
    assert np.all((horizontal == 0.0) | (horizontal >= 1.999999))  # rounded to 1e-6 m
    assert np.all(wrong.block.control.kind[gross.any(axis=1)] != ControlKind.CHECK)
    away = wrong.block.control.position - plain.block.control.position
    known = ~np.isnan(away)
    np.testing.assert_allclose(away[known], gross[known], rtol=0, atol=1.01e-4)  # the cards end at 0.0001 m
    both = plain.truth.control_error + gross
    np.testing.assert_allclose(wrong.truth.control_error, both, rtol=0, atol=1e-9)  # sums of micrometres
    np.testing.assert_array_equal(wrong.block.plates.xy, plain.block.plates.xy)


def test_the_deck_has_ties() -> None:
    simulation = local(
        distance=[{"number": 4, "sigma": 0.03}, {"points": ["1", "5"]}],
        height_difference=[{"number": 2, "error": 0.5}, {"points": ["8", "3"]}],
        air_base=[{"photos": ["2", "3"]}],
    )
    block, truth = simulation.block, simulation.truth
    ends = truth.points.xyz[block.distances.point]
    np.testing.assert_allclose(truth.distances, np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
    np.testing.assert_allclose(block.distances.sigma, [0.03] * 4 + [0.02])
    heights = truth.points.natural[block.height_differences.point, 2]
    np.testing.assert_allclose(truth.height_differences, heights[:, 1] - heights[:, 0])
    base = truth.stations.xyz[2] - truth.stations.xyz[1]
    given = [*block.distances.length, *block.air_bases.length, block.height_differences.difference[2]]
    true = [*truth.distances, np.linalg.norm(base), truth.height_differences[2]]
    np.testing.assert_allclose(given, true, rtol=0, atol=0.51e-4)  # the cards end at 0.0001 m
    assert np.all(block.height_differences.difference[:2] != truth.height_differences[:2])
    assert block.points.ids[block.height_differences.point[2]].tolist() == ["8", "3"]
    assert deck_bytes(read_deck(deck_bytes(block))) == deck_bytes(block)


def test_program_iiia_agrees_with_ties() -> None:
    ties = {"distance": [{"number": 3}], "height_difference": [{"number": 3}]}
    simulation = local(**ties, measurement={"noise": 0.0}, options={"program": "IIIA"})
    solution = adjust(simulation.block)
    assert solution.converged, solution.reason
    measured, truth = solution.measured, simulation.truth
    found = [*measured[ObservationKind.DISTANCE], *measured[ObservationKind.HEIGHT_DIFFERENCE]]
    true = [*truth.distances, *truth.height_differences]
    np.testing.assert_allclose(found, true, rtol=0, atol=5e-4)  # 1e-6 mm of plate are 2e-5 m, heights thrice


@pytest.mark.slow
def test_a_search_finds_what_the_truth_says():
    """One of each kind, all plain to see: the truth has the words to tell what was found from what was missed."""
    simulation = simulate(
        spec_from_table({
            "job": {"system": "LOCL"},
            "flight": {"strips": 2, "photos": 3, "height": 1500.0, "side_overlap": 0.5},
            "terrain": {"level": 40.0, "relief": 30.0},
            "water": {},
            "shoal": [{"share": 0.4, "depth": [1.0, 30.0]}],
            "points": {"per_site": 2, "extra": [{"number": 15}]},
            "control": [{"kind": "full", "number": 12, "sigma": 0.05, "error": 0.05}],
            "measurement": {"noise": 5.0, "sigma": 5.0},
            "blunders": {
                "number": 2, "size": [2000.0, 5000.0], "swapped": 1,
                "control": [{"number": 1, "component": "vertical", "size": [20.0, 40.0]}],
            },
            "options": {"program": "IIIA", "editing": "EDIT"},
        })
    )  # fmt: skip
    record = truth_record(simulation)
    found = {(one.kind, one.photo, one.point) for one in adjust_and_search(simulation.block).findings}
    plates = {(one["photo"], one["point"]) for one in record["blunders"]}
    assert plates <= {(photo, point) for blunder, photo, point in found if blunder is CauseKind.IMAGE}
    (swapped,) = record["swapped"]
    names = {(photo, point) for blunder, photo, point in found if blunder is CauseKind.NAME}
    assert names == {(swapped["photo"], point) for point in swapped["points"]}
    assert {point for blunder, _, point in found if blunder is CauseKind.VERTICAL} == set(record["wrong_control"])
