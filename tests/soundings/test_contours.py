"""Distances of contours, and files of them."""

from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely

from musatpy.arrays import FloatArray
from musatpy.errors import ProblemsError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.interchange import dxf, geojson, geopackage
from musatpy.interchange.layers import LayerColumn, Lines, Points
from musatpy.soundings.contours import ContourLines, area_between, largest_of_most, offsets, read_contours
from musatpy.units import DEGREE

ROUNDING = 1e-9  # m


def line(*vertices: tuple[float, float]) -> FloatArray:
    return np.array(vertices, dtype=float)


def circle(radius: float, number: int = 3600) -> FloatArray:
    """Return a closed polygon, at most 4e-5 m within a circle of 100 m."""
    angle = np.linspace(0.0, 2.0 * np.pi, number + 1)
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring[-1] = ring[0]
    return ring


def test_pieces_that_join_are_one_line() -> None:
    """The ends at x 40 are no ends, nor is a repeated vertex at an open end a segment."""
    a = line((0, 0), (100, 0))
    pieces = [line((40, 7), (20, 7), (20, 7)), line((40, 7), (80, 7), (80, 7))]
    forward = offsets([a], pieces)
    np.testing.assert_array_equal(forward.beyond, (forward.xy[:, 0] < 20.0) | (forward.xy[:, 0] > 80.0))
    np.testing.assert_allclose(forward[~forward.beyond].distance, 7.0, atol=ROUNDING)

    for others in (
        [line((0, 0), (10, 0), (10, 10))],
        [line((0, 0), (10, 0)), line((10, 0), (10, 10))],
        [line((10, 0), (10, 10), (0, 10), (0, 0), (10, 0))],
    ):  # nor is a corner, within a line, where two meet, or where a closed one begins
        corner = offsets([line((12.9, -4), (13.1, -4))], others)
        np.testing.assert_allclose(corner.nearest, [[10.0, 0.0]], atol=ROUNDING)
        assert corner.distance[0] == pytest.approx(5.0) and not corner.beyond[0]


@pytest.mark.parametrize("inner", [88.0, 100.0])
def test_concentric_circles(inner: float) -> None:
    outer = 112.0
    a, b = circle(inner), circle(outer)
    forward, backward = offsets([a], [b]), offsets([b], [a])
    for way, radius in ((forward, inner), (backward, outer)):
        assert not way.beyond.any()
        np.testing.assert_allclose(way.distance, outer - inner, atol=1e-4)  # arrows of both polygons
        assert way.interval.sum() == pytest.approx(2.0 * np.pi * radius, rel=1e-6)
    assert area_between(forward, backward) == pytest.approx(np.pi * (outer**2 - inner**2), rel=1e-5)
    one_way = float(forward.interval @ forward.distance)
    assert one_way == pytest.approx(2.0 * np.pi * inner * (outer - inner), rel=1e-5)


def test_a_wedge() -> None:
    """Distances grow evenly from 0: their mean, RMS and 95 % are known, and the area is that of the triangle."""
    angle, length = np.radians(20.0), 400.0
    a, b = line((0, 0), (length, 0)), line((0, 0), (length * np.cos(angle), length * np.sin(angle)))
    forward, backward = offsets([a], [b]), offsets([b], [a])
    assert not forward.beyond.any() and not backward.beyond.any()
    farthest = length * np.sin(angle)
    assert forward.distance.mean() == pytest.approx(farthest / 2.0)
    assert np.sqrt(np.mean(np.square(forward.distance))) == pytest.approx(
        farthest / np.sqrt(3.0), rel=1e-4
    )  # of steps
    most = largest_of_most(forward.distance, forward.interval)
    assert most == pytest.approx(0.95 * farthest, abs=np.sin(angle))  # a step of a metre
    assert area_between(forward, backward) == pytest.approx(0.5 * length * farthest)


@pytest.mark.parametrize("waves", [2, 5, 9])
def test_the_area_between_rings_that_cross_is_that_of_their_polygons(waves: int) -> None:
    """The nearest place is not across a line that is oblique to the other: less than 1 % of the area."""
    angle = np.linspace(0.0, 2.0 * np.pi, 3601)
    ring = (100.0 + 6.0 * np.sin(waves * angle))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring[-1] = ring[0]
    other = circle(102.0) + np.array([3.0, -1.0])
    area = area_between(offsets([ring], [other]), offsets([other], [ring]))
    assert area == pytest.approx(shapely.Polygon(ring).symmetric_difference(shapely.Polygon(other)).area, rel=0.01)


WGS84 = Ellipsoid("", 6378137.0, 298.257223563)
EAST, NORTH = 290000.0, 2030000.0
PATHS = (
    np.array([[0.0, 0.0, -5.0], [50.0, 10.0, -5.0], [90.0, 0.0, -5.0]]),
    np.array([[0.0, 60.0, -7.5], [30.0, 60.0, -7.5], [15.0, 80.0, -7.5], [0.0, 60.0, -7.5]]),
)


def lines(crs: str = "", depth: bool = False) -> Lines:
    shift = [EAST, NORTH, 0.0] if crs else np.zeros(3)
    columns = {"depth": LayerColumn.of([5.2, 7.7])} if depth else {}
    paths = [path + shift for path in PATHS]
    return Lines.of_paths(paths, columns=columns, crs=pyproj.CRS(crs) if crs else None)


