"""The spec file: every key is checked, every problem is reported at once, and the manual lists every key."""

import re
import tomllib
from pathlib import Path

import pytest

from cli.commands import musat
from musatpy.errors import SpecError
from musatpy.simulation import load_spec, simulate, spec_from_table, truth_record
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.specs import key_tables

COLD = {"conditions": {"temperature": 12.0, "salinity": 35.0}}
DOCS = Path(__file__).parents[2] / "docs"


def problems_of(table):
    with pytest.raises(SpecError) as caught:
        spec_from_table(table, "block.toml")
    return {problem.field: problem.message for problem in caught.value.problems}


def conditions(**keys):
    return {"water": {"conditions": keys}}


def test_every_problem_is_reported_at_once():
    found = problems_of(
        {
            "sed": 5,
            "flight": {"photos": "three", "forward_overlap": 1.2, "hight": 3.0},
            "control": [{"kind": "total", "number": 3, "sigma": 1.0}, {"number": 2}],
            "stations": {"position_error": [1.0, 2.0]},
            "camera": 152.0,
        }
    )
    assert found["sed"].startswith("is no key here; there are title, seed,")
    assert "is no key here" in found["flight.hight"]
    assert found["flight.photos"] == "a whole number is expected, not 'three'"
    assert found["flight.forward_overlap"] == "1.2 is above 0.95"
    assert "not one of full" in found["control[1].kind"]
    assert found["control[2].kind"] == "is missing: what is known"
    assert found["stations.position_error"] == "3 values are expected, not 2"
    assert found["camera"] == "a table is expected, not 152.0"


@pytest.mark.parametrize(
    ("table", "what"),
    [
        ({"shoal": [{}]}, r"need a \[water\] table"),
        ({"water": {"tides": [0.1, 0.2]}}, "2 values, not one per photo"),
        ({"point": [{"id": "1", "local": [0.0, 0.0, 0.0]}]}, "GEOG job needs geographic or geocentric"),
        ({"control": [{"kind": "full", "sigma": 1.0}]}, "one of number, ids, points"),
        ({"control": [{"kind": "full", "number": 1}]}, "needs a sigma above zero"),
        (
            {"control": [{"kind": "full", "number": 1, "sigma": 1.0, "correlation": [0.9, -0.9, 0.9]}]},
            "no positive definite matrix, smallest eigenvalue -0.8",
        ),
        (
            {"control": [{"kind": "vertical", "number": 1, "sigma": 1.0, "correlation": 0.1}]},
            "correlation is for full control that is not fixed",
        ),
        ({"antenna": {"correlation": [0.9, -0.9, 0.9]}}, "antenna: correlation: no positive definite matrix"),
        ({"flight": {"strips": 2, "photos": 30, "strip_step": 20}}, "ids would repeat"),
        ({"job": {"centre": [91.0, 0.0]}}, "latitude within 89"),
        ({"blunders": {"number": 1, "share": 0.1}}, "not both"),
        ({"blunders": {"size": [5.0, 1.0]}}, "least, then the greatest"),
        ({"measurement": {"noise": float("nan")}}, "finite"),
        ({"title": ["T" * 69]}, "has not 1 to 68 characters"),
        (
            {"water": {"index": 1.2, "liquid": "ICE", "index_error": -0.3}},
            "water: on the card: a refractive index of 0.9",
        ),
        (
            {"water": {"index": 1.42}},
            "not within 1.3 to 1.4, as that of water is; another liquid is to be named by the key",
        ),
        ({"water": {"index": 1.38, "index_error": 0.05}}, "water: on the card: a refractive index of 1.43"),
        (conditions(temperature=31.0, salinity=35.0), "31 degrees Celsius: the formula quan-fry holds for 0 to 30"),
        ({"water": {"index": 1.333} | COLD}, "water: the index is given by its conditions"),
        ({"water": {"tilt": [0.0, 4000.0]}}, "water.tilt: 4000.0 is above 3600"),
        ({"blunders": {"log": True, "size": [0.0, 5.0]}}, "blunders: log needs a least size above zero"),
        (
            {"blunders": {"control": [{"number": 1, "component": "vertical", "size": [5.0, 1.0]}]}},
            r"blunders.control\[1\]: size is the least",
        ),
        ({"distance": [{"points": ["1", "1"]}]}, r"distance\[1\]: points are two different ones"),
        ({"options": {"water_tilt": "FREE"}}, "options.water_tilt: 'FREE' is not one of KNOWN, ADJUST"),
    ],
)
def test_contradictions_are_refused(table, what):
    with pytest.raises(SpecError, match=what):
        spec_from_table(table)


def test_extends_merges_tables_and_replaces_lists(tmp_path):
    spec = spec_from_table({"stations": {"position_error": 5}})  # one number stands for three
    assert spec.stations.position_error == (5.0, 5.0, 5.0)
    assert (spec.flight.strips, spec.flight.photos, spec.job.system, spec.water) == (1, 3, "GEOG", None)
    (tmp_path / "base.toml").write_text('title = ["A", "B"]\nseed = 3\n[flight]\nphotos = 7\nheight = 900.0\n')
    (tmp_path / "more.toml").write_text('extends = "base.toml"\ntitle = ["C"]\n[flight]\nheight = 800.0\n')
    spec = load_spec(tmp_path / "more.toml")
    assert (spec.title, spec.seed, spec.flight.photos, spec.flight.height) == (("C",), 3, 7, 800.0)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ('extends = "spec.toml"\n', "circle"),
        ("extends = 5\n", "another file"),
        ('extends = "nowhere.toml"\n', "No such file"),
        ("seed = \n", "cannot be read"),
    ],
)
def test_files_that_cannot_be_read_are_named(tmp_path, text, what):
    (tmp_path / "spec.toml").write_text(text)
    with pytest.raises(SpecError, match=what) as caught:
        load_spec(tmp_path / "spec.toml")
    assert str(tmp_path) in str(caught.value)


def test_examples_of_the_manual_run_and_it_has_all_tables():
    text = (DOCS / "simulation.md").read_text(encoding="utf-8")
    tables = re.findall(r"^### (`\[.*\]`)$", key_tables(SimulationSpec), re.MULTILINE)
    assert len(tables) > 20 and not [table for table in tables if table not in text]
    examples = [part.partition("```")[0] for part in text.split("```toml\n")[1:]]
    tables, errors = (tomllib.loads(example) for example in examples)
    besides = {name: tables.get(name, {}) | table for name, table in errors.items()}
    first, wrong = (simulate(spec_from_table(spec)) for spec in (tables, tables | besides))
    assert first.block.points.bathymetric.any() and len(first.block.control.point) == 8
    record = truth_record(wrong)
    assert {"water", "tides", "swapped", "misnamed", "wrong_control"} <= set(record) and record["blunders"]


def test_the_keys_of_a_spec_at_the_shell():
    result = musat("simulate", "--keys")
    assert result.exit_code == 0 and result.output == key_tables(SimulationSpec)
    waves = musat("waves", "--keys")
    assert "- `cameras` ([2 x [3 numbers]], m; required): stations of the left" in waves.output
    assert "- `least_count` (number, um; `0.001`): plate coordinates are rounded to this\n" in result.output
