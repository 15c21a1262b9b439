"""GeoPackages read by SQLite and shapely, GeoTIFFs by their tags."""

import sqlite3
import struct
import zlib
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pyproj
import pytest
import rasterio
import shapely

from interchange.layer_samples import EAST, HEIGHTS, NORTH, UTM, grid, lines, points, same_twice
from musatpy.errors import InterchangeError
from musatpy.interchange import geopackage, geotiff
from musatpy.interchange.layers import LOCAL

ENVELOPES = {0: 0, 1: 32, 2: 48}  # bytes of an envelope by its kind (OGC 12-128, 2.1.3)


def geometries(path: Path, layer: str) -> list[shapely.Geometry]:
    with closing(sqlite3.connect(path)) as database:
        blobs = [row[0] for row in database.execute(f'SELECT geom FROM "{layer}" ORDER BY fid')]
    assert all(blob[:2] == b"GP" for blob in blobs)
    return [shapely.from_wkb(blob[8 + ENVELOPES[blob[3] >> 1 & 7] :]) for blob in blobs]


def test_layers_are_read_by_sqlite_and_shapely(tmp_path: Path) -> None:
    path, contours, spots = tmp_path / "a.gpkg", lines(), points()
    same_twice(path, lambda target: geopackage.write(target, {"contours": contours, "spots": spots}))
    # Doubles are kept as they are.
    xyz = [shapely.get_coordinates(geometry, include_z=True) for geometry in geometries(path, "contours")]
    for drawn, line, closed in zip(xyz, contours.vertices, contours.closed, strict=True):
        np.testing.assert_array_equal(drawn[: len(line)], line)
        assert (drawn[len(line) :] == line[:1]).all() and len(drawn) == len(line) + closed
    xyz = [shapely.get_coordinates(geometry, include_z=True)[0] for geometry in geometries(path, "spots")]
    np.testing.assert_array_equal(xyz, spots.xyz)
    with closing(sqlite3.connect(path)) as database:
        depths = [row[0] for row in database.execute("SELECT depth FROM spots ORDER BY fid")]
        kinds = [row[0] for row in database.execute("SELECT kind FROM contours ORDER BY fid")]
        contents = database.execute("SELECT description, srs_id, last_change FROM gpkg_contents").fetchall()
        described = database.execute(
            "SELECT table_name, column_name, description FROM gpkg_data_columns"
        ).fetchall()
    assert depths[3] is None
    np.testing.assert_array_equal(np.array(depths, dtype=float), spots.columns["depth"].values)
    assert kinds == contours.columns["kind"].values.tolist()
    assert contents == [(HEIGHTS, 32620, "1983-09-01T00:00:00.000Z")] * 2
    assert described == [("contours", "depth", "unit: m"), ("spots", "depth", "unit: m")]


@pytest.mark.parametrize("crs", [UTM, None, pyproj.CRS("EPSG:4979")])
def test_what_is_read_is_what_was_written(tmp_path: Path, crs: pyproj.CRS | None) -> None:
    path, contours, spots = tmp_path / "a.gpkg", lines(crs), points(crs)
    geopackage.write(path, {"contours": contours, "spots": spots})
    for name, layer in (("contours", contours), ("spots", spots)):
        answer = geopackage.read(path, name)
        assert (answer.crs, answer.heights) == (crs, HEIGHTS)
        with closing(sqlite3.connect(path)) as database:
            (number,) = database.execute(
                "SELECT srs_id FROM gpkg_contents WHERE table_name = ?", (name,)
            ).fetchone()
        assert number == (-1 if crs is None else crs.to_epsg())  # -1: undefined Cartesian (OGC 12-128, 1.1.2)
        assert {key: column.unit for key, column in answer.columns.items()} == {
            key: column.unit for key, column in layer.columns.items()
        }
        for key, column in layer.columns.items():
            np.testing.assert_array_equal(answer.columns[key].values, column.values)
        if name == "spots":
            np.testing.assert_array_equal(answer.xyz, spots.xyz)
        else:
            np.testing.assert_array_equal(answer.closed, contours.closed)
            for read, line in zip(answer.vertices, contours.vertices, strict=True):
                np.testing.assert_array_equal(read, line)


def undefined(path: Path, number: int) -> Path:
    """Write a layer whose system has the number of one that is not defined."""
    geopackage.write(path, {"contours": lines()})
    with closing(sqlite3.connect(path)) as database, database:
        for table in ("gpkg_contents", "gpkg_geometry_columns"):
            database.execute(f"UPDATE {table} SET srs_id = ?", (number,))
    return path


