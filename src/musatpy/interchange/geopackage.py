"""GeoPackages (OGC 12-128r19): layers of points, of 3-D lines and areas.

Units of columns stand where the extension "schema" describes columns, the words for heights where the layer is
described. Needs the packages pyogrio and shapely, the extra `gis`.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pyproj

from musatpy.arrays import FloatArray
from musatpy.errors import InterchangeError
from musatpy.files import whole_path
from musatpy.interchange import layers as gis

_USE = "GeoPackages need"
_LAST_CHANGE = "1983-09-01T00:00:00.000Z"  # the month of ETL-0306: equal layers make equal files
_FIXED = {  # one date for the last change, and the journal of SQLite in memory
    "OGR_CURRENT_DATE": _LAST_CHANGE,
    "OGR_SQLITE_JOURNAL": "MEMORY",
    "OGR_SQLITE_SYNCHRONOUS": "OFF",
}
_CARTESIAN, _GEOGRAPHIC = -1, 0  # numbers of undefined systems: of local layers, of degrees without a datum
_POINT, _LINE, _MANY_POINTS, _MANY_LINES = 0, 1, 4, 5  # numbers of kinds of geometry in shapely
_SCHEMA = """
CREATE TABLE gpkg_data_columns (
  table_name TEXT NOT NULL, column_name TEXT NOT NULL, name TEXT, title TEXT, description TEXT, mime_type TEXT,
  constraint_name TEXT, CONSTRAINT pk_gdc PRIMARY KEY (table_name, column_name),
  CONSTRAINT gdc_tn UNIQUE (table_name, name));
CREATE TABLE gpkg_data_column_constraints (
  constraint_name TEXT NOT NULL, constraint_type TEXT NOT NULL, value TEXT, min NUMERIC, min_is_inclusive BOOLEAN,
  max NUMERIC, max_is_inclusive BOOLEAN, description TEXT,
  CONSTRAINT gdcc_ntv UNIQUE (constraint_name, constraint_type, value));
