"""GeoTIFFs, read tag by tag; and rasters of others, written by rasterio."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

from interchange.layer_samples import EAST, HEIGHTS, NORTH, UTM, grid, same_twice
from musatpy.errors import InterchangeError
from musatpy.interchange import geotiff
from musatpy.interchange.layers import LOCAL

rasterio = pytest.importorskip("rasterio")
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
def test_what_is_read_is_what_was_written(tmp_path: Path, crs: pyproj.CRS | None) -> None:
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
    with geotiff.written(tmp_path / "a.tif", given.posts, {"depth": "m", "sigma": ""}) as writer:
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


@pytest.mark.parametrize("content", [b"", b"II*\0" + bytes(60), b"nothing"])
def test_files_that_are_none(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.tif").write_bytes(content)
    with pytest.raises(InterchangeError, match=r"is no raster that GDAL reads|the file is empty"):
        geotiff.read(tmp_path / "a.tif")
