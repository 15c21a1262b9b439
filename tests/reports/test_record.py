"""The JSON record: its schema, full precision, and that it says what the solution says."""

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from altered import altered
from json_schema import MANUAL, SCHEMA, load_schema, schema_text, violations, with_table
from musatpy.model import CoordinateSystem, RecordContent, Refraction
from musatpy.reports import record as record_module
from musatpy.reports.fields import Field, Rows
from musatpy.reports.record import dumps, held_tables, record, record_of, texts_of
from musatpy.reports.values import LazyColumn, rounded
from musatpy.statistics import Statistics
from sample_solutions import sample_solution

CASES = [(system, refraction) for system in CoordinateSystem for refraction in Refraction]


def read_back(solution):
    return json.loads(dumps(record(solution)))


def plain_again(value):
    """Return what a record holds with its columns as lists, read each in two ways."""
    if isinstance(value, LazyColumn):
        assert list(value) == [value[row] for row in range(len(value))] == value[:]
        return value[:]
    return {name: plain_again(entry) for name, entry in value.items()} if isinstance(value, dict) else value


@pytest.mark.parametrize(("system", "refraction"), CASES)
def test_the_record_obeys_its_schema_and_is_the_same_however_it_is_made(system, refraction):
    """Written piece by piece, or held as columns that are worked out when they are looked at."""
    statistics, schema = Statistics(sample_solution(system, refraction)), load_schema()
    whole, written = record_of(statistics), json.loads(dumps(record(statistics.solution)))
    assert not list(violations(written, schema, schema))
    assert json.loads("".join(texts_of(statistics))) == written
    assert json.dumps(plain_again(held_tables(statistics, set(whole)))) == json.dumps(whole)


def test_only_what_is_named_is_made():
    statistics = Statistics(sample_solution())
    whole = record_of(statistics)
    assert record_of(statistics, {"points", "verdict"}) == {name: whole[name] for name in ("verdict", "points")}


