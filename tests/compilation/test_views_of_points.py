"""What is told of compiled points: in the answer's system, in their models, by their rays, and in words."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest
from click.testing import CliRunner

from compilation.scenes import at_depth, flat_images, pair
from json_schema import violations
from musatpy import adjust, model, read_deck
from musatpy.arrays import FloatArray
from musatpy.cli.main import main as musat
from musatpy.compilation.compiled import compiled
from musatpy.compilation.run_records import of_record
from musatpy.compilation.triangulation import of_solution
from musatpy.formats.compilation_deck import read_compilation
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.reports.compilation import schema
from record_rows import read_rows, with_columns
from stage_readings import DECK, FIXTURES

_FEET = 1200.0 / 3937.0  # m, US survey foot


@pytest.fixture(scope="module")
def in_feet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the run whose answer is stated in State Plane feet, with what is compiled of it."""
    folder, runner = tmp_path_factory.mktemp("feet"), CliRunner()
    assert runner.invoke(musat, ["run", "-q", str(FIXTURES / "st_thomas_utm/st_thomas_utm.crd"), "-o", str(folder)])
    words = ["as11", "compile", str(folder / "st_thomas_utm.json"), str(DECK), "-o", str(folder)]
    result = runner.invoke(musat, words)
    assert result.exit_code == 0, result.output
    return folder


