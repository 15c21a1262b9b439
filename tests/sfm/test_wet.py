"""What is below the water: which statement goes first, what is undecided, areas and shorelines, and bad files."""

import json
from pathlib import Path

import numpy as np
import pytest

from musatpy.errors import DeckError, MusatError
from musatpy.sfm.model import ModelError
from musatpy.sfm.wet import NOTHING, Wet, read_flags, read_water, wetness

DRY, WET, UNDECIDED, SURFACE = Wet
POOL = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0], [0.0, 0.0]]


def test_heights_decide_beyond_three_sigmas_of_both() -> None:
    height, level = np.array([1.0, 0.51, 0.49, -0.49, -0.51, np.nan]), np.zeros(6)
    of = wetness(height, np.full(6, 0.1), level, np.sqrt(np.full(6, (0.5 / 3.0) ** 2 - 0.01)))
    assert of.code.tolist() == [DRY, DRY, UNDECIDED, UNDECIDED, WET, UNDECIDED]
    assert of.source.tolist() == [4, 4, 4, 4, 4, 0] and not of.against.any()
    assert of.counts() == {
        "dry by height": 2,
        "wet by height": 1,
        "undecided by default": 1,
        "undecided by height": 2,
    }


def test_the_first_that_speaks_decides() -> None:
    #                    flag   area   class
    rows = [
        (-5.0, WET, DRY, 0, WET, "flag"),
        (-5.0, DRY, WET, 40, DRY, "flag"),
        (0.1, DRY, WET, 40, DRY, "flag"),
        (-5.0, NOTHING, WET, 41, WET, "area"),
        (-0.1, NOTHING, WET, 40, UNDECIDED, "area"),
        (0.1, NOTHING, DRY, 41, UNDECIDED, "area"),
        (5.0, NOTHING, WET, 40, WET, "area"),
        (np.nan, NOTHING, WET, 0, WET, "area"),
    ]
    height, flags, areas, classes, code, source = map(np.array, zip(*rows, strict=True))
    sigma, level = np.full(8, 0.2), np.zeros(8)
    of = wetness(height, sigma, level, level, flags=flags, areas=areas, classes=classes)
    assert of.code.tolist() == code.tolist()
    names = ("", "flag", "area", "class", "height")
    assert [names[number] for number in of.source] == source.tolist()
    assert np.flatnonzero(of.against).tolist() == [1, 6]
    of = wetness(
        np.array([-5.0, -0.1, 0.0, 0.1, 5.0, -5.0, 0.1]),
        sigma[:7],
        level[:7],
        level[:7],
        classes=np.array([40, 40, 41, 42, 40, 2, 1]),
    )
    assert of.code.tolist() == [WET, UNDECIDED, SURFACE, SURFACE, WET, WET, UNDECIDED]
    assert of.source.tolist() == [3, 3, 3, 3, 3, 4, 4] and of.against.tolist() == [False] * 4 + [True, False, False]


def test_flags_of_points_in_a_table(tmp_path: Path) -> None:
    points, path = np.array(["a", "b", "c", "d", "e"]), tmp_path / "flags.csv"
    path.write_text("Label;note;Wet\nd;x;WET\na;;0\nb;;\nc;;B\n")
    assert read_flags(path, points).tolist() == [DRY, NOTHING, WET, WET, NOTHING]
    path.write_text("id,wet\na,1\nf,1\nb,damp\na,0\n")
    with pytest.raises(ModelError) as caught:
        read_flags(path, points)
    assert [problem.headline().rpartition("/flags.csv")[2] for problem in caught.value.problems] == [
        ":5 col 1 id: 'a' stands in line 2 already"
    ]
    path.write_text("id,wet\na,1\nf,1\nb,damp\n")
    with pytest.raises(ModelError) as caught:
        read_flags(path, points)
    assert [problem.headline().rpartition("/flags.csv")[2] for problem in caught.value.problems] == [
        ":3 col 1 id: there is no point 'f' in the model",
        ":4 cols 3-6 wet: 'damp' is none of wet, dry, 1, 0, B, D, yes, no, true, false",
    ]
    for text, why in (("id,wet\n", "there are no points"), ("id,depth\na,1\n", "no column wet among id, depth")):
        path.write_text(text)
        with pytest.raises(ModelError, match=why):
            read_flags(path, points)


