"""DXF drawings, read by GDAL; and what other programs draw, written by ezdxf."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import ezdxf
import numpy as np
import pyproj
import pytest
import shapely
from pyogrio import raw

from interchange.layer_samples import DIGIT, HEIGHTS, UTM, lines, points, same_twice
from musatpy.errors import InterchangeError
from musatpy.interchange import dxf


def test_a_drawing_is_read_by_gdal(tmp_path: Path) -> None:
    path, contours, spots = tmp_path / "a.dxf", lines(), points()
    same_twice(path, lambda target: dxf.write(target, {"contours": contours, "spots": spots}))
    meta, _, encoded, values = raw.read(path)
    fields = dict(zip(meta["fields"], values, strict=True))
    shapes = shapely.from_wkb(encoded)
    drawn = [shape for shape in shapes if shape.geom_type == "LineString"]
    for shape, line, closed in zip(drawn, contours.vertices, contours.closed, strict=True):
        xyz = shapely.get_coordinates(shape, include_z=True)
        np.testing.assert_allclose(xyz[: len(line)], line, rtol=0, atol=DIGIT)
        assert shape.is_closed == closed
    names = fields["Layer"][[shape.geom_type == "LineString" for shape in shapes]]
    assert names.tolist() == [f"CONTOURS_{depth}" for depth in ("2_5", "5", "7_5", "10", "12_5", "15")]
    at = [shape.geom_type == "Point" and not text for shape, text in zip(shapes, fields["Text"], strict=True)]
    xyz = shapely.get_coordinates(shapes[at], include_z=True)
    np.testing.assert_allclose(xyz, spots.xyz, rtol=0, atol=DIGIT)
    texts = [text for text in fields["Text"] if text]
    assert texts == [f"{depth:.1f}" for depth in spots.columns["depth"].values if np.isfinite(depth)]


@pytest.mark.parametrize("crs", [UTM, None, pyproj.CRS("+proj=tmerc +lat_0=18.3 +lon_0=-64.9 +ellps=clrk66")])
def test_what_is_read_is_what_was_written(tmp_path: Path, crs: pyproj.CRS | None) -> None:
    contours, spots = lines(crs), points(crs)
    dxf.write(tmp_path / "a.dxf", {"contours": contours, "spots": spots})
    dots, drawn = dxf.read(tmp_path / "a.dxf")
    assert dots.heights == drawn.heights == HEIGHTS
    assert (dots.crs, drawn.crs) == (crs, crs)
    np.testing.assert_allclose(dots.xyz, spots.xyz, rtol=0, atol=DIGIT)
    np.testing.assert_array_equal(drawn.closed, contours.closed)
    np.testing.assert_allclose(np.array(drawn.vertices), np.array(contours.vertices), rtol=0, atol=DIGIT)
    assert drawn.columns["layer"].values[0] == "CONTOURS_2_5"


@pytest.mark.parametrize("release", ["R12", "R2000", "R2018"])
def test_plain_drawings_are_read_as_ezdxf_has_them(
    tmp_path: Path, release: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By GDAL and by ezdxf: lines of every plain kind, closed, elevated, with names of other scripts."""
    document = ezdxf.new(release)
    space = document.modelspace()
    for row, name in enumerate(("Tiefe_5", "HÖHE" if release != "R12" else "HOEHE", "0")):
        at = {"layer": name, "color": row}
        space.add_polyline3d([(row, 0, -1), (1, 1, -2), (2, 0.5, -3.25)], close=row == 1, dxfattribs=at)
        space.add_line((row, 0, -1), (1, 1, -2), dxfattribs=at)
        space.add_point((1, 2, -3 - row), dxfattribs=at)
        space.add_text("5", dxfattribs=at)
        if release != "R12":
            space.add_lwpolyline([(row, 0), (1, 1), (2, -1)], close=True, dxfattribs=at | {"elevation": -5})
    document.saveas(tmp_path / "a.dxf")
    dots, drawn = dxf.read(tmp_path / "a.dxf")
    with monkeypatch.context() as patch:
        patch.setattr(ezdxf, "readfile", None)
        dxf.read(tmp_path / "a.dxf")
    monkeypatch.setattr(dxf, "_by_gdal", lambda *_: None)
    other_dots, other_drawn = dxf.read(tmp_path / "a.dxf")
    np.testing.assert_array_equal(dots.xyz, other_dots.xyz)
    assert dots.columns["layer"].values.tolist() == other_dots.columns["layer"].values.tolist()
    assert drawn.columns["layer"].values.tolist() == other_drawn.columns["layer"].values.tolist()
    assert len(drawn.vertices) == (9 if release != "R12" else 6)
    np.testing.assert_array_equal(drawn.closed, other_drawn.closed)
    for line, other in zip(drawn.vertices, other_drawn.vertices, strict=True):
        np.testing.assert_array_equal(line, other)


