"""Two solutions side by side: known differences come out as they were put in."""

import copy
import json
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from musatpy.cli.main import main
from musatpy.comparison import ComparedRuns, compare
from musatpy.errors import MusatError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import CoordinateSystem
from musatpy.model.solution import WAVE_VALUES
from musatpy.reports.comparison import comparison_record, comparison_text
from musatpy.reports.record import dumps, record
from record_rows import with_columns, with_rows
from sample_solutions import sample_solution

SYSTEMS = list(CoordinateSystem)


def solution_record(system: CoordinateSystem = CoordinateSystem.GEOGRAPHIC) -> dict[str, Any]:
    """The record of the sample solution, its tables by rows."""
    rows: dict[str, Any] = with_rows(record(sample_solution(system)))
    return rows


def compared(first: dict[str, Any], second: dict[str, Any], labels: tuple[str, str] = ("A", "B")) -> ComparedRuns:
    """The comparison of two records by rows."""
    return compare(with_columns(first), with_columns(second), labels)


def moved(one: dict, kind: str, name: str, row: int, enu: tuple[float, float, float]) -> str:
    """Move a station or point by east, north, up metres, in place, and return its id."""
    target = one[kind][row]
    position = np.array(target["position"], dtype=float)
    system = one["options"]["system"]
    if system == "LOCL":
        position = position + enu
    else:
        ellipsoid = Ellipsoid(one["ellipsoid"]["name"])
        native = position if system == "GEOG" else ellipsoid.geographic(position)
        xyz = ellipsoid.geocentric(native) + np.array(enu) @ ellipsoid.frame(native)
        position = ellipsoid.geographic(xyz) if system == "GEOG" else xyz
    target["position"] = position.tolist()
    return str(target[name])


@pytest.mark.parametrize("system", SYSTEMS)
def test_known_differences_come_out_first(system: CoordinateSystem) -> None:
    first = solution_record(system)
    second = copy.deepcopy(first)
    photo = moved(second, "stations", "photo", 4, (1.0, -2.0, 0.5))
    second["stations"][6]["attitude"][2] += 1e-3
    point = moved(second, "points", "point", 30, (0.0, 0.2, -3.0))
    found = compared(first, second)
    assert found.points.ids[0] == point
    # geodetic conversions are good to a nanometre or so; axes turn by distance over the earth's radius
    np.testing.assert_allclose(found.points.difference[0], [0.0, 0.2, -3.0], atol=1e-5)
    expected = np.array([0.0, 0.2, -3.0]) / second["points"][30]["sigma"]
    np.testing.assert_allclose(found.points.ratio[0], expected, atol=1e-3)
    station = found.stations.ids.tolist().index(photo)
    np.testing.assert_allclose(found.stations.difference[station, :3], [1.0, -2.0, 0.5], atol=1e-5)
    turned = found.stations.ids.tolist().index(second["stations"][6]["photo"])
    assert found.stations.difference[turned, 5] == pytest.approx(1e-3)
    others = np.abs(np.delete(found.stations.difference, [station, turned], axis=0))
    assert others.max() == 0.0
    assert (np.diff(found.stations.largest) <= 1e-9).all()


def test_the_same_solution_twice_differs_in_nothing() -> None:
    one = solution_record()
    found = compared(one, one)
    assert found.largest == 0.0
    assert found.only_one == ()
    assert not [fact for fact in found.facts if fact[0].startswith("option")]


def test_order_does_not_matter_and_what_is_in_one_only_is_listed() -> None:
    first, second = solution_record(), solution_record()
    second["points"] = second["points"][::-1]
    gone = second["points"].pop(3)["point"]
    lost = second["points"][5]
    lost["position"], lost["reason"] = [None, None, None], "its rays are parallel"
    found = compared(first, second, ("one", "two"))
    assert found.largest == 0.0
    assert f"point {gone}: in two it is not there" in found.only_one
    assert f"point {lost['point']}: in two it is not determined: its rays are parallel" in found.only_one


def with_waves_found(one: dict, sigma: dict[str, list[float | None]], **changes: list[float]) -> dict:
    """Return a record whose waves were unknown: found where they were given, but for changes added, with sigmas."""
    one = copy.deepcopy(one)
    waves = [{name: row[name] for name in ("wave", *WAVE_VALUES)} for row in one["waves"]]
    for row in waves:
        for name, change in zip(WAVE_VALUES, changes.get(row["wave"], [0.0] * 4), strict=True):
            row[name] += change
    parameters = [
        {"wave": wave, "parameter": name, "sigma": value}
        for wave, values in sigma.items()
        for name, value in zip(WAVE_VALUES, values, strict=True)
    ]
    one["adjusted_water"]["waves"] = {"waves": waves, "parameters": parameters}
    return one


SIGMAS = {"SW": [0.05, 1.0, 0.01, 2.0], "CHOP": [0.1, None, None, 0.4]}