def geojson(tmp_path: Path, *geometries: object) -> Path:
    features = [{"type": "Feature", "properties": {}, "geometry": geometry} for geometry in geometries]
    path = tmp_path / "water.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_areas_and_closed_lines_hold_what_is_in_them(tmp_path: Path) -> None:
    hole = [[4.0, 4.0], [6.0, 4.0], [6.0, 6.0], [4.0, 6.0], [4.0, 4.0]]
    lake = [[x + 20.0, y] for x, y in POOL]
    path = geojson(
        tmp_path,
        {"type": "Polygon", "coordinates": [POOL, hole]},
        {"type": "MultiLineString", "coordinates": [lake]},
    )
    plan = np.array([[1.0, 1.0], [5.0, 5.0], [15.0, 5.0], [25.0, 5.0], [-1.0, 5.0], [np.nan, 5.0]])
    assert read_water(path, geographic=False).holds(plan).tolist() == [True, False, False, True, False, False]
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [POOL]}))
    assert read_water(path, geographic=True).holds(plan).tolist() == [True, True, False, False, False, False]


def test_heights_decide_near_a_shore_of_a_model_that_is_off(tmp_path: Path) -> None:
    water = read_water(geojson(tmp_path, {"type": "Polygon", "coordinates": [POOL]}), geographic=False)
    plan = np.array([[5.0, 5.0], [0.4, 5.0], [-0.4, 5.0], [-0.8, 5.0], [0.8, 5.0], [10.4, 10.4]])
    assert water.codes(plan, 0.5).tolist() == [WET, NOTHING, NOTHING, DRY, WET, DRY]
    path = geojson(tmp_path, {"type": "LineString", "coordinates": [[-122.5, 47.0], [-122.5, 48.0]]})
    shore, metre = read_water(path, "right", geographic=True), 1.0 / 111195.0
    east = -122.5 + np.array([-3.0, -1.0, 1.0, 3.0]) * metre / np.cos(np.radians(47.5))
    codes = shore.codes(np.column_stack([east, np.full(4, 47.5)]), 2.0 * metre)
    assert codes.tolist() == [DRY, NOTHING, NOTHING, WET]
    stations = np.radians([[47.5, 237.49, 0.0], [47.51, 237.5, 0.0]])  # east of Greenwich to the end
    assert len(read_water(path, "right", geographic=True, stations=stations).shore)
    with pytest.raises(
        ModelError, match=r"it has water at .* alone; expected: some near the photos, which are at 243"
    ):
        read_water(path, "right", geographic=True, stations=stations + 0.1)


def test_a_shoreline_has_the_water_on_one_side(tmp_path: Path) -> None:
    # a spit of land between its two arms: only the nearest part that is most across says the side at its tip
    shore = [[0.0, 0.0], [100.0, 4.0], [0.0, 8.0], [0.0, 8.0]]
    path = geojson(tmp_path, {"type": "LineString", "coordinates": shore})
    plan = np.array(
        [[50.0, -5.0], [50.0, 4.0], [50.0, 12.0], [120.0, 3.0], [120.0, 5.0], [101.0, 4.0], [99.0, 4.0]]
    )
    land = np.array([False, True, False, False, False, False, True])
    assert (read_water(path, "left", geographic=False).holds(plan) == land).all()
    assert (read_water(path, "right", geographic=False).holds(plan) == ~land).all()
    # degrees are shorter along parallels: at 60 degrees the arm in the east is nearer than the one in the south
    north = [[0.0, 60.0], [0.013, 60.0], [0.013, 60.02], [0.0, 60.02]]
    path = geojson(tmp_path, {"type": "LineString", "coordinates": north})
    water = read_water(path, "left", geographic=True)
    assert water.holds(np.array([[0.004, 60.005], [0.02, 60.005], [0.004, 59.995]])).tolist() == [
        True,
        False,
        False,
    ]
    many = water.holds(np.tile([[0.004, 60.005], [0.02, 60.005]], (3000, 1)))
    assert many.tolist() == [True, False] * 3000


