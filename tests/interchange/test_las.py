"""LAS and LAZ files of compiled points, read by laspy from their bytes, and one of them by its header alone."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest

from interchange.layer_samples import DIGIT, HEIGHTS, UTM, points, same_twice
from musatpy.errors import InterchangeError
from musatpy.interchange import las
from musatpy.interchange.layers import Column

laspy = pytest.importorskip("laspy")
CHARLOTTE = pyproj.CRS("EPSG:4979")


def test_points_stand_where_the_specification_says(tmp_path: Path) -> None:
    """LAS 1.4 R15, table 3: place and length of points, counts, scales and offsets; table 14: three integers."""
    given = points()
    data = same_twice(tmp_path / "a.las", lambda target: las.write(target, given))
    start, form, length, day, year = (
        *struct.unpack_from("<I", data, 96),
        data[104],
        *struct.unpack_from("<H", data, 105),
        *struct.unpack_from("<HH", data, 90),
    )
    (count,) = struct.unpack_from("<Q", data, 247)
    numbers = np.array(struct.unpack_from("<6d", data, 131))
    assert (form, length, count) == (6, 30 + 8 + 8, len(given.xyz))
    assert (day, year) == (318, 2011)  # no date of the run
    rows = [struct.unpack_from("<3i", data, start + length * i) for i in range(count)]
    np.testing.assert_allclose(np.array(rows) * numbers[:3] + numbers[3:], given.xyz, rtol=0, atol=DIGIT)
    depths = [struct.unpack_from("<d", data, start + length * i + 30)[0] for i in range(count)]
    np.testing.assert_array_equal(depths, given.columns["depth"].values)


@pytest.mark.parametrize("kind", ["las", "laz"])
@pytest.mark.parametrize("crs", [UTM, None, CHARLOTTE])
def test_columns_are_extra_bytes(tmp_path: Path, kind: str, crs: pyproj.CRS | None) -> None:
    given = points(crs)
    if crs == CHARLOTTE:
        given = replace(given, xyz=given.xyz * (1e-6, 1e-6, 1.0))
    digit = DIGIT * np.array([1e-5, 1e-5, 1.0] if crs == CHARLOTTE else [1.0, 1.0, 1.0])
    las.write(tmp_path / f"a.{kind}", given)
    file = laspy.read(tmp_path / f"a.{kind}")
    assert (np.abs(file.xyz - given.xyz) <= digit).all()
    assert file.header.parse_crs() == crs
    np.testing.assert_array_equal(file["depth"], given.columns["depth"].values)
    assert file.point_format.dimension_by_name("depth").description == "m"
    answer = las.read(tmp_path / f"a.{kind}")
    np.testing.assert_array_equal(answer.xyz, file.xyz)
    assert (answer.crs, answer.heights) == (crs, HEIGHTS)
    for name, column in given.columns.items():
        np.testing.assert_array_equal(answer.columns[name].values, column.values)
        assert answer.columns[name].unit == column.unit


def test_what_a_file_cannot_hold(tmp_path: Path) -> None:
    texts = {"why": Column.of(["dry"] * 40)}
    with pytest.raises(InterchangeError, match="columns why: texts; expected: numbers"):
        las.write(tmp_path / "a.las", replace(points(), columns=texts))
    far = np.array([[0.0, 0.0, 0.0], [1e7, 0.0, 0.0]])  # 1e11 digits
    with pytest.raises(InterchangeError, match="cannot hold the points"):
        las.write(tmp_path / "a.las", replace(points(), xyz=far, columns={}))
    assert not list(tmp_path.iterdir())


def test_files_that_are_none(tmp_path: Path) -> None:
    path = tmp_path / "a.las"
    for content, words in ((b"", "the file is empty"), (b"LASF" + bytes(900), "is no LAS file")):
        path.write_bytes(content)
        with pytest.raises(InterchangeError, match=words):
            las.read(path)
    las.write(path, replace(points(), xyz=np.empty((0, 3)), columns={"depth": Column.of(np.empty(0))}))
    with pytest.raises(InterchangeError, match="there are no points"):
        las.read(path)
