"""Ground points for given stations: weighted intersection, with whatever is known of the points beforehand.

Every point is brought to the optimum of its own plate residuals and priors. The images of that point are then the
adjusted observations at which the conditions are linearised: only there does A'(GQG')^-1 A equal the reduced normal
matrix of the bundle (docs/theory.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from musatpy.adjustment import sightings
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry import collinearity

MAX_STEPS = 25
_FEW_STEPS = 4  # for a trial: points that take more of them are running away
STEP_LIMIT = 1e-5  # m; Gauss-Newton squares what is left of a step this small: rounding
ROUNDING = 1e-6  # growth of the squares that may be rounding: geocentric coordinates are good to a nanometre
RIDGE = 1e-13  # of the largest diagonal term: keeps a direction that nothing observes from dividing by zero
Step = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class Priors:
    """Known components of k points as four rows each: east, north, up, and up against the level of its group."""

    axes: FloatArray  # (k, 3, 3) east, north, up
    deviation: FloatArray  # (k, 4) m, known minus current
    weight: FloatArray  # (k, 4) 1/m2
    free: BoolArray  # (k, 3) the component may move

    @property
    def squares(self) -> FloatArray:
        """(k,) weighted squares."""
        return np.asarray(np.einsum("ka,ka,ka->k", self.deviation, self.weight, self.deviation))

    @property
    def by_point(self) -> FloatArray:
        """(k, 4, 3) partials of the rows by the free components."""
        return np.concatenate([np.eye(3), [[0.0, 0.0, 1.0]]]) * self.free[:, None, :]


@dataclass(frozen=True, kw_only=True, eq=False)
class PointNormals:
    """Normal equations of k points with m rays, in east, north, up (working axes for points without priors)."""

    images: sightings.Images
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
    residual = images.xy - network.xy[rays]
    W = group.weights(network.weight)
    priors = prior_rows(network, state, group.point, ground) if group.known else None
    axes, B = np.broadcast_to(np.eye(3), (len(ground), 3, 3)), images.by_ground
    if priors is not None:
        axes = priors.axes
        B = B @ np.swapaxes(axes, -1, -2)[:, None] * priors.free[:, None, None, :]
    rows, weighted = B.reshape(len(ground), -1, 3), residual * W
    matrix = np.swapaxes(rows, 1, 2) @ (rows * W.reshape(len(ground), -1, 1))
    rhs = -np.einsum("kri,kr->ki", rows, weighted.reshape(len(ground), -1))
    objective = np.einsum("kma,kma->k", residual, weighted)
    diagonal = np.einsum("kii->ki", matrix)
    if priors is not None:
        weight, deviation = priors.weight, priors.deviation
        diagonal += weight[:, :3]
        diagonal[:, 2] += weight[:, 3] * priors.free[:, 2]
        rhs += weight[:, :3] * deviation[:, :3]
        rhs[:, 2] += weight[:, 3] * deviation[:, 3] * priors.free[:, 2]
        diagonal += np.where(priors.free, 0.0, 1.0)
        objective = objective + priors.squares
    ridge = RIDGE * diagonal.max(axis=1, keepdims=True)
    diagonal += ridge
    return PointNormals(
        images=images,
        residual=residual,
        B=B,
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
    group = priors.group[point]
    grouped = group >= 0
    deviation[grouped, 3] = state.levels[group[grouped]] - current[grouped, 2]
    weight = np.concatenate([priors.weight[point], priors.group_weight[point][:, None]], axis=1)
    return Priors(axes=axes, deviation=deviation, weight=weight, free=~priors.held[point])


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
        normals = point_normals(network, state, group, X, stations=False)
        local = np.linalg.solve(normals.matrix, normals.rhs[..., None])
        fall = np.einsum("ki,kij->k", normals.rhs, local)
        return (np.swapaxes(normals.axes, -1, -2) @ local)[..., 0], normals.objective, fall

    def held(rows: IntArray, X: FloatArray) -> FloatArray:
        return hold(network, group.point, X) if group.known else X

    return steps_to_best(step, ground, held, trial=trial)


def steps_to_best(
    step: Callable[[IntArray, FloatArray], Step],
    ground: FloatArray,
    held: Callable[[IntArray, FloatArray], FloatArray],
    each: bool = False,
    trial: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return where points come to rest (k, 3) from `ground`, and their weighted squares (k,) there.

    `step` tells of some of them, rows (r,) at X (r, 3), the steps, the squares where they are, and by how much
    these fall; `held` puts back what is held of them. They go on until all are at rest, or `each` until it is. What
    a `trial` is, `settle_group` says.
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
        moving = ~(np.abs(last[rows]).max(axis=1) < STEP_LIMIT)
        if not moving.any():
            break
        rows = rows[moving] if each else rows
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
    seen = collinearity.in_front(X - state.position[photo], state.M[photo]).all(axis=1)
    return np.where(seen & np.isfinite(squares), squares, np.inf)