def test_the_text_of_odd_values_is_that_of_the_table(monkeypatch):
    """Quotes, percent signs and what is no number; more rows than are made at a time; a table without rows."""
    monkeypatch.setattr(record_module, "_ROWS", 2)
    names = ['a "quoted" 100% one', "", "\u00fc\\", "b", "b"]
    values = np.array([1.0, np.nan, np.inf, -0.0, 1e-300])
    table = Rows(
        "t %s",
        "",
        of=lambda s: s,
        fields=(
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
    empty = Rows("empty", "", of=lambda s: None, fields=table.fields)
    text = "".join(record_module.object_texts([table, empty], 1, "\n"))
    found = json.loads(text)
    assert found == json.loads(dumps({node.name: node.json(1) for node in (table, empty)}))
    assert found["t %s"]["%d"] == [1.0, None, None, 0.0, 1e-300] and found["t %s"]["name"] == names
    assert found["empty"] == {field.name: [] for field in table.fields}


@given(
    st.lists(st.floats(allow_nan=True) | st.floats(-1e6, 1e6), min_size=1, max_size=50), st.sampled_from([6, 9, 12])
)
def test_columns_are_rounded_to_their_digits(values, digits):
    """A number next to a tie may go either way."""
    found = rounded(np.array(values), digits)
    for value, number in zip(values, found.tolist(), strict=True):
        nearest = float(f"{value:.{digits}g}")
        if math.isnan(value) or nearest == number:
            assert math.isnan(value) == math.isnan(number)
            continue
        assert float(f"{number:.{digits}g}") == number
        assert abs(number - value) == pytest.approx(abs(nearest - value), rel=1e-3)


@pytest.mark.parametrize("package", [True, False])
def test_with_and_without_a_package_the_numbers_are_the_same(monkeypatch, package):
    """To the last bit, whichever way their exponents are written."""
    if package:
        monkeypatch.setattr(record_module, "_MANY", 0)
    else:
        monkeypatch.setattr(record_module, "quick_json", lambda: None)
    for system, refraction in CASES[::3]:
        statistics = Statistics(sample_solution(system, refraction))
        text = "".join(texts_of(statistics))
        assert json.loads(text) == json.loads(dumps(record(statistics.solution)))


def test_the_schema_says_the_digits_that_there_are():
    """Of every number of a record: no more than its field says, and what is whole has more somewhere."""
    found, schema = read_back(sample_solution()), load_schema()
    longest = {}
    for name in ("points", "stations", "plates", "observations", "control", "bathymetric_points"):
        for field, column in schema["properties"][name]["properties"].items():
            flat = np.ravel(np.array(found[name][field], dtype=object)).tolist()
            numbers = [value for value in flat if isinstance(value, float)]
            texts = [f"{value!r}".split("e")[0].strip("-0.").replace(".", "") for value in numbers]
            longest[f"{name}.{field}"] = digits = max(map(len, texts), default=0)
            assert digits <= column.get("digits", 17), (name, field)
    assert longest["points.position"] > 12 and longest["stations.covariance"] > 12
    assert longest["plates.residual"] == 12


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("schema_version",), "1.0"),
        (("solution", "sigma0"), "1.0"),
        (("solution", "degrees_of_freedom"), 2.5),
        (("options", "refraction"), "SOME"),
        (("stations", "attitude", 0), [1.0, 2.0]),
        (("plates", "extra"), []),
        (("points", "point"), []),
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


def test_a_record_without_tables_of_images_has_all_else():
    statistics = Statistics(sample_solution())
    whole, some = (
        json.loads("".join(texts_of(statistics, content))) for content in (RecordContent.FULL, RecordContent.TABLES)
    )
    left_out = {"observations", "plates", "fiducial_measurements", "cross_measurements"}
    assert whole.keys() - some.keys() == left_out == whole.keys() - set(load_schema()["required"])
    assert whole | {"content": "tables"} == some | {name: whole[name] for name in left_out}


def test_every_field_of_the_schema_is_in_the_record():
    """The order too: that of the schema is that of the record."""
    solution = altered(sample_solution(), block={"settings": ("OPT.program=IIA",)})
    schema, found = load_schema(), record(solution)
    assert list(found) == list(schema["properties"])
    assert list(record(sample_solution())) == [name for name in found if name != "settings"]
    for name, entry in schema["properties"].items():
        if entry.get("columns"):
            assert list(found[name]) == list(entry["properties"]), name
        elif "properties" in entry.get("items", {}):
            assert list(found[name][0]) == list(entry["items"]["properties"]), name


def test_numbers_come_back():
    """Bit for bit, or to twelve digits."""
    solution = sample_solution()
    found = read_back(solution)
    for table, name, expected in (
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
        digits = load_schema()["properties"][table]["properties"][name].get("digits")
        tolerance = 0.0 if digits is None else 0.5 * 10.0 ** (1 - digits)
        values = np.array(found[table][name], dtype=float)
        np.testing.assert_allclose(values, expected, rtol=tolerance, atol=0.0, err_msg=name)
    assert found["solution"]["sigma0"] == solution.sigma0
    assert [row["rotation"] for row in found["iterations"]] == [i.rotation for i in solution.iterations]


def test_what_does_not_exist_is_null():
    found = read_back(dataclasses.replace(sample_solution(), sigma0=float("inf")))
    assert found["solution"]["sigma0"] is None
    assert found["points"]["position"][12] == [None, None, None]
    assert found["points"]["reason"][12] == "a single ray and no control"
    assert found["control"]["given_position"][0][2] is None
    assert found["distortion"]["values"][1][2] is None
    assert found["plate_statistics"]["frames"]["rms"][0][1] == [None, None]


def test_the_shipped_schema_is_that_of_the_tables():
    """`python tests/json_schema.py` makes it anew."""
    assert SCHEMA.read_text() == schema_text()


def test_the_manual_has_the_table_of_the_schema():
    """`python tests/json_schema.py` makes it anew."""
    text = MANUAL.read_text()
    assert with_table(text, load_schema()) == text
