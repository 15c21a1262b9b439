"""Where things are before any adjustment: plan positions, images put down on level ground, areas."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Self

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import DeckError, MusatError, Problem
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid, Frame, GeocentricFrame, GeographicFrame, LocalFrame
from musatpy.model import Block, CoordinateSystem
from musatpy.units import DEGREE


def frame_of(block: Block) -> Frame:
    """Return the frame of a block, its working axes about the origin of its system.

    Raises `DeckError` where an ellipsoid is needed and not known.
    """
    system, spec = block.options.system, block.ellipsoid
    if system is CoordinateSystem.LOCAL:
        return LocalFrame(np.zeros(3))
    if spec is None:
        raise DeckError([Problem(message=f"a {system} job needs an ellipsoid")])
    try:
        ellipsoid = Ellipsoid.of(spec)
    except ValueError as error:
        raise DeckError([Problem(message=str(error))]) from error
    kind = GeographicFrame if system is CoordinateSystem.GEOGRAPHIC else GeocentricFrame
    return kind(np.zeros(3), ellipsoid)


def plan(block: Block, system: FloatArray) -> FloatArray:
    """Return east and north (..., 2) of positions (..., 3): X, Y of local jobs, else degrees.

    Degrees are longitude and latitude. NaN where a position is not given as far as it is needed.
    """
    if block.options.system is CoordinateSystem.LOCAL:
        return system[..., :2]
    level = _level(block, system)
    return np.stack([level[..., 1], level[..., 0]], axis=-1) / DEGREE


def _level(block: Block, system: FloatArray) -> FloatArray:
    """Return positions (..., 3), of geocentric jobs as latitude, longitude, height; NaN where not known."""
    if block.options.system is not CoordinateSystem.GEOCENTRIC:
        return np.array(system)
    known = np.isfinite(system).all(axis=-1)
    level = np.full(system.shape, np.nan)
    level[known] = frame_of(block).level(system[known])
    return level


def control_heights(block: Block) -> FloatArray:
    """Return the heights (k,) of control, NaN where not given."""
    position = block.control.position
    if block.options.system is not CoordinateSystem.GEOCENTRIC:
        return position[:, 2]
    heights = np.full(len(position), np.nan)
    known = np.isfinite(position).all(axis=1)
    heights[known] = frame_of(block).height(position[known])
    return heights


def ground_level(block: Block) -> float:
    """Return the height (m) that stands for the ground: the median of the control, or of the tides without any.

    Raises `DeckError` where a block has neither.
    """
    for heights in (control_heights(block), block.photos.tide):
        known = heights[np.isfinite(heights)]
        if known.size:
            return float(np.median(known))
    raise DeckError([Problem(message="the height of the ground follows from neither control nor tides: give it")])


def images_on_ground(block: Block, height: float) -> FloatArray:
    """Return the positions (m, 3), in the job's system, of all images put down on level ground at `height` (m).

    By straight rays from the stations as given, in the level plane below each: approximate. NaN where a photo has
    no station or attitude, or a ray does not come down. Raises `DeckError` for readings, which say no direction.
    """
    if block.raw:
        message = "the plates are comparator readings (RED): where their points are is known only after a run"
        raise DeckError([Problem(message=message)])
    frame, photos, plates = frame_of(block), block.photos, block.plates
    known = np.asarray(np.isfinite(np.hstack([photos.position, photos.attitude])).all(axis=1))
    rays = np.flatnonzero(known[plates.photo])
    photo = plates.photo[rays]
    camera = photos.camera[photo]
    image = np.empty((len(rays), 3))
    image[:, :2] = plates.xy[rays] - block.cameras.principal_point[camera]
    image[:, 2] = -block.cameras.focal_length[camera]
    direction = np.einsum("rji,rj->ri", attitude_matrix(photos.attitude[photo]), image)
    station = frame.working(photos.position[photo])
    drop: FloatArray = np.atleast_1d(frame.height(station)) - height
    down = (direction[:, 2] < 0.0) & (drop > 0.0)
    rays, station, direction, drop = rays[down], station[down], direction[down], drop[down]
    below = direction * (drop / -direction[:, 2])[:, None]
    ground = np.full((len(plates.photo), 3), np.nan)
    ground[rays] = frame.system(station + np.einsum("rji,rj->ri", frame.axes(station), below))
    return ground


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
        outlines = [
            tuple(np.array([corner[:2] for corner in outline], dtype=float) for outline in polygon)
            for polygon in _polygons(json.loads(text))
        ]
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
        why = f": {error}" if isinstance(error, json.JSONDecodeError) else ""
        raise DeckError([Problem(file=file, message=f"not the GeoJSON of a polygon{why}")]) from error
    good = [len(one) > 2 and one.shape[1:] == (2,) and np.isfinite(one).all() for of in outlines for one in of]
    if not good or not all(good) or not all(outlines):
        raise DeckError([Problem(file=file, message="an area needs polygons, of three corners at least each")])
    return tuple(outlines)


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


def near_control(blocks: list[Block], limit: float) -> list[tuple[int, str, int, str, float]]:
    """Return pairs of control points of two blocks, of different names, nearer to each other than `limit` m.

    Rows are block, point, block, point, distance in plan; those without horizontal positions are not compared. It
    is a hint only: what is near is not therefore the same.
    """
    from scipy.spatial.distance import cdist

    places = [_working_plan(block) for block in blocks]
    names = [block.points.ids[block.control.point].tolist() for block in blocks]
    pairs = []
    for first, second in combinations(range(len(blocks)), 2):
        distance = cdist(places[first], places[second])
        for a, b in np.argwhere(distance < limit).tolist():
            one, other = names[first][a], names[second][b]
            if one != other:
                pairs.append((first, one, second, other, float(distance[a, b])))
    return pairs


def _working_plan(block: Block) -> FloatArray:
    """Return control (k, 3) in working axes at height 0, so that distances are those in plan; NaN where unknown."""
    position, frame = _level(block, block.control.position), frame_of(block)
    known = np.isfinite(position[:, :2]).all(axis=1)
    position[:, 2] = 0.0
    working = np.full(position.shape, np.nan)
    working[known] = frame.from_level(position[known])
    return working
