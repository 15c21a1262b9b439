"""Positions of ground points for given stations: first ones, and where they are at their best."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from musatpy.adjustment import sightings
from musatpy.adjustment.kernels import loops_of
from musatpy.adjustment.network import Network, PointGroup, together
from musatpy.adjustment.point_normals import point_normals, settle_group, with_known
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray, finite_rows
from musatpy.geometry import intersection
from musatpy.model import ObservationKind

PARALLEL = 1e-5  # rad; rays nearer to parallel than this give no position, only trouble
_FLATTEST = 0.1  # cosine from the vertical: flatter rays reach the typical height no farther off than this one
_REACHED = 1e-9  # m from a height
_STEPS_TO_LEVEL = 3  # at most, along a ray


def settle(network: Network, state: State) -> State:
    """Return the state with every point of the solution at its optimum for the current stations and levels."""
    ground, squares = state.ground.copy(), np.zeros(network.points)
    loops = loops_of(network, (*network.pass_groups, *network.control_groups))
    for group in together(loops.settle(state, ground, squares)):
        ground[group.point], squares[group.point] = settle_group(network, state, group, ground[group.point])
    return replace(state, ground=ground, squares=squares)


def unrest(network: Network, state: State) -> FloatArray:
    """Return how far points (p,) are from their best positions for the stations, in sigmas; 0 for all others."""
    out = np.zeros(network.points)
    for group in together(network.groups):
        normals = point_normals(network, state, group, state.ground[group.point], stations=False)
        local = np.linalg.solve(normals.matrix, normals.rhs[..., None])[..., 0]
        out[group.point] = np.sqrt(np.maximum(np.sum(normals.rhs * local, axis=1), 0.0))
    return np.nan_to_num(out, nan=0.0)


def at_their_best(network: Network, state: State, points: BoolArray) -> State:
    """Return the state with some of the eliminated points (p,) at their best for the stations as they are."""
    ground = state.ground.copy()
    for group in network.groups:
        for part in () if group.kept else group.some(points[group.point]):
            ground[part.point], _ = settle_group(network, state, part, ground[part.point], trial=True)
    return replace(state, ground=ground)


def apart_at_their_best(
    network: Network, state: State, groups: Sequence[PointGroup], xy: FloatArray | None = None
) -> tuple[Network, list[PointGroup], State]:
    """Return a network of the points of groups alone, these groups in it, and a state with them at their best.

    From where their rays meet; the stations stay. A point may be in them more than once, with other rays, or with
    other images xy (r, 2), in the order of the rays.
    """
    rays = np.concatenate([group.rays.reshape(-1) for group in groups])
    point = np.concatenate([group.point for group in groups])
    alone, every = network.apart(groups, network.xy[rays] if xy is None else xy, network.refracted[rays])
    first = start_ground(alone, replace(state, ground=state.ground[point])).ground
    return alone, every, settle(alone, replace(state, ground=first, squares=np.zeros(len(first))))


def start_ground(network: Network, state: State, parallel: BoolArray | None = None) -> State:
    """Return the state with first positions of the points and first levels of the groups.

    Points are the nearest to their rays; known components are put in; a single ray is cut at its known height, or
    at the mean height of the control. Sets which pass points (p,) have rays that are as good as `parallel`, where
    that is asked for.
    """
    ground, heights = state.ground.copy(), network.priors.given[:, 2]
    mean_height = float(np.nanmean(heights)) if np.isfinite(heights).any() else 0.0
    for group in network.groups:
        ground[group.point] = nearest_ground(network, state, group, mean_height)
    for group in network.pass_groups:
        if parallel is None:
            break
        _, direction = sightings.straight_rays(network, state, group.rays)
        near = np.linalg.norm(direction - direction[:, :1], axis=2).max(axis=1) < PARALLEL  # the others are not
        parallel[group.point[near]] = intersection.widest_angle(direction[near]) < PARALLEL
    members = np.flatnonzero(network.priors.group >= 0)
    heights = network.frame.height(ground[members])
    number = network.border.count(ObservationKind.EQUAL_ELEVATION)
    count = np.bincount(network.priors.group[members], minlength=number)
    total = np.bincount(network.priors.group[members], weights=heights, minlength=number)
    levels = np.divide(total, count, out=np.full(number, np.nan), where=count > 0)
    return replace(state, ground=ground, levels=levels)


def level_start(network: Network, state: State) -> State:
    """Return the state with points where their rays reach the typical height, on the average.

    Poor stations intersect points behind the cameras, or far off; a level ground is never so wrong. Rays near the
    horizon, or above it, are bent down to `_FLATTEST`. `state` has the points of `start_ground`.
    """
    heights = network.priors.given[:, 2]
    if not np.isfinite(heights).any():
        known = finite_rows(state.ground)
        heights = network.frame.height(state.ground[known])
    height = float(np.nanmedian(heights))
    ground = state.ground.copy()
    for group in network.groups:
        straight = sightings.straight_rays(network, state, group.rays)
        origin, direction = (vectors.reshape(-1, 3) for vectors in straight)
        cut = _cut(network, origin, _bent_down(network, origin, direction), height)
        ground[group.point] = _put_in(network, group, cut.reshape(*group.rays.shape, 3).mean(axis=1))
    return replace(state, ground=ground)


def _put_in(network: Network, group: PointGroup, X: FloatArray) -> FloatArray:
    """Return the points X (k, 3) of a group with what is known of them."""
    if not group.known:
        return X
    return network.frame.from_level(with_known(network, group.point, network.frame.level(X)))


def _bent_down(network: Network, origin: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the unit directions (k, 3) with those flatter than `_FLATTEST`, or upward, turned down to it."""
    up = network.frame.axes(origin)[..., 2, :]
    fall = -np.einsum("ki,ki->k", up, direction)[:, None]
    if (fall >= _FLATTEST).all():
        return direction
    across = direction + up * fall
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)  # a ray straight up has none
    return np.where(fall < _FLATTEST, np.sqrt(1.0 - _FLATTEST**2) * across - _FLATTEST * up, direction)


