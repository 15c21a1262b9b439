"""GeoTIFF (OGC 19-008r4): grids whose pixels stand for nodes, one band for each quantity, NaN where it is empty.

Rasters of any size are read and written by rows. Needs the package rasterio, the extra `gis`.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyproj

from musatpy.arrays import FloatArray
from musatpy.errors import InterchangeError, Problem
from musatpy.files import whole_path
from musatpy.interchange.layers import LOCAL, Grid, Posts, fault, package, placed, refuse, require_content, upsets

_USE = "GeoTIFFs need"
_HEIGHTS = "HEIGHTS"  # tag with the words for heights
_SQUARE = 1e-6  # of a spacing, by which sides of pixels may differ: PROJ and CAD print seven digits
_CACHE = 32  # MB, of GDAL: by itself it takes a twentieth of the memory of the machine


@dataclass(frozen=True, kw_only=True, eq=False)
class Raster:
    """An open raster: where its nodes stand, the names of its bands, and the units of those that have one."""

    path: Path
    posts: Posts
    names: tuple[str, ...]
    units: Mapping[str, str]
    dataset: Any = field(repr=False)

    def rows(self, name: str, first: int, last: int) -> FloatArray:
        """Return values (rows, columns) of a band from row `first` to before `last`, NaN where it is empty.

        Raises `InterchangeError`.
        """
        band, dataset = self.names.index(name) + 1, self.dataset
        with upsets(self.path, "cannot be read"):
            values = dataset.read(band, window=_window(self.posts, first, last), masked=True)
        return np.asarray(
            values.astype(float).filled(np.nan)[::-1] * dataset.scales[band - 1] + dataset.offsets[band - 1]
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RasterWriter:
    """An open raster that is being written, row by row; `sums` of what was, by band and rows."""

    path: Path
    posts: Posts
    dataset: Any = field(repr=False)
    sums: dict[tuple[int, int, int], int] = field(default_factory=dict)

    def put(self, first: int, values: Mapping[str, FloatArray]) -> None:
        """Write rows from `first` on of all bands, each (rows, columns). Raises `InterchangeError`."""
        for band, rows in enumerate(values.values(), 1):
            last, northern = first + len(rows), np.ascontiguousarray(rows[::-1])
            with upsets(self.path, "cannot be written"):
                self.dataset.write(northern, band, window=_window(self.posts, first, last))
            self.sums[band, first, last] = zlib.crc32(northern.tobytes())


def write(path: Path, grid: Grid) -> None:
    """Write a grid in double precision, its first row the northern one.

    Raises `InterchangeError` without rasterio, or for what GDAL refuses; `OSError`.
    """
    with written(path, grid, {name: grid.units.get(name, "") for name in grid.bands}) as writer:
        writer.put(0, grid.bands)


@contextmanager
def written(path: Path, posts: Posts, bands: Mapping[str, str]) -> Iterator[RasterWriter]:
    """Open a raster of named bands and their units, whole at the end or not there.

    Raises `InterchangeError` without rasterio, for what GDAL refuses, and where what is read again is not what was
    written: on a full disk GDAL may close a file without a word. `OSError`.
    """
    rasterio = package("rasterio", _USE)
    rows, columns = posts.shape
    half = posts.spacing / 2.0
    west, north = posts.west - half, posts.south + (rows - 1) * posts.spacing + half  # corner of the first pixel
    profile = {
        "driver": "GTiff",
        "width": columns,
        "height": rows,
        "count": len(bands),
        "dtype": "float64",
        "nodata": np.nan,
        "crs": rasterio.crs.CRS.from_wkt(LOCAL if posts.crs is None else posts.crs.to_wkt()),
        "transform": rasterio.Affine(posts.spacing, 0.0, west, 0.0, -posts.spacing, north),
        "compress": "deflate",
        "predictor": 3,  # of floating point numbers: bytes of like order beside each other
        "interleave": "band",
        "bigtiff": "if_safer",
    }
    with rasterio.Env(GDAL_CACHEMAX=_CACHE), whole_path(path) as temporary:
        with upsets(path, "cannot be written"):
            dataset = rasterio.open(temporary, "w", **profile)
            dataset.update_tags(AREA_OR_POINT="Point", **({_HEIGHTS: posts.heights} if posts.heights else {}))
            for band, (name, unit) in enumerate(bands.items(), 1):
                dataset.set_band_description(band, name)
                dataset.set_band_unit(band, unit)
        writer = RasterWriter(path=path, posts=posts, dataset=dataset)
        try:
            yield writer
        finally:
            with upsets(path, "cannot be written"):
                dataset.close()
        with upsets(path, "cannot be written"), rasterio.open(temporary) as done:
            if any(_sum(done, posts, *rows_of) != crc for rows_of, crc in writer.sums.items()):
                raise refuse(path, "", "the file differs from what was written: is the disk full?", "room for it")


@contextmanager
def opened(path: Path, crs: pyproj.CRS | None = None, heights: str = "") -> Iterator[Raster]:
    """Open a raster; a band without a name has that of its number.

    `crs` and `heights` stand in for what the file does not say (`layers.LOCAL` for local coordinates). Raises
    `InterchangeError` for a file that states no coordinate system where none is given, for pixels that are turned
    or not square; `OSError`.
    """
    rasterio = package("rasterio", _USE)
    require_content(path)
    with rasterio.Env(GDAL_CACHEMAX=_CACHE):
        with upsets(path, "is no raster that GDAL reads"):
            dataset = rasterio.open(path)
        with dataset:
            yield _raster(path, dataset, crs, heights)


def read(path: Path, crs: pyproj.CRS | None = None, heights: str = "") -> Grid:
    """Read all bands of a raster. Raises as `opened`."""
    with opened(path, crs, heights) as raster:
        posts, rows = raster.posts, raster.posts.shape[0]
        return Grid(
            west=posts.west,
            south=posts.south,
            spacing=posts.spacing,
            bands={name: raster.rows(name, 0, rows) for name in raster.names},
            units=raster.units,
            crs=posts.crs,
            heights=posts.heights,
        )


def _raster(path: Path, dataset: Any, crs: pyproj.CRS | None, heights: str) -> Raster:
    """Return an open raster. Raises `InterchangeError`."""
    with upsets(path, "is no raster that GDAL reads"):
        stated = None if dataset.crs is None else pyproj.CRS.from_wkt(dataset.crs.to_wkt())
    if problems := _faults(path, dataset, stated or crs):
        raise InterchangeError(problems)
    names = tuple(name or f"band{band}" for band, name in enumerate(dataset.descriptions, 1))
    transform = dataset.transform
    posts = Posts(
        west=transform.c + transform.a / 2.0,
        south=transform.f + transform.e * (dataset.height - 0.5),
        spacing=transform.a,
        shape=(dataset.height, dataset.width),
        crs=placed(stated or crs),
        heights=dataset.tags().get(_HEIGHTS, "") or heights,
    )
    units = {name: unit for name, unit in zip(names, dataset.units, strict=True) if unit}
    return Raster(path=path, posts=posts, names=names, units=units, dataset=dataset)


def _window(posts: Posts, first: int, last: int) -> Any:
    """Return rows, counted from the south, as a window of a file that begins in the north."""
    rows, columns = posts.shape
    return package("rasterio.windows", _USE).Window(0, rows - last, columns, last - first)


def _sum(dataset: Any, posts: Posts, band: int, first: int, last: int) -> int:
    values = dataset.read(band, window=_window(posts, first, last))
    return zlib.crc32(values.tobytes())


def _faults(path: Path, dataset: Any, crs: pyproj.CRS | None) -> list[Problem]:
    """Return what is wrong with the place of a raster."""
    problems, transform = [], dataset.transform
    if crs is None:
        expected = "one in the file, or one that is given with it (--crs)"
        problems.append(fault(path, "", "the raster has no coordinate system", expected))
    if transform.is_identity:
        problems.append(fault(path, "", "the raster has no place on the ground", "a north-up grid"))
    elif transform.b or transform.d or transform.a <= 0.0 or transform.e >= 0.0:
        problems.append(fault(path, "", "the raster is turned or mirrored", "a north-up grid"))
    elif abs(transform.a + transform.e) > _SQUARE * transform.a:
        problems.append(
            fault(
                path, "", f"pixels of {transform.a:g} by {-transform.e:g}", "square ones (`gdalwarp -tr SIZE SIZE`)"
            )
        )
    return problems
