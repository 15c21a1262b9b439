"""Points of runs and files for surfaces, control of decks, and a pair on the ellipsoid."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sea_fixtures
from cli.commands import musat
from depth import restated
from depth.lagoon import rows
from depth.test_run_cameras import run_on_the_ellipsoid
from musatpy import read_deck
from musatpy.errors import CollocationError, SeaError
from musatpy.geometry.collinearity import nearest_point
from musatpy.geometry.systems import LocalRectangular, geographic
from musatpy.model import ControlKind, CoordinateSystem
from musatpy.refraction import fermat
from musatpy.reports.record import dumps, record
from musatpy.sea.interpolation.control_tables import control_of, deck_control
from musatpy.sea.stereo.point_records import PointPrecision, read_points
from musatpy.sea.stereo.surface_file import load_surface
from musatpy.sea.stereo.surface_points import intersection_covariance
from musatpy.systems.statement import ellipsoid_of
from record_rows import with_columns
from sample_solutions import sample_solution
from sea_fixtures import SEA, SHIFT


@pytest.mark.parametrize("system", [CoordinateSystem.GEOGRAPHIC, CoordinateSystem.GEOCENTRIC])
def test_a_run_on_the_ellipsoid_has_its_points_on_a_map(tmp_path: Path, system: CoordinateSystem) -> None:
    solution = sample_solution(system)
    path = tmp_path / "job.json"
    path.write_text(dumps(record(solution)))
    read = read_points(path, PointPrecision())
    ellipsoid = ellipsoid_of(solution.block)
    points = solution.points.position[np.isin(solution.block.points.ids, read.points.ids)]
    position = points if system is CoordinateSystem.GEOCENTRIC else ellipsoid.geocentric(points)
    apart = np.linalg.norm(read.points.position - read.points.position[0], axis=1)
    # lengths on the map are those in space but for heights: 3 km over 6400 km
    np.testing.assert_allclose(apart, np.linalg.norm(position - position[0], axis=1), rtol=1e-3)
    heights = geographic(ellipsoid, position)[:, 2]
    np.testing.assert_allclose(read.points.position[:, 2], heights, atol=1e-6)
    assert read.plan is not None
    back = read.plan.coordinates(read.points.position)
    np.testing.assert_allclose(
        back[:, 2] if system is CoordinateSystem.GEOGRAPHIC else back[:, 0],
        heights if system is CoordinateSystem.GEOGRAPHIC else points[:, 0],
        atol=1e-5,
    )
    with pytest.raises(SeaError, match="has covariances, and sigmas are given too"):
        read_points(path, PointPrecision(sigma=(1.0, 1.0, 1.0)))


def test_points_without_their_own_sigmas_take_those_given(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("id,x,y,z,sx,sy,sz\na,10,20,0.5,1,2,3\nb,-10,5,0.25,, ,\n")
    found = read_points(path, PointPrecision(sigma=(0.1, 0.2, 0.3))).points.covariance
    np.testing.assert_array_equal(found, [np.diag([1.0, 4.0, 9.0]), np.diag(np.square([0.1, 0.2, 0.3]))])
    cameras = sea_fixtures.SETUP.cameras
    pair = read_points(path, PointPrecision(cameras=cameras, image_sigma=1e-5), only=("b",)).points
    assert pair.ids == ("b",)
    np.testing.assert_array_equal(pair.position, [[-10.0, 5.0, 0.25]])
    np.testing.assert_array_equal(pair.covariance, intersection_covariance(cameras, pair.position, 1e-5))
    with pytest.raises(SeaError, match=r"points\.csv:3 col 14 sx: no sigmas here, and none are given") as caught:
        read_points(path, PointPrecision())
    assert len(caught.value.problems) == 1
    path.write_text("id,x,y,z,sx,sy,sz\nb,-10,5,0.25,1,,1\n")
    with pytest.raises(SeaError, match="col 16 sy: sx, sy, sz go together"):
        read_points(path, PointPrecision(sigma=(0.1, 0.2, 0.3)))
    path.write_text("id,NORTH,East,Up,sx,sy,sz\na,20,10,0.5,1,2,3\n")
    with pytest.raises(SeaError, match="column sx is none of coordinates"):
        read_points(path, PointPrecision(), columns=("east", "north", "sx"))


DECK = Path(__file__).parents[2] / "fixtures" / "cayman" / "cayman_modified.crd"


def test_the_check_points_under_water_of_a_deck_are_control() -> None:
    block = read_deck(DECK)
    count = len(block.control.point)
    wet = block.points.bathymetric.copy()
    wet[block.control.point] = [row != 1 for row in range(count)]
    kind = np.full(count, ControlKind.CHECK)
    kind[0] = ControlKind.FULL
    position = np.arange(3.0 * count).reshape(count, 3)
    position[2, 2] = np.nan
    sigma = np.full((count, 3), np.nan)
    sigma[3] = 0.5
    block = replace(
        block,
        options=replace(block.options, system=CoordinateSystem.LOCAL),
        points=replace(block.points, bathymetric=wet),
        control=replace(block.control, kind=kind, position=position, sigma=sigma),
    )
    found = deck_control(block, "job.crd", LocalRectangular())
    ids = block.points.ids[block.control.point].tolist()
    assert list(found.ids) == ids[3:]  # not the full one, the dry one, the one without a height
    assert found.needs_mapped
    assert (found.values["z_true"][0], found.values["sigma"][0]) == (11.0, 0.5)
    control = control_of(found, dict.fromkeys(ids, (1.0, 2.0, 10.0)), "mapped.csv", default_sigma=0.2)
    assert control.value[0] == -1.0
    assert control.sigma.tolist() == [0.5, *[0.2] * (len(ids) - 4)]
    block = replace(block, control=replace(block.control, kind=np.full(count, ControlKind.FULL)))
    with pytest.raises(CollocationError, match="no check point under water has a height"):
        deck_control(block, "job.crd", LocalRectangular())


INDEX = 1.34
# Waves are laid on a map about the middle of their points, true points along the verticals; points are written to
# 1e-9 degrees or 0.1 mm, and the fitted surface of 1e-4 m more or less is the same for both ways
NEAR = 1e-3


def table(name: str) -> tuple[list[str], np.ndarray]:
    found = rows(SEA / name)
    places = np.array([[float(row[axis]) for axis in "xyz"] for row in found])
    return [row.get("id", row.get("name", "")) for row in found], places


def level(place: np.ndarray) -> np.ndarray:
    return restated.geographic(place - SHIFT)


def written(path: Path, system: str, ids: list[str], geocentric: np.ndarray) -> Path:
    places = zip(ids, restated.restated(geocentric, restated.GEOCENTRIC, system).tolist(), strict=True)
    path.write_text("id,x,y,z\n" + "".join(f"{n},{x:.11g},{y:.11g},{z:.5f}\n" for n, (x, y, z) in places))
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
    found = np.array([[float(row[f"true_{axis}"]) for axis in "xyz"] for row in rows(tmp_path / "true.csv")])
    missed = restated.restated(found, system, restated.MAP) - (truth - SHIFT)
    assert np.abs(missed).max() < NEAR


def test_surface_and_points_stand_on_one_earth(tmp_path: Path) -> None:
    assert musat("sea", "fit", SEA / "water.csv", "-o", tmp_path).exit_code == 0
    run = run_on_the_ellipsoid()
    run["stations"] = run["stations"][:2]
    run["adjusted_water"]["tide"] = run["adjusted_water"]["tide"][:2]
    record = tmp_path / "run.json"
    record.write_text(json.dumps(with_columns(run)))
    points = tmp_path / "points.csv"
    points.write_text("id,x,y,z\n1,-64.93,18.34,-5\n")
    command = ["sea", "correct", points, "--surface", tmp_path / "water.surface.json", "--cameras", record]
    result = musat(*command, "--index", INDEX, "--sigma", 0.05, "-o", tmp_path / "true.csv")
    assert result.exit_code == 1
    assert "stands in local coordinates, the points on the ellipsoid" in result.output
