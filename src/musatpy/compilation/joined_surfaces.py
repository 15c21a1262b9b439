"""The surfaces of a compilation: triangles over points, joined over models that overlap.

The bottom has depths below the sounding datum at the submerged points. Points of the shoreline belong to it and
bound it: triangles between these alone are land. The foreshore, dry points up to a height above the datum, belongs
to it where the deck says so. Heights are those of all points, land and bottom. Points of the run read again check
the model, and are in no surface; nor are spikes of profiles. A point that is flagged as submerged and stands above
the water contradicts itself, and is not in the bottom. Where models overlap they are joined in the middle: of
the points there each keeps those that are nearer to its own middle. What both say there is the edge match.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.compilation.compiled import Compiled, CompiledModel, DepthDatum
from musatpy.compilation.profiles import profiles_of
from musatpy.errors import SurfaceError
from musatpy.geometry.crs import MapPlan
from musatpy.model.compilation import AGAIN, SHORE
from musatpy.surfaces.tin import Tin


class Of(StrEnum):
    """What a surface has at its points."""

    DEPTH = "depth"  # below the sounding datum
    HEIGHT = "height"  # of the job

    @property
    def layer(self) -> str:
        """The name of its contours, in layers and files."""
        return "contours" if self is Of.DEPTH else "heights"


@dataclass(frozen=True, kw_only=True, eq=False)
class EdgeMatch:
    """What two models that overlap say of the same places: values of the first less those of the second.

    names (k,) of the points there, of either model, each against the surface of the other, with sigmas (k,) m of
    points and surface.
    """

    models: tuple[str, str]
    names: TextArray
    difference: FloatArray
    sigma: FloatArray

    @property
    def rms(self) -> float:
        """Root mean square, m."""
        return float(np.sqrt(np.mean(np.square(self.difference))))

    @property
    def expected(self) -> float:
        """Root mean square of the sigmas, m; stations in common would make it smaller."""
        return float(np.sqrt(np.mean(np.square(self.sigma))))

    @property
    def largest(self) -> int:
        """The point of the largest difference."""
        return int(np.argmax(np.abs(self.difference)))


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthPoints:
    """k points of a bottom, xy (k, 2) m: depths below the datum (k,) m, with sigmas, and those of the water."""

    xy: FloatArray
    depth: FloatArray
    sigma: FloatArray
    water: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class JoinedSurface:
    """The surface of models that overlap, in plan: metres on the map about the job, X and Y of local jobs; depths.

    The network is None, with its `reason`, where the points make none. `plan` takes places back to the job, None in
    local jobs. Points `left_out` lie beyond the middles of overlaps.
    """

    models: tuple[str, ...]
    points: DepthPoints
    tin: Tin | None
    plan: MapPlan | None
    reason: str = ""
    left_out: int = 0

    @property
    def angular(self) -> bool:
        """Whether its job has latitude and longitude."""
        return self.plan is not None

    def coordinates(self, xy: FloatArray, height: FloatArray) -> FloatArray:
        """Return coordinates (k, 3) of the job of places (k, 2) at heights (k,)."""
        places = np.column_stack([xy, height])
        return places if self.plan is None else self.plan.coordinates(places)

    def below(self, xy: FloatArray, depth: FloatArray, datum: DepthDatum) -> FloatArray:
        """Return coordinates (k, 3) of the job of places (k, 2) at depths (k,) below a datum."""
        at_zero = self.coordinates(xy, np.zeros(len(xy)))
        return self.coordinates(xy, datum.over(at_zero) - depth)

    def places(self, coordinates: FloatArray) -> FloatArray:
        """Return the places (k, 2) of the first two coordinates (k, 2) of the job."""
        if self.plan is None:
            return coordinates
        return self.plan.places(np.column_stack([coordinates, np.zeros(len(coordinates))]))[:, :2]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Points:
    """The k points of the bottom of a model: xyz (k, 3), z the depth, sigmas (k,), which are on the shore.

    water (k,): depths of the water below the datum, m.
    """

    model: CompiledModel
    names: TextArray
    xyz: FloatArray
    sigma: FloatArray
    shore: BoolArray
    water: FloatArray
    tin: Tin | None
    reason: str


def surfaces_of(compiled: Compiled, of: Of = Of.DEPTH) -> tuple[tuple[JoinedSurface, ...], tuple[EdgeMatch, ...]]:
    """Return the surfaces of depths below the sounding datum, or of heights, and how models that overlap match."""
    spec = compiled.deck.contours if of is Of.DEPTH else compiled.deck.heights
    longest = spec.longest_edge if spec else np.inf
    plan, parts = _parts(compiled, longest, of)
    edges = []
    beyond: list[BoolArray] = [np.zeros(len(part.xyz), dtype=bool) for part in parts]
    group = np.arange(len(parts))
    for first, second in combinations(range(len(parts)), 2):
        edge, of_first, of_second = _edge_match(parts[first], parts[second])
        beyond[first] |= of_first
        beyond[second] |= of_second
        if edge is not None:
            edges.append(edge)
            group[group == group[second]] = group[first]
    surfaces = [
        _surface([parts[row] for row in rows], [beyond[row] for row in rows], plan, longest)
        for rows in (np.flatnonzero(group == number) for number in dict.fromkeys(group.tolist()))
    ]
    return tuple(surfaces), tuple(edges)


def _parts(compiled: Compiled, longest_edge: float, of: Of) -> tuple[MapPlan | None, list[_Points]]:
    """Return the map of the job, and the points of each model that make its surface."""
    value, sigma, used = _values(compiled, of)
    position, system = compiled.points.position, compiled.run.map_system
    on_shore = (compiled.kind == SHORE) & (of is Of.DEPTH)
    plan = None if system is None or not used.any() else MapPlan.about(system, position[used])
    parts, first = [], 0
    for model in compiled.models:
        rows = first + np.flatnonzero(used[first : first + len(model.rows)])
        place = position[rows] if plan is None else plan.places(position[rows])
        xyz = np.column_stack([place[:, :2], value[rows]])
        shore = on_shore[rows]
        level = model.points.water_level[rows - first]
        level = np.where(np.isnan(level), model.stereo.tides.mean(), level)
        tin, reason = _network(xyz, sigma[rows], shore, longest_edge)
        parts.append(
            _Points(
                model=model,
                names=model.readings.ids[rows - first],
                xyz=xyz,
                sigma=sigma[rows],
                shore=shore,
                water=compiled.datum.over(position[rows]) - level,
                tin=tin,
                reason=reason,
            )
        )
        first += len(model.rows)
    return plan, parts


def _values(compiled: Compiled, of: Of) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the values (k,) of a surface at all points, their sigmas, and which points make it."""
    read: BoolArray = compiled.kind != AGAIN
    for line in profiles_of(compiled):
        read[line.rows] &= ~line.profile.spike if line.profile else True
    if of is Of.HEIGHT:
        return compiled.height, compiled.sigma[:, 2], read & np.isfinite(compiled.height)
    depth, spec = compiled.datum_depth, compiled.deck.contours
    wet = (compiled.submerged & ~compiled.too_high) | (compiled.kind == SHORE)
    if spec is not None and np.isfinite(spec.drying):
        wet = wet | (depth >= -spec.drying)
    return depth, compiled.datum_depth_sigma, read & wet & np.isfinite(depth)


