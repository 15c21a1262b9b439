"""Submerged points without refraction, as a rule of thumb predicts them, and with refraction; their depths."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.network import Network
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.waterline import heights_and_water
from musatpy.model import BathymetricPoints, Block
from musatpy.refraction.snell import water_tangent_ratio

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def bathymetric_points(
    block: Block, measured: Network, state: State, apparent: FloatArray, depth_sigma: FloatArray
) -> BathymetricPoints:
    """Return the submerged points at `state`; `apparent` (p, 3) working, `depth_sigma` (p,) m of all points."""
    chosen = np.flatnonzero(block.points.bathymetric)
    frame, p = measured.frame, measured.points
    rays = np.flatnonzero(block.points.bathymetric[measured.point])
    point = measured.point[rays]
    level = _mean(point, heights_and_water(measured, state)[1][rays], p)
    height = np.full(p, np.nan)
    seen = np.isfinite(apparent).all(axis=1)
    height[seen] = frame.height(apparent[seen])
    depth = level - height
    factor = _mean(point, _depth_factor(measured, state, rays, apparent), p)
    # along the local vertical, not along geocentric Z as in Table 6.9; a dry point stays where it is
    predicted_depth = np.where(depth > 0.0, depth * factor, depth)
    predicted = np.full((p, 3), np.nan)
    sure = np.isfinite(predicted_depth)
    place = frame.level(apparent[sure])
    place[:, 2] = level[sure] - predicted_depth[sure]
    predicted[sure] = frame.from_level(place)
    true_height = np.full(p, np.nan)
    true_height[np.isfinite(state.ground).all(axis=1)] = frame.height(
        state.ground[np.isfinite(state.ground).all(axis=1)]
    )
    return BathymetricPoints(
        point=chosen,
        apparent=_system(measured, apparent[chosen]),
        predicted=_system(measured, predicted[chosen]),
        water_level=level[chosen],
        apparent_depth=depth[chosen],
        predicted_depth=predicted_depth[chosen],
        depth=(level - true_height)[chosen],
        depth_sigma=depth_sigma[chosen],
    )


def _system(network: Network, working: FloatArray) -> FloatArray:
    out = np.full(working.shape, np.nan)
    known = np.isfinite(working).all(axis=1)
    out[known] = network.frame.system(working[known])
    return out


def _depth_factor(network: Network, state: State, rays: IntArray, apparent: FloatArray) -> FloatArray:
    """Return tan I / tan theta (r,) of the rays to apparent points: the depth factor of each ray alone."""
    X = apparent[network.point[rays]]
    gap = state.position[network.photo[rays]] - X
    known = np.isfinite(gap).all(axis=1)
    up = np.full(gap.shape, np.nan)
    up[known] = network.frame.axes(X[known])[:, 2]
    rise = np.einsum("ri,ri->r", up, gap)
    tangent = np.linalg.norm(gap - up * rise[:, None], axis=1) / rise
    return np.asarray(1.0 / water_tangent_ratio(tangent, state.index))


def _mean(point: IntArray, value: FloatArray, points: int) -> FloatArray:
    """Return the mean (p,) of values by point, NaN where a point has none."""
    total = np.bincount(point, weights=value, minlength=points)
    number = np.bincount(point, minlength=points)
    return np.asarray(np.divide(total, number, out=np.full(points, np.nan), where=number > 0))
