"""Tables of points by whatever parts their values, whatever their columns are called, and every fault of a file."""

import csv
from pathlib import Path

import numpy as np
import pytest

from depth.lagoon import by_photographs
from musatpy.correction.files import correct_table
from musatpy.correction.methods import TRUE
from musatpy.errors import DepthError
from musatpy.pointfiles import point_tables
from musatpy.pointfiles.columns import AXES, MAP_PLACES, PLAN, FileColumn, Wanted, place_columns
from musatpy.pointfiles.point_tables import PointTable, read_chunks, read_table

POINTS = Wanted(columns=place_columns(), bare=AXES)
STATIONS = Wanted(
    columns=(
        FileColumn(name="name", kind="text", unique=True, expected="a name"),
        *place_columns(),
        FileColumn(name="sigma", unit="m", required=False, blank=True, least=0.0, expected="0 or more, or nothing"),
        FileColumn(name="day", kind="date", required=False, blank=True, expected="a date YYYY-MM-DD"),
    ),
    closed=True,
)
PLACED = Wanted(
    columns=(*MAP_PLACES, FileColumn(name="depth", unit="m"), FileColumn(name="height", unit="m")),
    forms=((*PLAN, "depth"), (*PLAN, "height"), ("lat", "lon", "depth")),
)


def table_of(tmp_path: Path, text: str, wanted: Wanted = POINTS) -> PointTable:
    """Return the table of a text."""
    (tmp_path / "a.csv").write_text(text, newline="")
    return read_table(tmp_path / "a.csv", wanted)


def faults(table: PointTable) -> list[str]:
    """Return what is wrong with a table in its lines."""
    if not table.problems:
        return []
    with pytest.raises(DepthError) as caught:
        table.require(DepthError)
    return [problem.headline().rpartition("/a.csv")[2] for problem in caught.value.problems]


@pytest.mark.parametrize(
    "text",
    [
        "id,x,y,z\nA,500,400.25,-3.5\nB,510,410.5,-4\n",
        "\ufeffid;X;Y;Z\r\nA;500;400,25;-3,5\r\nB;510;410,5;-4\r\n",
        "Label\tEasting\tNorthing\tElevation\nA\t500\t400,25\t-3.5\n# off\nB\t510\t410.5\t-4\n",
        "z|north|east\n-3.5|400.25|500\n ||\n-4|410.5|510\n",
        "500 400.25 -3.5\n510  410.5 -4\n",
        "500 400,25 -3,5\n510 410,5 -4",
        "500,400.25,-3.5\r510,410.5,-4\r",
        "500;400,25;-3,5;dry\n510;410,5;-4;wet\n",
        "# Cameras (2)\n#Label,X/Easting,Y/Northing,Z/Altitude\nD1.JPG,500,400.25,-3.5\nD2.JPG,510,410.5,-4\n",
        "# of May\nx [m], y [m], height [metres], note\n500,400.25,-3.5,\"a, b\"\n\n510,410.5,-4,c;d\n,,,\n",
        "//X Y Z R\n500 400.25 -3.5 1\n510 410.5 -4 1\n",
        "X (m),Y (m),Z (m)\n500,400.25,-3.5\n510,410.5,-4\n",
        "x,y,z,2020\n500,400.25,-3.5,1\n510,410.5,-4,1\n",
        'Z,"text",X,Y\n-3.5,"a ""b""",500,400.25\n-4,, 510 ,410.5\n',
    ],
)  # fmt: skip
def test_points_by_all_separators_and_names(tmp_path: Path, text: str) -> None:
    table = table_of(tmp_path, text)
    assert faults(table) == [] and table.numbers(*AXES).tolist() == [[500.0, 400.25, -3.5], [510.0, 410.5, -4.0]]