def test_undefined_systems_say_none(tmp_path: Path) -> None:
    """OGC 12-128, 1.1.2: -1 is an undefined Cartesian system, 0 an undefined geographic one, on no ellipsoid."""
    cartesian, geographic = undefined(tmp_path / "a.gpkg", -1), undefined(tmp_path / "b.gpkg", 0)
    assert geopackage.read(cartesian).crs is None and geopackage.read(geographic).crs is None
    assert geopackage.read(cartesian, crs=UTM).crs == UTM
    degrees = pyproj.CRS("EPSG:4267")
    assert geopackage.read(geographic, crs=degrees).crs == degrees
    for other in (UTM, pyproj.CRS.from_wkt(LOCAL)):
        with pytest.raises(
            InterchangeError, match=r"layer contours: longitude and latitude of no datum \(srs_id 0\)"
        ):
            geopackage.read(geographic, crs=other)


def test_layers_that_are_missing_or_not_named(tmp_path: Path) -> None:
    path = tmp_path / "a.gpkg"
    geopackage.write(path, {"contours": lines(), "spots": points()})
    with pytest.raises(InterchangeError, match="layer depths: it is missing among layers contours, spots"):
        geopackage.read(path, "depths")
    with pytest.raises(InterchangeError, match="layers contours, spots; expected: one, or the name"):
        geopackage.read(path)


def test_geometries_that_are_none_of_ours(tmp_path: Path) -> None:
    path = tmp_path / "a.gpkg"
    texts = ["LINESTRING Z (0 0 1, 1 1 1)", "LINESTRING (0 0, 1 1)", "POLYGON Z ((0 0 1, 1 0 1, 1 1 1, 0 0 1))"]
    texts += ["MULTILINESTRING Z ((0 0 1, 1 1 1), (5 5 1, 6 6 1))", "LINESTRING Z (0 0 nan, 1 1 1)"]
    shapes = [*shapely.from_wkt(texts), None]
    encoded = shapely.to_wkb(shapes, output_dimension=3, flavor="iso")
    write = {"field_data": [], "fields": [], "driver": "GPKG", "geometry_type": "Unknown", "crs": "EPSG:32620"}
    pyogrio.raw.write(path, geometry=encoded, **write)
    with pytest.raises(InterchangeError) as caught:
        geopackage.read(path)
    texts = [problem.message for problem in caught.value.problems]
    assert texts == [
        "layer a feature 2: it has no heights (2-D); expected: x, y and z",
        "layer a feature 3: a Polygon; expected: lines",
        "layer a feature 5: a coordinate is no number; expected: x, y and z",
        "layer a feature 6: it has no geometry; expected: lines",
    ]
    assert {problem.file for problem in caught.value.problems} == {str(path)}
    pyogrio.raw.write(path, geometry=encoded[[0, 3]], **write)
    parts = geopackage.read(path)
    assert [line[0].tolist() for line in parts.vertices] == [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [5.0, 5.0, 1.0]]


def test_the_settings_of_gdal_are_as_they_were(tmp_path: Path) -> None:
    geopackage.write(tmp_path / "a.gpkg", {"spots": points()})
    assert pyogrio.get_gdal_config_option("OGR_CURRENT_DATE") is None
    assert pyogrio.get_gdal_config_option("OGR_SQLITE_SYNCHRONOUS") is None


SIZES = {1: "B", 2: "s", 3: "H", 4: "I", 12: "d"}  # types of fields, TIFF 6.0


def tags(data: bytes) -> dict[int, Any]:
    """Return the fields of the first directory of a little-endian file."""
    assert data[:4] == b"II*\0"
    (place,) = struct.unpack_from("<I", data, 4)
    fields = {}
    for i in range(struct.unpack_from("<H", data, place)[0]):
        tag, kind, count = struct.unpack_from("<HHI", data, place + 2 + 12 * i)
        size = struct.calcsize(SIZES[kind]) * count
        start = place + 10 + 12 * i
        if size > 4:
            (start,) = struct.unpack_from("<I", data, start)
        values = struct.unpack_from(f"<{count}{SIZES[kind]}", data, start)
        fields[tag] = values[0] if kind == 2 else values
    return fields


def unpredicted(data: bytes, columns: int) -> np.ndarray:
    """Undo predictor 3 (Adobe Photoshop TIFF Technical Note 3): differences of bytes, planes of significance."""
    rows = np.frombuffer(data, np.uint8).reshape(-1, 8 * columns)
    planes = np.cumsum(rows, axis=1, dtype=np.uint8).reshape(-1, 8, columns)
    return np.ascontiguousarray(planes.transpose(0, 2, 1)).view(">f8")[..., 0]


