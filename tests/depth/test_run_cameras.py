"""Stations of a correction from the record of a run."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from depth.lagoon import FOLDER as LAGOON
from musatpy.cli.main import main
from musatpy.depth.correction import Correction
from musatpy.depth.run_cameras import read_run
from musatpy.errors import DepthError
from musatpy.geometry.rotations import attitude_matrix
from musatpy.model import CoordinateSystem, Refraction
from musatpy.reports.record import dumps, record
from record_rows import with_columns, with_rows
from sample_solutions import sample_solution

INDEX = 1.3398


def lagoon_run() -> dict[str, Any]:
    """The record of a run in local coordinates, with the stations of the lagoon in place of its own."""
    run = with_rows(json.loads(dumps(record(sample_solution(CoordinateSystem.LOCAL, Refraction.WATPT)))))
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
    run["waves"] = []
    tides = [float(row["tide"]) for row in rows]
    run["adjusted_water"] |= {"tide": tides, "tilt": [0.0, 0.0], "index": INDEX}
    return dict(run)


def written(tmp_path: Path, run: Any) -> Path:
    path = tmp_path / "run.json"
    path.write_text(json.dumps(with_columns(run)))
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
        ("options", {"system": "GEOG"}, "a GEOG job needs an ellipsoid"),
        ("options", {"initial": "COMPUTE"}, "the water of the run is tilted, about a place that is known where"),
        ("adjusted_water", {"index": 1.45}, "1.45 is not within 1.3 to 1.4, as that of water is"),
        ("adjusted_water", {"tide": [None, 0.3, None, *[0.2] * 5]}, "no tide of photo 101, 103$"),
        ("adjusted_water", {"tide": [2000.0] * 8}, "station 1 is not above the water"),
    ],
)
def test_a_run_that_cannot_be_used_says_why(
    tmp_path: Path, table: str, changes: dict[str, Any], message: str
) -> None:
    run = lagoon_run()
    run["adjusted_water"]["tilt"] = [1e-4, 0.0]
    run[table] |= changes
    with pytest.raises(DepthError, match=message):
        read_run(written(tmp_path, run))


@pytest.mark.parametrize(
    ("table", "value", "message"),
    [
        ("adjusted_water", None, "the run knows no water"),
        ("waves", [{"wave": "1"}], "the water of the run has waves, here it is still"),
    ],
)
def test_water_that_is_not_still_is_said(tmp_path: Path, table: str, value: Any, message: str) -> None:
    with pytest.raises(DepthError, match=message):
        read_run(written(tmp_path, lagoon_run() | {table: value}))


def test_tilted_water_is_level_water_turned(tmp_path: Path) -> None:
    """The lagoon with all that is in it turned by some milliradians: true points are the turned ones."""
    run, turn = lagoon_run(), Rotation.from_rotvec([2e-3, -3e-3, 0.0]).as_matrix()
    given = np.array([row["position"] for row in run["stations"]])
    normal = turn[:, 2]
    pivot = np.rint((given @ turn.T).mean(axis=0))  # the adjustment tilts water about the stations, to a metre
    for row, place in zip(run["stations"], given @ turn.T, strict=True):
        row["position"], row["given_position"] = place.tolist(), place.tolist()
        row["attitude"] = (
            Rotation.from_matrix((attitude_matrix(np.array(row["attitude"])) @ turn.T).T).as_euler("XYZ").tolist()
        )
    water = run["adjusted_water"]
    water["tilt"] = (-normal[:2] / normal[2]).tolist()
    water["tide"] = [(tide - normal[:2] @ pivot[:2]) / normal[2] for tide in water["tide"]]
    cameras = read_run(written(tmp_path, run))
    level = Correction(cameras=read_run(written(tmp_path, lagoon_run())), index=INDEX)
    with (LAGOON / "points.csv").open(newline="") as file:
        apparent = np.array([[float(row[axis]) for axis in "xyz"] for row in csv.DictReader(file)])
    found, seen = Correction(cameras=cameras, index=INDEX)(apparent @ turn.T)
    wanted, seen_level = level(apparent)
    np.testing.assert_array_equal(seen, seen_level)
    np.testing.assert_array_equal(found.fault, wanted.fault)
    # a level counts along the normal as it does along the vertical: 1e-5 of a tide of 4 m at the pivot
    np.testing.assert_allclose(found.position, wanted.position @ turn.T, atol=1e-4)
    np.testing.assert_allclose(found.depth, wanted.depth, rtol=1e-5)  # along the vertical, and across the water


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"program": 5}', "\xff"])
def test_a_file_that_is_no_record(tmp_path: Path, text: str) -> None:
    path = tmp_path / "run.json"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(DepthError, match=r"is not the record of a run|is no JSON"):
        read_run(path)
