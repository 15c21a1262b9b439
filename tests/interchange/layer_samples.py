"""Layers for the tests of formats, and bytes of their files."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyproj

from musatpy.interchange.layers import Grid, LayerColumn, Lines, Points

UTM = pyproj.CRS("EPSG:32620")
EAST, NORTH = 290000.0, 2030000.0  # St. Thomas
HEIGHTS = "mean low water, Charlotte Amalie"
DIGIT = 0.5001e-4  # m: half of the last digit that is written, 0.1 mm


def points(crs: pyproj.CRS | None = UTM, count: int = 40) -> Points:
    rng = np.random.default_rng(7)
    depth = rng.uniform(0.5, 30.0, count)
    depth[3] = np.nan
    columns = {"depth": LayerColumn.of(depth, "m"), "rays": LayerColumn.of(np.arange(count) % 5)}
    xyz = rng.uniform((EAST, NORTH, -30.0), (EAST + 900.0, NORTH + 900.0, 0.0), (count, 3))
    return Points(xyz=xyz, columns=columns, crs=crs, heights=HEIGHTS)


def lines(crs: pyproj.CRS | None = UTM) -> Lines:
    """Return contours at depths of 2.5, 5, ... m, every other one closed."""
    rng = np.random.default_rng(8)
    depths = 2.5 * np.arange(1, 7)
    vertices = [
        np.column_stack(
            [rng.uniform(EAST, EAST + 900.0, 9), rng.uniform(NORTH, NORTH + 900.0, 9), np.full(9, -depth)]
        )
        for depth in depths
    ]
    columns = {"depth": LayerColumn.of(depths, "m"), "kind": LayerColumn.of(["index", "Höhe", "a", "b", "c", ""])}
    return Lines(vertices=vertices, closed=np.arange(6) % 2 == 0, columns=columns, crs=crs, heights=HEIGHTS)


def grid(crs: pyproj.CRS | None = UTM) -> Grid:
    depth = np.random.default_rng(9).uniform(0.0, 30.0, (7, 5))
    depth[2, 3] = np.nan
    bands = {"depth": depth, "sigma": 0.01 * depth}
    return Grid(west=EAST, south=NORTH, spacing=2.5, bands=bands, units={"depth": "m"}, crs=crs, heights=HEIGHTS)


def same_twice(path: Path, write: Callable[[Path], None]) -> bytes:
    """Return the bytes of a file that was written twice; they are the same, and nothing else is left."""
    write(path)
    first = path.read_bytes()
    write(path)
    assert path.read_bytes() == first
    assert [left.name for left in path.parent.iterdir()] == [path.name]
    return first