def nearest_ground(network: Network, state: State, group: PointGroup, mean_height: float) -> FloatArray:
    """Return first positions (k, 3) of the points of a group, from their straight rays."""
    origin, direction = sightings.straight_rays(network, state, group.rays)
    given = network.priors.given[group.point]
    if group.rays.shape[1] == 1:
        height = np.where(network.priors.known[group.point, 2], given[:, 2], mean_height)
        ground = _cut(network, origin[:, 0], direction[:, 0], height)
    else:
        ground = intersection.nearest_point(origin, direction)
    return _put_in(network, group, ground)


def _cut(
    network: Network,
    origin: FloatArray,
    direction: FloatArray,
    height: FloatArray | float,
    steps: int = _STEPS_TO_LEVEL,
) -> FloatArray:
    """Return the points of single rays at a height, or one for each; steps along the ray follow the surface."""
    X = origin
    for _ in range(steps):
        up, above = network.frame.vertical(X)
        above = above - height
        if np.abs(above).max(initial=0.0) < _REACHED:
            break
        fall = -np.einsum("ki,ki->k", up, direction)
        X = X + direction * (above / np.maximum(fall, _FLATTEST))[:, None]
    return X


def intersect_freely(network: Network, state: State, groups: Iterable[PointGroup]) -> State:
    """Return the state with points that took no part intersected from the stations as they are."""
    ground = state.ground.copy()
    for group in groups:
        start = nearest_ground(network, state, group, 0.0)
        ground[group.point], _ = settle_group(network, state, group, start)
    return replace(state, ground=ground)


def all_residuals(network: Network, state: State, chosen: BoolArray) -> FloatArray:
    """Return the residuals (m, 2) mm of all measurements, of some that are not `chosen` (m,) NaN."""
    out = np.full(network.xy.shape, np.nan)
    out[chosen] = sightings.residuals(network, state, np.flatnonzero(chosen))
    return out
