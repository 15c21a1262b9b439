"""Contours of rasters, as files that other programs read."""

from __future__ import annotations

from pathlib import Path

import ezdxf
import numpy as np
import pyogrio
import pyproj
import pytest
import shapely
from click.testing import CliRunner, Result

from musatpy.cli.main import main as musat
from musatpy.interchange.any_file import write_layers
from musatpy.interchange.layers import Grid

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


def contoured(*words: str | Path) -> Result:
    return CliRunner().invoke(musat, ["as11", "contours", *map(str, words)])


def test_contours_are_read_by_other_programs(tmp_path: Path) -> None:
    """Rings at the heights of their depths: by GDAL as GeoPackage and GeoJSON, by ezdxf as a drawing."""
    source = raster(tmp_path / "a.tif")
    targets = [word for name in ("a.gpkg", "a.dxf", "a.geojson") for word in ("-o", tmp_path / name)]
    result = contoured(source, *targets, "--interval", "5", "--index", "2")
    assert result.exit_code == 0, result.output
    meta, _, encoded, values = pyogrio.raw.read(tmp_path / "a.gpkg")
    fields = dict(zip(meta["fields"], values, strict=True))
    rings = [depth for depth in fields["depth"].tolist() if depth > 0.0]
    assert meta["crs"] == "EPSG:32620" and rings == [5.0, 10.0, 15.0]
    assert (
        fields["index_line"][fields["depth"] == 10.0].all()
        and not fields["index_line"][fields["depth"] == 5.0].any()
    )
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


def test_depths_below_a_datum_and_drying_heights(tmp_path: Path) -> None:
    """Of the band of heights: contours at the depths' heights, a drying one above the datum."""
    source = raster(tmp_path / "a.tif")
    words = ("--band", "height", "--datum", str(DATUM), "--depth", "10", "--depth", "-4")
    assert contoured(source, "-o", tmp_path / "a.gpkg", *words).exit_code == 0
    meta, _, encoded, values = pyogrio.raw.read(tmp_path / "a.gpkg")
    depth = dict(zip(meta["fields"], values, strict=True))["depth"]
    heights = [shapely.get_coordinates(shape, include_z=True)[0, 2] for shape in shapely.from_wkb(encoded)]
    assert set(depth.tolist()) == {-4.0, 10.0}
    np.testing.assert_allclose(heights, DATUM - depth, rtol=0.0, atol=1e-9)


def test_heights_are_contoured_as_heights(tmp_path: Path) -> None:
    source = raster(tmp_path / "a.tif")
    result = contoured(source, "-o", tmp_path / "a.gpkg", "--band", "height", "--depth", "-50")
    assert result.exit_code == 0 and "1 line of 1 height" in result.output
    meta, _, encoded, _ = pyogrio.raw.read(tmp_path / "a.gpkg")
    assert meta["fields"].tolist()[0] == "height"
    assert shapely.get_coordinates(shapely.from_wkb(encoded), include_z=True)[0, 2] == -50.0


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
    result = contoured(source, "-o", tmp_path / "a.gpkg", *words)
    assert result.exit_code == status and said in result.output, result.output
    assert not (tmp_path / "a.gpkg").exists()


def test_an_empty_raster_and_a_raster_of_no_system(tmp_path: Path) -> None:
    empty = raster(tmp_path / "e.tif", depth=np.full((4, 4), np.nan))
    result = contoured(empty, "-o", tmp_path / "a.gpkg", "--interval", "1")
    assert result.exit_code == 1 and "all of its posts are empty" in result.output
    local = raster(tmp_path / "l.tif", None)
    assert contoured(local, "-o", tmp_path / "a.gpkg", "--interval", "5").exit_code == 0
    result = contoured(local, "-o", tmp_path / "a.geojson", "--interval", "5")
    assert result.exit_code == 1 and "the coordinates are local" in result.output
    assert contoured(local, "-o", tmp_path / "a.csv", "--interval", "5").exit_code == 1
