"""Files of soundings: names of columns, places, dates, LAS files, and what cannot be used, with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyproj
import pytest

from musatpy.errors import ProblemsError, SoundingError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.interchange import las
from musatpy.interchange.layers import Column, Points
from musatpy.soundings.sounding_files import read_soundings
from musatpy.units import DEGREE

WGS84 = Ellipsoid("", 6378137.0, 298.257223563)
EAST, NORTH = 290000.0, 2030000.0


def test_soundings_are_read_by_their_names(tmp_path: Path) -> None:
    file = tmp_path / "s.csv"
    file.write_text("Longitude, Latitude,Depth,sigma,id\n-64.93,18.33,2.5,0.2,A\n\n-64.94,18.34,-0.3,0.1,B\n")
    soundings = read_soundings(file)
    assert soundings.angular and soundings.names.tolist() == ["A", "B"]
    np.testing.assert_allclose(soundings.place[0] / DEGREE, [18.33, -64.93])
    assert soundings.depth.tolist() == [2.5, -0.3] and soundings.sigma.tolist() == [0.2, 0.1]
    file.write_text("x,y,z\n1,2,-3\n")
    assert read_soundings(file).depth.tolist() == [3.0] and not read_soundings(file).angular


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("\n\n", "the file is empty"),
        ("a,b\n", "no columns lat and lon"),
        ("x,y\n1,2\n", "no column depth or height"),
        ("x;y;depth\n1;2;3\n", "semicolons"),
        ("x,y,depth\n", "no sounding"),
        ("x,y,depth,depth\n1,2,3,4\n", "more than one column depth"),
        ("x,y,depth,z\n1,2,3,4\n", "columns depth and height"),
        ("lat,lon,x,y,depth\n1,2,3,4,5\n", "columns lat and x"),
        ("lat,lon,depth\n950,2,3\n", "-90 to 90 degrees"),
        ("x,y,depth,sigma\n1,2,3,abc\n", "0 or more"),
        ("x,y,depth,sigma\n1,2,3,-1\n", "0 or more"),
        ("x,y,depth\n1,2,3\n1,b,3\n1,2\n", "3.*y.*'b'|a number"),
    ],
)
def test_files_that_cannot_be_used(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "s.csv"
    file.write_text(text)
    with pytest.raises(SoundingError, match=message) as caught:
        read_soundings(file)
    if "1,b,3" in text:
        assert [problem.line for problem in caught.value.problems] == [3, 4]


def test_lines_are_counted_through_line_breaks_in_cells(tmp_path: Path) -> None:
    file = tmp_path / "s.csv"
    file.write_text('name,x,y,depth\n"A\nof\nB",1,2,3\n\n"C\n",1,b,3\nD,1,2,x\n')
    with pytest.raises(SoundingError) as caught:
        read_soundings(file)
    assert [(problem.line, problem.field) for problem in caught.value.problems] == [(6, "y"), (8, "depth")]
    file.write_text('x,y,depth,remark\n1,2,3,"a\nb"\n1,2,4,c\n')
    assert read_soundings(file).names.tolist() == ["2", "4"]


def test_dates_are_read_where_they_are_asked_for(tmp_path: Path) -> None:
    file = tmp_path / "s.csv"
    file.write_text("x,y,depth,Date\n1,2,3,1979-12-31\n1,2,4,\n1,2,5\n")
    assert read_soundings(file, dated=True).date.astype(str).tolist() == ["1979-12-31", "NaT", "NaT"]
    file.write_text("x,y,depth,Date\n1,2,3,12/31/79\n1,2,4,1979-02-30\n")
    assert np.isnat(read_soundings(file).date).all()
    with pytest.raises(SoundingError, match="3 date: '1979-02-30' is not a date YYYY-MM-DD") as caught:
        read_soundings(file, dated=True)
    assert [problem.line for problem in caught.value.problems] == [2, 3]
    file.write_text("x,y,depth\n1,2,3\n")
    with pytest.raises(SoundingError, match="no column date"):
        read_soundings(file, dated=True)


def cloud(crs: str = "", **columns: list[float]) -> Points:
    xyz = np.array([[EAST, NORTH, -3.5], [EAST + 100.0, NORTH + 50.0, 0.25]])
    values = {name: Column.of(np.array(of), "m") for name, of in columns.items()}
    return Points(xyz=xyz, columns=values, crs=pyproj.CRS(crs) if crs else None)


def test_las_files(tmp_path: Path) -> None:
    """Heights with the opposite sign, or the extra bytes depth and sigma; places by the system of the file."""
    file = tmp_path / "s.laz"
    las.write(file, cloud())
    plain = read_soundings(file)
    np.testing.assert_allclose(plain.depth, [3.5, -0.25], atol=1e-4)  # the scale of the file
    np.testing.assert_allclose(plain.place, [[EAST, NORTH], [EAST + 100.0, NORTH + 50.0]], atol=1e-4)
    assert not plain.angular and np.isnan(plain.sigma).all() and plain.names.tolist() == ["1", "2"]
    las.write(file, cloud("EPSG:32620", depth=[3.1, 0.5], sigma=[0.1, 0.2]))
    mapped = read_soundings(file, WGS84)
    longitude, latitude = pyproj.Transformer.from_crs("EPSG:32620", "EPSG:4326", always_xy=True).transform(
        EAST, NORTH
    )
    np.testing.assert_allclose(mapped.place[0] / DEGREE, [latitude, longitude], atol=1e-9)  # 0.1 mm
    assert mapped.angular and mapped.depth.tolist() == [3.1, 0.5] and mapped.sigma.tolist() == [0.1, 0.2]
    for job, message in ((None, "the job in a local one"), (Ellipsoid("", 6378206.4, 294.978698214), "ellipsoid")):
        with pytest.raises(SoundingError, match=message):
            read_soundings(file, job)
    with pytest.raises(SoundingError, match="no column date"):
        read_soundings(file, WGS84, dated=True)
    las.write(file, cloud(depth=[3.1, np.nan]))
    with pytest.raises(SoundingError, match="1 points have no depth, point 2 first"):
        read_soundings(file)
    (tmp_path / "t.las").write_text("x")
    with pytest.raises(ProblemsError, match="LAS"):
        read_soundings(tmp_path / "t.las")


def test_places_of_a_map_that_is_named(tmp_path: Path) -> None:
    file = tmp_path / "s.csv"
    file.write_text(f"x,y,depth\n{EAST},{NORTH},3\n")
    soundings = read_soundings(file, WGS84, crs="EPSG:32620")
    longitude, latitude = pyproj.Transformer.from_crs("EPSG:32620", "EPSG:4326", always_xy=True).transform(
        EAST, NORTH
    )
    assert soundings.angular
    np.testing.assert_allclose(soundings.place[0] / DEGREE, [latitude, longitude], atol=1e-9)  # 0.1 mm
    assert not read_soundings(file, WGS84).angular
