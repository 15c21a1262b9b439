"""GeoJSON, read by json; in longitude and latitude of WGS 84 or not written."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

from interchange.layer_samples import HEIGHTS, UTM, lines, points, same_twice
from musatpy.errors import InterchangeError
from musatpy.interchange import geojson
from musatpy.interchange.layers import LOCAL, LayerColumn, Lines, Points, Polygons

DEGREES = 0.5001e-9  # half of the last digit that is written
SPACE = pyproj.CRS("EPSG:4979")


def utm(longitude: float, latitude: float) -> tuple[float, float]:
    """Return easting and northing in zone 20 of WGS 84 by Redfearn's series (Snyder, USGS 1395, 8-9 and 8-10)."""
    a, e2 = 6378137.0, 0.0066943799901413165
    phi, dl = np.radians(latitude), np.radians(longitude + 63.0)
    second, N = e2 / (1 - e2), a / np.sqrt(1 - e2 * np.sin(phi) ** 2)
    T, C, A = np.tan(phi) ** 2, second * np.cos(phi) ** 2, dl * np.cos(phi)
    sines = (e2, e2**2, e2**3)
    terms = [
        (1, (-1 / 4, -3 / 64, -5 / 256)),
        (0, (-3 / 8, -3 / 32, -45 / 1024)),
        (0, (0, 15 / 256, 45 / 1024)),
        (0, (0, 0, -35 / 3072)),
    ]
    M = sum(
        (one + sum(c * e for c, e in zip(factors, sines, strict=True))) * (phi if k == 0 else np.sin(2 * k * phi))
        for k, (one, factors) in enumerate(terms)
    )
    x = N * (A + (1 - T + C) * A**3 / 6 + (5 - 18 * T + T**2 + 72 * C - 58 * second) * A**5 / 120)
    y = a * M + N * np.tan(phi) * (A**2 / 2 + (5 - T + 9 * C + 4 * C**2) * A**4 / 24)
    return 500000.0 + 0.9996 * x, 0.9996 * y


def test_points_are_read_by_json(tmp_path: Path) -> None:
    given = points()
    text = same_twice(tmp_path / "a.geojson", lambda target: geojson.write(target, given))
    content = json.loads(text)
    assert (content["type"], content["heights"], content["units"]) == ("FeatureCollection", HEIGHTS, {"depth": "m"})
    assert content["transformation"].endswith("accuracy 0 m")
    assert "crs" not in content  # RFC 7946, 4
    features = content["features"]
    for feature, xyz in zip(features, given.xyz, strict=True):
        longitude, latitude = feature["geometry"]["coordinates"]
        # The series is good to 0.1 mm, two degrees from the meridian; nine decimals of a degree are 0.06 mm.
        np.testing.assert_allclose(utm(longitude, latitude), xyz[:2], rtol=0, atol=5e-4)
        assert feature["properties"]["z"] == pytest.approx(xyz[2], abs=0.5001e-4)
    assert features[3]["properties"]["depth"] is None
    assert [feature["properties"]["rays"] for feature in features[:6]] == [0, 1, 2, 3, 4, 0]


def test_heights_of_the_ellipsoid_are_third_coordinates(tmp_path: Path) -> None:
    degrees = replace(points(SPACE), xyz=np.array([[-64.9, 18.3, -48.25], [-64.8, 18.2, -40.0]]), columns={})
    geojson.write(tmp_path / "a.geojson", degrees)
    content = json.loads((tmp_path / "a.geojson").read_text())
    places = [feature["geometry"]["coordinates"] for feature in content["features"]]
    assert places == [[-64.9, 18.3, -48.25], [-64.8, 18.2, -40.0]]
    assert "z" not in content["features"][0]["properties"]
    answer = geojson.read(tmp_path / "a.geojson")
    assert answer.crs == SPACE and isinstance(answer, Points)
    np.testing.assert_array_equal(answer.xyz, degrees.xyz)