def in_state_plane(position: FloatArray) -> FloatArray:
    """Return feet, feet, metres of latitudes, longitudes (rad) and heights on the ellipsoid of the job, by PROJ."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a string of PROJ has no datum: none is shifted
        project = pyproj.Proj(pyproj.CRS.from_epsg(3992).to_proj4())
    east, north = project(*np.degrees(position[:, [1, 0]]).T)
    return np.column_stack([east, north, position[:, 2]])


def test_points_are_stated_as_the_answer_of_the_run(in_feet: Path) -> None:
    record = read_rows(in_feet / "st_thomas_as11.json")
    assert not list(violations(with_columns(record, schema()), schema(), schema()))
    for name in ("position", "apparent"):
        of_job = np.array([row[name] for row in record["points"]], dtype=float)
        stated = np.array([row[name] for row in record["stated"]["points"]], dtype=float)
        np.testing.assert_allclose(stated, in_state_plane(of_job), rtol=0, atol=1e-6)
    assert record["stated"]["answer"]["definition"] == "EPSG:3992"


def test_covariances_are_of_the_stated_coordinates(in_feet: Path) -> None:
    """By central differences of 10 m along east, north and up."""
    record = read_rows(in_feet / "st_thomas_as11.json")
    position = np.array([row["position"] for row in record["points"]])
    ellipsoid = Ellipsoid.of(model.EllipsoidSpec(name="clrk66"))
    at, axes = ellipsoid.geocentric(position), ellipsoid.frame(position)
    J = np.empty((len(at), 3, 3))
    for axis in range(3):
        sides = [in_state_plane(ellipsoid.geographic(at + step * axes[:, axis])) for step in (10.0, -10.0)]
        J[:, :, axis] = (sides[0] - sides[1]) / 20.0
    covariance = J @ np.array([row["covariance"] for row in record["points"]]) @ np.swapaxes(J, 1, 2)
    stated = np.array([row["covariance"] for row in record["stated"]["points"]])
    np.testing.assert_allclose(stated, covariance, rtol=1e-5, atol=1e-9)
    listing = (in_feet / "st_thomas_as11.lst").read_text()
    assert "Point Compilation: True Coordinates Of The Answer" in listing and "US survey foot" in listing
    assert max(len(line) for line in listing.replace("\f", "").splitlines()) <= 132


def test_files_have_the_coordinates_of_the_answer(in_feet: Path) -> None:
    head, *rows = (in_feet / "st_thomas_as11.contours.csv").read_text().splitlines()
    assert head == "line,surface,depth,index,closed,E,N,h"
    east = np.array([float(row.split(",")[5]) for row in rows])
    # The bay lies some 310 km from the false origin of the zone.
    assert (east * _FEET > 309_000.0).all() and (east * _FEET < 313_000.0).all()
    for name in ("profiles", "BAY"):
        assert ",E,N,h" in f",{(in_feet / f'st_thomas_as11.{name}.csv').read_text().splitlines()[0]}"


def test_a_solution_and_its_record_state_the_same(in_feet: Path) -> None:
    solution = of_solution(adjust(read_deck(FIXTURES / "st_thomas_utm/st_thomas_utm.crd")))
    recorded = of_record(in_feet / "st_thomas_utm.json")
    assert solution.stated == recorded.stated is not None
    assert of_solution(adjust(read_deck(FIXTURES / "st_thomas/st_thomas.crd"))).stated is None


def test_places_in_the_model_come_back_by_the_axes_of_the_record(in_feet: Path) -> None:
    """Round trip below 1e-9 m, with what the record says of the model and nothing else."""
    record = read_rows(in_feet / "st_thomas_as11.json")
    ellipsoid = Ellipsoid.of(model.EllipsoidSpec(name="clrk66"))
    for of_model in record["models"]:
        rows = [row for row in record["points"] if row["model"] == of_model["model"]]
        axes, origin = np.array(of_model["axes"]), np.array(of_model["origin"])
        for name, place in (("position", "model_position"), ("apparent", "model_apparent")):
            in_model = np.array([row[place] for row in rows], dtype=float)
            geocentric = in_model @ axes + origin + of_model["working_origin"]
            given = ellipsoid.geocentric(np.array([row[name] for row in rows], dtype=float))
            np.testing.assert_allclose(geocentric, given, rtol=0, atol=1e-8)  # rounding of 6e6 m
        height = np.array(of_model["origin_position"])[2]
        assert height == pytest.approx(np.mean(of_model["tides"]), abs=1e-9)
        assert of_model["scale"] == pytest.approx(of_model["height"] / 0.15225, rel=1e-4)


TIDES = (0.4, -0.3)
POINTS = {"DEEP": -12.0, "BETWEEN": 0.05, "ABOVE": 3.0}


def told() -> dict[str, tuple[str | None, FloatArray]]:
    """Return the remarks of points, all flagged as submerged, of one on land, and of one on the shore."""
    run = pair(3000.0, 1810.0, TIDES)
    heights = {**POINTS, "LAND": 8.0, "SHORE": 0.05, "SLIP": -6.0}
    xyz = np.array([[700.0, 300.0, height] for height in heights.values()])
    gap = xyz[:, None] - run.block.photos.position
    straight = -run.block.cameras.focal_length[0] * gap[..., :2] / gap[..., 2:]
    wet = xyz[:, None, 2] < run.block.photos.tide
    xy = np.where(wet[..., None], flat_images(run, np.minimum(xyz, [np.inf, np.inf, min(TIDES)])), straight)
    xy = np.where(wet.all(axis=1)[:, None, None], flat_images(run, xyz), xy)
    high = replace(run.block.photos, tide=np.full(2, 0.4))
    half = flat_images(replace(run, block=replace(run.block, photos=high)), at_depth(xyz[:, :2], -0.05))
    xy[1] = np.where(wet[1, :, None], half[1], straight[1])
    xy[5, 1, 1] += 0.1  # a slip of the right stage in y
    lines = ["MDL 1        1        2                                          5.00"]
    for name, stages in zip(heights, xy.reshape(-1, 4), strict=True):
        kind = {"LAND": "G ", "SHORE": "S "}.get(name, "GB")
        lines.append(f"STG 1        {name:<8} {kind}" + "".join(f"{value:11.6f}" for value in stages))
    result = compiled(run, read_compilation("\n".join([*lines, "END", ""]).encode())[0])
    return dict(zip(heights, zip(result.remarks, result.incidences, strict=True), strict=True))


def test_remarks_say_why_there_is_no_depth_and_angles_are_those_of_wet_rays() -> None:
    found = told()
    assert {name: remark for name, (remark, _) in found.items()} == {
        "DEEP": None,
        "BETWEEN": "between the tides",
        "ABOVE": "above the water",
        "LAND": "dry",
        "SHORE": "shoreline",
        "SLIP": "y-parallax",
    }
    wet = {name: np.isfinite(angles).tolist() for name, (_, angles) in found.items()}
    assert wet["DEEP"] == [True, True] and wet["BETWEEN"] == [True, False]
    assert wet["ABOVE"] == wet["LAND"] == [False, False]
    # By the tangents of the rays of the apparent point, some 9 m below the water.
    deep = found["DEEP"][1]
    run = pair(3000.0, 1810.0, TIDES)
    xy = flat_images(run, np.array([[700.0, 300.0, -12.0]]))[0]
    np.testing.assert_allclose(np.tan(deep), np.linalg.norm(xy, axis=1) / 152.4, rtol=1e-6)


def test_apparent_points_of_dry_ones_are_themselves(in_feet: Path) -> None:
    rows = read_rows(in_feet / "st_thomas_as11.json")["points"]
    dry = [row for row in rows if not row["submerged"]]
    assert dry and all(row["apparent"] == row["position"] for row in dry)
    deep = [row for row in rows if row["depth"] and row["depth"] > 5.0]
    # In air the water looks shallower by a quarter or more of the depth.
    assert all(row["apparent"][2] - row["position"][2] > 0.25 * row["depth"] for row in deep)
