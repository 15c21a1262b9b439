"""Records read from JSON, by rows or columns, and their tables of images."""

import copy
import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli.commands import musat
from json_schema import load_schema, violations
from musatpy import adjust, read_deck
from musatpy.comparison import OPTIONAL, TABLES
from musatpy.errors import RecordError
from musatpy.model import RecordContent, Solution
from musatpy.records import inquiry
from musatpy.records.json_files import FIELDS, are_apart, read_json, read_record, with_images
from musatpy.records.tables import array_of
from musatpy.reports.record import dumps, record, record_of
from musatpy.runs import run_deck
from musatpy.statistics import Statistics

ROOT = Path(__file__).parents[2]


DECKS = ("st_thomas/st_thomas.crd", "cayman/cayman_modified.crd")  # the latter with plates that took no part


@cache
def solution(deck: str) -> Solution:
    return adjust(read_deck(ROOT / "fixtures" / deck))


@cache
def written(deck: str = DECKS[0]) -> str:
    return dumps(record(solution(deck)))


@pytest.fixture
def run() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(written())
    return found


def problems(tmp_path: Path, run: Any, needs: Iterable[str] = TABLES) -> list[str]:
    path = tmp_path / "RUN.json"
    path.write_bytes(run if isinstance(run, bytes) else (run if isinstance(run, str) else json.dumps(run)).encode())
    with pytest.raises(RecordError) as caught:
        read_record(path, needs, OPTIONAL)
    return [str(problem).removeprefix(f"{path}").lstrip(" :") for problem in caught.value.problems]


def test_a_record_is_read_whole_or_as_far_as_it_is_asked_for(tmp_path: Path, run: dict[str, Any]) -> None:
    path = tmp_path / "RUN.json"
    path.write_text(json.dumps(run))
    assert read_record(path, run) == with_images(run)
    some = read_record(path, ("options", "points"))
    assert some == {"options": run["options"], "points": run["points"]}


def test_an_image_without_redundancy_has_no_estimated_error(run: dict[str, Any]) -> None:
    whole = with_images(run)["observations"]["estimated_error"]
    assert whole[0] is not None
    run["plates"]["redundancy"][0][0] = 0.0
    assert with_images(run)["observations"]["estimated_error"] == [None, *whole[1:]]


@pytest.mark.parametrize("strange", [[], None])
def test_columns_that_the_schema_does_not_know_have_the_rows_of_their_table(
    tmp_path: Path, run: dict[str, Any], strange: object
) -> None:
    path, table = tmp_path / "RUN.json", run["bathymetric_points"]
    path.write_text(json.dumps({**run, "bathymetric_points": {**table, "strange": strange}}))
    for arguments in (("explain", "206", path), ("report", path, "-o", tmp_path / "run.html")):
        result = musat(*arguments)
        assert result.exit_code == 1
        assert "bathymetric_points: has columns of 0 and of 8 entries" in result.output


@pytest.mark.parametrize("version", ["4.0", "2.0"])
def test_other_schemas_are_refused(tmp_path: Path, run: dict[str, Any], version: str) -> None:
    run["schema_version"] = version
    told = f"schema_version: is a record of schema {version}, and this program reads 3.0; run the deck again"
    assert problems(tmp_path, run) == [told]


def test_a_table_that_was_left_out_is_told(tmp_path: Path) -> None:
    run_deck(ROOT / "fixtures/st_thomas/st_thomas.crd", tmp_path, record=RecordContent.TABLES)
    path = tmp_path / "st_thomas.json"
    run = json.loads(path.read_text())
    assert run["content"] == "tables" and "plates" not in run and "observations" not in run
    assert problems(tmp_path, run, ("plates", "points")) == [
        "plates: is missing: the record was written with --record tables"
    ]
    assert read_record(path, TABLES, OPTIONAL).keys() == {*TABLES, *OPTIONAL} - {"plates"}
    assert musat("compare", path, path).exit_code == 0
    schema = load_schema()
    assert not list(violations(run, schema, schema))


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("stations", "position", 2), [1.0, 2.0], "stations.position[2]: expected 3 numbers, found 2"),
        (("stations", "position", 2, 1), "x", 'stations.position[2][1]: expected a number, found "x"'),
        (("stations", "position", 2, 1), True, "stations.position[2][1]: expected a number, found true"),
        (("points", "position", 0, 1), 10**400, "points.position[0][1]: expected a number or null, found 1000"),
        (("points", "bathymetric", 3), 1, "points.bathymetric[3]: expected true or false, found 1"),
        (("stations",), [], "stations: expected a table, found a list"),
        (("stations", "photo"), 7, "stations.photo: expected a list, found 7"),
        (("stations", "photo"), ["a", "b"], "stations: has columns of 2 and of 3 entries"),
        (("options", "system"), "XYZ", 'options.system: expected "GEOG" or "GEOC" or "LOCL", found "XYZ"'),
        (("schema_version",), 1.6, "is not the record of a run"),
    ],
)
def test_what_is_not_as_the_schema_says(
    tmp_path: Path, run: dict[str, Any], place: tuple[str | int, ...], value: Any, message: str
) -> None:
    spoilt: Any = copy.deepcopy(run)
    *path, last = place
    inner = spoilt
    for key in path:
        inner = inner[key]
    inner[last] = value
    (found,) = problems(tmp_path, spoilt, {*TABLES, *inquiry.TABLES})
    assert found.startswith(message)