def csv_of(head: str, sign: float = 1.0) -> str:
    rows = [f"{i},{x},{y},{sign * z}" for i, path in enumerate(PATHS) for x, y, z in path.tolist()]
    return "\n".join([head, *rows]) + "\n"


def assert_local(contours: ContourLines) -> None:
    assert not contours.angular
    for line, path in zip(contours.places, PATHS, strict=True):
        np.testing.assert_allclose(line, path[:, :2], atol=1e-4)  # digits of files
    np.testing.assert_allclose(contours.depth, [5.0, 7.5], atol=1e-4)


def test_local_lines_of_all_formats(tmp_path: Path) -> None:
    dxf.write(tmp_path / "a.dxf", {"contours": lines()})
    geopackage.write(tmp_path / "a.gpkg", {"contours": lines()})
    (tmp_path / "a.csv").write_text(csv_of("line,East,North,Height"))
    (tmp_path / "b.csv").write_text(csv_of("line,x,y,depth", -1.0))
    rows = [row.split(",") for row in csv_of("").split()]
    (tmp_path / "a.xyz").write_text("".join(f"{x} {y} {z} {line}\n" for line, x, y, z in rows))
    for name in ("a.dxf", "a.gpkg", "a.csv", "b.csv", "a.xyz"):
        assert_local(read_contours(tmp_path / name, None))
    (tmp_path / "a.xyz").write_text("".join(f"{x} {y} {-float(z)} {line}\n" for line, x, y, z in rows))
    assert_local(read_contours(tmp_path / "a.xyz", None, depths=True))


def test_lines_on_a_map_become_latitudes_and_longitudes(tmp_path: Path) -> None:
    """By the system of the file, or the one that is named; by PROJ itself."""
    to_degrees = pyproj.Transformer.from_crs("EPSG:32620", "EPSG:4326", always_xy=True)
    longitude, latitude = to_degrees.transform(PATHS[0][:, 0] + EAST, PATHS[0][:, 1] + NORTH)
    expected = np.stack([latitude, longitude], axis=1) * DEGREE
    geopackage.write(tmp_path / "a.gpkg", {"contours": lines("EPSG:32620", depth=True)})
    dxf.write(tmp_path / "a.dxf", {"contours": lines("EPSG:32620")})
    geojson.write(tmp_path / "a.geojson", lines("EPSG:32620"))
    bare = Lines.of_paths(lines("EPSG:32620").paths())
    dxf.write(tmp_path / "b.dxf", {"contours": bare})
    for name, crs in (("a.gpkg", ""), ("a.dxf", ""), ("a.geojson", ""), ("b.dxf", "EPSG:32620")):
        contours = read_contours(tmp_path / name, WGS84, crs=crs)
        assert contours.angular
        np.testing.assert_allclose(contours.places[0], expected, atol=2e-11)  # rad: 0.1 mm
        np.testing.assert_allclose(contours.depth, [5.2, 7.7] if name == "a.gpkg" else [5.0, 7.5], atol=1e-4)


DEGREES = "line,model,depth,latitude,longitude,height\n1,M,2,18.3,-64.9,-2.15\n1,M,2,18.4,-64.9,-2.15\n"
CLARKE = Ellipsoid("", 6378206.4, 294.978698214)
LAYERS = {
    "b.gpkg": Points(xyz=PATHS[0]),
    "c.gpkg": Lines.of_paths(PATHS, columns={"depth": LayerColumn.of([1.0, np.nan])}),
    "d.gpkg": lines("EPSG:32620"),
}


@pytest.mark.parametrize(
    ("name", "text", "job", "message"),
    [
        ("a.csv", csv_of("line,x,y,what"), None, "no columns lon, lat, depth or lon, lat, height or x, y, depth"),
        ("a.csv", "line,x,y,depth\n1,0,0,2\n1,9,9,3\n", None, "line 1: its third coordinate goes from 2 to 3 m"),
        ("a.csv", "line,x,y,depth\n1,0,0,2\n2,9,9,2\n2,9,8,2\n", None, "line 1 has one vertex"),
        ("a.csv", csv_of("line,x,y,depth"), WGS84, "no coordinate system is given"),
        ("a.shp", "x", None, "contours are read from .gpkg, .geojson"),
        ("b.gpkg", "", None, "it has points"),
        ("c.gpkg", "", None, "line 2: it has no depth"),
        ("d.gpkg", "", None, "the job in a local one"),
        ("d.gpkg", "", CLARKE, "ellipsoid"),
    ],
)  # fmt: skip
def test_files_that_cannot_be_used(
    name: str, text: str, job: Ellipsoid | None, message: str, tmp_path: Path
) -> None:
    if name in LAYERS:
        geopackage.write(tmp_path / name, {"contours": LAYERS[name]})
    else:
        (tmp_path / name).write_text(text)
    with pytest.raises(ProblemsError, match=message):
        read_contours(tmp_path / name, job)


def test_degrees_of_a_csv_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(DEGREES)
    contours = read_contours(tmp_path / "a.csv", WGS84)
    assert contours.angular and contours.depth.tolist() == [2.0]
    np.testing.assert_allclose(contours.places[0] / DEGREE, [[18.3, -64.9], [18.4, -64.9]])
