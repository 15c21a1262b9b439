"""Which rays go through the water surface, and how that may change from one triangulation to the next.

At the water line the image of a point has a kink. Were a ray wet or dry as the point stands at every moment, a
point near the tide of one of its photos would switch for ever, or stop the run. So the rays keep their state while
a triangulation runs, the formulas going on smoothly through zero depth; after it each point takes the state with
the least squares of those that agree with where it then comes to stand. Where none does, every state taking the
point to the other side of a tide, the sum of squares is least on that water line, and there the point is held.

WATPT, which has no equations for a refracted ray, moves its points by where they stand (`moved`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.ground import hold, point_normals, settle_group
from musatpy.adjustment.network import Network, PointGroup, group_points
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water import water_heights

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_NEAR = 4.0  # sigmas of a height: farther from every tide, a point that agrees with its state has no other one
_TURNS = 6  # changes of a point after which it rests: those of several points can go round in a circle
_SAME = 1e-4  # m, of water lines that points are held on: where the water is tilted they move with the points


@dataclass(frozen=True, kw_only=True, eq=False)
class WaterLine:
    """The state of m rays and of the p points they belong to."""

    wet: BoolArray  # (m,)
    way: IntArray  # (p,) last change of a point: above zero drying, below it flooding, 0 none yet; counts changes
    rests: BoolArray  # (p,) the point changes no more
    level: FloatArray  # (p,) m, of the water line on which a point is held, NaN for most

    def same_as(self, other: WaterLine) -> bool:
        """Return whether no ray and no held point has changed."""
        held, before = np.nan_to_num(self.level, nan=np.inf), np.nan_to_num(other.level, nan=np.inf)
        return np.array_equal(self.wet, other.wet) and np.allclose(held, before, rtol=0.0, atol=_SAME)


def water_line(network: Network, state: State, bathymetric: BoolArray) -> WaterLine:
    """Return the state of the rays of bathymetric points (p,) where they stand."""
    height, water = heights_and_water(network, state)
    wet = (height < water) & bathymetric[network.point]
    return starting_line(wet, network.points)


def every_ray_wet(network: Network, bathymetric: BoolArray) -> WaterLine:
    """Return the line with all rays of bathymetric points (p,) under water, wherever these stand."""
    return starting_line(np.asarray(bathymetric[network.point]), network.points)


def starting_line(wet: BoolArray, points: int) -> WaterLine:
    """Return the line with rays (m,) under water or not, of so many points that have not moved yet."""
    nothing = np.zeros(points, dtype=int)
    return WaterLine(wet=wet, way=nothing, rests=nothing.astype(bool), level=np.full(points, np.nan))


def refracted(network: Network, line: WaterLine, state: State) -> tuple[Network, State]:
    """Return network and state with the rays refracted that are wet, and points on a water line held there.

    `network` is the measured one.
    """
    network = network.with_plates(network.xy, line.wet).with_heights_held(line.level)
    point = np.flatnonzero(np.isfinite(line.level))
    ground = state.ground.copy()
    ground[point] = hold(network, point, ground[point])
    return network, replace(state, ground=ground)


def chosen(network: Network, line: WaterLine, state: State, bathymetric: BoolArray) -> WaterLine:
    """Return the line with every bathymetric point (p,) in its best state for the stations of `state`.

    `network` is the measured one. Points are settled in each of their states; that with the least squares counts
    of those that agree with where the point then stands. One that turns back from its last change lies on the
    water line between, as does one of which no state agrees. Where the height of the water is unknown, or waves
    go on it, nothing can be held on its line, and such a point rests as it is.
    """
    height, water = heights_and_water(network, state)
    wet, level = (height < water) & bathymetric[network.point], np.full(network.points, np.nan)
    near = np.zeros(network.points, dtype=bool)
    present = network.with_plates(network.xy, line.wet)
    for group in _bathymetric_groups(network, state, bathymetric):
        near[group.point], disagrees = _near_and_at_odds(present, line, state, group)
        held = np.isfinite(line.level[group.point])
        part = group.part((near[group.point] | disagrees | held) & ~line.rests[group.point])
        if len(part.point):
            wet[part.rays], level[part.point] = _best_states(network, state, part)
    point = network.point
    change = _per_point(network, line.wet & ~wet) - _per_point(network, wet & ~line.wet)
    back = near & (change * line.way < 0)
    turned = np.abs(water - height) + np.where((wet != line.wet) & back[point], 0.0, np.inf)
    nearest = np.full(network.points, np.inf)
    np.fmin.at(nearest, point, turned)
    between = np.isfinite(turned) & (turned == nearest[point])
    level[point[between]] = water[between]
    changed = (change != 0) | (np.isfinite(level) != np.isfinite(line.level))
    rests = line.rests | (changed & (np.abs(line.way) >= _TURNS))
    if network.water.unknown or network.sea is not None:
        rests, level = rests | np.isfinite(level), np.full(network.points, np.nan)
    on_line = np.isfinite(level)[point]
    wet = np.where(on_line, (water > level[point]) & bathymetric[point], wet)
    sign = np.where(change != 0, np.sign(change), np.where(line.way < 0, -1, 1))
    return WaterLine(
        wet=np.where(rests[point], line.wet, wet),
        way=np.where(changed & ~rests, sign * (np.abs(line.way) + 1), line.way),
        rests=rests,
        level=np.where(rests, line.level, level),
    )


def _per_point(network: Network, rays: BoolArray) -> IntArray:
    return np.bincount(network.point[rays], minlength=network.points)


def _bathymetric_groups(network: Network, state: State, bathymetric: BoolArray) -> Iterator[PointGroup]:
    """Yield the bathymetric points by the rays that give their positions; tied ones stand where they stand."""
    entering = np.zeros(network.points, dtype=bool)
    for group in network.groups:
        entering[group.point] = True
        part = group.part(bathymetric[group.point])
        if len(part.point) and not group.kept:
            yield part
    known = np.isfinite(state.ground).all(axis=1)
    every_ray = np.ones(len(network.point), dtype=bool)
    yield from group_points(network.photo, network.point, every_ray, bathymetric & known & ~entering)


def _near_and_at_odds(
    present: Network, line: WaterLine, state: State, group: PointGroup
) -> tuple[BoolArray, BoolArray]:
    """Return which points (k,) of a group are near a tide, and which disagree with their state in `present`."""
    X = state.ground[group.point]
    normals = point_normals(present, state, group, X, group.known, stations=False)
    up = np.einsum("kij,kj->ki", normals.axes, present.frame.axes(X)[:, 2])
    variance = np.einsum("ki,kij,kj->k", up, np.linalg.inv(normals.matrix), up)
    gap = _water(present, state, group, X) - present.frame.height(X)[:, None]
    near = np.abs(gap).min(axis=1) < _NEAR * np.sqrt(variance)
    return near, (line.wet[group.rays] != (gap > 0.0)).any(axis=1)


def _water(network: Network, state: State, group: PointGroup, X: FloatArray) -> FloatArray:
    """Return the heights (k, m) of the water over points X (k, 3) at the photos of their rays."""
    tide = state.tide[network.photo[group.rays]]
    return water_heights(network.slope(state.tilt), tide, np.repeat(X[:, None], tide.shape[1], axis=1))


def _best_states(network: Network, state: State, group: PointGroup) -> tuple[BoolArray, FloatArray]:
    """Return which rays (k, m) of the points of a group are wet in their best states, and the line (k,) or NaN.

    State j of a point has the rays of its j lowest tides dry.
    """
    X = state.ground[group.point]
    tides = _water(network, state, group, X)
    order = np.argsort(tides, axis=1, kind="stable")
    rank = np.argsort(order, axis=1, kind="stable")
    k, m = tides.shape
    squares, height, water = np.full((m + 1, k), np.inf), np.full((m + 1, k), np.nan), np.zeros((m + 1, k, m))
    for j in range(m + 1):
        refracted = network.refracted.copy()
        refracted[group.rays] = rank >= j
        found, squares[j] = settle_group(network.with_plates(network.xy, refracted), state, group, X, group.known)
        height[j] = network.frame.height(found)
        water[j] = np.sort(_water(network, state, group, found), axis=1)
    edge = np.full((m + 1, k), np.inf)
    upper, lower = edge.copy(), -edge
    upper[:m] = np.stack([water[j, :, j] for j in range(m)])
    lower[1:] = np.stack([water[j, :, j - 1] for j in range(1, m + 1)])
    sunk, risen = height < lower, height >= upper
    best = np.where(sunk | risen | ~np.isfinite(squares), np.inf, squares)
    state_of = np.argmin(best, axis=0)
    none = ~np.isfinite(np.min(best, axis=0))
    # the lowest tide which the state below it takes the point over, and the state above it takes it back under
    crossed = risen[:-1] & sunk[1:]
    line = np.where(none & crossed.any(axis=0), np.argmax(crossed, axis=0), -1)
    state_of = np.where(line >= 0, line + 1, state_of)
    level = np.where(
        line >= 0, np.take_along_axis(np.sort(tides, axis=1), np.maximum(line, 0)[:, None], 1)[:, 0], np.nan
    )
    return rank >= state_of[:, None], level


def moved(network: Network, line: WaterLine, state: State, bathymetric: BoolArray) -> WaterLine:
    """Return the line after the points have come to stand where they are in `state`: each at most one tide on.

    A point that turns back rests: it lies on that water line within its own error, and either side serves.
    """
    height, tide = heights_and_water(network, state)
    wanted, point = (height < tide) & bathymetric[network.point], network.point
    way = np.zeros_like(line.way)
    way[point[line.wet & ~wanted]] = 1
    way[point[~line.wet & wanted]] = -1
    rests = line.rests | (way * line.way < 0)
    way[rests] = 0
    # the next tide on the way: the lowest of the wet rays dries first, the highest of the dry ones is flooded first
    lowest = np.full(network.points, np.inf)
    np.fmin.at(lowest, point[line.wet], tide[line.wet])
    highest = np.full(network.points, -np.inf)
    np.fmax.at(highest, point[~line.wet & wanted], tide[~line.wet & wanted])
    dries = line.wet & (way[point] == 1) & (tide == lowest[point])
    floods = wanted & ~line.wet & (way[point] == -1) & (tide == highest[point])
    return replace(line, wet=line.wet & ~dries | floods, way=np.where(way != 0, way, line.way), rests=rests)


def heights_and_water(network: Network, state: State) -> tuple[FloatArray, FloatArray]:
    """Return (m,) the height of the point of each measurement, and that of the water over it; NaN where unknown."""
    known = np.isfinite(state.ground).all(axis=1)
    height = np.full(network.points, np.nan)
    height[known] = network.frame.height(state.ground[known])
    slope = network.slope(state.tilt)
    water = water_heights(slope, state.tide[network.photo], state.ground[network.point])
    return height[network.point], water