def test_columns_go_by_their_own_names_first_and_by_no_name_of_another_kind_of_place(tmp_path: Path) -> None:
    table = table_of(tmp_path, "easting,height,x,y,z\n9,8,1,2,3\n")
    assert table.numbers(*AXES).tolist() == [[1.0, 2.0, 3.0]]
    assert table.others() == {"easting": (["9"], ""), "height": (["8"], "")}
    for units, text in ((("m",) * 3, "lon,lat,z\n1,2,3\n"), (("degree", "degree", "m"), "east,north,z\n1,2,3\n")):
        unit = {"m": "m"}.get(units[0], "deg")
        assert faults(table_of(tmp_path, text, Wanted(columns=place_columns(units=units)))) == [
            f":1: no column {name} [{unit}] among {text.split()[0].replace(',', ', ')}" for name in "xy"
        ]
    degrees = Wanted(columns=place_columns(units=("degree", "degree", "m")))
    for text in (
        "lat,long,height\n2,1,3\n",
        "X/Longitude,Y/Latitude,Z/Altitude\n1,2,3\n",
        "x [deg],y [°],z\n1,2,3",
    ):
        assert table_of(tmp_path, text, degrees).numbers(*AXES).tolist() == [[1.0, 2.0, 3.0]]
    named = Wanted(columns=place_columns(("e", "n", "Up")))
    assert table_of(tmp_path, "UP,N,E\n3,2,1\n", named).numbers("e", "n", "up").tolist() == [[1.0, 2.0, 3.0]]
    assert faults(table_of(tmp_path, "x,y,z\n1,2,3\n", named))[0] == ":1: no column e [m] among x, y, z"


@pytest.mark.parametrize(
    ("wanted", "text", "messages"),
    [
        (POINTS, "", [": no line of names or values"]),
        (POINTS, "# x\n\n", [": no line of names or values"]),
        (POINTS, "a,x,y\n1,2,3\n", [":1: no column z [m] among a, x, y"]),
        (POINTS, "1,2\n", [": no column z [m] among x, y"]),
        (POINTS, "x,X,y,z\n", [":1: more than one column x among x, X, y, z"]),
        (POINTS, "east,easting,y,z\n", [":1: more than one column x among east, easting, y, z"]),
        (POINTS, "x,y,Height [ft]\n1,2,3\n", [":1: column Height is in ft: m is needed"]),
        (Wanted(columns=POINTS.columns, added=("a",)), "x,y,z,A\n", [":1: there is a column A already"]),
        (POINTS, 'x,"y\n",z\n1,2,3\n', [": no line of names or values"]),
        (STATIONS, "id,x,y,z,roll\n", [":1: unknown column roll"]),
        (STATIONS, "x,y,z\n1,2,3\n", [":1: no column name among x, y, z"]),
        (Wanted(columns=POINTS.columns, together=(AXES,)), "x,z\n", [
            ":1: no column y [m] among x, z", ":1: x, y, z go together: only x, z found"
        ]),
        (PLACED, "x,lat,depth\n", [
            ":1: no columns x, y, depth or x, y, height or lat, lon, depth among x, lat, depth"
        ]),
        (PLACED, "x,y,depth,z\n", [":1: columns depth and height: one is meant"]),
        (PLACED, "x,y,depth,lon,lat\n", [":1: columns x, y and lat, lon: one is meant"]),
    ],
)  # fmt: skip
def test_names_that_cannot_be_used(tmp_path: Path, wanted: Wanted, text: str, messages: list[str]) -> None:
    table = table_of(tmp_path, text, wanted)
    assert faults(table) == messages and not table.rows


def test_every_fault_of_a_file_by_line_and_column(tmp_path: Path) -> None:
    text = (
        "name,x,y,z,sigma,day\nA,1,2,3,,\nB,1_0,two,nan,-1,1979-02-30\n,1e16,,٣,inf,\nA,1,2,3,0,2024-02-29\n"
        'C,1,2\nD,1,2,3,"4,5\nE,1,2,3,,,\n"F",1,b,3,,\n'
    )
    table = table_of(tmp_path, text, STATIONS)
    assert faults(table) == [
        ":3 cols 3-5 x: '1_0' is not a number",
        ":3 cols 7-9 y: 'two' is not a number",
        ":3 cols 11-13 z: 'nan' is not a number",
        ":3 cols 15-16 sigma: '-1' is not 0 or more, or nothing",
        ":3 cols 18-27 day: '1979-02-30' is not a date YYYY-MM-DD",
        ":4 col 1 name: is missing",
        ":4 cols 2-5 x: '1e16' is not a number",
        ":4 col 7 y: is missing",
        ":4 col 8 z: '٣' is not a number",
        ":4 cols 10-12 sigma: 'inf' is not 0 or more, or nothing",
        ":5 col 1 name: 'A' stands in line 2 already",
        ":6: 3 values for 6 columns",
        ":7: a text in quotes does not end on its line",
        ":8: 7 values for 6 columns",
        ":9 y: 'b' is not a number",
    ]
    assert table.texts("name") == ["A", "B", "", "A", "F"] and np.isnan(table.numbers("sigma")[0])
    good = table_of(tmp_path, "label;x;y;z;day\nA;1;2;3;2024-02-29\nB;1;2;1e-16;\n", STATIONS)
    assert good.dates("day").astype(str).tolist() == ["2024-02-29", "NaT"]
    assert good.numbers("z").tolist() == [3.0, 0.0] and good.lines == [2, 3]
    for text in (
        "x y z\n1 2 3\n1 zwei 3\n",
        "x;y;z\n1;2;3\n1;1.234,5;3\n",
        "1 2 3\n1_0 2 3",
        "1 2 3 4\n1 2 3 a b\n",
    ):
        assert len(faults(table_of(tmp_path, text))) == 1
    assert faults(table_of(tmp_path, "lat,lon,depth\n95,2,3\n", PLACED)) == [
        ":2 cols 1-2 lat: '95' is not -90 to 90 degrees"
    ]
    (problem,) = table_of(tmp_path, "x,y,z\n1, two,3\n").problems
    assert (problem.found, problem.expected, problem.text) == ("two", "a number", "1, two,3")