@pytest.mark.filterwarnings("ignore:'crs' was not provided")
def test_other_files_of_gis_come_to_degrees_by_their_system(tmp_path: Path) -> None:
    raw, shapely = pytest.importorskip("pyogrio.raw"), pytest.importorskip("shapely")
    corners = np.array([[500000.0, 5000000.0], [501000.0, 5000000.0], [501000.0, 5001000.0], [500000.0, 5001000.0]])
    polygon = shapely.to_wkb(np.array([shapely.polygons(corners)]))
    for crs, name in (("EPSG:32632", "a.gpkg"), (None, "b.gpkg")):
        raw.write(tmp_path / name, geometry=polygon, field_data=[], fields=[], geometry_type="Polygon", crs=crs)
    water = read_water(tmp_path / "a.gpkg", geographic=True)
    assert water.holds(np.array([[9.006, 45.155], [9.006, 45.15], [8.99, 45.155]])).tolist() == [True, False, False]
    local = read_water(tmp_path / "b.gpkg", geographic=False)
    assert local.holds(np.array([[500500.0, 5000500.0], [499000.0, 5000500.0]])).tolist() == [True, False]
    with pytest.raises(ModelError, match="it has no coordinate system; expected: one that leads to WGS 84"):
        read_water(tmp_path / "b.gpkg", geographic=True)
    (tmp_path / "c.gpkg").write_bytes(b"SQLite format 3\0" + b"x" * 100)
    with pytest.raises(MusatError, match=r"c.gpkg: is no file of GIS that is read"):
        read_water(tmp_path / "c.gpkg", geographic=False)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("{", "it has no features; expected: GeoJSON"),
        ("[1]", "it has no features; expected: GeoJSON"),
        (
            '{"type": "FeatureCollection", "features": []}',
            "it has nothing; expected: polygons, or lines of a shore",
        ),
        ('{"type": "Point", "coordinates": [1, 2]}', "it has a geometry of the kind Point; expected: polygons"),
        (
            '{"type": "LineString", "coordinates": [[1, 2], [3, 4]]}',
            "a shoreline that is not closed; expected: a side",
        ),
        ('{"type": "MultiLineString", "coordinates": [[1, 2], 3]}', "a shoreline that is not closed"),
        (
            '{"type": "Polygon", "coordinates": [[[5e5, 5e6], [6e5, 5e6], [6e5, 6e6]]]}',
            "longitude and latitude in de",
        ),
    ],
)
def test_files_that_say_nothing_of_water(tmp_path: Path, content: str, why: str) -> None:
    (tmp_path / "water.json").write_text(content)
    with pytest.raises(ModelError, match=why):
        read_water(tmp_path / "water.json", geographic=True)


def test_lines_and_rings_that_are_none(tmp_path: Path) -> None:
    for line in ([[1, 2], 3], [[1], [2]], [["a", "b"], ["c", "d"]]):
        with pytest.raises(
            ModelError, match="a line whose coordinates are no positions; expected: two numbers of each"
        ):
            read_water(geojson(tmp_path, {"type": "LineString", "coordinates": line}), "left", geographic=False)
    with pytest.raises(DeckError, match="an area needs polygons, of three corners at least each"):
        read_water(geojson(tmp_path, {"type": "Polygon", "coordinates": [[[1, 2], [3, 4]]]}), geographic=False)
