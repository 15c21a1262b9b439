"""`musat run --gis`: layers read back by other libraries, with their system and to the printed digit."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pyproj
import pytest
import shapely
from click.testing import Result

from cli.commands import musat
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.records.json_files import with_images
from plots.plot_records import FIXTURES

ST_THOMAS = FIXTURES / "st_thomas/st_thomas.crd"
UTM = FIXTURES / "st_thomas_utm/st_thomas_utm.crd"
LOCAL = FIXTURES / "waves/unknown.crd"


def run(deck: Path, folder: Path, *options: str) -> Result:
    return musat("run", deck, "-o", folder, "--gis", *options)


def layer(folder: Path, name: str) -> tuple[Any, np.ndarray, dict[str, np.ndarray]]:
    """Return the system, the coordinates (n, 3) of the first vertices, and the fields of a layer."""
    meta, _, geometry, fields = pyogrio.raw.read(next(folder.glob("*.gpkg")), layer=name)
    xyz = np.array([shapely.get_coordinates(shape, include_z=True)[0] for shape in shapely.from_wkb(geometry)])
    return meta["crs"], xyz, dict(zip(meta["fields"].tolist(), fields, strict=True))


def record(folder: Path) -> dict[str, Any]:
    return with_images(json.loads(next(folder.glob("*.json")).read_text()))


def test_a_geographic_job_is_in_degrees_on_its_ellipsoid(tmp_path: Path) -> None:
    result = run(ST_THOMAS, tmp_path)
    assert result.exit_code == 0 and "no st_thomas.stations.geojson: PROJ has no transformation" in result.output
    points = record(tmp_path)["points"]
    crs, xyz, fields = layer(tmp_path, "points")
    assert pyproj.CRS(crs).is_geographic and pyproj.CRS(crs).ellipsoid.semi_major_metre == 6378206.4
    assert fields["point"].tolist() == points["point"]
    position = np.array(points["position"])
    np.testing.assert_allclose(xyz[:, :2], np.degrees(position[:, [1, 0]]), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(xyz[:, 2], position[:, 2], rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(fields["sigma_up"], np.array(points["sigma"])[:, 2])
    wet = record(tmp_path)["bathymetric_points"]
    depths = {point: depth for point, depth in zip(fields["point"], fields["depth"], strict=True) if depth == depth}
    assert depths == dict(zip(wet["point"], wet["depth"], strict=True)) and fields["submerged"].sum() == 8


def test_points_that_are_dry_for_certain_are_marked(tmp_path: Path) -> None:
    lines = ST_THOMAS.read_text().splitlines()
    for row, line in enumerate(lines):
        if line[:3] == "PLT" and line[13:21].strip() == "204":
            lines[row] = f"{line[:61]}D{line[62:]}"
    deck = tmp_path / "dry.crd"
    deck.write_text("\n".join([*lines, ""]))
    assert run(deck, tmp_path).exit_code == 0
    _, _, fields = layer(tmp_path, "points")
    dry = fields["dry"] == 1
    assert fields["point"][dry].tolist() == ["204"] and not fields["submerged"][dry].any()


def test_all_layers_have_rows(tmp_path: Path) -> None:
    run(ST_THOMAS, tmp_path)
    names = [str(name) for name, _ in pyogrio.list_layers(tmp_path / "st_thomas.gpkg")]
    assert names == ["stations", "points", "footprints", "control", "observations"]
    observed = record(tmp_path)["observations"]
    crs, _, fields = layer(tmp_path, "observations")
    assert len(fields["residual"]) == len(observed["residual"])
    np.testing.assert_array_equal(fields["residual"], observed["residual"])
    assert pyproj.CRS(crs).is_geographic and set(fields["unit"]) == {"mm", "m"}
    plates = fields["kind"] == "plate"
    assert (fields["photo"][plates] != "").all() and (fields["point"][plates] != "").all()


def test_footprints_hold_the_points_of_their_photos(tmp_path: Path) -> None:
    run(ST_THOMAS, tmp_path, "--crs", "EPSG:4267")
    package = tmp_path / "st_thomas.gpkg"
    meta, _, geometry, fields = pyogrio.raw.read(package, layer="footprints")
    areas = shapely.from_wkb(geometry)
    around = dict(zip(fields[0], areas, strict=True))
    assert meta["crs"] == "EPSG:4267" and meta["geometry_type"] == "Polygon Z"
    assert shapely.is_valid(areas).all() and shapely.is_ccw(shapely.get_exterior_ring(areas)).all()
    heights = shapely.get_coordinates(areas, include_z=True)[:, 2]
    assert np.ptp(heights) < 0.05  # at one height of a map about the stations
    values = record(tmp_path)
    place = dict(zip(values["points"]["point"], np.degrees(values["points"]["position"])[:, [1, 0]], strict=True))
    inside = [
        shapely.contains_xy(around[photo], *place[point])
        for photo, point in zip(values["plates"]["photo"], values["plates"]["point"], strict=True)
    ]
    assert np.mean(inside) > 0.95  # the ground is not level


def test_geojson_is_of_wgs84_by_the_transformation_of_the_datum(tmp_path: Path) -> None:
    result = run(ST_THOMAS, tmp_path, "--crs", "EPSG:4267")
    assert result.exit_code == 0
    features = json.loads((tmp_path / "st_thomas.stations.geojson").read_text())
    assert "NAD27 to WGS 84" in features["transformation"] and len(features["features"]) == 3
    _, xyz, _ = layer(tmp_path, "stations")
    way = pyproj.Transformer.from_crs("EPSG:4267", "OGC:CRS84", always_xy=True)
    for feature, (x, y) in zip(features["features"], xyz[:, :2].tolist(), strict=True):
        longitude, latitude = feature["geometry"]["coordinates"][:2]
        moved = Ellipsoid("WGS84").geocentric(np.radians([[latitude, longitude, 0.0], [y, x, 0.0]]))
        assert 10.0 < np.linalg.norm(moved[0] - moved[1]) < 600.0  # the shift of NAD27
        assert (longitude, latitude) == pytest.approx(way.transform(x, y), abs=2e-4)
    meta = pyogrio.read_info(tmp_path / "st_thomas.points.geojson")
    assert meta["features"] == 22 and pyproj.CRS(meta["crs"]).is_geographic


@pytest.mark.slow
def test_a_stated_job_is_in_the_system_of_its_answer(tmp_path: Path) -> None:
    assert run(UTM, tmp_path).exit_code == 0
    crs, xyz, _ = layer(tmp_path, "points")
    answer = np.array(record(tmp_path)["stated"]["points"]["position"])
    assert crs == "EPSG:3992"  # in feet
    np.testing.assert_allclose(xyz, answer, rtol=0.0, atol=1e-5)
    assert (tmp_path / "st_thomas_utm.points.geojson").exists()


def test_a_local_job_is_as_it_is_and_in_no_system(tmp_path: Path) -> None:
    result = run(LOCAL, tmp_path)
    assert result.exit_code == 0 and "the coordinates are local" in result.output
    crs, xyz, _ = layer(tmp_path, "stations")
    assert crs is None or pyproj.CRS(crs).is_engineering
    np.testing.assert_array_equal(xyz, record(tmp_path)["stations"]["position"])
    assert not list(tmp_path.glob("*.geojson"))


@pytest.mark.parametrize(
    ("deck", "crs", "status", "said"),
    [
        (LOCAL, "EPSG:4267", 1, "the run is a local job"),
        (ST_THOMAS, "EPSG:32620", 1, "no datum is shifted"),
        (ST_THOMAS, "EPSG:99999999", 2, "is no coordinate system that PROJ knows"),
    ],
)
def test_a_system_that_the_job_is_not_in_is_refused(
    tmp_path: Path, deck: Path, crs: str, status: int, said: str
) -> None:
    result = run(deck, tmp_path, "--crs", crs)
    assert result.exit_code == status and said in result.output and not list(tmp_path.glob("*.gpkg"))


def test_a_system_without_layers_is_a_wrong_command_line(tmp_path: Path) -> None:
    result = musat("run", ST_THOMAS, "-o", tmp_path, "--crs", "EPSG:4267")
    assert result.exit_code == 2 and "--crs goes with --gis" in result.output


@pytest.mark.slow
def test_footprints_are_cut_at_the_date_line(tmp_path: Path) -> None:
    spec = Path(__file__).with_name("date_line.toml")
    assert musat("simulate", spec, "-o", tmp_path).exit_code == 0
    assert run(tmp_path / "date_line.crd", tmp_path, "--crs", "EPSG:4326").exit_code == 0
    _, _, geometry, _ = pyogrio.raw.read(tmp_path / "date_line.gpkg", layer="footprints")
    packaged = shapely.from_wkb(geometry)
    parts, row = shapely.get_parts(packaged, return_index=True)
    assert (shapely.get_num_geometries(packaged) == 2).any() and shapely.is_valid(packaged).all()
    bounds = shapely.bounds(parts)
    assert (np.abs(bounds[:, [0, 2]]) <= 180.0).all() and {180.0, -180.0} <= set(bounds[:, [0, 2]].ravel().tolist())
    # 2.26 km at 16.8 degrees south, tilts of a degree
    np.testing.assert_allclose(np.bincount(row, bounds[:, 2] - bounds[:, 0]), 0.021, atol=0.001)
    assert shapely.is_ccw(shapely.get_exterior_ring(parts)).all()
    content = json.loads((tmp_path / "date_line.footprints.geojson").read_text())
    areas = [shapely.from_geojson(json.dumps(each["geometry"])) for each in content["features"]]
    assert any(area.geom_type == "MultiPolygon" for area in areas) and all(area.is_valid for area in areas)
    assert (np.abs(shapely.bounds(areas)[:, [0, 2]]) <= 180.0).all()
    np.testing.assert_allclose(shapely.area(areas), shapely.area(packaged), rtol=1e-6)
