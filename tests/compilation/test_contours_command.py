"""Contours beside others, by functions and by `musat as11 compare-contours`, and contours of rasters as files."""

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import ezdxf
import numpy as np
import pyogrio
import pyproj
import pytest
import shapely
from click.testing import Result

import stage_readings
from cli.commands import musat
from compilation.scenes import surface_of
from musatpy.arrays import FloatArray
from musatpy.compilation.other_bottoms import NO_BOTTOM, NOT_IN_OTHER, NOT_ON_IT, PAST_ENDS, Contoured, contoured
from musatpy.errors import SoundingError
from musatpy.interchange.any_file import write_layers
from musatpy.interchange.layers import Grid
from musatpy.reports.compilation_bottom import COMPARED_CONTOURS as DOCUMENT
from musatpy.soundings.contours import ContourLines
from record_rows import read_rows, valid_rows

SLOPE = 0.1


def patch(south: float, north: float, shift: float = 0.0) -> FloatArray:
    """Return points of a bottom that falls towards east, x 0 to 100 m."""
    x, y = np.meshgrid(np.linspace(0.0, 100.0, 11), np.linspace(south, north, 5))
    return np.column_stack([x.ravel(), y.ravel(), SLOPE * x.ravel() + shift])


def others(*lines: tuple[float, list[tuple[float, float]]]) -> ContourLines:
    places = tuple(np.array(xy, dtype=float) for _, xy in lines)
    return ContourLines(places=places, angular=False, depth=np.array([depth for depth, _ in lines]))


def beside(*lines: tuple[float, list[tuple[float, float]]], **how: Any) -> Contoured:
    """Return contours of a bottom 40 m wide beside others."""
    return contoured([surface_of(patch(0.0, 40.0))], others(*lines), **how)


@pytest.mark.parametrize(("x", "depth"), [(60.0, 1.0), (45.0, -0.5)])
@pytest.mark.parametrize("turned", [1, -1])
def test_a_contour_on_the_deeper_side_says_that_the_bottom_is_deeper(x: float, depth: float, turned: int) -> None:
    """Compiled 5 m are at x 50: where the other has them farther out, the compiled bottom is deeper than 5 m."""
    compared = beside((5.0, [(x, -10.0), (x, 60.0)][::turned]))
    assert [way.of for way in compared.distances] == ["compiled", "other"]
    for way in compared.distances:
        assert way.length == pytest.approx(40.0, abs=1.0) and way.beyond == 0.0  # a sample at the edge
        assert (way.mean, way.rms, way.most) == pytest.approx([abs(x - 50.0)] * 3)
        assert (way.mean_depth, way.rms_depth, way.most_depth) == pytest.approx([depth, abs(depth), abs(depth)])
    (area,) = compared.areas
    assert area.area == pytest.approx(40.0 * abs(x - 50.0)) and area.width == pytest.approx(abs(x - 50.0))
    assert compared.rms == pytest.approx(abs(x - 50.0)) and not area.reason


def test_a_datum_is_added_to_the_depths_of_the_other() -> None:
    compared = beside((4.5, [(52.0, -10.0), (52.0, 60.0)]), datum=0.5)
    assert [row.depth for row in compared.areas] == [5.0]
    assert compared.distances[0].mean == pytest.approx(2.0)
    again = beside((0.3, [(9.0, -10.0), (9.0, 60.0)]), levels=[3 * 0.1])
    assert [(row.depth, row.reason) for row in again.areas] == [(0.3, "")]


def test_a_turned_contour_has_depths_on_both_sides() -> None:
    """Deeper in the north, shoaler in the south: the mean depth is none, its RMS that of an even spread."""
    forward = beside((5.0, [(48.0, -20.0), (52.0, 60.0)])).distances[0]
    most = SLOPE * 20.0 * np.sin(np.arctan(4.0 / 80.0))
    assert forward.mean_depth == pytest.approx(0.0, abs=1e-6)
    assert forward.rms_depth == pytest.approx(most / np.sqrt(3.0), rel=1e-3)  # of 40 steps
    assert forward.most_depth == pytest.approx(0.95 * most, abs=most / 20.0)


