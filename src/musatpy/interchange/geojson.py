"""GeoJSON (RFC 7946): points, lines and areas in longitude and latitude of WGS 84, and in no other system.

A layer is written only where PROJ has a transformation of its datum to WGS 84; the file names it. What crosses the
meridian of 180 degrees is cut there. Third coordinates
are heights above the ellipsoid of WGS 84, of layers whose system has them. Heights of other layers are a property
`z` of points, and of lines at one height; the members `heights` and `units` say in words what these are above, and
the units of properties.
"""

from __future__ import annotations

import json
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
from pyproj.aoi import AreaOfInterest
from pyproj.crs import GeographicCRS
from pyproj.exceptions import ProjError
from pyproj.transformer import TransformerGroup

from musatpy.arrays import FloatArray
from musatpy.errors import InterchangeError
from musatpy.files import write_file
from musatpy.geometry.projected import no_network
from musatpy.interchange import layers as gis

_PLAN, _SPACE = "OGC:CRS84", "EPSG:4979"
_SAME = ("urn:ogc:def:crs:OGC:1.3:CRS84", "urn:ogc:def:crs:OGC::CRS84", "EPSG:4326")  # in files before RFC 7946
_DECIMALS = (9, 9, 4)  # 0.1 mm
_HEIGHT = "z"
_POINT, _LINE, _AREA = "Point", "LineString", "Polygon"


def write(path: Path, layer: gis.Points | gis.Lines) -> None:
    """Write points, lines or areas.

    Raises `InterchangeError` where they cannot be brought to WGS 84 without a guess, and where heights whose datum
    is not the system's differ along a line; `OSError`.
    """
    paths = [point[None] for point in layer.xyz] if isinstance(layer, gis.Points) else layer.paths()
    xyz = np.concatenate([np.empty((0, 3)), *paths])
    positions, members = _to_wgs84(path, layer, xyz)
    properties: dict[str, list[Any]] = {  # what is no number is null
        name: [None if value != value else value for value in column.values.tolist()]
        for name, column in layer.columns.items()
    }
    if positions.shape[1] == 2:
        if _HEIGHT in properties:
            raise gis.refuse(path, f"column {_HEIGHT}", "it has the name of the heights", "another name")
        properties[_HEIGHT] = [_line_height(path, i, line[:, 2]) for i, line in enumerate(paths)]
    units = {name: column.unit for name, column in layer.columns.items() if column.unit}
    drawn = np.split(positions, np.cumsum([len(line) for line in paths], dtype=int)[:-1])
    features = (
        {
            "type": "Feature",
            "geometry": _geometry(vertices, layer),
            "properties": {name: values[i] for name, values in properties.items()},
        }
        for i, vertices in enumerate(drawn[: len(paths)])
    )
    head = {"type": "FeatureCollection", **members, "units": units}
    lines = ",\n".join(json.dumps(feature, ensure_ascii=False) for feature in features)
    text = f'{json.dumps(head, ensure_ascii=False)[:-1]}, "features": [\n{lines}\n]}}\n'
    write_file(path, text.encode())


def write_each(layers: Mapping[str, gis.Points | gis.Lines], stem: Path) -> tuple[list[Path], list[str]]:
    """Write layers to `STEM.LAYER.geojson`, and return these files, and why a layer has none. Raises `OSError`."""
    written, refused = [], []
    for name, layer in layers.items():
        path = stem.with_name(f"{stem.name}.{name}.geojson")
        try:
            write(path, layer)
            written.append(path)
        except InterchangeError as error:
            refused.append(f"no {path.name}: {error.problems[0].message}")
    return written, refused