@pytest.mark.parametrize("crs", [UTM.to_3d(), pyproj.CRS("EPSG:4326"), pyproj.CRS("EPSG:4978")])
def test_axes_stand_in_the_order_of_the_format(tmp_path: Path, crs: pyproj.CRS) -> None:
    """Whatever order the register gives them: latitude first in EPSG:4326 and in EPSG:4979."""
    place = (-64.9, 18.3, -48.25)
    plan = pyproj.Transformer.from_crs(SPACE, crs, always_xy=True)
    layer = replace(points(crs), xyz=np.array([plan.transform(*place)]), columns={})
    geojson.write(tmp_path / "a.geojson", layer)
    (written,) = json.loads((tmp_path / "a.geojson").read_text())["features"]
    expected = place[:2] if len(crs.axis_info) == 2 else place
    digits = [DEGREES, DEGREES, 0.5001e-4][: len(expected)]
    assert (np.abs(np.subtract(written["geometry"]["coordinates"], expected)) <= digits).all()


def test_what_is_read_is_what_was_written(tmp_path: Path) -> None:
    given = lines()
    geojson.write(tmp_path / "a.geojson", given)
    answer = geojson.read(tmp_path / "a.geojson")
    assert isinstance(answer, Lines) and answer.heights == HEIGHTS and answer.crs == pyproj.CRS("OGC:CRS84")
    np.testing.assert_array_equal(answer.closed, given.closed)
    back = pyproj.Transformer.from_crs("OGC:CRS84", UTM, always_xy=True)
    for read, line in zip(answer.vertices, given.vertices, strict=True):
        east, north = back.transform(*read[:, :2].T)
        np.testing.assert_allclose(
            np.column_stack([east, north, read[:, 2]]), line, rtol=0, atol=1e-4
        )  # nine decimals
    assert answer.columns["depth"].unit == "m" and list(answer.columns) == ["depth", "kind"]
    for name, column in given.columns.items():
        assert answer.columns[name].values.tolist() == column.values.tolist()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("crs", "words"),
    [
        (None, "the coordinates are local"),
        (pyproj.CRS("+proj=utm +zone=20 +ellps=clrk66"), "no transformation from unknown to WGS 84"),
        (pyproj.CRS("EPSG:26720"), "no transformation from NAD27 / UTM zone 20N"),  # none of NAD27 for the islands
        (pyproj.CRS("EPSG:32620+5773"), "without us_nga_egm96_15.tif"),
        (pyproj.CRS.from_wkt(LOCAL), "does not reach the coordinates"),
    ],
)
def test_systems_that_have_no_way_to_wgs_84(tmp_path: Path, crs: pyproj.CRS | None, words: str) -> None:
    with pytest.raises(InterchangeError, match=words) as caught:
        geojson.write(tmp_path / "a.geojson", points(crs))
    assert "expected: longitude and latitude of WGS 84 (RFC 7946)" in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_heights_along_a_line_need_a_datum(tmp_path: Path) -> None:
    slope = [line + np.arange(9)[:, None] * (0.0, 0.0, 1.0) for line in lines().vertices]
    with pytest.raises(InterchangeError, match="line 1: heights above a datum that the system does not say"):
        geojson.write(tmp_path / "a.geojson", replace(lines(), vertices=slope))


def test_a_column_that_has_the_name_of_heights(tmp_path: Path) -> None:
    columns = {"z": LayerColumn.of(np.zeros(40))}
    with pytest.raises(InterchangeError, match="column z: it has the name of the heights"):
        geojson.write(tmp_path / "a.geojson", replace(points(), columns=columns))