def test_waves_are_compared_in_sigmas_of_the_second() -> None:
    given = solution_record()
    first = with_waves_found(given, {}, SW=[0.1, 2.0, 0.0, 1.0])
    second = with_waves_found(given, SIGMAS, SW=[0.2, -1.0, 0.03, 5.0], CHOP=[0.5, 0.25, 0.0, -0.4])
    found = compared(first, second)
    assert found.waves.ids.tolist() == ["CHOP", "SW"]
    expected = [[0.5, 0.25, 0.0, -0.4], [0.1, -3.0, 0.03, 4.0]]
    np.testing.assert_allclose(found.waves.difference, expected, rtol=0, atol=1e-12)  # rounding of sums to 100 m
    ratio = [[5.0, np.nan, np.nan, -1.0], [2.0, -3.0, 3.0, 2.0]]
    np.testing.assert_allclose(
        found.waves.ratio, ratio, rtol=0, atol=1e-10
    )  # the same over sigmas of 0.01 and more
    assert found.largest == pytest.approx(5.0)
    text, whole = comparison_text(found, 1), comparison_record(found)
    section = text.split("\nWaves: B minus A")[1].split("\n\n\n")[0]
    assert section.splitlines()[-2].split() == ["CHOP", ".500", ".250", ".000", "-.400", "5.00", "-1.00"]
    assert section.splitlines()[-1] == "and 1 more that differ less"
    assert [row["wave"] for row in whole["waves"]] == ["CHOP", "SW"]
    assert whole["waves"][0]["sigma"] == [0.1, None, None, 0.4]


def test_waves_that_were_known_are_compared_without_sigmas() -> None:
    first = solution_record()
    second = copy.deepcopy(first)
    second["waves"][0]["height"] += 0.25
    found = compared(first, second)
    row = found.waves.ids.tolist().index("SW")
    np.testing.assert_allclose(found.waves.difference[row], [0.25, 0.0, 0.0, 0.0], rtol=0, atol=1e-12)  # rounding
    assert np.isnan(found.waves.sigma).all() and found.largest == 0.0
    # one where they were adjusted beside one where they were known
    later = with_waves_found(first, SIGMAS, SW=[0.1, 0.0, 0.0, 0.0])
    assert compared(first, later).largest == pytest.approx(2.0)


def test_a_crest_or_a_direction_that_comes_round_is_the_same_wave() -> None:
    given = solution_record()
    length = given["waves"][0]["length"]
    first = with_waves_found(given, {})
    second = with_waves_found(given, SIGMAS, SW=[0.0, 0.0, 2.0 * np.pi + 0.01, 3.0 * length - 1.5])
    found = compared(first, second)
    row = found.waves.ids.tolist().index("SW")
    np.testing.assert_allclose(found.waves.difference[row], [0.0, 0.0, 0.01, -1.5], rtol=0, atol=1e-9)  # of 300 m


def test_crests_from_two_origins_are_not_compared() -> None:
    first = with_waves_found(solution_record(), SIGMAS)
    second = copy.deepcopy(first)
    second["wave_origin"][2] += 1.0
    found = compared(first, second)
    assert np.isnan(found.waves.difference[:, 3]).all() and (found.waves.difference[:, :3] == 0.0).all()
    assert ("origin of the waves (crests not compared)", "one", "another") in found.facts
    assert "origin of the waves (crests not compared)" in comparison_text(found)


def test_a_wave_of_one_solution_only_is_listed() -> None:
    first, second = solution_record(), solution_record()
    second["waves"] = second["waves"][:1]
    found = compared(first, second, ("one", "two"))
    assert found.waves.ids.tolist() == ["SW"] and "wave CHOP: in two it is not there" in found.only_one
    second["waves"], second["wave_origin"], second["adjusted_water"] = [], None, None  # of a job without water
    found = compared(first, second)
    assert "Waves:" not in comparison_text(found) and comparison_record(found)["waves"] == []


def test_other_jobs_are_not_compared() -> None:
    first, second = solution_record(), solution_record(CoordinateSystem.LOCAL)
    with pytest.raises(MusatError, match="A is a GEOG job, B a LOCL job"):
        compared(first, second)
    other = copy.deepcopy(first)
    for row in other["stations"]:
        row["photo"] += "X"
    with pytest.raises(MusatError, match="no photo in common"):
        compared(first, other)


def test_text_and_json_say_the_same() -> None:
    first, second = solution_record(), solution_record()
    point = moved(second, "points", "point", 30, (0.0, 0.0, 2.0))
    found = compared(first, second, ("one", "two"))
    text, whole = comparison_text(found, 3), comparison_record(found)
    assert f"Largest difference: {found.largest:.3f} sigmas of two" in text
    assert whole["points"][0]["point"] == point
    assert whole["points"][0]["difference"][2] == pytest.approx(2.0, abs=1e-6)
    assert "and 95 more that differ less" in text
    json.dumps(whole, allow_nan=False)


def test_the_command(tmp_path) -> None:
    first, second = tmp_path / "a.json", tmp_path / "b.json"
    one = solution_record()
    first.write_text(dumps(with_columns(one)))
    moved(one, "points", "point", 30, (0.0, 0.0, 2.0))
    second.write_text(dumps(with_columns(one)))
    run = CliRunner().invoke
    done = run(main, ["compare", str(first), str(second)])
    assert done.exit_code == 0, done.output
    assert "COMPARISON OF TWO SOLUTIONS: a AND b" in done.output
    assert run(main, ["compare", str(first), str(second), "--limit", "1"]).exit_code == 1
    assert run(main, ["compare", str(first), str(first), "--limit", "0"]).exit_code == 0
    assert json.loads(run(main, ["compare", str(first), str(second), "--json"]).output)["labels"] == ["a", "b"]