def test_what_lies_past_an_end_or_too_far_is_left_out_and_has_no_area() -> None:
    """A contour that ends in the middle; of two of a depth, 10 m and 35 m off, the first is within 20 m."""
    compared = beside((5.0, [(60.0, -10.0), (60.0, 20.0)]))
    forward, backward = compared.distances
    assert (forward.length, forward.beyond, forward.most) == pytest.approx((20.0, 20.0, 10.0))
    assert backward.length == pytest.approx(20.0, abs=1.0) and backward.beyond == 0.0  # a sample at the edge
    assert compared.areas[0].area == pytest.approx(200.0)
    both = (5.0, [(60.0, -10.0), (60.0, 60.0)]), (5.0, [(85.0, -10.0), (85.0, 60.0)])
    whole, near, none = (beside(*both, farthest=farthest) for farthest in (np.inf, 20.0, 5.0))
    assert [row.beyond for row in whole.distances] == [0.0, 0.0] and whole.distances[1].most > 30.0
    forward, backward = near.distances
    assert (forward.length, backward.length, backward.beyond) == pytest.approx((40.0,) * 3, abs=1.0)
    assert backward.most == pytest.approx(10.0) and near.areas[0].area == pytest.approx(400.0, rel=0.02)
    assert not none.distances and none.areas[0].reason == PAST_ENDS


def test_reasons() -> None:
    bottom = surface_of(np.concatenate([patch(0.0, 40.0), patch(60.0, 100.0, 30.0)]), longest=15.0)
    lines = others(
        (5.0, [(50.0, 70.0), (50.0, 90.0)]),
        (6.0, [(50.0, 500.0), (50.0, 600.0)]),
        (20.0, [(50.0, 10.0), (50.0, 30.0)]),
        (90.0, [(50.0, 10.0), (50.0, 30.0)]),
    )
    compared = contoured([bottom], lines, levels=[8.0])
    assert not compared.distances
    assert {row.depth: row.reason for row in compared.areas} == {
        5.0: PAST_ENDS,
        6.0: NOT_ON_IT,
        8.0: NOT_IN_OTHER,
        20.0: NO_BOTTOM,
        90.0: "the surface goes from 0.00 to 40.00 m",
    }


def test_coordinates_of_another_kind_are_refused() -> None:
    bottom = surface_of(patch(0.0, 40.0), plan=SimpleNamespace())
    with pytest.raises(SoundingError, match="the job has lat and lon"):
        contoured([bottom], others((5.0, [(50.0, 0.0), (50.0, 40.0)])))
    assert not contoured([replace(bottom, tin=None, plan=None)], others()).areas