def test_a_grid_is_read_by_the_tags_of_its_file(tmp_path: Path) -> None:
    given = grid()
    data = same_twice(tmp_path / "a.tif", lambda target: geotiff.write(target, given))
    fields = tags(data)
    rows, columns = given.shape
    assert fields[256] + fields[257] + fields[339][:1] == (columns, rows, 3)
    assert fields[33550] == (2.5, 2.5, 0.0)  # ModelPixelScale
    # ModelTiepoint: pixel 0, 0 is the north-western node, GTRasterType (1025) "point"
    assert fields[33922] == (0.0, 0.0, 0.0, EAST, NORTH + 2.5 * (rows - 1), 0.0)
    keys = {fields[34735][i]: fields[34735][i + 3] for i in range(4, len(fields[34735]), 4)}
    assert (keys[1025], keys[3072]) == (2, 32620)  # and ProjectedCSType
    assert fields[42113].rstrip(b"\0") == b"nan"
    assert fields[317] == (3,)
    strips = [zlib.decompress(data[a : a + n]) for a, n in zip(fields[273], fields[279], strict=True)]
    bands = unpredicted(b"".join(strips), columns).reshape(2, rows, columns)
    np.testing.assert_array_equal(bands[0], given.bands["depth"][::-1])
    np.testing.assert_array_equal(bands[1], given.bands["sigma"][::-1])


@pytest.mark.parametrize("crs", [UTM, None, pyproj.CRS("EPSG:4326")])
def test_a_raster_is_read_as_it_was_written(tmp_path: Path, crs: pyproj.CRS | None) -> None:
    given = grid(crs)
    geotiff.write(tmp_path / "a.tif", given)
    answer = geotiff.read(tmp_path / "a.tif")
    assert (answer.crs, answer.heights, answer.units) == (crs, HEIGHTS, {"depth": "m"})
    assert (answer.west, answer.south, answer.spacing) == (EAST, NORTH, 2.5)
    for name, values in given.bands.items():
        np.testing.assert_array_equal(answer.bands[name], values)


def test_rows_are_counted_from_the_south(tmp_path: Path) -> None:
    """Read and written in pieces; rasterio has the northern row first."""
    given = grid()
    with geotiff.written(tmp_path / "a.tif", given, {"depth": "m", "sigma": ""}) as writer:
        for first, last in ((4, 7), (0, 3), (3, 4)):
            writer.put(first, {name: values[first:last] for name, values in given.bands.items()})
    with rasterio.open(tmp_path / "a.tif") as dataset:
        np.testing.assert_array_equal(dataset.read(1)[::-1], given.bands["depth"])
        np.testing.assert_array_equal(dataset.read(2)[::-1], given.bands["sigma"])
    with geotiff.opened(tmp_path / "a.tif") as raster:
        np.testing.assert_array_equal(raster.rows("sigma", 1, 5), given.bands["sigma"][1:5])


def raster(path: Path, crs: str | None, transform: tuple[float, ...], **others: Any) -> Path:
    profile = {"driver": "GTiff", "width": 3, "height": 2, "count": 1, "dtype": "int16", "nodata": -99}
    profile |= {"crs": crs, "transform": rasterio.Affine(*transform)} | others
    with rasterio.open(path, "w", **profile) as dataset:
        dataset.write(np.array([[1, 2, -99], [4, 5, 6]], dtype=np.int16), 1)
        dataset.scales, dataset.offsets = (0.5,), (-10.0,)
    return path


def test_a_raster_of_scaled_integers(tmp_path: Path) -> None:
    answer = geotiff.read(raster(tmp_path / "a.tif", "EPSG:32620", (10, 0, 1000, 0, -10, 2000)))
    assert (answer.west, answer.south, answer.spacing) == (1005.0, 1985.0, 10.0)
    np.testing.assert_array_equal(answer.bands["band1"], [[-8.0, -7.5, -7.0], [-9.5, -9.0, np.nan]])


@pytest.mark.parametrize(
    ("crs", "transform", "words"),
    [
        (None, (10, 0, 1000, 0, -10, 2000), ["the raster has no coordinate system; expected: one in the file"]),
        ("EPSG:32620", (10, 1, 1000, 1, -10, 2000), ["the raster is turned or mirrored; expected: a north-up"]),
        ("EPSG:32620", (10, 0, 1000, 0, 10, 2000), ["the raster is turned or mirrored; expected: a north-up"]),
        (
            None,
            (10, 0, 1000, 0, -20, 2000),
            ["no coordinate system", "pixels of 10 by 20; expected: square ones (`gdalwarp -tr"],
        ),
    ],
)
def test_rasters_without_a_place(
    tmp_path: Path, crs: str | None, transform: tuple[float, ...], words: list[str]
) -> None:
    path = raster(tmp_path / "a.tif", crs, transform)
    with pytest.raises(InterchangeError) as caught:
        geotiff.read(path)
    for problem, text in zip(caught.value.problems, words, strict=True):
        assert text in problem.message and problem.file == str(path)


def test_the_caller_says_the_system_of_a_raster_without_one(tmp_path: Path) -> None:
    path = raster(tmp_path / "a.tif", None, (10, 0, 1000, 0, -10, 2000))
    assert geotiff.read(path, crs=UTM).crs == UTM
    assert geotiff.read(path, crs=pyproj.CRS.from_wkt(LOCAL)).crs is None