@pytest.mark.parametrize(
    ("place", "on_globe"),
    [((180.0, 90.0), True), ((-180.0, -90.0), True), ((180.1, 0.0), False), ((-181.0, 0.0), False),
     ((0.0, 90.1), False), ((0.0, -91.0), False)],
)  # fmt: skip
def test_where_the_globe_ends(tmp_path: Path, place: tuple[float, float], on_globe: bool) -> None:
    content = {"type": "FeatureCollection", "features": [feature("Point", [*place, 3.0])]}
    (tmp_path / "a.geojson").write_text(json.dumps(content))
    if on_globe:
        assert geojson.read(tmp_path / "a.geojson").xyz.tolist() == [[*place, 3.0]]
        return
    with pytest.raises(InterchangeError, match="none of the globe"):
        geojson.read(tmp_path / "a.geojson")


def geometries(path: Path, layer: Points | Lines) -> list[dict[str, Any]]:
    geojson.write(path, layer)
    return [each["geometry"] for each in json.loads(path.read_text())["features"]]


def test_points_on_both_sides_of_the_antimeridian(tmp_path: Path) -> None:
    degrees = replace(points(SPACE), xyz=np.array([[179.9, 18.3, 0.0], [180.1, 18.2, 0.0]]), columns={})
    places = [geometry["coordinates"] for geometry in geometries(tmp_path / "a.geojson", degrees)]
    assert places == [[179.9, 18.3, 0.0], [-179.9, 18.2, 0.0]]


@pytest.mark.parametrize("end", [180.3, -179.7])
def test_a_line_is_cut_at_the_antimeridian(tmp_path: Path, end: float) -> None:
    """As RFC 7946, 3.1.9, shows; latitude and height of the cut stand where a third of the way is done."""
    there = np.array([[179.9, 18.0, 3.0], [179.95, 18.0, 3.0], [end, 18.7, 10.0]])
    back = np.array([[-179.9, 18.0, 3.0], [179.9, 18.2, 3.0], [-179.9, 18.4, 3.0]])
    lines = Lines.of_paths([there, back, there[:2]], crs=SPACE, heights="")
    cut, twice, whole = geometries(tmp_path / "a.geojson", lines)
    assert cut["type"] == twice["type"] == "MultiLineString" and whole["type"] == "LineString"
    assert cut["coordinates"] == [
        [[179.9, 18.0, 3.0], [179.95, 18.0, 3.0], [180.0, 18.1, 4.0]],
        [[-180.0, 18.1, 4.0], [-179.7, 18.7, 10.0]],
    ]
    assert [part[0][:2] for part in twice["coordinates"]] == [[-179.9, 18.0], [180.0, 18.1], [-180.0, 18.3]]
    assert [part[-1][:2] for part in twice["coordinates"]] == [[-180.0, 18.1], [180.0, 18.3], [-179.9, 18.4]]


@pytest.mark.parametrize("start", [0, 1, 2, 3])
def test_an_area_is_cut_at_the_antimeridian(tmp_path: Path, start: int) -> None:
    """Its two parts have its area together, and go counterclockwise from whatever corner it begins."""
    square = np.roll([[179.9, 18.0, 0.0], [-179.8, 18.0, 0.0], [-179.8, 18.1, 0.0], [179.9, 18.1, 0.0]], start, 0)
    (area,) = geometries(tmp_path / "a.geojson", Polygons.of_outlines([square], crs=SPACE, heights=""))
    assert area["type"] == "MultiPolygon"
    rings = sorted((np.array(part[0])[:, :2] for part in area["coordinates"]), key=lambda ring: -ring[0, 0])
    assert all((ring[0] == ring[-1]).all() for ring in rings)
    sizes = [0.5 * float(np.sum(r[:-1, 0] * r[1:, 1] - r[1:, 0] * r[:-1, 1])) for r in rings]
    np.testing.assert_allclose(sizes, [0.01, 0.02], atol=1e-9)
    assert [(ring[:, 0].min(), ring[:, 0].max()) for ring in rings] == [(179.9, 180.0), (-180.0, -179.8)]


