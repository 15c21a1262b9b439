"""The examples that are written to begin with."""

from __future__ import annotations

from pathlib import Path

import pytest

from cli.commands import musat
from musatpy.examples import examples

FIXTURES = Path(__file__).parents[1] / "fixtures"


def test_every_example_is_of_files_that_are_there_and_of_commands():
    assert list(examples()) == ["st_thomas", "cayman", "lagoon"]
    for example in examples().values():
        assert all((FIXTURES / file).is_file() for file in example.files)
        assert len(example.contents()) == len(example.files)  # no two of one name
        assert all(command.startswith("musat ") for command in example.commands)


def test_an_example_is_the_fixture(tmp_path):
    ran = musat("example", "st_thomas", "-o", tmp_path / "job")
    assert ran.exit_code == 0
    assert f"  cd {tmp_path / 'job'}\n  musat check st_thomas.crd\n" in ran.stdout
    deck = FIXTURES / "st_thomas/st_thomas.crd"
    assert (tmp_path / "job/st_thomas.crd").read_bytes() == deck.read_bytes()
    assert not list((tmp_path / "job").glob("*.lst"))
    assert musat("example", "st_thomas", "-o", tmp_path / "job").exit_code == 0  # as it is already


def test_a_name_with_blanks_can_be_copied(tmp_path):
    assert f"cd '{tmp_path / 'a job'}'" in musat("example", "lagoon", "-o", tmp_path / "a job").stdout


def test_another_file_of_the_name_stays(tmp_path):
    (tmp_path / "points.csv").write_text("mine")
    ran = musat("example", "lagoon", "-o", tmp_path)
    assert ran.exit_code == 1
    assert "points.csv is there already and is not that of the example; nothing is written" in ran.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["points.csv"]
    assert (tmp_path / "points.csv").read_text() == "mine"


def test_the_examples_are_listed():
    ran = musat("example")
    assert ran.exit_code == 0
    assert ran.stdout.startswith("st_thomas  three photos over a shore, eight points under water")


@pytest.mark.parametrize(("name", "meant"), [("caymann", "did you mean cayman?"), ("xyz", "there are st_thomas, ")])
def test_a_wrong_name_is_a_wrong_command_line(name, meant, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = musat("example", name)
    assert ran.exit_code == 2 and f"no example '{name}'; {meant}" in ran.stderr
    assert not list(tmp_path.iterdir())
