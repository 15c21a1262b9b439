"""Submerged points as straight rays show them, as a rule of thumb predicts them, and as adjusted; their depths."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from musatpy.adjustment.ground import PARALLEL
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.point_normals import settle_group
from musatpy.adjustment.sightings import straight_rays
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_surface import surface, water_heights
from musatpy.arrays import BoolArray, FloatArray, finite_rows
from musatpy.geometry.intersection import nearest_point, widest_angle
from musatpy.model import BathymetricPoints, Block


def bathymetric_points(
    block: Block, measured: Network, state: State, groups: Iterable[PointGroup], depth_sigma: FloatArray
) -> BathymetricPoints:
    """Return the submerged points of a block at `state`.

    `measured` is the network with the images as they were measured, its rays straight; `groups` are all points with
    the rays that give their positions; `depth_sigma` (p,) m of all points.
    """
    chosen, submerged = np.flatnonzero(block.points.bathymetric), block.points.bathymetric
    known = submerged & finite_rows(state.ground)
    wet = [part for group in groups for part in (group.part(known[group.point]),) if len(part.point)]
    apparent = _straight_intersections(measured, state, wet)
    level = _water_levels(measured, state, submerged, wet)
    depth = level - _heights(measured, apparent)
    # a dry point stays where it is; without a WTR card there is no index to predict by
    factor = np.where(depth > 0.0, state.index if block.water else np.nan, 1.0)
    predicted_depth = depth * factor
    return BathymetricPoints(
        point=chosen,
        apparent=_system(measured, apparent)[chosen],
        predicted=_system(measured, _at_heights(measured, apparent, level - predicted_depth))[chosen],
        water_level=level[chosen],
        incidence=_incidence(measured, state, wet)[chosen],
        apparent_depth=depth[chosen],
        predicted_depth=predicted_depth[chosen],
        depth=(level - _heights(measured, state.ground))[chosen],
        depth_sigma=depth_sigma[chosen],
    )


def _straight_intersections(measured: Network, state: State, groups: Iterable[PointGroup]) -> FloatArray:
    """Return where straight rays meet best (p, 3), working; nothing else known of the points enters.

    NaN where there are not two rays, these are parallel, or meet behind a camera.
    """
    ground = np.full((measured.points, 3), np.nan)
    for group in groups:
        origin, direction = straight_rays(measured, state, group.rays)
        meets = widest_angle(direction) >= PARALLEL
        part = replace(group.part(meets), known=False)  # nothing else enters
        if len(part.point):
            start = nearest_point(origin[meets], direction[meets])
            X, squares = settle_group(measured, state, part, start)
            ground[part.point] = np.where(np.isfinite(squares)[:, None], X, np.nan)
    return ground


def _incidence(measured: Network, state: State, groups: Iterable[PointGroup]) -> FloatArray:
    """Return the mean angle (p,) rad, in air, between the rays of a point and the normal of the water over it.

    The water is the level or tilted surface of the adjustment, without its waves.
    """
    angle = np.full(measured.points, np.nan)
    for group in groups:
        _, direction = straight_rays(measured, state, group.rays)
        ground = np.broadcast_to(state.ground[group.point][:, None], direction.shape)
        over = surface(measured.frame, measured.slope(state.tilt), state.tide[measured.photo[group.rays]], ground)
        down = -np.einsum("kmi,kmi->km", over.normal, direction)
        angle[group.point] = np.arccos(np.clip(down, -1.0, 1.0)).mean(axis=1)
    return angle


def _water_levels(
    measured: Network, state: State, submerged: BoolArray, groups: Iterable[PointGroup]
) -> FloatArray:
    """Return the mean height (p,) m of the water at submerged points, over the photos that give them.

    That of a point without a position is over all photos that show it.
    """
    lost, giving = submerged.copy(), np.zeros(len(measured.point), dtype=bool)
    for group in groups:
        lost[group.point], giving[group.rays] = False, True
    rays = np.flatnonzero(giving | lost[measured.point])
    point = measured.point[rays]
    water = water_heights(measured.slope(state.tilt), state.tide[measured.photo[rays]], state.ground[point])
    number = np.bincount(point, minlength=measured.points)
    total = np.bincount(point, weights=water, minlength=measured.points)
    return np.divide(total, number, out=np.full(measured.points, np.nan), where=number > 0)


def _heights(network: Network, working: FloatArray) -> FloatArray:
    height = np.full(len(working), np.nan)
    known = finite_rows(working)
    height[known] = network.frame.height(working[known])
    return height


def _at_heights(network: Network, working: FloatArray, height: FloatArray) -> FloatArray:
    """Return points moved along their local verticals to heights (p,), NaN where either is unknown."""
    moved = np.full(working.shape, np.nan)
    known = np.isfinite(height) & finite_rows(working)
    # along the local vertical, not along geocentric Z as in Table 6.9
    level = network.frame.level(working[known])
    level[:, 2] = height[known]
    moved[known] = network.frame.from_level(level)
    return moved


def _system(network: Network, working: FloatArray) -> FloatArray:
    out = np.full(working.shape, np.nan)
    known = finite_rows(working)
    out[known] = network.frame.system(working[known])
    return out