@pytest.mark.parametrize("what", ["extruded", "paper", "block", "bent", "fitted", "binary", "old"])
def test_what_gdal_would_change_goes_through_ezdxf(tmp_path: Path, what: str) -> None:
    """What is tilted, bent, elevated in the old way or stands in blocks; what is hidden is left out."""
    document = ezdxf.new("R2010")
    space = document.modelspace()
    space.add_polyline3d([(0, 0, -1), (1, 1, -2)])
    points = [(0.0, 0.0), (1.0, 1.0), (2.0, 0.0)]
    if what == "extruded":
        space.add_lwpolyline(points, dxfattribs={"extrusion": (0, 0, -1), "elevation": 5})
    elif what == "paper":
        document.paperspace().add_polyline3d([(0, 0, -1), (1, 1, -2)])
    elif what == "old":
        space.add_polyline2d([(0, 0), (3, 1)], dxfattribs={"elevation": (0, 0, -7)})
    elif what == "block":
        document.blocks.new("B").add_line((0, 0, -1), (1, 1, -1))
        space.add_blockref("B", (0, 0))
    elif what == "bent":
        space.add_polyline2d([(0, 0, 0, 0, 0.5), (1, 1, 0, 0, 0)], format="xyseb")
    elif what == "fitted":
        space.add_polyline3d([(0, 0, -1), (1, 1, -2)]).dxf.flags |= 2
    document.saveas(tmp_path / "a.dxf", fmt="bin" if what == "binary" else "asc")
    if what in ("block", "bent", "fitted"):
        with pytest.raises(InterchangeError, match=r"of the kind (INSERT|POLYLINE with curves)"):
            dxf.read(tmp_path / "a.dxf")
        return
    _, drawn = dxf.read(tmp_path / "a.dxf")
    assert drawn.vertices[0].tolist() == [[0.0, 0.0, -1.0], [1.0, 1.0, -2.0]]
    assert len(drawn.vertices) == (2 if what in ("extruded", "old") else 1)
    if what == "old":
        assert drawn.vertices[1].tolist() == [[0.0, 0.0, -7.0], [3.0, 1.0, -7.0]]
    if what == "extruded":  # x and z turned over
        assert drawn.vertices[1].tolist() == [[0.0, 0.0, -5.0], [-1.0, 1.0, -5.0], [-2.0, 0.0, -5.0]]


def drawing(path: Path, *kinds: str) -> Path:
    """Write a drawing of a newer release with entities of some kinds."""
    document = ezdxf.new("R2010")
    space = document.modelspace()
    draw = {
        "elevated": lambda: space.add_lwpolyline(
            [(0, 0), (1, 1), (2, 0)], close=True, dxfattribs={"elevation": -5}
        ),
        "flat": lambda: space.add_lwpolyline([(0, 0), (1, 1)], dxfattribs={"layer": "FLAT"}),
        "old": lambda: space.add_polyline2d([(0, 0), (3, 1)], dxfattribs={"elevation": (0, 0, -7)}),
        "line": lambda: space.add_line((0, 0, -1), (1, 1, -2)),
        "bulge": lambda: space.add_lwpolyline([(0, 0, 0.5), (1, 1, 0)], format="xyb", dxfattribs={"layer": "B"}),
        "circle": lambda: space.add_circle((0, 0), 5, dxfattribs={"layer": "C"}),
        "point": lambda: space.add_point((1, 2, -3)),
        "text": lambda: space.add_text("5"),
    }
    for kind in kinds:
        draw[kind]()
    document.saveas(path)
    return path


def test_polylines_of_each_kind_are_read(tmp_path: Path) -> None:
    dots, drawn = dxf.read(drawing(tmp_path / "a.dxf", "elevated", "old", "line", "point", "text"), crs=UTM)
    assert dots.xyz.tolist() == [[1.0, 2.0, -3.0]]
    assert [line.tolist() for line in drawn.vertices] == [
        [[0.0, 0.0, -5.0], [1.0, 1.0, -5.0], [2.0, 0.0, -5.0]],
        [[0.0, 0.0, -7.0], [3.0, 1.0, -7.0]],
        [[0.0, 0.0, -1.0], [1.0, 1.0, -2.0]],
    ]
    assert drawn.closed.tolist() == [True, False, False]
    assert drawn.crs == UTM


@pytest.mark.parametrize(
    ("kinds", "words"),
    [
        (
            ("flat",),
            ["no line has a height (2-D): LWPOLYLINE; expected: 3-D polylines, or polylines with an elevation"],
        ),
        (("text",), ["the drawing has none; expected: points, lines and polylines"]),
        (
            ("circle", "circle", "bulge", "line"),
            [
                "layer C: 2 of the kind CIRCLE; expected: points, lines and polylines",
                "layer B: 1 of the kind LWPOLYLINE with curves; expected: points, lines and polylines",
            ],
        ),
    ],
)
def test_drawings_without_what_is_needed(tmp_path: Path, kinds: tuple[str, ...], words: list[str]) -> None:
    with pytest.raises(InterchangeError) as caught:
        dxf.read(drawing(tmp_path / "a.dxf", *kinds))
    assert Counter(problem.message for problem in caught.value.problems) == Counter(words)


def test_coordinates_that_are_no_numbers(tmp_path: Path) -> None:
    dxf.write(tmp_path / "a.dxf", {"spots": replace(points(), columns={})})
    text = (tmp_path / "a.dxf").read_text()
    x = f"{points().xyz[0, 0]:.4f}".rstrip("0")
    assert x in text
    (tmp_path / "a.dxf").write_text(text.replace(x, "nan", 1))
    with pytest.raises(InterchangeError, match="layer SPOTS: a coordinate is no number"):
        dxf.read(tmp_path / "a.dxf")


def test_drawings_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InterchangeError, match="different coordinate systems"):
        dxf.write(tmp_path / "a.dxf", {"a": points(), "b": lines(None)})
    with pytest.raises(InterchangeError, match="a name of 32 characters"):
        dxf.write(tmp_path / "a.dxf", {"n" * 32: replace(points(), columns={})})
    assert not list(tmp_path.iterdir())
