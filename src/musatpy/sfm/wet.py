"""Which points of a model are below the water: what says it first of flags, areas, classes of LAS and heights."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
import pyproj

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.errors import Problem
from musatpy.geometry.areas import Area, area_of
from musatpy.interchange.layers import package, upsets
from musatpy.pointfiles.columns import FileColumn, Wanted
from musatpy.pointfiles.point_tables import read_table
from musatpy.reduction.displacements import EARTH_RADIUS
from musatpy.sfm.model import ModelError, links

METRE = float(np.degrees(1.0 / EARTH_RADIUS))  # of northing, in degrees
_REACH, _FARTHEST = 1000.0, 1e9  # m: of water from photos, and of any coordinate
LIMIT = 3.0  # sigmas within which a height says nothing
NOTHING = -1  # of a flag
SOURCES = ("default", "flag", "area", "class", "height")
_CLASSES = {40: 1, 41: 3, 42: 3}  # LAS 1.4 R15: bathymetric point, water surface, derived water surface
_DRY, _WET = ("dry", "0", "d", "no", "false"), ("wet", "1", "b", "yes", "true")
_WORDS = {"": NOTHING} | dict.fromkeys(_DRY, 0) | dict.fromkeys(_WET, 1)
_GEOJSON, _SIDES = (".geojson", ".json"), {"left": 1.0, "right": -1.0}
_FLAGS = (
    FileColumn(name="id", kind="text", unique=True, expected="a point"),
    FileColumn(name="wet", kind="text", aliases=("water", "submerged", "bathymetric"), blank=True),
)


class Wet(IntEnum):
    """What is known of a point."""

    DRY = 0
    WET = 1
    UNDECIDED = 2
    SURFACE = 3  # on the water itself: no point of the ground


@dataclass(frozen=True, kw_only=True, eq=False)
class Wetness:
    """What p points are, and which of `SOURCES` says it."""

    code: IntArray  # (p,) of `Wet`
    source: IntArray  # (p,)
    against: BoolArray  # (p,) heights say the contrary by more than three sigmas

    def counts(self, rows: BoolArray | slice = slice(None)) -> Counter[str]:
        """Return how many of some points are what by which source: "wet by area"."""
        number = np.bincount((self.code * len(SOURCES) + self.source)[rows], minlength=len(Wet) * len(SOURCES))
        names = (f"{code.name.lower()} by {source}" for code in Wet for source in SOURCES)
        return +Counter(dict(zip(names, number.tolist(), strict=True)))


def wetness(
    height: FloatArray,
    sigma: FloatArray,
    level: FloatArray,
    level_sigma: FloatArray,
    *,
    flags: IntArray | None = None,
    areas: IntArray | None = None,
    classes: IntArray | None = None,
) -> Wetness:
    """Return what p points are by heights and the level of the water there, m, with their sigmas.

    `flags` (p,) and `areas` (p,) are codes or `NOTHING`, `classes` (p,) those of LAS. The first that says something
    decides, but nearer to the water than three sigmas only flags and classes of its surface do: the others leave a
    point undecided, and so do heights that are not known.
    """
    above = height - level
    near = ~(np.abs(above) > LIMIT * np.hypot(sigma, level_sigma))
    by_height = np.where(near, Wet.UNDECIDED, np.where(above > 0.0, Wet.DRY, Wet.WET)).astype(np.int64)
    silent = np.full(len(height), NOTHING)
    of_class = silent.copy()
    for number, meaning in _CLASSES.items() if classes is not None else ():
        of_class[classes == number] = meaning
    given = [silent if flags is None else flags, silent if areas is None else areas, of_class]
    every = np.stack([*given, by_height])
    source = np.argmax(every != NOTHING, axis=0)
    stated = every[source, np.arange(len(height))]
    held, known = (source == 0) | (stated == Wet.SURFACE), np.isfinite(above)
    code = np.where(near & known & ~held, Wet.UNDECIDED, stated)
    against = ~near & (code != by_height) & (code < Wet.UNDECIDED)
    return Wetness(code=code, source=np.where(known | (source < 3), source + 1, 0), against=against)


def read_flags(path: Path, points: TextArray) -> IntArray:
    """Return the flags (p,) of points by the columns id and wet of a table: wet, 1, B, dry, 0, D, or nothing.

    Raises `ModelError` with line and column; `OSError`.
    """
    table = read_table(path, Wanted(columns=_FLAGS))
    table.require(ModelError, "there are no points")
    ids, texts = table.texts("id"), table.texts("wet")
    row, known = links(ids, points.tolist())
    for number in np.flatnonzero(~known).tolist():
        table.refuse(f"there is no point '{ids[number]}' in the model", number, "id")
    codes = np.array([_WORDS.get(text.lower(), -2) for text in texts], dtype=np.int64)
    for number in np.flatnonzero(codes < NOTHING).tolist():
        table.refuse(f"'{texts[number]}' is none of wet, dry, 1, 0, B, D, yes, no, true, false", number, "wet")
    table.require(ModelError)
    flags = np.full(len(points), NOTHING)
    flags[row] = codes
    return flags


@dataclass(frozen=True, kw_only=True, eq=False)
class WaterArea:
    """Where there is water, in plan: areas, or the side of shorelines."""

    area: Area | None
    shore: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 2)))  # (s, 2, 2) parts of lines
    side: float = 0.0  # 1: water is to the left of the lines, -1: to the right
    scale: FloatArray = field(default_factory=lambda: np.ones(2))  # of coordinates among each other

    def holds(self, plan: FloatArray) -> BoolArray:
        """Return (k,) which plan positions (k, 2) are in an area, or on the side of the nearest line."""
        inside = np.zeros(len(plan), dtype=bool) if self.area is None else self.area.holds(plan)
        if len(self.shore):
            for rows in np.array_split(np.arange(len(plan)), 1 + len(plan) * len(self.shore) // 2**19):
                inside[rows] |= self.side * _left_of(self.shore * self.scale, plan[rows] * self.scale) > 0.0
        return inside

    def codes(self, plan: FloatArray, doubt: float) -> IntArray:
        """Return (k,) codes of plan positions (k, 2): `NOTHING` nearer to a shore than `doubt`, in northings.

        A model whose bundle knew of no water is off in plan too.
        """
        turn = np.arange(0.0, 2.0 * np.pi, np.pi / 4.0)
        around = doubt * np.column_stack([np.cos(turn), np.sin(turn)]) / self.scale
        inside = np.stack([self.holds(plan), *(self.holds(plan + off) for off in around)])
        return np.where(inside.all(axis=0), Wet.WET, np.where(inside.any(axis=0), NOTHING, Wet.DRY))


def _left_of(parts: FloatArray, plan: FloatArray) -> FloatArray:
    """Return (k,) how far positions (k, 2) are to the left of the nearest of parts (s, 2, 2) of lines.

    Of two parts that meet where they are nearest, the one decides from whose line a position is farther off.
    """
    along = np.diff(parts, axis=1)[:, 0]
    length = np.linalg.norm(along, axis=1)
    off = plan[:, None] - parts[:, 0]
    share = np.clip(np.einsum("ksi,si->ks", off, along) / length**2, 0.0, 1.0)
    distance = np.linalg.norm(off - share[..., None] * along, axis=2)
    across = (along[:, 0] * off[..., 1] - along[:, 1] * off[..., 0]) / length
    least = distance.min(axis=1, keepdims=True)
    nearest_parts = distance <= least * (1.0 + 1e-9)
    return across[np.arange(len(plan)), np.argmax(np.where(nearest_parts, np.abs(across), -1.0), axis=1)]


def read_water(path: Path, side: str = "", *, geographic: bool, stations: FloatArray | None = None) -> WaterArea:
    """Return the areas of water or the shorelines of a GeoJSON file, or of another file of GIS (extra `gis`).

    Closed lines are areas. `side` says where the water is along others: left or right. Coordinates are longitude
    and latitude in degrees where the job is `geographic` (others are brought to WGS 84), else local. Raises
    `ModelError`, `DeckError` or `InterchangeError` for a file that has neither, or none near `stations` (n, 3),
    latitude and longitude in radians, or local; `OSError`.
    """
    kinds: dict[str, list[Any]] = {"Polygon": [], "LineString": []}
    for geometry in _geometries(path, geographic):
        kind, parts = str(geometry.get("type")), geometry.get("coordinates")
        if kind.removeprefix("Multi") not in kinds or not isinstance(parts, list):
            raise _refused(path, f"a geometry of the kind {kind}", "polygons, or lines of a shore")
        kinds[kind.removeprefix("Multi")] += parts if kind.startswith("Multi") else [parts]
    lines = {True: list[Any](), False: list[Any]()}  # closed ones, and others
    for line in kinds["LineString"]:
        lines[isinstance(line, list) and len(line) > 3 and line[0] == line[-1]].append(line)
    areas = [*kinds["Polygon"], *([ring] for ring in lines[True])]
    text = json.dumps({"type": "MultiPolygon", "coordinates": areas})
    area = area_of(text, str(path), geographic=geographic) if areas else None
    if lines[False] and side not in _SIDES:
        raise _refused(path, "a shoreline that is not closed", "a side of it, left or right, on which the water is")
    try:
        paths = [np.array(line, dtype=float)[:, :2] for line in lines[False]]
        shore = np.concatenate([np.zeros((0, 2, 2)), *(np.stack([path[:-1], path[1:]], axis=1) for path in paths)])
    except (ValueError, TypeError, IndexError):
        raise _refused(path, "a line whose coordinates are no positions", "two numbers of each") from None
    shore = shore[(shore[:, 0] != shore[:, 1]).any(axis=1)]
    outlines = [ring for rings in area.polygons for ring in rings] if area else []
    corners = np.concatenate([shore.reshape(-1, 2), *outlines])
    if not len(corners):
        raise _refused(path, "nothing", "polygons, or lines of a shore")
    wrong = ~(np.abs(corners) <= ((360.0, 90.0) if geographic else _FARTHEST)).all(axis=1)
    if wrong.any():
        expected = "longitude and latitude in degrees" if geographic else "metres"
        raise _refused(path, "a corner at {:.9g}, {:.9g}".format(*corners[wrong][0]), expected)
    if stations is not None:
        _require_near(path, corners, np.degrees(stations[:, 1::-1]) if geographic else stations[:, :2], geographic)
    scale = np.array([np.cos(np.radians(corners[:, 1].mean())), 1.0]) if geographic else np.ones(2)
    return WaterArea(area=area, shore=shore, side=_SIDES.get(side, 0.0), scale=scale)


def _require_near(path: Path, corners: FloatArray, plan: FloatArray, geographic: bool) -> None:
    """Raise `ModelError` where corners (k, 2) of water are all on one side of photos (n, 2), and far from them."""
    if geographic:  # meridians may be counted on
        corners = corners - [360.0 * np.round((corners[:, 0].mean() - plan[:, 0].mean()) / 360.0), 0.0]
    (west, east), (left, right) = ((of.min(axis=0), of.max(axis=0)) for of in (corners, plan))
    reach = right - left + (_REACH * METRE if geographic else _REACH)
    if ((east < left - reach) | (west > right + reach)).any():
        ranges = "{:.6g} to {:.6g}, {:.6g} to {:.6g}".format
        water, photos = (ranges(*np.column_stack(ends).ravel()) for ends in ((west, east), (left, right)))
        raise _refused(path, f"water at {water} alone", f"some near the photos, which are at {photos}")


def _geometries(path: Path, geographic: bool) -> list[dict[str, Any]]:
    """Return the geometries of a file as GeoJSON has them. Raises `ModelError`, `InterchangeError`."""
    if path.suffix.lower() not in _GEOJSON:
        pyogrio, shapely = (package(name, f"files {path.suffix} need") for name in ("pyogrio.raw", "shapely"))
        with upsets(path, "is no file of GIS that is read"):
            meta, _, encoded, _ = pyogrio.read(path)
            geometries = shapely.from_wkb(encoded)
            if geographic and not meta["crs"]:
                raise _refused(path, "no coordinate system", "one that leads to WGS 84")
            if geographic:
                way = pyproj.Transformer.from_crs(meta["crs"], "OGC:CRS84", always_xy=True)
                geometries = shapely.transform(geometries, lambda xy: np.column_stack(way.transform(*xy.T)))
        return [json.loads(text) for text in shapely.to_geojson(geometries).tolist()]
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig", errors="replace"))
        features = content["features"] if content["type"] == "FeatureCollection" else [content]
        geometries = [one["geometry"] if one["type"] == "Feature" else one for one in features]
        geometries = [dict(geometry) for geometry in geometries if geometry is not None]
        if not geographic or not content.get("crs"):
            return geometries
        system = content["crs"]["properties"]["name"]
        way = pyproj.Transformer.from_crs(system, "OGC:CRS84", always_xy=True)
        return [one | {"coordinates": _moved(one["coordinates"], way)} for one in geometries]
    except pyproj.exceptions.CRSError:
        raise _refused(path, f"the coordinate system {system}", "one that PROJ knows") from None
    except (ValueError, TypeError, KeyError, IndexError, RecursionError):
        raise _refused(path, "no features", "GeoJSON") from None


def _moved(coordinates: Any, way: pyproj.Transformer) -> Any:
    """Return coordinates of GeoJSON, lists of positions to any depth, in another system."""
    if isinstance(coordinates[0], list):
        return [_moved(part, way) for part in coordinates]
    return list(way.transform(*coordinates[:2]))


def _refused(path: Path, content: str, expected: str) -> ModelError:
    return ModelError([Problem(message=f"it has {content}; expected: {expected}", file=str(path))])
