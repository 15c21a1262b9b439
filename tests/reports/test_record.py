"""The JSON record: its schema, full precision, and that it says what the solution says."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from json_schema import MANUAL, SCHEMA, load_schema, violations, with_table
from musatpy.model import CoordinateSystem, Refraction
from musatpy.reports import record_text
from musatpy.reports.fields import Field, Rows
from musatpy.reports.record import dumps, record, record_of, schema_text, texts_of
from musatpy.statistics import Statistics
from sample_solutions import sample_solution

CASES = [(system, refraction) for system in CoordinateSystem for refraction in Refraction]


def read_back(solution):
    return json.loads(dumps(record(solution)))


@pytest.mark.parametrize(("system", "refraction"), CASES)
def test_the_record_obeys_its_schema(system, refraction):
    schema = load_schema()
    assert not list(violations(read_back(sample_solution(system, refraction)), schema, schema))


@pytest.mark.parametrize(("system", "refraction"), CASES)
def test_the_text_made_by_columns_is_that_of_the_rows(system, refraction):
    statistics = Statistics(sample_solution(system, refraction))
    assert "".join(texts_of(statistics)) == dumps(record_of(statistics))


def test_the_text_by_columns_of_odd_values_is_that_of_the_rows(monkeypatch):
    """Quotes, percent signs and what is no number; more rows than are made at a time; a table without rows."""
    monkeypatch.setattr(record_text, "_ROWS", 2)
    names = ['a "quoted" 100% one', "", "\u00fc\\", "b", "b"]
    values = np.array([1.0, np.nan, np.inf, -0.0, 1e-300])
    table = Rows(
        "t %s",
        "",
        lambda s: s,
        (
            Field("name", "string", "", lambda s: names),
            Field("%d", "number?", "", lambda s: values),
            Field("pair", "2x2 number?", "", lambda s: np.arange(20.0).reshape(5, 2, 2)),
            Field("some", "2 number?", "", lambda s: np.stack([values, values[::-1]], axis=1)),
            Field("count", "integer", "", lambda s: np.arange(5)),
            Field("flag", "boolean", "", lambda s: np.arange(5) > 2),
            Field("ids", "* string", "", lambda s: [["x", "y"], [], ["z"], ["x"], ["%"]]),
            Field("mixed", "string?", "", lambda s: [None, "a", None, "b", "c"]),
        ),
    )
    empty = Rows("empty", "", lambda s: None, table.fields)
    text = "".join(record_text.record_texts([table, empty], 1))
    assert text == dumps({node.name: node.json(1) for node in (table, empty)})


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("schema_version",), "2.0"),
        (("solution", "sigma0"), "1.0"),
        (("solution", "degrees_of_freedom"), 2.5),
        (("options", "refraction"), "SOME"),
        (("stations", 0, "attitude"), [1.0, 2.0]),
        (("plates", 3, "extra"), 1),
        (("points", 5), {}),
        (("analyses", "ground_point", 0, "unit"), "ft"),
    ],
)
def test_the_schema_notices(path, value):
    schema, found = load_schema(), read_back(sample_solution())
    place = found
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    assert list(violations(found, schema, schema))


def test_every_field_of_the_schema_is_in_the_record():
    """The order too: that of the schema is that of the record."""
    schema, found = load_schema(), record(sample_solution())
    assert list(found) == list(schema["properties"]) == schema["required"]
    for name, entry in schema["properties"].items():
        if "properties" in entry.get("items", {}):
            assert list(found[name][0]) == list(entry["items"]["properties"]), name


def test_numbers_come_back_bit_for_bit():
    solution = sample_solution()
    found = read_back(solution)
    for rows, name, expected in (
        ("stations", "position", solution.stations.position),
        ("stations", "covariance", solution.stations.covariance),
        ("points", "position", solution.points.position),
        ("points", "covariance", solution.points.covariance),
        ("plates", "residual", solution.plates.residual),
        ("plates", "refraction", solution.plates.correction),
        ("plates", "xy", solution.block.plates.xy),
        ("bathymetric_points", "depth", solution.bathymetric.depth),
        ("control", "given_position", solution.block.control.position),
    ):
        np.testing.assert_array_equal(np.array([row[name] for row in found[rows]], dtype=float), expected, name)
    assert found["solution"]["sigma0"] == solution.sigma0
    assert [row["rotation"] for row in found["iterations"]] == [i.rotation for i in solution.iterations]


def test_statistics_are_those_of_the_analyses():
    solution = sample_solution()
    found = read_back(solution)["analyses"]["camera_station_position"]
    analysis = Statistics(solution).station_positions
    assert [row["rms"] for row in found] == [d.rms for d in analysis.statistics]
    assert [row["maximum_id"] for row in found] == [d.maximum_id for d in analysis.statistics]


def test_what_does_not_exist_is_null():
    found = read_back(sample_solution())
    assert found["points"][12]["position"] == [None, None, None]
    assert found["points"][12]["reason"] == "a single ray and no control"
    assert found["control"][0]["given_position"][2] is None
    assert found["distortion"][1]["values"][2] is None
    assert found["plate_statistics"]["frames"][0]["rms"][1] == [None, None]


def test_infinity_is_null_too():
    solution = dataclasses.replace(sample_solution(), sigma0=float("inf"))
    assert read_back(solution)["solution"]["sigma0"] is None


def test_rows_stand_on_lines_of_their_own():
    text = dumps(record(sample_solution()))
    assert text.endswith("}\n")
    lines = [line for line in text.splitlines() if line.startswith('    {"photo": "837", "point": "1102"')]
    assert len(lines) == 1


def test_the_same_solution_is_the_same_text():
    assert dumps(record(sample_solution())) == dumps(record(sample_solution()))


def test_the_shipped_schema_is_that_of_the_tables():
    """`python tests/json_schema.py` makes it anew."""
    assert SCHEMA.read_text() == schema_text()


def test_the_manual_has_the_table_of_the_schema():
    """`python tests/json_schema.py` makes it anew."""
    text = MANUAL.read_text()
    assert with_table(text, load_schema()) == text
