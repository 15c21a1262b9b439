"""Positions of ground points for given stations: first ones, and by weighted intersection those at their best.

With whatever is known of the points beforehand every point is brought to the optimum of its own plate residuals and
priors. The images of that point are then the adjusted observations at which the conditions are linearised: only
there does A'(GQG')^-1 A equal the reduced normal matrix of the bundle (docs/theory.md).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment import sightings
from musatpy.adjustment.iteration import State
from musatpy.adjustment.kernels import loops_of, side_by_side
from musatpy.adjustment.network import RAYS, Network, PointGroup, parts_of, together
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry import collinearity
from musatpy.model import ObservationKind
from musatpy.model.tables import finite_rows

PARALLEL = 1e-5  # rad; rays nearer to parallel than this give no position, only trouble
_FLATTEST = 0.1  # cosine from the vertical: flatter rays reach the typical height no farther off than this one
_ALONG = 0.3  # cosine from the vertical of a ray that looks along the ground
_REACHED = 1e-9  # m from a height
_STEPS_TO_LEVEL = 3  # at most, along a ray
MAX_STEPS = 25
_FEW_STEPS = 4  # for a trial: points that take more of them are running away
STEP_LIMIT = 1e-5  # m; Gauss-Newton squares what is left of a step this small: rounding
ROUNDING = 1e-6  # growth of the squares that may be rounding: geocentric coordinates are good to a nanometre
RIDGE = 1e-13  # of the largest diagonal term: keeps a direction that nothing observes from dividing by zero
Step = tuple[FloatArray, FloatArray, FloatArray]


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

    def meet(group: PointGroup) -> None:
        origin, direction = sightings.straight_rays(network, state, group.rays)
        ground[group.point] = _nearest(network, group, origin, direction, mean_height)
        if parallel is not None and not group.known:
            near = np.linalg.norm(direction - direction[:, :1], axis=2).max(axis=1) < PARALLEL  # the others are not
            parallel[group.point[near]] = collinearity.widest_angle(direction[near]) < PARALLEL

    _for_all(network, meet)
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

    def reach(group: PointGroup) -> None:
        straight = sightings.straight_rays(network, state, group.rays)
        origin, direction = (vectors.reshape(-1, 3) for vectors in straight)
        cut = _cut(network, origin, _bent_down(network, origin, direction), height)
        ground[group.point] = _put_in(network, group, cut.reshape(*group.rays.shape, 3).mean(axis=1))

    _for_all(network, reach)
    return replace(state, ground=ground)


def looks_along(network: Network, state: State) -> bool:
    """Return whether most rays look along the ground, or up: no level is a start for their points."""
    rays = np.concatenate([group.rays.reshape(-1) for group in network.groups])
    origin, direction = sightings.straight_rays(network, state, rays)
    up = network.frame.axes(origin)[..., 2, :]
    return bool(np.median(np.einsum("ki,ki->k", up, direction)) > -_ALONG)


def _for_all(network: Network, work: Callable[[PointGroup], None]) -> None:
    """Work at all points of a network, parts of the groups side by side: each part sets its own points alone."""
    deque(side_by_side(work, parts_of(network.groups, RAYS), len(network.photo)), maxlen=0)


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
    return _nearest(network, group, *sightings.straight_rays(network, state, group.rays), mean_height)


def _nearest(
    network: Network, group: PointGroup, origin: FloatArray, direction: FloatArray, mean_height: float
) -> FloatArray:
    """Return the points (k, 3) nearest to straight rays (k, m, 3), with what is known of them."""
    given = network.priors.given[group.point]
    if group.rays.shape[1] == 1:
        height = np.where(network.priors.known[group.point, 2], given[:, 2], mean_height)
        ground = _cut(network, origin[:, 0], direction[:, 0], height)
    else:
        ground = collinearity.nearest_point(origin, direction)
    return _put_in(network, group, ground)


def _cut(network: Network, origin: FloatArray, direction: FloatArray, height: FloatArray | float) -> FloatArray:
    """Return the points of single rays at a height, or one for each; steps along the ray follow the surface."""
    X = origin
    for _ in range(_STEPS_TO_LEVEL):
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Priors:
    """Known components of k points as four rows each: east, north, up, and up against the level of its group.

    Of control with covariances the first three are what `network.decorrelated` makes of these components.
    """

    axes: FloatArray  # (k, 3, 3) east, north, up
    deviation: FloatArray  # (k, 4) m, known minus current
    weight: FloatArray  # (k, 4) 1/m2
    free: BoolArray  # (k, 3) the component may move
    decorrelation: FloatArray | None = None  # (k, 3, 3)

    @property
    def squares(self) -> FloatArray:
        """(k,) weighted squares."""
        return np.asarray(np.einsum("ka,ka,ka->k", self.deviation, self.weight, self.deviation))

    @property
    def by_point(self) -> FloatArray:
        """(k, 4, 3) partials of the rows by the free components."""
        rows = np.concatenate([np.eye(3), [[0.0, 0.0, 1.0]]]) * self.free[:, None, :]
        if self.decorrelation is not None:
            rows[:, :3] = self.decorrelation @ rows[:, :3]
        return rows


@dataclass(frozen=True, kw_only=True, eq=False)
class PointNormals:
    """Normal equations of k points with m rays, in east, north, up (working axes for points without priors)."""

    images: sightings.RayImages
    residual: FloatArray  # (k, m, 2) mm, adjusted minus measured
    B: FloatArray  # (k, m, 2, 3) images by the free components of the point
    matrix: FloatArray  # (k, 3, 3)
    rhs: FloatArray  # (k, 3)
    axes: FloatArray  # (k, 3, 3)
    priors: Priors | None
    objective: FloatArray  # (k,) weighted sum of squares, infinite where a point is behind a camera
    ridge: FloatArray  # (k,) that the diagonals of the matrices have beyond what is observed


def point_normals(
    network: Network, state: State, group: PointGroup, ground: FloatArray, stations: bool = True
) -> PointNormals:
    """Return the normal equations of the points of a group at positions `ground` (k, 3).

    What is known of the points counts where the group says so. Without `stations` images have no partials by these.
    """
    rays = group.rays
    X = np.repeat(ground[:, None], rays.shape[1], axis=1)
    images = sightings.images(network, state, rays, X, stations)
    residual = images.xy - network.xy.take(rays, axis=0)
    W = group.weights(network.weight)
    priors = prior_rows(network, state, group.point, ground) if group.known else None
    rows = images.by_ground.reshape(len(ground), -1, 3)
    if priors is None:
        axes = np.broadcast_to(np.eye(3), (len(ground), 3, 3))
    else:
        axes = priors.axes
        rows = rows @ np.swapaxes(axes, 1, 2) * priors.free[:, None]
    weighted = residual * W
    matrix = np.swapaxes(rows, 1, 2) @ (rows * W.reshape(len(ground), -1, 1))
    rhs = -np.einsum("kri,kr->ki", rows, weighted.reshape(len(ground), -1))
    objective = np.einsum("kma,kma->k", residual, weighted)
    diagonal = np.einsum("kii->ki", matrix)
    if priors is not None:
        weight, deviation = priors.weight, priors.deviation
        if priors.decorrelation is None:
            diagonal += weight[:, :3]
            rhs += weight[:, :3] * deviation[:, :3]
        else:
            T = np.swapaxes(priors.decorrelation, 1, 2)
            matrix += (T * weight[:, None, :3]) @ priors.decorrelation
            rhs += (T @ (weight * deviation)[:, :3, None])[..., 0]
        diagonal[:, 2] += weight[:, 3] * priors.free[:, 2]
        rhs[:, 2] += weight[:, 3] * deviation[:, 3] * priors.free[:, 2]
        diagonal += np.where(priors.free, 0.0, 1.0)
        objective = objective + priors.squares
    ridge = RIDGE * diagonal.max(axis=1, keepdims=True)
    diagonal += ridge
    return PointNormals(
        images=images,
        residual=residual,
        B=rows.reshape(images.by_ground.shape),
        matrix=matrix,
        rhs=rhs,
        axes=axes,
        priors=priors,
        objective=_unless_behind(network, state, rays, X, objective),
        ridge=ridge[:, 0],
    )


def prior_rows(network: Network, state: State, point: IntArray, ground: FloatArray) -> Priors:
    """Return what is known of the points, compared with their current positions (k, 3)."""
    priors, frame = network.priors, network.frame
    known, current = priors.known[point], frame.level(ground)
    reference = with_known(network, point, current)
    axes, off = frame.axes_at(reference), frame.from_level(reference) - ground
    deviation = np.zeros((len(point), 4))
    deviation[:, :3] = np.where(known, np.einsum("kij,kj->ki", axes, off), 0.0)
    decorrelation = None
    if priors.decorrelation is not None:
        decorrelation = priors.decorrelation[point]
        deviation[:, :3] = np.einsum("kij,kj->ki", decorrelation, deviation[:, :3])
    group = priors.group[point]
    grouped = group >= 0
    deviation[grouped, 3] = state.levels[group[grouped]] - current[grouped, 2]
    weight = np.concatenate([priors.weight[point], priors.group_weight[point][:, None]], axis=1)
    free = ~priors.held[point]
    return Priors(axes=axes, deviation=deviation, weight=weight, free=free, decorrelation=decorrelation)


def with_known(network: Network, point: IntArray, level: FloatArray, held_only: bool = False) -> FloatArray:
    """Return level coordinates with the known (or only the held) components put in."""
    mask = (network.priors.held if held_only else network.priors.known)[point]
    # level coordinates are latitude, longitude, height; components are east, north, up: both horizontal or none
    return np.where(mask, network.priors.given[point], level)


def settle_group(
    network: Network, state: State, group: PointGroup, ground: FloatArray, trial: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return the optimal positions (k, 3) of the points of a group and their weighted squares (k,).

    By Gauss-Newton with step halving. A `trial` goes some way only where points run away, and to places that it has
    looked at: none that fits worse than `ground` does.
    """

    def step(rows: IntArray, X: FloatArray) -> Step:
        normals = point_normals(network, state, group.part(rows), X, stations=False)
        local = np.linalg.solve(normals.matrix, normals.rhs[..., None])
        fall = np.einsum("ki,kij->k", normals.rhs, local)
        return (np.swapaxes(normals.axes, -1, -2) @ local)[..., 0], normals.objective, fall

    def held(rows: IntArray, X: FloatArray) -> FloatArray:
        return hold(network, group.point[rows], X) if group.known else X

    return steps_to_best(step, ground, held, trial=trial)


