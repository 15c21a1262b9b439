"""Contours of another source: 3-D lines of DXF, GeoJSON and GeoPackage, or vertices of CSV and XYZ files.

A column `depth` says the depth of a line, positive down; without it the third coordinates are its height. How far
lines lie from others is sampled every metre, both ways, with the area between them (shapely, the extra `gis`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, ComplexArray, FloatArray, InRows
from musatpy.errors import Problem, SoundingError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.projected import crs_of
from musatpy.interchange import xyz
from musatpy.interchange.any_file import read_layers
from musatpy.interchange.layers import Lines, Points, package, require_content
from musatpy.pointfiles.columns import LON_LAT, MAP_PLACES, PLAN, FileColumn, Wanted
from musatpy.pointfiles.point_tables import read_table
from musatpy.soundings.sounding_files import FORMS, VALUES, job_places
from musatpy.units import DEGREE

_STEP = 1.0  # m
_MOST = 0.95
_SAME = 1e-6  # m, of ends that join
_SUFFIXES = (".gpkg", ".geojson", ".json", ".dxf", ".csv", ".xyz")
_LEVEL = 1e-3  # m, by which heights along a contour may differ
_DEPTH, _LINE = "depth", "line"
_LINE_OF_XYZ = "column4"  # behind x, y, z
_FORMS = (*((*plan, "depth", "height") for plan in (LON_LAT, PLAN)), *FORMS)  # depths go before heights
_TABLE = Wanted(
    columns=(*MAP_PLACES, *VALUES, FileColumn(name=_LINE, kind="text", expected="a line")), forms=_FORMS
)


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
    kind, angular = source.suffix.lower(), False
    require_content(source)
    if kind not in _SUFFIXES:
        raise _refused(source, f"contours are read from {', '.join(_SUFFIXES)}, not from '{source.suffix}'")
    if kind == ".csv":
        lines, depths, angular = _of_table(source)
    elif kind == ".xyz":
        points = xyz.read(source)
        if _LINE_OF_XYZ not in points.columns:
            raise _refused(source, f"no column {_LINE_OF_XYZ}, which says on which line a vertex is")
        lines = _joined(source, points.xyz, points.columns[_LINE_OF_XYZ].values)
    else:
        parts = list(read_layers(source, layer=layer).values())
        if kind != ".dxf" and any(isinstance(part, Points) for part in parts):
            raise _refused(source, "it has points, and contours are lines")
        lines = next((part for part in parts if isinstance(part, Lines)), Lines.of_paths([]))
    paths = lines.paths()
    if not paths:
        raise _refused(source, "there are no lines")
    depth, plan = _depths(source, lines, paths, depths), np.concatenate(paths)[:, :2]
    if angular:
        places = plan[:, ::-1] * DEGREE
    else:
        places = job_places(source, plan, lines.crs or (crs_of(crs) if crs else None), job)
    ends = np.cumsum([len(path) for path in paths])[:-1]
    return ContourLines(places=tuple(np.split(places, ends)), angular=angular or job is not None, depth=depth)


def _depths(source: Path, lines: Lines, paths: list[FloatArray], depths: bool) -> FloatArray:
    """Return the depth (n,) of each line, by its column or by third coordinates: `depths`, or heights.

    Raises `SoundingError` with all lines that have none or more than one.
    """
    column = lines.columns.get(_DEPTH)
    if column is not None and not column.is_text:
        depth = column.values.astype(float)
        faults = dict.fromkeys(np.flatnonzero(~np.isfinite(depth)).tolist(), "it has no depth")
    else:
        depth = np.array([float(path[:, 2].mean()) for path in paths]) * (1.0 if depths else -1.0)
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


def _of_table(source: Path) -> tuple[Lines, bool, bool]:
    """Return the lines of a table, whether third coordinates are depths, and the others longitude and latitude."""
    table = read_table(source, _TABLE)
    table.require(SoundingError, empty="there are no points")
    plan = LON_LAT if table.has("lat") else PLAN
    depths = table.has("depth")
    xyz_of_vertices = table.numbers(*plan, "depth" if depths else "height")
    return _joined(source, xyz_of_vertices, table.texts(_LINE)), depths, plan == LON_LAT


def _joined(source: Path, vertices: FloatArray, line_of: ArrayLike) -> Lines:
    """Return the lines of vertices (n, 3) by the line (n,) that each is on."""
    _, first, line = np.unique(line_of, return_index=True, return_inverse=True)
    paths = [vertices[line.reshape(-1) == row] for row in np.argsort(first).tolist()]
    short = [row for row, path in enumerate(paths, 1) if len(path) < 2]
    if short:
        raise SoundingError([Problem(file=str(source), message=f"line {row} has one vertex") for row in short])
    return Lines.of_paths(paths)


def _refused(source: Path, message: str) -> SoundingError:
    return SoundingError.of(message, file=source)


@dataclass(frozen=True, kw_only=True, eq=False)
class Offsets(InRows):
    """n samples xy (n, 2) m of lines, each for an interval (n,) m, and their nearest places (n, 2) on others.

    beyond (n,): without a partner, past an open end of the other line, which is the nearest place, or too far.
    """

    xy: FloatArray
    interval: FloatArray
    nearest: FloatArray
    beyond: BoolArray

    @property
    def distance(self) -> FloatArray:
        """(n,) m."""
        return np.linalg.norm(self.nearest - self.xy, axis=1)


def offsets(
    lines: Sequence[FloatArray], others: Sequence[FloatArray], farthest: float = np.inf, step: float = _STEP
) -> Offsets:
    """Return how lines, each (k, 2) m, lie from others; a closed one ends where it begins.

    The samples are the middles of intervals of `step` at most; others `farthest` (m) away are no partners. Raises
    `InterchangeError` without shapely.
    """
    shapely = package("shapely", "distances of contours need")
    parts = [_samples(shapely, line, step) for line in lines]
    xy, interval = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    pieces = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in others])
    segments = shapely.linestrings(pieces[np.ptp(pieces, axis=1).any(axis=1)])
    samples = shapely.points(xy)
    _, near = shapely.STRtree(segments).query_nearest(samples, all_matches=False)
    nearest = shapely.get_coordinates(shapely.shortest_line(samples, segments[near]))[1::2]
    ends, count = np.unique(
        _rounded(np.array([line[end] for line in others for end in (0, -1)])), return_counts=True
    )
    past_end = np.isin(_rounded(nearest), ends[count == 1])  # where no line goes on
    too_far = np.linalg.norm(nearest - xy, axis=1) > farthest
    return Offsets(xy=xy, interval=interval, nearest=nearest, beyond=past_end | too_far)


def _rounded(xy: FloatArray) -> ComplexArray:
    """Return places (n, 2) as single numbers (n,), the same of ends that join."""
    return np.round(xy / _SAME) @ np.array([1.0, 1.0j])


def area_between(forward: Offsets, backward: Offsets) -> float:
    """Return the area (m2) between lines that were sampled both ways.

    The mean of both integrals of the distance d along a line: where one has the curvature k the other is 1 + k d
    times as long, and the strip between them d (1 + k d / 2) of the first.
    """
    return float(0.5 * (forward.interval @ forward.distance + backward.interval @ backward.distance))


def largest_of_most(values: FloatArray, weight: FloatArray) -> float:
    """Return the least value (n,) that 95 % of the weight (n,) does not exceed."""
    order = np.argsort(values)
    share = np.cumsum(weight[order]) / weight.sum()
    return float(values[order[min(int(np.searchsorted(share, _MOST)), len(values) - 1)]])


def _samples(shapely: Any, line: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Return places (n, 2) in the middle of equal intervals along a line (k, 2), and these (n,)."""
    shape = shapely.linestrings(line)
    count = max(int(np.ceil(shape.length / step)), 1)
    at = (np.arange(count) + 0.5) * shape.length / count
    xy = shapely.get_coordinates(shapely.line_interpolate_point(shape, at))
    return xy, np.full(count, shape.length / count)
