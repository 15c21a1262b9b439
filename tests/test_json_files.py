"""JSON files: what is refused of a record before anything is read of it, with the place where it stands."""

from __future__ import annotations

import copy
import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from musatpy.cli.main import main
from musatpy.comparison import NEEDS, OPTIONAL
from musatpy.errors import RecordError
from musatpy.json_files import read_json, read_record
from musatpy.runs import run_deck

ROOT = Path(__file__).parents[1]


@cache
def _text() -> str:
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        result = run_deck(ROOT / "fixtures/st_thomas/st_thomas.crd", folder)
        assert result.record is not None
        return result.record.read_text()


@pytest.fixture
def run() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(_text())
    return found


def problems(tmp_path: Path, run: Any) -> list[str]:
    path = tmp_path / "RUN.json"
    path.write_text(run if isinstance(run, str) else json.dumps(run))
    with pytest.raises(RecordError) as caught:
        read_record(path, NEEDS, OPTIONAL)
    return [str(problem).removeprefix(f"{path}").lstrip(" :") for problem in caught.value.problems]


def test_a_record_of_ours_is_read_whole(tmp_path: Path, run: dict[str, Any]) -> None:
    path = tmp_path / "RUN.json"
    path.write_text(json.dumps(run))
    whole = {name: () for name in run if name != "schema_version"}
    assert read_record(path, whole) == run


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("stations", 2, "position"), [1.0, 2.0], "stations[2].position: expected 3 numbers, found 2"),
        (("stations", 2, "position", 1), "x", 'stations[2].position[1]: expected a number, found "x"'),
        (("stations", 2, "position", 1), None, "stations[2].position[1]: expected a number, found null"),
        (("stations", 2, "position", 1), True, "stations[2].position[1]: expected a number, found true"),
        (("points", 0, "position", 1), 10**400, "points[0].position[1]: expected a number or null, found 1000"),
        (("points", 3, "bathymetric"), 1, "points[3].bathymetric: expected true or false, found 1"),
        (("stations",), {}, "stations: expected a list, found a table"),
        (("stations", 0), 7, "stations[0]: expected a table, found 7"),
        (("options", "system"), "XYZ", 'options.system: expected "GEOG" or "GEOC" or "LOCL", found "XYZ"'),
        (("schema_version",), "2.0", "schema_version: is a record of schema 2.0, and this program reads 1."),
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
    (found,) = problems(tmp_path, spoilt)
    assert found.startswith(message)


def test_every_missing_field_is_named(tmp_path: Path, run: dict[str, Any]) -> None:
    del run["stations"][1]["attitude"], run["plates"]
    assert problems(tmp_path, run) == ["stations[1].attitude: is missing", "plates: is missing"]
    run["stations"] = [{}] * 1000
    assert len(problems(tmp_path, run)) == 20


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no JSON: Expecting value"),
        ("[" * 100_000, "is nested too deep"),
        ('{"a":' * 100_000, "is nested too deep"),
        ('{"schema_version": NaN}', "is no JSON: NaN is no finite number"),
        ("[1]", "is not the record of a run"),
        ("1" * 5000, "is no JSON: Exceeds the limit"),
    ],
)
def test_what_is_no_record(tmp_path: Path, text: str, message: str) -> None:
    (found,) = problems(tmp_path, text)
    assert found.startswith(message)


def test_bytes_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    path.write_bytes(b'{"a": "\xe2\x82')
    with pytest.raises(RecordError, match=r"is no JSON: byte 8 is none of a text in UTF-8"):
        read_json(path)


@pytest.mark.parametrize("number", ["1e999", "-1e400", "1" * 400, "Infinity"])
def test_numbers_beyond_reach(tmp_path: Path, run: dict[str, Any], number: str) -> None:
    run["stations"][0]["position"][0] = "HERE"
    text = json.dumps(run).replace('"HERE"', number)
    assert len(problems(tmp_path, text)) == 1
    (path := tmp_path / "surface.json").write_text(f"[{number}]")
    with pytest.raises(RecordError, match="no finite number"):
        read_json(path)


@pytest.mark.parametrize("command", ["compare {0} {0}", "audit {1} --against {0}", "depth table --cameras {0}"])
def test_commands_name_the_place(tmp_path: Path, run: dict[str, Any], command: str) -> None:
    path, listing = tmp_path / "RUN.json", ROOT / "fixtures/st_thomas/st_thomas.lst"
    run["stations"][1]["position"] = [0.0]
    path.write_text(json.dumps(run))
    result = CliRunner().invoke(main, command.format(path, listing).split())
    assert result.exit_code == (2 if "audit" in command else 1)
    assert f"{path} stations[1].position: expected 3 numbers, found 1" in result.stderr