"""
_EXTENSION = ("gpkg_schema", "http://www.geopackage.org/spec121/#extension_schema", "read-write")


def write(path: Path, layers: Mapping[str, gis.Points | gis.Lines]) -> None:
    """Write layers by their names; the same layers give the same bytes.

    Raises `InterchangeError` without the packages and for what GDAL refuses; `OSError`.
    """
    raw, shapely = gis.package("pyogrio.raw", _USE), gis.package("shapely", _USE)
    with gis.upsets(path, "cannot be written"), whole_path(path) as temporary:
        with gis.gdal_options(_USE, _FIXED):
            for position, (name, layer) in enumerate(layers.items()):
                fields = list(layer.columns)
                local = {"SRID": str(_CARTESIAN)} if layer.crs is None else {}
                raw.write(
                    str(temporary),
                    geometry=_encoded(shapely, layer),
                    field_data=[
                        column.values.astype(object) if column.is_text else column.values
                        for column in layer.columns.values()
                    ],
                    fields=np.array(fields, dtype=object),
                    layer=name,
                    driver="GPKG",
                    geometry_type=_geometry_type(layer),
                    crs=None if layer.crs is None else layer.crs.to_wkt(),
                    append=position > 0,
                    layer_options={"DESCRIPTION": layer.heights, **local},
                )
        _describe(temporary, layers)


def read(path: Path, layer: str = "", crs: pyproj.CRS | None = None, heights: str = "") -> gis.Points | gis.Lines:
    """Read a layer, the only one unless it is named; `crs` and `heights` stand in for what the file does not say.

    Undefined systems say none: a Cartesian one is local without `crs`; one of longitude and latitude takes a `crs`
    that is geographic, and has degrees on no ellipsoid without it. Geometries of several parts become a point or a
    line each. Raises `InterchangeError` with all that is wrong; `OSError`.
    """
    pyogrio, shapely = gis.package("pyogrio", _USE), gis.package("shapely", _USE)
    gis.require_content(path)
    with gis.upsets(path, "is no GeoPackage"):
        names = [str(name) for name, _ in pyogrio.list_layers(path)]
        name = _layer_name(path, names, layer)
        meta, _, encoded, values = pyogrio.raw.read(path, layer=name)
        units, description, srs = _described(path, name)
    fields = [str(field) for field in meta["fields"]]
    columns = {
        field: gis.LayerColumn.of(value, units.get(field, "")) for field, value in zip(fields, values, strict=True)
    }
    with gis.upsets(path, f"layer {name} cannot be read"):
        geometries = shapely.from_wkb(encoded)
    _check(shapely, path, name, geometries)
    parts, rows = shapely.get_parts(geometries, return_index=True)
    columns = {
        field: gis.LayerColumn(values=column.values[rows], unit=column.unit) for field, column in columns.items()
    }
    xyz, index = shapely.get_coordinates(parts, include_z=True, return_index=True)
    is_defined = bool(meta["crs"]) and srs not in (_CARTESIAN, _GEOGRAPHIC)
    if srs == _GEOGRAPHIC and crs is not None and not crs.is_geographic:
        found = "longitude and latitude of no datum (srs_id 0)"
        raise gis.refuse(
            path, f"layer {name}", found, "a geographic system, or coordinates of the one that is meant"
        )
    stated = pyproj.CRS.from_user_input(meta["crs"]) if is_defined else crs
    place: dict[str, Any] = {"crs": gis.placed(stated), "heights": description or heights, "columns": columns}
    if shapely.get_type_id(parts[0]) == _POINT:
        return gis.Points(xyz=xyz, **place)
    return gis.Lines.of_paths(np.split(xyz, np.searchsorted(index, np.arange(1, len(parts)))), **place)


def _geometry_type(layer: gis.Points | gis.Lines) -> str:
    if isinstance(layer, gis.Points):
        return "Point Z"
    if not isinstance(layer, gis.Polygons):
        return "LineString Z"
    return "Polygon Z" if len(_areas(layer)) == len(layer.vertices) else "MultiPolygon Z"


def _areas(layer: gis.Polygons) -> list[tuple[int, FloatArray]]:
    """Return the rings of areas with their rows; those of degrees are cut at 180 (RFC 7946)."""
    is_angular = layer.crs is not None and layer.crs.is_geographic
    rings = [gis.cut_at_180(path, is_area=True) if is_angular else [path] for path in layer.paths()]
    return [(row, ring) for row, parts in enumerate(rings) for ring in parts]


def _encoded(shapely: Any, layer: gis.Points | gis.Lines) -> Any:
    """Return the geometries as WKB."""
    if isinstance(layer, gis.Points):
        geometries = shapely.points(layer.xyz)
    elif isinstance(layer, gis.Polygons):
        rows, rings = zip(*_areas(layer), strict=True) if layer.vertices else ((), ())
        geometries = shapely.polygons([shapely.linearrings(ring) for ring in rings])
        if len(rings) > len(layer.vertices):
            geometries = shapely.multipolygons(geometries, indices=rows)
    else:
        paths = layer.paths()
        index = np.repeat(np.arange(len(paths)), [len(path) for path in paths])
        geometries = shapely.linestrings(np.concatenate([np.empty((0, 3)), *paths]), indices=index)
    return shapely.to_wkb(geometries, output_dimension=3, flavor="iso")


def _describe(path: Path, layers: Mapping[str, gis.Points | gis.Lines]) -> None:
    """Write the units of columns into a GeoPackage."""
    units = [
        (name, field, f"unit: {column.unit}")
        for name, layer in layers.items()
        for field, column in layer.columns.items()
        if column.unit
    ]
    if not units:
        return
    with closing(sqlite3.connect(path)) as database, database:
        database.executescript(_SCHEMA)
        tables = ("gpkg_data_columns", "gpkg_data_column_constraints")
        database.executemany(
            "INSERT INTO gpkg_extensions (table_name, extension_name, definition, scope) VALUES (?, ?, ?, ?)",
            [(table, *_EXTENSION) for table in tables],
        )
        database.executemany(
            "INSERT INTO gpkg_data_columns (table_name, column_name, description) VALUES (?, ?, ?)", units
        )


def _described(path: Path, name: str) -> tuple[dict[str, str], str, int | None]:
    """Return the units of the columns of a layer, its description, and the number of its system."""
    query = "SELECT column_name, description FROM gpkg_data_columns WHERE table_name = ?"
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
        tables = {row[0] for row in database.execute("SELECT name FROM sqlite_master")}
        rows = database.execute(query, (name,)).fetchall() if "gpkg_data_columns" in tables else []
        contents = database.execute("SELECT description, srs_id FROM gpkg_contents WHERE table_name = ?", (name,))
        description, srs = contents.fetchone() or ("", None)
    units = {field: text.removeprefix("unit: ") for field, text in rows if (text or "").startswith("unit: ")}
    return units, description or "", srs


def _layer_name(path: Path, names: list[str], wanted: str) -> str:
    """Return the layer that is wanted, or the only one. Raises `InterchangeError`."""
    if wanted in names:
        return wanted
    there = f"layers {', '.join(names)}" if names else "no layer"
    if wanted:
        raise gis.refuse(
            path, f"layer {wanted}", f"it is missing among {there}" if names else there, "a layer there"
        )
    if len(names) != 1:
        raise gis.refuse(path, "", there, "one, or the name of the one that is meant")
    return names[0]


def _check(shapely: Any, path: Path, name: str, geometries: Any) -> None:
    """Raise `InterchangeError` unless there are 3-D geometries, all of them points or all of them lines."""
    if not len(geometries):
        raise gis.refuse(path, f"layer {name}", "it has no features", "points or lines")
    kinds = shapely.get_type_id(geometries)
    is_point, is_line = np.isin(kinds, (_POINT, _MANY_POINTS)), np.isin(kinds, (_LINE, _MANY_LINES))
    wanted, is_wanted = ("points", is_point) if is_point.sum() > is_line.sum() else ("lines", is_line)
    has_z, is_empty = shapely.has_z(geometries), shapely.is_empty(geometries) | (kinds < 0)
    finite = np.ones(len(geometries), dtype=bool)
    xyz, rows = shapely.get_coordinates(geometries, include_z=True, return_index=True)
    finite[rows[~np.isfinite(xyz).all(axis=1)]] = False  # the heights of 2-D ones too
    problems = []
    for row in np.flatnonzero(~is_wanted | is_empty | ~finite).tolist():
        place = f"layer {name} feature {row + 1}"
        if is_empty[row]:
            problems.append(gis.fault(path, place, "it has no geometry", wanted))
        elif not is_wanted[row]:
            problems.append(gis.fault(path, place, f"a {geometries[row].geom_type}", wanted))
        elif not has_z[row]:
            problems.append(gis.fault(path, place, "it has no heights (2-D)", "x, y and z"))
        else:
            problems.append(gis.fault(path, place, "a coordinate is no number", "x, y and z"))
    if problems:
        raise InterchangeError(problems)
