"""Stations of a correction from the record of a run."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from depth.lagoon import FOLDER as LAGOON
from musatpy.cli.main import main
from musatpy.depth.run_cameras import read_run
from musatpy.errors import DepthError
from musatpy.model import CoordinateSystem, Refraction
from musatpy.reports.record import dumps, record
from sample_solutions import sample_solution

INDEX = 1.3398


def lagoon_run() -> dict[str, Any]:
    """The record of a run in local coordinates, with the stations of the lagoon in place of its own."""
    run = json.loads(dumps(record(sample_solution(CoordinateSystem.LOCAL, Refraction.WATPT))))
    with (LAGOON / "cameras.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    run["solution"]["converged"] = True
    run["cameras"] = [run["cameras"][0] | {"camera": "RC8", "focal_length": 152.4, "format_size": [228.6, 228.6]}]
    run["stations"] = [
        run["stations"][0]
        | {
            "photo": row["name"],
            "camera": "RC8",
            "position": [float(row[axis]) for axis in "xyz"],
            "attitude": np.radians([float(row[angle]) for angle in ("omega", "phi", "kappa")]).tolist(),
        }
        for row in rows
    ]
    tides = [float(row["tide"]) for row in rows]
    run["adjusted_water"] |= {"tide": tides, "tilt": [0.0, 0.0], "index": INDEX}
    return dict(run)


def written(tmp_path: Path, run: Any) -> Path:
    path = tmp_path / "run.json"
    path.write_text(json.dumps(run))
    return path


def test_a_run_corrects_as_the_file_of_its_stations(tmp_path: Path) -> None:
    """The index is that of the run too, unless another is given."""
    run = written(tmp_path, lagoon_run())
    stations = ("--focal", "152.4", "--format", "228.6,228.6", "--index", str(INDEX))
    sources = {"run": (str(run),), "csv": (str(LAGOON / "cameras.csv"), *stations)}
    for name, source in sources.items():
        arguments = [
            "depth",
            "correct",
            str(LAGOON / "points.csv"),
            "-o",
            str(tmp_path / f"{name}.csv"),
            "--jobs",
            "1",
        ]
        result = CliRunner().invoke(main, [*arguments, "--cameras", *source])
        assert result.exit_code == 0, result.output
    assert (tmp_path / "run.csv").read_bytes() == (tmp_path / "csv.csv").read_bytes()
    table = CliRunner().invoke(main, ["depth", "table", "--cameras", str(run), "--depths", "5"])
    assert table.output.startswith("8 stations, n = 1.33980, by rays")
    other = CliRunner().invoke(main, ["depth", "table", "--cameras", str(run), "--index", "1.33", "--depths", "5"])
    assert other.output.startswith("8 stations, n = 1.33000, by rays")


def test_a_camera_without_format_gets_that_of_the_options(tmp_path: Path) -> None:
    run = lagoon_run()
    run["cameras"][0]["format_size"] = [None, None]
    assert read_run(written(tmp_path, run)).camera is None
    found = read_run(written(tmp_path, run), camera=(150.0, 230.0, 230.0)).camera
    assert found is not None
    np.testing.assert_array_equal(found, np.tile([152.4, 230.0, 230.0], (8, 1)))


@pytest.mark.parametrize(
    ("table", "changes", "message"),
    [
        ("program", {"name": "other"}, r'program.name: expected "musatpy", found "other"'),
        ("solution", {"converged": False}, "the run has not converged"),
        ("options", {"system": "GEOG"}, r"not in local rectangular coordinates \(LOCL\)"),
        ("adjusted_water", {"tilt": [1e-4, 0.0]}, "the water of the run is tilted"),
        ("adjusted_water", {"tide": [None] * 8}, "a photo has no tide"),
        ("adjusted_water", {"tide": [2000.0] * 8}, "station 1 is not above the water"),
    ],
)
def test_a_run_that_cannot_be_used_says_why(
    tmp_path: Path, table: str, changes: dict[str, Any], message: str
) -> None:
    run = lagoon_run()
    run[table] |= changes
    with pytest.raises(DepthError, match=message):
        read_run(written(tmp_path, run))


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"program": 5}', "\xff"])
def test_a_file_that_is_no_record(tmp_path: Path, text: str) -> None:
    path = tmp_path / "run.json"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(DepthError, match=r"is not the record of a run|is no JSON"):
        read_run(path)