def read(path: Path, heights: str = "") -> gis.Points | gis.Lines:
    """Read points or lines; `heights` stands in for what the file does not say.

    Raises `InterchangeError` with all that is wrong (another system or geometry, features without heights);
    `OSError`.
    """
    gis.require_content(path)
    with gis.upsets(path, "is no GeoJSON"):
        content = json.loads(path.read_bytes())
    members = _mapping(content)
    features = [_mapping(feature) for feature in _listed(members.get("features"))]
    if not features:
        raise gis.refuse(path, "", "there are no features", "a FeatureCollection with points or lines")
    _require_wgs84(path, members)
    kinds = Counter(_mapping(feature.get("geometry")).get("type") for feature in features)
    kind = _POINT if kinds[_POINT] > kinds[_LINE] else _LINE
    in_space = _has_third(_mapping(features[0].get("geometry")).get("coordinates"))
    paths, problems = [], []
    for position, feature in enumerate(features, 1):
        try:
            paths.append(_vertices(feature, kind, in_space))
        except _FeatureError as error:
            problems.append(gis.fault(path, f"feature {position}", *error.args))
    if problems:
        raise InterchangeError(problems)
    place: dict[str, Any] = {
        "crs": pyproj.CRS(_SPACE if in_space else _PLAN),
        "heights": str(members.get("heights", "")) or heights,
        "columns": _columns(features, _mapping(members.get("units")), () if in_space else (_HEIGHT,)),
    }
    return gis.Points(xyz=np.concatenate(paths), **place) if kind == _POINT else gis.Lines.of_paths(paths, **place)


