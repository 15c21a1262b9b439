"""Clouds of points: LAS and LAZ read from their bytes, XYZ by csv and numpy."""

import csv
import struct
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest

from interchange.layer_samples import DIGIT, HEIGHTS, UTM, points, same_twice
from musatpy.errors import InterchangeError
from musatpy.interchange import las, xyz
from musatpy.interchange.layers import LOCAL, LayerColumn

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
    texts = {"why": LayerColumn.of(["dry"] * 40)}
    with pytest.raises(InterchangeError, match="columns why: texts; expected: numbers"):
        las.write(tmp_path / "a.las", replace(points(), columns=texts))
    far = np.array([[0.0, 0.0, 0.0], [1e7, 0.0, 0.0]])  # 1e11 digits
    with pytest.raises(InterchangeError, match="cannot hold the points"):
        las.write(tmp_path / "a.las", replace(points(), xyz=far, columns={}))
    assert not list(tmp_path.iterdir())


def test_named_columns_are_read_by_csv(tmp_path: Path) -> None:
    given = points()
    given = replace(given, columns=given.columns | {"why": LayerColumn.of(['dry, or "wet"'] * len(given.xyz))})
    text = same_twice(tmp_path / "a.csv", lambda target: xyz.write(target, given)).decode()
    names, *rows = csv.reader(text.splitlines())
    assert names == ["x", "y", "z", "depth [m]", "rays", "why"]
    np.testing.assert_allclose(np.array([row[:3] for row in rows], dtype=float), given.xyz, rtol=0, atol=DIGIT)
    assert rows[3][3:] == ["", "3", 'dry, or "wet"']
    answer = xyz.read(tmp_path / "a.csv", crs=UTM, heights=HEIGHTS)
    assert (answer.crs, answer.heights, answer.columns["depth"].unit) == (UTM, HEIGHTS, "m")
    for name, column in given.columns.items():
        if column.is_text:
            assert answer.columns[name].values.tolist() == column.values.tolist()
        else:
            np.testing.assert_allclose(answer.columns[name].values, column.values, rtol=0, atol=DIGIT)


def test_bare_numbers_are_read_by_numpy(tmp_path: Path) -> None:
    given = points()
    same_twice(tmp_path / "a.xyz", lambda target: xyz.write(target, given))
    table = np.loadtxt(tmp_path / "a.xyz")
    np.testing.assert_allclose(table[:, :3], given.xyz, rtol=0, atol=DIGIT)
    np.testing.assert_allclose(table[:, 3], given.columns["depth"].values, rtol=0, atol=DIGIT)
    answer = xyz.read(tmp_path / "a.xyz")
    np.testing.assert_array_equal(answer.xyz, table[:, :3])
    np.testing.assert_array_equal(answer.columns["column5"].values, given.columns["rays"].values)


def test_degrees_have_nine_decimals(tmp_path: Path) -> None:
    degrees = replace(points(pyproj.CRS("EPSG:4979")), xyz=np.array([[-64.123456789, 18.0, -3.0]]), columns={})
    xyz.write(tmp_path / "a.csv", degrees)
    assert (tmp_path / "a.csv").read_text() == "x,y,z\n-64.123456789,18.000000000,-3.0000\n"


def test_columns_of_coordinates_by_their_names(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("id,Depth [ft],Easting,Northing,Z\nA1,7,1,2,-3\n\nA2,,4,5,-6\n")
    answer = xyz.read(tmp_path / "a.csv", columns=("easting", "northing", "z"))
    assert answer.xyz.tolist() == [[1.0, 2.0, -3.0], [4.0, 5.0, -6.0]]
    assert answer.columns["id"].values.tolist() == ["A1", "A2"]
    depth = answer.columns["Depth"]
    assert depth.unit == "ft" and depth.values[0] == 7.0 and np.isnan(depth.values[1])


def test_names_of_coordinates_go_with_their_system(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("lon,lat,z\n1,2,3\n")
    for crs in (None, pyproj.CRS("EPSG:4979")):
        assert xyz.read(tmp_path / "a.csv", crs=crs).xyz.tolist() == [[1.0, 2.0, 3.0]]
    for crs in (pyproj.CRS(LOCAL), UTM):
        with pytest.raises(InterchangeError, match=r"no column x \[m\] among lon, lat, z"):
            xyz.read(tmp_path / "a.csv", crs=crs)


def test_texts_do_not_go_among_bare_numbers(tmp_path: Path) -> None:
    texts = {"why": LayerColumn.of(["dry"] * 40)}
    with pytest.raises(InterchangeError, match="columns why: texts in a file of bare numbers"):
        xyz.write(tmp_path / "a.xyz", replace(points(), columns=texts))
