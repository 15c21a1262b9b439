"""Numbers, texts and nesting beyond all reason end as problems of their place, before anything is computed."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
from click.testing import CliRunner

from musatpy.cli.main import main
from musatpy.interchange import xyz
from musatpy.pointfiles.csv_tables import number
from musatpy.specs import Reader, key, read_toml

ROOT = Path(__file__).parents[1]
DEEP = "[" * 100_000


@dataclass(frozen=True)
class Spec:
    length: float = key(1.0)


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e308", math.inf), ("-1e16", -math.inf), ("1e-320", 0.0), ("1e15", 1e15), ("-2.5", -2.5), ("1e-12", 1e-12)],
)
def test_numbers_of_files_are_within_reach(text: str, value: float) -> None:
    assert number(text) == value


@pytest.mark.parametrize("value", [10**400, 1e16, -1e308])
def test_numbers_of_specs_are_within_reach(value: float) -> None:
    reader = Reader("s.toml")
    assert reader.table(Spec, {"length": value}, "") is None
    (problem,) = reader.problems
    assert "is beyond 1e+15" in str(problem) and len(str(problem)) < 80


@pytest.mark.parametrize("text", [f"a = {DEEP}", "a = " + "1" * 5000, "a = "])
def test_toml_that_cannot_be_read_is_a_value_error(tmp_path: Path, text: str) -> None:
    (path := tmp_path / "a.toml").write_text(text)
    with pytest.raises(ValueError, match=r"nested too deep|Exceeds the limit|Invalid value"):
        read_toml(path)


@pytest.mark.parametrize(
    "command",
    [
        "simulate {}", "waves {}", "batch {}", "diff --rules {} {lst} {lst}", "check --formats {folder} {crd}",
        "convert --formats {folder} {crd} x",
    ],
)  # fmt: skip
def test_deep_nesting_is_a_problem_of_the_file(tmp_path: Path, command: str) -> None:
    (path := tmp_path / "deep.toml").write_text(f"a = {DEEP}")
    thomas = ROOT / "fixtures/st_thomas/st_thomas"
    words = command.format(path, lst=f"{thomas}.lst", crd=f"{thomas}.crd", folder=tmp_path).split()
    ran = CliRunner().invoke(main, words)
    assert ran.exit_code in (1, 2) and "nested too deep" in ran.stderr and "unexpected" not in ran.stderr


@pytest.mark.parametrize("text", ["a.b." * 10_000 + "c = 1", "b = 1.5\n[" + "'a' . " * 20_000 + "c]"])
def test_a_key_of_many_parts_is_refused_before_it_is_taken_apart(tmp_path: Path, text: str) -> None:
    """Its parser keeps all beginnings of a key: those of 20,000 parts take 1.6 GB."""
    (path := tmp_path / "a.toml").write_text(text)
    line = text.count("\n") + 1
    with pytest.raises(ValueError, match=rf"nested too deep: a key of more than 100 parts \(at line {line}\)"):
        read_toml(path)
    path.write_text("a" + ".a" * 99 + " = [" + "1.5, 2.5, " * 500 + "]")
    assert read_toml(path)["a"]["a"]


def test_a_head_of_brackets_takes_no_time(tmp_path: Path) -> None:
    (path := tmp_path / "a.csv").write_text("x,y,z," + "[" * 200_000 + "\n1,2,3,4\n")
    start = time.process_time()
    assert len(xyz.read(path).xyz) == 1
    assert time.process_time() - start < 2.0  # half an hour where all are tried against all
    path.write_text("x,y,z,depth [m]\n1,2,3,4\n")
    assert xyz.read(path).columns["depth"].unit == "m"


def test_a_field_of_any_size_is_a_problem_of_its_line(tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    points.write_text("id,x,y,z\nA,1,2," + "9" * 200_000 + "\n")
    ran = CliRunner().invoke(main, ["sea", "fit", str(points), "--sigma", "1,1,1"])
    assert ran.exit_code == 1 and f"{points}:2" in ran.stderr
