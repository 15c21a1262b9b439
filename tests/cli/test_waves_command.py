"""`musat waves`: what it writes, says, and refuses."""

from pathlib import Path

import pytest

from cli.commands import musat

SPEC = """
title = "SWELL"
[stereo]
cameras = [[0.0, 0.0, 490.0], [264.0, 0.0, 490.0]]
[water]
depth = 10.0
[[wave]]
period = 10.0
deep_height = 0.1
[area]
first = [0.0, -300.0]
spacing = [100.0, 100.0]
numbers = [4, 7]
"""


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "swell.toml"
    path.write_text(SPEC)
    return path


def test_report_and_points_are_written(spec: Path) -> None:
    result = musat("waves", spec, "-o", spec.parent / "out")
    assert result.exit_code == 0, result.output
    assert result.output.splitlines()[-1].endswith("accuracy kept")
    assert sorted(path.name for path in (spec.parent / "out").iterdir()) == ["swell.waves.csv", "swell.waves.txt"]
    assert (spec.parent / "out" / "swell.waves.txt").read_text().startswith("SWELL\n")
    again = musat("waves", spec)
    assert again.exit_code == 0
    for name in ("swell.waves.csv", "swell.waves.txt"):
        assert (spec.parent / name).read_bytes() == (spec.parent / "out" / name).read_bytes()


def test_what_is_exceeded_is_said(spec: Path) -> None:
    spec.write_text(SPEC.replace("deep_height = 0.1", "deep_height = 1.5"))
    assert musat("waves", spec).output.rstrip().endswith("accuracy exceeded")


@pytest.mark.slow
def test_pictures_are_written_on_request(spec: Path) -> None:
    spec.write_text(SPEC + "[study]\ndepths = [5, 10]\n")
    assert musat("waves", spec, "--plots").exit_code == 0
    for name in ("map", "histogram", "dependence"):
        assert (spec.parent / f"swell.{name}.png").read_bytes().startswith(b"\x89PNG")


def test_a_bad_spec_is_an_error(spec: Path) -> None:
    spec.write_text(SPEC.replace("depth", "deep"))
    result = musat("waves", spec)
    assert result.exit_code == 1
    assert "swell.toml water.depth: is missing" in result.output and "water.deep: is no key here" in result.output


def test_the_spec_is_not_overwritten(tmp_path: Path) -> None:
    spec = tmp_path / "swell.waves.txt"
    spec.write_text(SPEC)
    (tmp_path / "swell").symlink_to(spec)
    result = musat("waves", tmp_path / "swell")
    assert result.exit_code == 2 and "the result would overwrite" in result.output
    assert spec.read_text() == SPEC
