"""The pair of fixtures/sea on the ellipsoid: surface and true points are those of the local job."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from depth import restated
from depth.test_restated import run_on_the_ellipsoid
from musatpy.cli.main import main
from musatpy.geometry.intersection import nearest_point
from musatpy.refraction import fermat
from musatpy.sea.stereo.surface_file import load_surface
from record_rows import with_columns
from sea_fixtures import SEA, SHIFT

INDEX = 1.34
# Waves are laid on a map about the middle of their points, true points along the verticals; points are written to
# 1e-9 degrees or 0.1 mm, and the fitted surface of 1e-4 m more or less is the same for both ways
NEAR = 1e-3


def musat(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def table(name: str) -> tuple[list[str], np.ndarray]:
    with (SEA / name).open(newline="") as file:
        rows = list(csv.DictReader(file))
    return [row.get("id", row.get("name", "")) for row in rows], np.array(
        [[float(row[axis]) for axis in "xyz"] for row in rows]
    )


def level(place: np.ndarray) -> np.ndarray:
    return restated.geographic(place - SHIFT)


def written(path: Path, system: str, ids: list[str], geocentric: np.ndarray) -> Path:
    rows = restated.restated(geocentric, restated.GEOCENTRIC, system).tolist()
    path.write_text(
        "id,x,y,z\n" + "".join(f"{n},{x:.11g},{y:.11g},{z:.5f}\n" for n, (x, y, z) in zip(ids, rows, strict=True))
    )
    return path


def bent(path: Path, fitted: object) -> np.ndarray:
    """The apparent bottom (geocentric): traced through the surface in the vertical of each point."""
    _, cameras = table("cameras.csv")
    _, bottom = table("truth.csv")
    definition = json.loads(path.read_text())["map"]
    stations = np.array([restated.geocentric(level(place)) for place in cameras])
    found = []
    for place in bottom:
        here = level(place)
        axes, foot = restated.vertical(here), restated.geocentric(np.array([*here[:2], 0.0]))
        x, y = restated.restated(np.degrees([[here[1], here[0], 0.0]]) * [1, 1, 0], "EPSG:4326", definition)[0, :2]
        at = np.array([x, y, 0.0]) - np.append(fitted.origin, 0.0)
        C = (stations - foot) @ axes.T + at
        G = at + here[2] * np.eye(3)[2]
        rays = np.array([fermat.incidence(fitted.surface, one, G, INDEX).v for one in C])
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        found.append(foot + axes.T @ (nearest_point(C[None], rays[None])[0] - at))
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("system", ["EPSG:4326", "EPSG:32620"])
def test_a_pair_on_the_ellipsoid(tmp_path: Path, system: str) -> None:
    ids, water = table("water.csv")
    places = np.array([restated.geocentric(level(place)) for place in water])
    points = written(tmp_path / "water.csv", system, ids, places)
    result = musat("sea", "fit", points, "--crs", system, "--sigma", 0.05)
    assert result.exit_code == 0, result.output
    surface = tmp_path / "water.surface.json"
    fitted, local = load_surface(surface), tmp_path / "local"
    assert musat("sea", "fit", SEA / "water.csv", "-o", local).exit_code == 0
    flat = load_surface(local / "water.surface.json")
    np.testing.assert_allclose(fitted.parameters[0], flat.parameters[0], atol=5e-3)  # other weights
    run = run_on_the_ellipsoid()
    _, cameras = table("cameras.csv")
    run["stations"] = [
        run["stations"][0] | {"photo": name, "position": level(place).tolist()}
        for name, place in zip("LR", cameras, strict=True)
    ]
    run["adjusted_water"] = None  # a run without refraction
    record = tmp_path / "run.json"
    record.write_text(json.dumps(with_columns(run)))
    names, truth = table("truth.csv")
    bottom = written(tmp_path / "bottom.csv", system, names, bent(surface, fitted))
    command = ["sea", "correct", bottom, "--surface", surface, "--cameras", record, "--index", INDEX]
    result = musat(*command, "--crs", system, "--sigma", 0.05, "-o", tmp_path / "true.csv")
    assert result.exit_code == 0, result.output
    with (tmp_path / "true.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = np.array([[float(row[f"true_{axis}"]) for axis in "xyz"] for row in rows])
    missed = restated.restated(found, system, restated.MAP) - (truth - SHIFT)
    assert np.abs(missed).max() < NEAR


def test_surface_and_points_stand_on_one_earth(tmp_path: Path) -> None:
    assert musat("sea", "fit", SEA / "water.csv", "-o", tmp_path).exit_code == 0
    run = run_on_the_ellipsoid()
    run["stations"] = run["stations"][:2]
    record = tmp_path / "run.json"
    record.write_text(json.dumps(with_columns(run)))
    points = tmp_path / "points.csv"
    points.write_text("id,x,y,z\n1,-64.93,18.34,-5\n")
    command = ["sea", "correct", points, "--surface", tmp_path / "water.surface.json", "--cameras", record]
    result = musat(*command, "--index", INDEX, "--sigma", 0.05, "-o", tmp_path / "true.csv")
    assert result.exit_code == 1
    assert "stands in local coordinates, the points on the ellipsoid" in result.output