def test_every_missing_field_is_named(tmp_path: Path, run: dict[str, Any]) -> None:
    del run["stations"]["attitude"], run["control"]
    assert problems(tmp_path, run) == ["stations.attitude: is missing", "control: is missing"]
    run["stations"]["photo"] = [None] * 1000
    assert len(problems(tmp_path, run)) == 20


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no JSON: Expecting value"),
        ("[" * 100_000, "is nested too deep"),
        ('{"schema_version": NaN}', "is no JSON: NaN is no finite number"),
        ("[1]", "is not the record of a run"),
        ("1" * 5000, "is no JSON: Exceeds the limit"),
        (b'{"a": "\xe2\x82', "is no JSON: byte 8 is none of a text in UTF-8"),
    ],
)
def test_what_is_no_record(tmp_path: Path, text: str | bytes, message: str) -> None:
    (found,) = problems(tmp_path, text)
    assert found.startswith(message)


@pytest.mark.parametrize("number", ["1e999", "-1e400", "1" * 400, "Infinity"])
def test_numbers_beyond_reach(tmp_path: Path, run: dict[str, Any], number: str) -> None:
    run["stations"]["position"][0][0] = "HERE"
    text = json.dumps(run).replace('"HERE"', number)
    assert len(problems(tmp_path, text)) == 1
    (path := tmp_path / "surface.json").write_text(f"[{number}]")
    with pytest.raises(RecordError, match="no finite number"):
        read_json(path)


@pytest.mark.parametrize(
    ("command", "table", "field", "status"),
    [
        ("compare {0} {0}", "stations", "position", 1),
        ("depth table --cameras {0}", "stations", "position", 1),
        ("audit {1} --against {0}", "bathymetric_points", "predicted", 2),
    ],
)
def test_commands_name_the_place(
    tmp_path: Path, run: dict[str, Any], command: str, table: str, field: str, status: int
) -> None:
    path, listing = tmp_path / "RUN.json", ROOT / "fixtures/st_thomas/st_thomas.lst"
    run[table][field][1] = [0.0]
    path.write_text(json.dumps(run))
    result = musat(*command.format(path, listing).split())
    assert result.exit_code == status
    assert f"{path} {table}.{field}[1]: expected 3 numbers, found 1" in result.stderr


IMAGE_TABLES = ("observations", "plates")


def as_numbers(column):
    return np.array(column, dtype=float)


@pytest.mark.parametrize("deck", DECKS)
def test_what_is_read_of_a_file_is_what_the_solution_has(tmp_path, deck):
    path = tmp_path / "run.json"
    path.write_text(written(deck))
    assert are_apart(json.loads(written(deck)))
    found, whole = read_record(path, IMAGE_TABLES), record_of(Statistics(solution(deck)), IMAGE_TABLES)
    assert found["plates"] == json.loads(json.dumps(whole["plates"]))
    given, back = whole["observations"], found["observations"]
    assert list(back) == list(given)
    for name in ("kind", "of", "component", "residual", "sigma"):
        assert back[name] == given[name]
    for name in (*FIELDS, "test", "estimated_error"):
        np.testing.assert_allclose(as_numbers(back[name]), as_numbers(given[name]), rtol=1e-9, atol=0.0)


def test_a_file_says_an_image_once(run):
    assert "plate" not in run["observations"]["kind"]
    assert [pair != [None, None] for pair in run["plates"]["redundancy"]] == run["plates"]["triangulated"]


def test_a_record_that_has_them_in_one_table_says_the_same(tmp_path, run):
    content = with_images(run)
    assert not are_apart(content)
    path = tmp_path / "earlier.json"
    path.write_text(dumps(content))
    assert read_record(path, IMAGE_TABLES) == {name: content[name] for name in IMAGE_TABLES}


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (lambda run: run["plates"].pop("effect"), "plates.effect"),
        (lambda run: run["plates"].update(standardised=[1.0] * len(run["plates"]["photo"])), "plates"),
        (lambda run: run["plates"].update(redundancy=run["plates"]["redundancy"][:-1]), "plates"),
        (lambda run: run["solution"].update(unit_sigma="large"), "solution.unit_sigma"),
    ],
)
def test_tables_that_are_wrong_are_told(tmp_path, run, change, where):
    change(run)
    assert any(where in text for text in problems(tmp_path, run, IMAGE_TABLES))


def test_columns_are_arrays_of_a_shape_whether_they_are_nested_or_flat() -> None:
    """Covariances of water levels stand in a row, positions in triples; null is unknown in all components."""
    np.testing.assert_array_equal(array_of([1.0, 2.0, 3.0, 4.0], 2), [[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_array_equal(array_of([[1.0, None], None], 2), [[1.0, np.nan], [np.nan, np.nan]])
