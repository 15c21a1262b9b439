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

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class WaterLine:
    """The state of m rays and of the p points they belong to."""

    wet: BoolArray  # (m,)
    way: IntArray  # (p,) last change of a point: 1 drying, -1 flooding, 0 none yet
    rests: BoolArray  # (p,) the point has turned back once and changes no more


def water_line(network: Network, ground: FloatArray, bathymetric: BoolArray) -> WaterLine:
    """Return the state of the rays of bathymetric points (p,) that stand at `ground` (p, 3)."""
    wet = _below_tide(network, ground) & bathymetric[network.point]
    return WaterLine(wet=wet, way=np.zeros(network.points, dtype=int), rests=np.zeros(network.points, dtype=bool))


def moved(network: Network, line: WaterLine, ground: FloatArray, bathymetric: BoolArray) -> WaterLine:
    """Return the state after the points have come to stand at `ground`: each at most one tide on."""
    wanted = _below_tide(network, ground) & bathymetric[network.point]
    tide, point = network.tide[network.photo], network.point
    way = np.zeros_like(line.way)
    way[point[line.wet & ~wanted]] = 1
    way[point[~line.wet & wanted]] = -1
    rests = line.rests | (way * line.way < 0)
    way[rests] = 0
    # the next tide on the way: the lowest of the wet rays dries first, the highest of the dry ones is flooded first
    lowest = np.full(network.points, np.inf)
    np.minimum.at(lowest, point[line.wet], tide[line.wet])
    highest = np.full(network.points, -np.inf)
    np.maximum.at(highest, point[~line.wet & wanted], tide[~line.wet & wanted])
    dries = line.wet & (way[point] == 1) & (tide == lowest[point])
    floods = wanted & ~line.wet & (way[point] == -1) & (tide == highest[point])
    return WaterLine(wet=line.wet & ~dries | floods, way=np.where(way != 0, way, line.way), rests=rests)


def _below_tide(network: Network, ground: FloatArray) -> BoolArray:
    """Return (m,) whether the point of a measurement lies below the tide of its photo; an unknown one does not."""
    known = np.isfinite(ground).all(axis=1)
    height = np.full(network.points, np.nan)
    height[known] = network.frame.height(ground[known])
    return np.asarray(height[network.point] < network.tide[network.photo])
