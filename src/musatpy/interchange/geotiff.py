"""GeoTIFF (OGC 19-008r4): grids whose pixels stand for nodes, one band for each quantity, NaN where it is empty.

Needs the package rasterio, the extra `gis`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyproj

from musatpy.errors import InterchangeError, Problem
from musatpy.files import write_file
from musatpy.interchange.layers import LOCAL, Grid, placed
from musatpy.interchange.packages import fault, package, require_content, upsets

_USE = "GeoTIFFs need"
_HEIGHTS = "HEIGHTS"  # tag with the words for heights
_SQUARE = 1e-6  # of a spacing, by which sides of pixels may differ: PROJ and CAD print seven digits


def write(path: Path, grid: Grid) -> None:
    """Write a grid in double precision, its first row the northern one.

    Raises `InterchangeError` without rasterio, or for what GDAL refuses; `OSError`.
    """
    rasterio = package("rasterio", _USE)
    rows, columns = grid.shape
    half = grid.spacing / 2.0
    west, north = grid.west - half, grid.south + (rows - 1) * grid.spacing + half  # corner of the first pixel
    profile = {
        "driver": "GTiff",
        "width": columns,
        "height": rows,
        "count": len(grid.bands),
        "dtype": "float64",
        "nodata": np.nan,
        "crs": rasterio.crs.CRS.from_wkt(LOCAL if grid.crs is None else grid.crs.to_wkt()),
        "transform": rasterio.Affine(grid.spacing, 0.0, west, 0.0, -grid.spacing, north),
        "compress": "deflate",
        "predictor": 3,  # of floating point numbers: bytes of like order beside each other
        "interleave": "band",
    }
    # Written in memory: GDAL may close a file on a full disk without a word.
    with upsets(path, "cannot be written"), rasterio.io.MemoryFile() as memory:
        with memory.open(**profile) as dataset:
            dataset.update_tags(AREA_OR_POINT="Point", **({_HEIGHTS: grid.heights} if grid.heights else {}))
            for band, (name, values) in enumerate(grid.bands.items(), 1):
                dataset.write(values[::-1], band)
                dataset.set_band_description(band, name)
                dataset.set_band_unit(band, grid.units.get(name, ""))
        write_file(path, memoryview(memory.getbuffer()))


def read(path: Path, crs: pyproj.CRS | None = None, heights: str = "") -> Grid:
    """Read all bands of a raster; a band without a name has that of its number.

    `crs` and `heights` stand in for what the file does not say (`layers.LOCAL` for local coordinates). Raises
    `InterchangeError` for a file that states no coordinate system where none is given, for pixels that are turned
    or not square; `OSError`.
    """
    rasterio = package("rasterio", _USE)
    require_content(path)
    with upsets(path, "is no raster that GDAL reads"), rasterio.open(path) as dataset:
        stated = None if dataset.crs is None else pyproj.CRS.from_wkt(dataset.crs.to_wkt())
        if problems := _faults(path, dataset, stated or crs):
            raise InterchangeError(problems)
        names = [name or f"band{band}" for band, name in enumerate(dataset.descriptions, 1)]
        transform = dataset.transform
        return Grid(
            west=transform.c + transform.a / 2.0,
            south=transform.f + transform.e * (dataset.height - 0.5),
            spacing=transform.a,
            bands={name: _values(dataset, band) for band, name in enumerate(names, 1)},
            units={name: unit for name, unit in zip(names, dataset.units, strict=True) if unit},
            crs=placed(stated or crs),
            heights=dataset.tags().get(_HEIGHTS, "") or heights,
        )


def _values(dataset: Any, band: int) -> Any:
    """Return a band (rows, columns) from the south, NaN where it is empty."""
    values = dataset.read(band, masked=True).astype(float).filled(np.nan)[::-1]
    return values * dataset.scales[band - 1] + dataset.offsets[band - 1]


def _faults(path: Path, dataset: Any, crs: pyproj.CRS | None) -> list[Problem]:
    """Return what is wrong with the place of a raster."""
    problems, transform = [], dataset.transform
    if crs is None:
        expected = "one in the file, or one that is given with it"
        problems.append(fault(path, "", "the raster has no coordinate system", expected))
    if transform.is_identity:
        problems.append(fault(path, "", "the raster has no place on the ground", "a north-up grid"))
    elif transform.b or transform.d or transform.a <= 0.0 or transform.e >= 0.0:
        problems.append(fault(path, "", "the raster is turned or mirrored", "a north-up grid"))
    elif abs(transform.a + transform.e) > _SQUARE * transform.a:
        problems.append(fault(path, "", f"pixels of {transform.a:g} by {-transform.e:g}", "square ones"))
    return problems