def _network(xyz: FloatArray, sigma: FloatArray, shore: BoolArray, longest_edge: float) -> tuple[Tin | None, str]:
    """Return the triangles of points, or why there are none."""
    if not len(xyz):
        return None, "no point of it has a position"
    try:
        return Tin.of(xyz, sigma, longest_edge, shore), ""
    except SurfaceError as error:
        return None, error.problems[0].message


def _edge_match(first: _Points, second: _Points) -> tuple[EdgeMatch | None, BoolArray, BoolArray]:
    """Return how two models match, None where they do not overlap, and which points of each the other one keeps."""
    rows, difference, sigma, beyond = _less_other(first, second)
    rows_back, back, sigma_back, beyond_back = _less_other(second, first)
    if not len(rows) + len(rows_back):
        return None, beyond, beyond_back
    edge = EdgeMatch(
        models=(first.model.name, second.model.name),
        names=np.concatenate([first.names[rows], second.names[rows_back]]),
        difference=np.concatenate([difference, -back]),
        sigma=np.concatenate([sigma, sigma_back]),
    )
    return edge, beyond, beyond_back


def _less_other(part: _Points, other: _Points) -> tuple[IntArray, FloatArray, FloatArray, BoolArray]:
    """Return the rows of a model's points that the surface of another one has too, less that, with sigmas.

    And which of all its points are there and nearer to the middle of the other model.
    """
    beyond: BoolArray = np.zeros(len(part.xyz), dtype=bool)
    if part.tin is None or other.tin is None:
        return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), beyond
    xy = part.xyz[:, :2]
    at = other.tin.at(xy)
    rows = np.flatnonzero(np.isfinite(at.value))
    far, near = (np.linalg.norm(xy[rows] - points.xyz[:, :2].mean(axis=0), axis=1) for points in (part, other))
    beyond[rows] = near < far
    return rows, part.xyz[rows, 2] - at.value[rows], np.hypot(part.sigma[rows], at.sigma[rows]), beyond


def _surface(
    parts: list[_Points], beyond: list[BoolArray], plan: MapPlan | None, longest_edge: float
) -> JoinedSurface:
    """Return the surface of models by their points that are not `beyond` the middle of an overlap."""
    kept = ~np.concatenate(beyond)
    xyz, sigma, shore, water = (
        np.concatenate([getattr(part, name) for part in parts])[kept] for name in ("xyz", "sigma", "shore", "water")
    )
    alone = len(parts) == 1
    tin, reason = (parts[0].tin, parts[0].reason) if alone else _network(xyz, sigma, shore, longest_edge)
    return JoinedSurface(
        models=tuple(part.model.name for part in parts),
        points=DepthPoints(xy=xyz[:, :2], depth=xyz[:, 2], sigma=sigma, water=water),
        tin=tin,
        plan=plan,
        reason=reason,
        left_out=int(np.count_nonzero(~kept)),
    )