def test_an_area_that_touches_the_antimeridian_is_whole(tmp_path: Path) -> None:
    square = np.array([[180.0, 18.0, 0.0], [-179.8, 18.0, 0.0], [-179.8, 18.1, 0.0], [180.0, 18.1, 0.0]])
    (area,) = geometries(tmp_path / "a.geojson", Polygons.of_outlines([square], crs=SPACE, heights=""))
    assert area["type"] == "Polygon"
    ring = np.array(area["coordinates"][0])
    assert (ring[:, 0].min(), ring[:, 0].max()) == (-180.0, -179.8)


def feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ([], ["there are no features; expected: a FeatureCollection with points or lines"]),
        ({"features": []}, ["there are no features; expected: a FeatureCollection with points or lines"]),
        (
            {"crs": {"properties": {"name": "EPSG:32620"}}, "features": [feature("Point", [1, 2, 3])]},
            ["crs: EPSG:32620; expected: WGS 84, the only system of RFC 7946"],
        ),
        (
            {
                "features": [
                    feature("Point", [1, 2], z=3),
                    feature("Point", [1, 2]),
                    feature("LineString", [[1, 2], [2, 3]]),
                    feature("Point", [500000, 2], z=3),
                    feature("Point", ["1", None], z=3),
                    feature("Point", [1, 2, 3]),
                    {"type": "Feature", "geometry": None},
                ]
            },
            [
                "feature 2: it has no heights (2-D); expected: a third coordinate, or a property z",
                "feature 3: a geometry of the kind LineString; expected: a Point as most features",
                "feature 4: its coordinates are none of the globe; "
                "expected: longitude and latitude in degrees, height",
                "feature 5: its coordinates are no positions; expected: longitude, latitude and height",
                "feature 6: heights in positions of some features only; expected: all or none",
                "feature 7: a geometry of the kind None; expected: a Point as most features",
            ],
        ),
        (
            {"features": [feature("LineString", [[1, 2, 3]])]},
            ["feature 1: its coordinates are no positions; expected: longitude, latitude and height"],
        ),
    ],
)
def test_features_that_cannot_be_read(tmp_path: Path, content: Any, words: list[str]) -> None:
    (tmp_path / "a.geojson").write_text(json.dumps(content))
    with pytest.raises(InterchangeError) as caught:
        geojson.read(tmp_path / "a.geojson")
    assert [problem.message for problem in caught.value.problems] == words
    assert {problem.file for problem in caught.value.problems} == {str(tmp_path / "a.geojson")}


def test_properties_that_are_missing(tmp_path: Path) -> None:
    features = [feature("Point", [1, 2, 3], a=5, b="x"), feature("Point", [1, 2, 4], c=[1])]
    (tmp_path / "a.geojson").write_text(json.dumps({"features": features}))
    answer = geojson.read(tmp_path / "a.geojson", heights=HEIGHTS)
    columns = {name: column.values.tolist() for name, column in answer.columns.items()}
    assert columns["a"][0] == 5.0 and np.isnan(columns["a"][1])
    assert (columns["b"], columns["c"]) == (["x", ""], ["", "[1]"])
    assert answer.heights == HEIGHTS and not any(
        isinstance(c, LayerColumn) and c.unit for c in answer.columns.values()
    )


@pytest.mark.parametrize("step", [1, -1])
def test_outlines_of_areas_go_counterclockwise_whichever_way_they_came(tmp_path: Path, step: int) -> None:
    corners = np.array([[7.0, 47.0, 10.0], [7.1, 47.0, 10.0], [7.1, 47.1, 10.0], [7.0, 47.1, 10.0]])
    layer = Polygons.of_outlines([corners[::step]], crs=pyproj.CRS("EPSG:4326"))
    path = tmp_path / "AREA.geojson"
    geojson.write(path, layer)
    (ring,) = json.loads(path.read_text())["features"][0]["geometry"]["coordinates"]
    x, y = np.array(ring)[:, :2].T
    assert ring[0] == ring[-1] and len(ring) == 5
    assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) == pytest.approx(2.0 * 0.1 * 0.1)  # positive: counterclockwise