def _to_wgs84(path: Path, layer: gis.Points | gis.Lines, xyz: FloatArray) -> tuple[FloatArray, dict[str, str]]:
    """Return longitude, latitude and, where the system has heights, height, rounded; and what the file says of it.

    Raises `InterchangeError` where the way to WGS 84 is not known.
    """
    crs, wanted = layer.crs, "longitude and latitude of WGS 84 (RFC 7946)"
    if crs is None:
        raise gis.refuse(path, "", "the coordinates are local", wanted)
    if not len(xyz):
        return np.empty((0, 2)), {}
    in_space = len(crs.axis_info) == 3
    with no_network(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of transformations that lack their grids: they are named below
        try:
            area: Any = _area(crs, xyz)  # pyproj says two classes of it
            target = _SPACE if in_space else _PLAN
            group = TransformerGroup(crs, target, True, area_of_interest=area, allow_ballpark=False)
            if not group.transformers:
                grids = sorted({grid.short_name for way in group.unavailable_operations for grid in way.grids})
                lacking = f" without {', '.join(grids)}" if grids else ""
                raise gis.refuse(path, "", f"PROJ has no transformation from {crs.name} to WGS 84{lacking}", wanted)
            way = group.transformers[0]
            positions = _transformed(way, xyz if in_space else xyz[:, :2])
        except ProjError as error:
            raise gis.refuse(path, "", f"{crs.name} does not reach the coordinates ({error})", wanted) from error
    positions = _rounded(positions)
    accuracy = f"{way.accuracy:g} m" if way.accuracy >= 0.0 else "unknown"
    members = {"transformation": f"{way.description}; accuracy {accuracy}"}
    return positions, members | ({} if in_space or not layer.heights else {"heights": layer.heights})


def _rounded(positions: FloatArray) -> FloatArray:
    """Return positions (n, 2 or 3) to a tenth of a millimetre; no zero has a sign."""
    axes = zip(positions.T, _DECIMALS, strict=False)
    return np.column_stack([np.round(axis, decimals) + 0.0 for axis, decimals in axes])


def _area(crs: pyproj.CRS, xyz: FloatArray) -> AreaOfInterest:
    """Return the bounds of coordinates by longitude and latitude of their own datum. Raises `ProjError`.

    Across the antimeridian west is greater than east.
    """
    geodetic = crs.geodetic_crs
    if geodetic is None:
        raise ProjError("it stands nowhere on the ellipsoid")
    plan = pyproj.Transformer.from_crs(crs, GeographicCRS(datum=geodetic.datum), always_xy=True)
    degrees = gis.continuous(_transformed(plan, xyz[:, : len(crs.axis_info)]))
    (west, south), (east, north) = degrees[:, :2].min(axis=0), degrees[:, :2].max(axis=0)
    return AreaOfInterest((west + 180.0) % 360.0 - 180.0, south, (east + 180.0) % 360.0 - 180.0, north)


def _transformed(way: pyproj.Transformer, coordinates: FloatArray) -> FloatArray:
    """Return coordinates (n, 2 or 3) in another system. Raises `ProjError` where they do not reach it."""
    transform: Any = way.transform  # of two coordinates or three
    return np.column_stack(transform(*coordinates.T, errcheck=True))


def _line_height(path: Path, position: int, heights: FloatArray) -> float:
    """Return the height of a point or of all vertices of a line. Raises `InterchangeError`."""
    if np.ptp(heights) > 0.0:
        expected = "a system with heights, or lines at one height each"
        raise gis.refuse(
            path, f"line {position + 1}", "heights above a datum that the system does not say", expected
        )
    return float(np.round(heights[0], _DECIMALS[2]) + 0.0)


def _geometry(vertices: FloatArray, layer: gis.Points | gis.Lines) -> dict[str, Any]:
    """Return vertices (k, 2 or 3) as a geometry, of several parts where the antimeridian cuts it."""
    is_area = isinstance(layer, gis.Polygons)
    parts = [_rounded(part).tolist() for part in gis.cut_at_180(vertices, is_area)]
    if isinstance(layer, gis.Points):
        return {"type": _POINT, "coordinates": parts[0][0]}
    coordinates = [[part] for part in parts] if is_area else parts
    kind = _AREA if is_area else _LINE
    if len(parts) > 1:
        return {"type": f"Multi{kind}", "coordinates": coordinates}
    return {"type": kind, "coordinates": coordinates[0]}


class _FeatureError(Exception):
    """What was found in a feature, and what is expected there."""


def _vertices(feature: dict[str, Any], kind: str, in_space: bool) -> FloatArray:
    """Return the vertices (k, 3) of a feature of one kind: heights stand in its positions, or are a property.

    Raises `_FeatureError`.
    """
    geometry = _mapping(feature.get("geometry"))
    if geometry.get("type") != kind:
        raise _FeatureError(f"a geometry of the kind {geometry.get('type')}", f"a {kind} as most features")
    coordinates = geometry.get("coordinates")
    try:
        vertices = np.array([coordinates] if kind == _POINT else coordinates)
    except ValueError:  # positions of different lengths
        vertices = np.empty(0)
    if (
        vertices.dtype.kind not in "if"
        or vertices.ndim != 2
        or vertices.shape[1] < 2
        or len(vertices) < (1 if kind == _POINT else 2)
    ):
        raise _FeatureError("its coordinates are no positions", "longitude, latitude and height")
    if (vertices.shape[1] > 2) != in_space:
        raise _FeatureError("heights in positions of some features only", "all or none")
    if not in_space:
        height = _mapping(feature.get("properties")).get(_HEIGHT)
        if isinstance(height, bool) or not isinstance(height, int | float):
            raise _FeatureError("it has no heights (2-D)", f"a third coordinate, or a property {_HEIGHT}")
        vertices = np.column_stack([vertices, np.full(len(vertices), float(height))])
    if not np.isfinite(vertices[:, :3]).all() or (np.abs(vertices[:, :2]) > (180.0, 90.0)).any():
        raise _FeatureError("its coordinates are none of the globe", "longitude and latitude in degrees, height")
    return vertices[:, :3]


def _columns(
    features: list[dict[str, Any]], units: dict[str, Any], left_out: Sequence[str]
) -> dict[str, gis.LayerColumn]:
    """Return the properties of features; one that some of them lack is NaN there, or an empty text."""
    rows = [_mapping(feature.get("properties")) for feature in features]
    names = dict.fromkeys(name for row in rows for name in row if name not in left_out)
    columns = {}
    for name in names:
        values = [_scalar(row.get(name)) for row in rows]
        if all(value is None or isinstance(value, int | float) for value in values) and None in values:
            values = [np.nan if value is None else float(value) for value in values]
        columns[name] = gis.LayerColumn.of(values, str(units.get(name, "")))
    return columns


def _scalar(value: Any) -> Any:
    """Return a value of JSON, a list or an object as its text."""
    return json.dumps(value, ensure_ascii=False) if isinstance(value, list | dict) else value


def _require_wgs84(path: Path, members: dict[str, Any]) -> None:
    """Raise `InterchangeError` for a file of the form before RFC 7946 in another system."""
    stated = members.get("crs")
    name = _mapping(_mapping(stated).get("properties")).get("name", stated)
    if stated is not None and name not in _SAME:
        raise gis.refuse(path, "crs", str(name), "WGS 84, the only system of RFC 7946")


def _has_third(coordinates: Any) -> bool:
    """Tell whether the first position of nested coordinates has a height."""
    while isinstance(coordinates, list) and coordinates and isinstance(coordinates[0], list):
        coordinates = coordinates[0]
    return isinstance(coordinates, list) and len(coordinates) > 2


def _mapping(value: Any) -> dict[str, Any]:
    """Return an object of JSON, an empty one for what is none."""
    return value if isinstance(value, dict) else {}


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