@pytest.fixture(scope="module")
def run(run_record: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the record of the run of St. Thomas, beside the files of its compilation."""
    record = Path(shutil.copy(run_record, tmp_path_factory.mktemp("run")))
    assert musat("as11", "compile", record, stage_readings.DECK, "-o", record.parent, "--gis").exit_code == 0
    return record


def compared(run: Path, file: Path, folder: Path, *options: str) -> Result:
    return musat("as11", "compare-contours", run, stage_readings.DECK, file, "-o", folder, *options)


def test_contours_of_the_true_bottom(run: Path, tmp_path: Path) -> None:
    """To the scatter of the points, .3 m, and their sigmas, where no sliver of a triangle is steep."""
    assert compared(run, stage_readings.CONTOURS, tmp_path).exit_code == 0
    record = read_rows(tmp_path / "contours.contours.json")
    assert {row["depth"] for row in record["distances"]} == {4.0, 10.0, 20.0}
    for row in record["distances"]:
        assert abs(row["mean_depth"]) < 0.2 and row["most_depth"] < 1.0 and row["mean"] < 25.0
    reasons = {row["depth"]: row["reason"] for row in record["areas"] if row["surface"] == 1}
    assert not reasons[10.0] and "the surface goes from" in reasons[30.0]
    assert reasons[6.0] == "the other source has no contour of it"


@pytest.mark.parametrize(
    ("name", "options"),
    [
        pytest.param("st_thomas_as11.contours.csv", (), marks=pytest.mark.slow),
        ("st_thomas_as11.gpkg", ("--layer", "contours")),
        pytest.param("st_thomas_as11.dxf", ("--datum", "-0.15"), marks=pytest.mark.slow),  # heights of the job
    ],
)
def test_contours_lie_on_themselves(run: Path, tmp_path: Path, name: str, options: tuple[str, ...]) -> None:
    """To the digits of the files."""
    file = run.with_name(name)
    assert compared(run, file, tmp_path, *options).exit_code == 0
    stem = tmp_path / f"{file.stem}.contours"
    record = valid_rows(Path(f"{stem}.json"), DOCUMENT.schema())
    assert len(record["areas"]) == 12 and not any(row["reason"] for row in record["areas"])
    for row in record["distances"]:
        assert row["most"] < 2e-3 and abs(row["mean_depth"]) < 1e-3
    listing = Path(f"{stem}.lst").read_text()
    assert max(map(len, listing.splitlines())) <= 132 and "Areas Between Contours" in listing


def test_a_shift_of_the_depths_shows_in_the_depths(run: Path, tmp_path: Path) -> None:
    """Lines of 8.0 m called 8.2 m: the compiled bottom is 0.2 m shoaler there, seen from both sources."""
    head, *rows = run.with_name("st_thomas_as11.contours.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    kept = [",".join([*row[:2], "8.2", *row[3:]]) for row in cells if row[2] == "8"]
    file = tmp_path / "s.csv"
    file.write_text("\n".join([head, *kept]) + "\n")
    result = compared(run, file, tmp_path)
    assert result.exit_code == 0 and "contours of 1 depth," in result.output
    record = read_rows(tmp_path / "s.contours.json")
    for row in (row for row in record["distances"] if row["surface"] == 1):
        assert row["mean_depth"] == pytest.approx(-0.2, abs=0.02)  # of triangles with other slopes
    reasons = {row["reason"] for row in record["areas"]}
    assert reasons == {"", "the other source has no contour of it"}


def test_contours_without_a_partner_are_refused(run: Path, tmp_path: Path) -> None:
    file = tmp_path / "s.csv"
    file.write_text("line,lat,lon,depth\n1,10,20,4\n1,10,20.1,4\n")
    result = compared(run, file, tmp_path)
    assert result.exit_code == 1 and "no contour has a partner" in result.output
    assert not (tmp_path / "s.contours.lst").exists()


UTM = pyproj.CRS("EPSG:32620")
EAST, NORTH = 290000.0, 2030000.0
DATUM = -40.5  # m, a height


def raster(path: Path, crs: pyproj.CRS | None = UTM, **bands: np.ndarray) -> Path:
    """Write a bowl of 200 m, 20 m deep in its middle, and 0 m at 100 m from it; heights stand on the datum."""
    x, y = np.meshgrid(np.arange(0.0, 201.0, 2.0), np.arange(0.0, 201.0, 2.0))
    depth = 20.0 - 0.2 * np.hypot(x - 100.0, y - 100.0)
    values = bands or {"height": DATUM - depth, "depth": depth, "sigma": np.full(depth.shape, 0.1)}
    write_layers(path, {"grid": Grid(west=EAST, south=NORTH, spacing=2.0, bands=values, crs=crs)})
    return path


def drawn_by(*words: str | Path) -> Result:
    return musat("as11", "contours", *map(str, words))


def test_contours_are_read_by_other_programs(tmp_path: Path) -> None:
    """Rings at the heights of their depths: by GDAL as GeoPackage and GeoJSON, by ezdxf as a drawing."""
    source = raster(tmp_path / "a.tif")
    targets = [word for name in ("a.gpkg", "a.dxf", "a.geojson") for word in ("-o", tmp_path / name)]
    result = drawn_by(source, *targets, "--interval", "5", "--index", "2")
    assert result.exit_code == 0, result.output
    meta, _, encoded, values = pyogrio.raw.read(tmp_path / "a.gpkg")
    fields = dict(zip(meta["fields"], values, strict=True))
    rings = [depth for depth in fields["depth"].tolist() if depth > 0.0]
    assert meta["crs"] == "EPSG:32620" and rings == [5.0, 10.0, 15.0]
    thick = set(fields["depth"][fields["index_line"].astype(bool)].tolist())
    assert 10.0 in thick and not {5.0, 15.0} & thick
    for depth, shape in zip(fields["depth"].tolist(), shapely.from_wkb(encoded), strict=True):
        xyz = shapely.get_coordinates(shape, include_z=True)
        np.testing.assert_array_equal(xyz[:, 2], -depth)
        if depth > 0.0:
            radius = np.hypot(*(xyz[:, :2] - [EAST + 100.0, NORTH + 100.0]).T)
            # Linear along the sides of squares of 2 m: a circle of 25 m is off by half the square of 1 m over it.
            assert shape.is_closed and np.abs(radius - (20.0 - depth) / 0.2).max() < 0.025
            assert not shapely.is_ccw(shape)  # the deeper side, the middle, on the right
    drawn = list(ezdxf.readfile(tmp_path / "a.dxf").modelspace())
    assert {entity.dxf.layer for entity in drawn} >= {"CONTOURS_5", "CONTOURS_10", "CONTOURS_15"}
    heights = {point[2] for entity in drawn if entity.dxf.layer == "CONTOURS_10" for point in entity.points()}
    assert heights == {-10.0}
    assert len(pyogrio.raw.read(tmp_path / "a.geojson")[2]) == len(encoded)


def test_depths_below_a_datum_drying_heights_and_heights(tmp_path: Path) -> None:
    """Of the band of heights: contours at the heights of depths, a drying one too; heights without a datum."""
    source, target = raster(tmp_path / "a.tif"), tmp_path / "a.gpkg"
    words = ("--band", "height", "--datum", str(DATUM), "--depth", "10", "--depth", "-4")
    for name, values, options in (
        ("depth", {10.0, -4.0}, words),
        ("height", {-50.0}, (*words[:2], "--depth", "-50")),
    ):
        result = drawn_by(source, "-o", target, *options)
        assert result.exit_code == 0 and (name == "depth" or "1 line of 1 height" in result.output)
        meta, _, encoded, columns = pyogrio.raw.read(target)
        of = dict(zip(meta["fields"], columns, strict=True))[name]
        heights = [shapely.get_coordinates(shape, include_z=True)[0, 2] for shape in shapely.from_wkb(encoded)]
        assert set(of.tolist()) == values
        np.testing.assert_allclose(heights, DATUM - of if name == "depth" else of, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        ((), 2, "give --interval, or --depth"),
        (("--interval", "5", "--depth", "3"), 2, "give --interval, or --depth"),
        (("--interval", "5", "--band", "sigma"), 1, "there is no contour between"),
        (("--depth", "90"), 1, "there is no contour between"),
        (("--interval", "0.001"), 1, "are the most"),
        (("--interval", "5", "--band", "z"), 1, "--band is one of height, depth, sigma"),
        (("--interval", "5", "--crs", "EPSG:1"), 1, "EPSG:1"),
    ],
)
def test_what_cannot_be_drawn(tmp_path: Path, words: tuple[str, ...], status: int, said: str) -> None:
    source = raster(tmp_path / "a.tif")
    result = drawn_by(source, "-o", tmp_path / "a.gpkg", *words)
    assert result.exit_code == status and said in result.output, result.output
    assert not (tmp_path / "a.gpkg").exists()


def test_a_raster_of_no_system(tmp_path: Path) -> None:
    local = raster(tmp_path / "l.tif", None)
    assert drawn_by(local, "-o", tmp_path / "a.gpkg", "--interval", "5").exit_code == 0
    assert drawn_by(local, "-o", tmp_path / "a.csv", "--interval", "5").exit_code == 1
