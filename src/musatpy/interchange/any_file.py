"""Files of points, lines or grids by their suffix, whichever format that is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pyproj

from musatpy.errors import InterchangeError
from musatpy.interchange import dxf, geojson, geopackage, geotiff, las, xyz
from musatpy.interchange.layers import Grid, Lines, Points, refuse
from musatpy.pointfiles.columns import AXES

Layers = dict[str, Points | Lines | Grid]

TEXTS, CLOUDS, RASTERS = (".csv", ".xyz", ".txt"), (".las", ".laz"), (".tif", ".tiff")
GEOPACKAGES, GEOJSONS, DRAWINGS = (".gpkg",), (".geojson", ".json"), (".dxf",)
SUFFIXES = (*TEXTS, *CLOUDS, *RASTERS, *GEOPACKAGES, *GEOJSONS, *DRAWINGS)


def read_layers(
    path: Path, crs: pyproj.CRS | None = None, layer: str = "", columns: Sequence[str] = AXES
) -> Layers:
    """Return what is in a file, by the names of its layers; `crs` stands in where the file says none.

    `layer`: that of a GeoPackage of several; `columns`: names of coordinates in a text file. Raises
    `InterchangeError` for a file that cannot be used, `OSError`.
    """
    suffix = path.suffix.lower()
    if suffix in TEXTS:
        return {"points": xyz.read(path, columns, crs)}
    if suffix in CLOUDS:
        return {"points": las.read(path, crs)}
    if suffix in RASTERS:
        return {"grid": geotiff.read(path, crs)}
    if suffix in GEOPACKAGES:
        content = geopackage.read(path, layer, crs)
        return {layer or ("points" if isinstance(content, Points) else "lines"): content}
    if suffix in GEOJSONS:
        content = geojson.read(path)
        return {"points" if isinstance(content, Points) else "lines": content}
    if suffix in DRAWINGS:
        points, lines = dxf.read(path, crs)
        parts: Layers = {"points": points} if len(points.xyz) else {}
        return parts | ({"lines": lines} if lines.vertices else {})
    raise _no_format(path)


def write_layers(path: Path, layers: Mapping[str, Points | Lines | Grid]) -> None:
    """Write layers to a file that can hold them.

    Raises `InterchangeError` where the format cannot, and `OSError`.
    """
    suffix, parts = path.suffix.lower(), list(layers.values())
    vectors = {name: part for name, part in layers.items() if not isinstance(part, Grid)}
    points = [part for part in parts if isinstance(part, Points)]
    if suffix in GEOPACKAGES and len(vectors) == len(parts):
        geopackage.write(path, vectors)
    elif suffix in DRAWINGS and len(vectors) == len(parts):
        dxf.write(path, vectors)
    elif suffix in GEOJSONS and len(vectors) == len(parts) == 1:
        geojson.write(path, next(iter(vectors.values())))
    elif suffix in RASTERS and len(parts) == 1 and isinstance(parts[0], Grid):
        geotiff.write(path, parts[0])
    elif suffix in TEXTS and len(points) == len(parts) == 1:
        xyz.write(path, points[0])
    elif suffix in CLOUDS and len(points) == len(parts) == 1:
        las.write(path, points[0])
    elif suffix not in SUFFIXES:
        raise _no_format(path)
    else:
        kinds = ", ".join(type(part).__name__.lower() for part in parts)
        raise refuse(path, "", f"a {suffix} file does not hold {kinds}", "a file of another suffix")


def _no_format(path: Path) -> InterchangeError:
    return refuse(path, "", f"'{path.suffix}' is no suffix of a known format", ", ".join(SUFFIXES))