def steps_to_best(
    step: Callable[[IntArray, FloatArray], Step],
    ground: FloatArray,
    held: Callable[[IntArray, FloatArray], FloatArray],
    trial: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return where points come to rest (k, 3) from `ground`, and their weighted squares (k,) there.

    `step` tells of some of them, rows (r,) at X (r, 3), the steps, the squares where they are, and by how much
    these fall; `held` puts back what is held of them. Each goes on until it is at rest. What a `trial` is,
    `settle_group` says.
    """
    X, best, rows = ground.copy(), ground.copy(), np.arange(len(ground))
    least, gain, last = np.full(len(ground), np.inf), np.zeros(len(ground)), np.zeros_like(ground)
    for _ in range(_FEW_STEPS if trial else MAX_STEPS):
        new, squares, fall = step(rows, X[rows])
        worse = np.isfinite(least[rows]) & ~(squares <= least[rows] * (1.0 + ROUNDING) + ROUNDING)
        best[rows] = np.where(worse[:, None], best[rows], X[rows])
        least[rows] = np.where(worse, least[rows], squares)
        gain[rows] = np.where(worse, 0.0, fall)
        last[rows] = np.where(worse[:, None], 0.5 * last[rows], new)
        X[rows] = held(rows, best[rows] + last[rows])
        rows = rows[~(np.abs(last[rows]).max(axis=1) < STEP_LIMIT)]
        if not len(rows):
            break
    if trial:
        return best, least
    # the last step is taken without looking: its gain in squares is known to the second order
    return X, np.maximum(least - gain, 0.0)


def hold(network: Network, point: IntArray, ground: FloatArray) -> FloatArray:
    """Put held components back exactly: a step along the local axes leaves a curved level surface."""
    held = network.priors.held[point].any(axis=1)
    if held.any():
        ground = ground.copy()
        level = network.frame.level(ground[held])
        ground[held] = network.frame.from_level(with_known(network, point[held], level, held_only=True))
    return ground


def point_squares(network: Network, state: State, group: PointGroup, ground: FloatArray) -> FloatArray:
    """Return the weighted squares (k,) of the points of a group at `ground` (k, 3), infinite behind a camera."""
    rays = group.rays
    X = np.repeat(ground[:, None], rays.shape[1], axis=1)
    residual = sightings.image_coordinates(network, state, rays, X) - network.xy[rays]
    squares = np.einsum("kma,kma,kma->k", residual, group.weights(network.weight), residual)
    if group.known:
        priors = prior_rows(network, state, group.point, ground)
        squares += priors.squares
    return _unless_behind(network, state, rays, X, squares)


def _unless_behind(
    network: Network, state: State, rays: IntArray, X: FloatArray, squares: FloatArray
) -> FloatArray:
    """Return the squares (k,) of points X (k, m, 3), infinite where one is behind a camera."""
    photo = network.photo[rays]
    camera, M = state.position.take(photo, axis=0), state.M.take(photo, axis=0)
    seen = collinearity.in_front(X - camera, M).all(axis=1)
    return np.where(seen & np.isfinite(squares), squares, np.inf)
