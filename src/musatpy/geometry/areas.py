"""Areas in plan: polygons with their holes, of GeoJSON or of a list of corners."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import DeckError, MusatError, Problem


@dataclass(frozen=True, kw_only=True, eq=False)
class Area:
    """Polygons in plan; `geographic` ones are longitudes and latitudes in degrees, and may cross 180 degrees."""

    polygons: tuple[tuple[FloatArray, ...], ...]  # of each its outline (v, 2) east, north, and those of its holes
    geographic: bool

    @classmethod
    def box(cls, west: float, south: float, east: float, north: float, *, geographic: bool) -> Self:
        """Return the area between two easts (longitudes) and two norths. Raises `MusatError` where it is empty."""
        if geographic and east < west:
            east += 360.0
        if not (west < east and south < north):
            raise MusatError(f"the box {west:g},{south:g},{east:g},{north:g} is empty: it is west,south,east,north")
        corners = np.array([[west, south], [east, south], [east, north], [west, north]])
        return cls(polygons=((corners,),), geographic=geographic)

    def holds(self, plan: FloatArray) -> BoolArray:
        """Return (k,) which plan positions (k, 2) are inside: even-odd rule; none where there is no position."""
        inside = np.zeros(len(plan), dtype=bool)
        for outlines in self.polygons:
            inside |= np.logical_xor.reduce([self._within(outlines[0][0], outline, plan) for outline in outlines])
        return inside & np.isfinite(plan).all(axis=1)

    def _within(self, origin: FloatArray, outline: FloatArray, plan: FloatArray) -> BoolArray:
        """Return (k,) which plan positions (k, 2) are inside one outline (v, 2)."""
        corners, points = self._about(origin, outline), self._about(origin, plan)
        inside = np.zeros(len(points), dtype=bool)
        for (x1, y1), (x2, y2) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if y1 == y2:
                continue
            with np.errstate(invalid="ignore"):
                between = (y1 > points[:, 1]) != (y2 > points[:, 1])
                inside ^= between & (points[:, 0] < x1 + (points[:, 1] - y1) / (y2 - y1) * (x2 - x1))
        return inside

    def _about(self, origin: FloatArray, plan: FloatArray) -> FloatArray:
        """Return positions about the first corner, longitudes the short way round."""
        shift = plan - origin
        if self.geographic:
            shift[:, 0] -= 360.0 * np.rint(shift[:, 0] / 360.0)
        return shift


def area_of(text: str, file: str, *, geographic: bool) -> Area:
    """Return the area of a text: GeoJSON polygons, or east and north of a corner on each line, # before a comment.

    Raises `DeckError` with every bad line, or where there are fewer than three corners.
    """
    if text.lstrip("\ufeff \t\r\n").startswith("{"):
        return Area(polygons=_of_geojson(text.removeprefix("\ufeff"), file), geographic=geographic)
    corners, problems = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            east, north = (float(word) for word in words)
            corners.append((east, north))
        except ValueError:
            problems.append(Problem(file=file, line=number, message=f"'{line.strip()}' is not an east and a north"))
    if not problems and (len(corners) < 3 or not np.isfinite(corners).all()):
        problems.append(Problem(file=file, message=f"an area needs three corners at least, not {len(corners)}"))
    if problems:
        raise DeckError(problems)
    return Area(polygons=((np.array(corners),),), geographic=geographic)


def _of_geojson(text: str, file: str) -> tuple[tuple[FloatArray, ...], ...]:
    """Return the outlines of the polygons of a GeoJSON text, holes too; raises `DeckError` where it has none."""
    try:
        polygons = [
            tuple(np.array([corner[:2] for corner in ring], dtype=float) for ring in polygon)
            for polygon in _polygons(json.loads(text))
        ]
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
        why = f": {error}" if isinstance(error, json.JSONDecodeError) else ""
        raise DeckError.of(f"not the GeoJSON of a polygon{why}", file=file) from error
    rings = [ring for polygon in polygons for ring in polygon]
    good = [len(ring) > 2 and ring.shape[1:] == (2,) and np.isfinite(ring).all() for ring in rings]
    if not good or not all(good) or not all(polygons):
        raise DeckError.of("an area needs polygons, of three corners at least each", file=file)
    return tuple(polygons)


def _polygons(member: Any) -> Iterator[Any]:
    """Yield the coordinates of the polygons of a GeoJSON object; raises `KeyError`, `TypeError`, `ValueError`."""
    match member["type"]:
        case "Polygon":
            yield member["coordinates"]
        case "MultiPolygon":
            yield from member["coordinates"]
        case "Feature":
            yield from _polygons(member["geometry"])
        case "FeatureCollection":
            for feature in member["features"]:
                yield from _polygons(feature)
        case kind:
            raise ValueError(kind)