def test_files_of_any_size_come_in_chunks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers alone and with texts, up to the first fault; the rest is looked through up to a hundred faults."""
    monkeypatch.setattr(point_tables, "CHUNK", 20)
    numbers = np.random.default_rng(1).uniform(-9.0, 9.0, (50, 3)).round(3)
    rows = [",".join(map(str, row)) for row in numbers.tolist()]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["x,y,z", *rows, ""]))
    for wanted in (POINTS, Wanted(columns=(*place_columns(), FileColumn(name="id", kind="text", required=False)))):
        tables = list(read_chunks(path, wanted, DepthError))
        assert [len(table.rows) for table in tables] == [20, 20, 10] and tables[1].lines[0] == 22
        np.testing.assert_array_equal(np.concatenate([table.numbers(*AXES) for table in tables]), numbers)
        assert sum(table.size for table in tables) == path.stat().st_size
    path.write_text("\n".join(["x,y,z", *rows[:20], "1,2,x", *rows, *(["1,2"] * 200)]))
    chunks = read_chunks(path, POINTS, DepthError)
    assert len(next(chunks).rows) == 20
    with pytest.raises(DepthError) as caught:
        next(chunks)
    assert len(caught.value.problems) == 100 and [p.line for p in caught.value.problems[:2]] == [22, 73]
    empty = tmp_path / "empty.csv"
    empty.write_text("x,y,z")
    (table,) = read_chunks(empty, POINTS, DepthError)
    assert table.rows == [] and table.numbers(*AXES).shape == (0, 3)
    with pytest.raises(DepthError, match=r"empty\.csv: no point"):
        table.require(DepthError, empty="no point")


def test_a_row_comes_out_as_it_stands_with_decimal_commas_behind_it(tmp_path: Path) -> None:
    """What is corrected is the same whatever parts the values, to the digit."""
    method = by_photographs()
    added = [*TRUE, *method.in_table]
    plain, semicolons, bare = tmp_path / "a.csv", tmp_path / "b.csv", tmp_path / "c.xyz"
    plain.write_text("name,x,y,z\nA.1,500.5,400,-3\nB,500,,-3\n")
    semicolons.write_bytes(b"name;x;y;z\r\nA.1;500,5;400;-3\r\nB;500;;-3,0\r\n")
    bare.write_text("500,5 400 -3\n")
    rows = {}
    for source, delimiter in ((plain, ","), (semicolons, ";"), (bare, ",")):
        correct_table(source, tmp_path / "out.csv", method)
        assert b"\r" not in (tmp_path / "out.csv").read_bytes()  # of the line, not of its last value
        rows[source] = list(csv.reader((tmp_path / "out.csv").open(), delimiter=delimiter))
    assert rows[plain][0] == ["name", "x", "y", "z", *added] and rows[bare][0] == ["x", "y", "z", *added]
    assert rows[semicolons][1][:4] == ["A.1", "500,5", "400", "-3"]
    assert [cell.replace(",", ".") for cell in rows[semicolons][1]] == rows[plain][1]
    assert rows[plain][1][1:] == rows[bare][1] and float(rows[plain][1][7]) > 3.0
    assert rows[plain][2][-1] == rows[semicolons][2][-1] == "a coordinate is no number"
