"""Which rays go through the water surface, and how that may change from one triangulation to the next.

At the water line the image of a point has a kink. Were a ray wet or dry as the point stands at every moment, a
point near the tide of one of its photos would switch for ever, or stop the run. So the rays keep their state while
a triangulation runs; after it a point moves at most one tide on, up or down, and one that turns back rests where it
is: it lies on that water line within its own error, and either side serves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.network import Network
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water import water_heights

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class WaterLine:
    """The state of m rays and of the p points they belong to."""

    wet: BoolArray  # (m,)
    way: IntArray  # (p,) last change of a point: 1 drying, -1 flooding, 0 none yet
    rests: BoolArray  # (p,) the point has turned back once and changes no more


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
    return WaterLine(wet=wet, way=np.zeros(points, dtype=int), rests=np.zeros(points, dtype=bool))


def moved(network: Network, line: WaterLine, state: State, bathymetric: BoolArray) -> WaterLine:
    """Return the line after the points have come to stand where they are in `state`: each at most one tide on."""
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
    return WaterLine(wet=line.wet & ~dries | floods, way=np.where(way != 0, way, line.way), rests=rests)


def heights_and_water(network: Network, state: State) -> tuple[FloatArray, FloatArray]:
    """Return (m,) the height of the point of each measurement, and that of the water over it; NaN where unknown."""
    known = np.isfinite(state.ground).all(axis=1)
    height = np.full(network.points, np.nan)
    height[known] = network.frame.height(state.ground[known])
    slope = network.slope(state.tilt)
    water = water_heights(slope, state.tide[network.photo], state.ground[network.point])
    return height[network.point], water
