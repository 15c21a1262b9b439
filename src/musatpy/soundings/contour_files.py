"""Contours of another source: 3-D lines of DXF, GeoJSON and GeoPackage, or vertices of CSV and XYZ files.

A column `depth` says the depth of a line, positive down; without it the third coordinates are its height.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import Problem, SoundingError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.projected import crs_of
from musatpy.interchange import dxf, geojson, geopackage, xyz
from musatpy.interchange.layers import Lines, Points
from musatpy.interchange.packages import require_content
from musatpy.pointfiles.csv_tables import ENCODING, common_name, names_of
from musatpy.soundings.job_places import job_places
from musatpy.units import DEGREE

_LEVEL = 1e-3  # m, by which heights along a contour may differ
_DEPTH, _LINE = "depth", "line"
_LINE_OF_XYZ = "column4"  # behind x, y, z
_PLACES, _VALUES = (("lon", "lat"), ("x", "y")), (_DEPTH, "height")


@dataclass(frozen=True, kw_only=True, eq=False)
class ContourLines:
    """n contours: places (k, 2) of each, latitude and longitude (rad) where `angular`, else m; depth (n,) m.

    A closed one ends where it begins.
    """

    places: tuple[FloatArray, ...]
    angular: bool
    depth: FloatArray


def read_contours(
    source: Path, job: Ellipsoid | None, *, crs: str = "", layer: str = "", depths: bool = False
) -> ContourLines:
    """Return the contours of a file by its suffix, in the coordinates of a job: None for those of a local one.

    `crs` stands in for what the file does not say, `layer` names one of a GeoPackage; with `depths` third
    coordinates are depths and no heights. Raises `SoundingError` and `InterchangeError` for what cannot be used;
    `OSError`.
    """
    readers: dict[str, Callable[[], _Content]] = {
        ".gpkg": lambda: _Content(lines=_require_lines(source, geopackage.read(source, layer)), depths=depths),
        ".geojson": lambda: _Content(lines=_require_lines(source, geojson.read(source)), depths=depths),
        ".json": lambda: _Content(lines=_require_lines(source, geojson.read(source)), depths=depths),
        ".dxf": lambda: _Content(lines=dxf.read(source)[1], depths=depths),
        ".csv": lambda: _of_csv(source),
        ".xyz": lambda: _Content(lines=_joined(source, xyz.read(source), _LINE_OF_XYZ), depths=depths),
    }
    reader = readers.get(source.suffix.lower())
    require_content(source)
    if reader is None:
        raise _refused(source, f"contours are read from {', '.join(readers)}, not from '{source.suffix}'")
    content = reader()
    paths = content.lines.paths()
    if not paths:
        raise _refused(source, "there are no lines")
    depth, plan = _depths(source, content, paths), np.concatenate(paths)[:, :2]
    if content.angular:
        places = plan[:, ::-1] * DEGREE
    else:
        places = job_places(source, plan, content.lines.crs or (crs_of(crs) if crs else None), job)
    ends = np.cumsum([len(path) for path in paths])[:-1]
    return ContourLines(
        places=tuple(np.split(places, ends)), angular=content.angular or job is not None, depth=depth
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Content:
    """Lines, in longitude and latitude where `angular`; third coordinates are depths, or else heights."""

    lines: Lines
    depths: bool
    angular: bool = False


def _depths(source: Path, content: _Content, paths: list[FloatArray]) -> FloatArray:
    """Return the depth (n,) of each line. Raises `SoundingError` with all lines that have none or more than one."""
    column = content.lines.columns.get(_DEPTH)
    if column is not None and not column.is_text:
        depth = column.values.astype(float)
        faults = dict.fromkeys(np.flatnonzero(~np.isfinite(depth)).tolist(), "it has no depth")
    else:
        depth = np.array([float(path[:, 2].mean()) for path in paths]) * (1.0 if content.depths else -1.0)
        faults = {
            row: f"its third coordinate goes from {path[:, 2].min():g} to {path[:, 2].max():g} m: a contour has one"
            for row, path in enumerate(paths)
            if np.ptp(path[:, 2]) > _LEVEL
        }
    if faults:
        raise SoundingError(
            [Problem(file=str(source), message=f"line {row + 1}: {fault}") for row, fault in faults.items()]
        )
    return depth


def _of_csv(source: Path) -> _Content:
    """Return the lines of a file of named columns."""
    with source.open(newline="", **ENCODING) as file:  # type: ignore[call-overload]
        given = names_of(file.readline())
    known = {common_name(name): name for name in reversed(given)}
    place = next((pair for pair in _PLACES if set(pair) <= set(known)), None)
    value = next((name for name in _VALUES if name in known), None)
    if place is None or value is None:
        wanted = "lat and lon, or x and y, and depth or height"
        raise _refused(source, f"columns {wanted} are needed, not {', '.join(given)}")
    points = xyz.read(source, [known[name] for name in (*place, value)])
    lines = _joined(source, points, known.get(_LINE, _LINE))
    return _Content(lines=lines, depths=value == _DEPTH, angular=place == _PLACES[0])


def _joined(source: Path, points: Points, name: str) -> Lines:
    """Return the lines of points by a column with the number of the line that each is on."""
    column = points.columns.get(name)
    if column is None:
        raise _refused(source, f"no column {name}, which says on which line a vertex is")
    _, first, line = np.unique(column.values, return_index=True, return_inverse=True)
    paths = [points.xyz[line.reshape(-1) == row] for row in np.argsort(first).tolist()]
    short = [row for row, path in enumerate(paths, 1) if len(path) < 2]
    if short:
        raise SoundingError([Problem(file=str(source), message=f"line {row} has one vertex") for row in short])
    return Lines.of_paths(paths, crs=points.crs)


def _require_lines(source: Path, layer: Points | Lines) -> Lines:
    if isinstance(layer, Points):
        raise _refused(source, "it has points, and contours are lines")
    return layer


def _refused(source: Path, message: str) -> SoundingError:
    return SoundingError([Problem(file=str(source), message=message)])
