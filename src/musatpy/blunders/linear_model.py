"""The adjustment of a scene made linear: residuals at the minimum, and how far the rest checks groups of them.

For a group S of observations that may all be wrong (Baarda 1968, alternatives of several dimensions), with
r = P v and R = P Qvv P, the sum of squares falls by r_S' R_SS^-1 r_S when they are given up, and their errors
are -R_SS^-1 r_S. One factor of the normal equations serves for all groups.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment import propagation
from musatpy.adjustment.ground import nearest_ground, point_squares, settle_group
from musatpy.adjustment.iteration import SingularNormalsError, State
from musatpy.adjustment.kinds import state_after, station_rows
from musatpy.adjustment.network import Network, kept_axes
from musatpy.adjustment.normals import Cofactors, Factor, factorised
from musatpy.adjustment.propagation import Piece, pieces
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.scene import IMAGES_CHECKED, OTHERS_CHECKED, Factors, StagedBlock

_FAR = 100.0  # squares of a point: control or images are more than some sigmas off
_STEPS = 4  # of an adjustment, that it takes as much as
_MEETS = 40.0  # squares for each of its images that say that these meet: stations need not be exact


@dataclass(frozen=True, kw_only=True, eq=False)
class Drop:
    """What giving up k groups of s observations explains."""

    squares: FloatArray  # (k,) by which v'Pv falls
    parameters: IntArray  # (k,) errors that are really tested
    error: FloatArray  # (k, s) given minus true, zero where nothing checks it
    sigma: FloatArray  # (k, s) for sigma0 of 1, NaN where nothing checks it


@dataclass(frozen=True, kw_only=True, eq=False)
class PointChecks:
    """The images (m of each), then the four priors of k points if any has some: o = 2 m + 4 rows, or 2 m."""

    point: IntArray  # (k,)
    rays: IntArray  # (k, m)
    residual: FloatArray  # (k, o) adjusted minus observed
    weight: FloatArray  # (k, o)
    partials: FloatArray  # (k, o, T) by the unknowns, the point following
    ground: FloatArray  # (k, o, 3) by the point
    inverse: FloatArray  # (k, 3, 3) of the normal equations of the point
    unknowns: IntArray  # (k, T) of the normal equations
    photo: IntArray  # (k, m)
    extras: IntArray  # (k, X) further unknowns
    cofactors: Cofactors  # of the unknowns
    decorrelation: FloatArray | None  # (k, 3, 3) of the control

    @cached_property
    def cofactor(self) -> FloatArray:
        """(k, o, o) cofactors of the adjusted observations."""
        by_stations = self.cofactors.cofactors_of(self.photo, self.extras, self.partials)
        return by_stations + self.ground @ self.inverse @ np.swapaxes(self.ground, 1, 2)

    def part(self, taken: BoolArray) -> PointChecks:
        """Return some of the points."""
        columns = {one.name: getattr(self, one.name) for one in fields(self) if one.name != "cofactors"}
        return replace(self, **{name: column[taken] for name, column in columns.items() if column is not None})

    def drop(self, rows: IntArray) -> Drop:
        """Return what the observations `rows` (s,) of every point explain."""
        control = rows - 2 * self.rays.shape[1]
        checked = IMAGES_CHECKED if rows.max(initial=0) < 2 * self.rays.shape[1] else OTHERS_CHECKED
        mixed: FloatArray | None = None
        if self.decorrelation is not None and control[0] >= 0 and control[-1] < 3:
            mixed = np.asarray(np.linalg.inv(self.decorrelation[:, control[:, None], control[None]]), dtype=float)
        Q = self.cofactor[:, rows[:, None], rows[None]]
        return dropped(self.residual[:, rows], self.weight[:, rows], Q, checked, mixed)


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel:
    """The linear adjustment of a scene at a state, some observations out; its points after the step."""

    scene: StagedBlock
    network: Network  # with the weights of what is in
    state: State  # at which it is linear, its points at their best for the stations
    points: tuple[PointChecks, ...]
    factor: Factor
    cofactors: Cofactors  # of stations and globals
    step: FloatArray  # (u,) to the minimum
    stations: FloatArray  # (n, q) residuals of positions, attitudes, tides
    station_weight: FloatArray  # (n, q)

    @cached_property
    def minimum(self) -> State:
        """Stations and kept points after the step, for the observations of these alone."""
        network, step = self.network, self.step
        after, kept = state_after(network, self.state, step), network.border.kept
        if not len(kept):
            return after
        ground, local = self.state.ground.copy(), step[network.pattern.order + network.border.kept_columns(kept)]
        ground[kept] += np.einsum("kji,kj->ki", kept_axes(network, ground[kept]), local)
        return replace(after, ground=ground)

    @property
    def squares(self) -> float:
        """v'Pv at the minimum, of images, control and stations."""
        of_points = sum(float(np.sum(checks.weight * np.square(checks.residual))) for checks in self.points)
        return of_points + float(np.sum(self.station_weight * np.square(self.stations)))

    def station_drop(self, columns: IntArray) -> Drop:
        """Return what some of the observations of each photo (n,) explain."""
        v, weight = self.stations[:, columns], self.station_weight[:, columns]
        n, q = self.stations.shape
        unit = np.broadcast_to(np.eye(q)[columns], (n, len(columns), q))
        Q = self.cofactors.cofactors_of(np.arange(n)[:, None], np.zeros((n, 0), dtype=np.int64), unit)
        return dropped(v, weight, Q, OTHERS_CHECKED)


def linear_model(scene: StagedBlock, factors: Factors, state: State) -> LinearModel:
    """Return the linear adjustment of a scene, its weights times `factors`, points at their best for the stations.

    Raises `SingularNormalsError`.
    """
    scene.effort.spend_steps(scene.network, _STEPS)
    problem = scene.problem(factors)
    network = problem.network
    state = _by_images(network, ground_points.settle(network, state))
    line = problem.linearise(state)
    factor = factorised(line.matrix)
    if factor is None:
        raise SingularNormalsError(line.matrix)
    cofactors, step = factor.cofactors().holding(scene.held), factor.solve(line.rhs)
    station_weight, residual = station_rows(network, state)
    return LinearModel(
        scene=scene,
        network=network,
        state=state,
        points=tuple(
            _checks_of(network, piece, cofactors, step)
            for group in network.groups
            for _, piece in pieces(network, state, group, cofactors)
        ),
        factor=factor,
        cofactors=cofactors,
        step=step,
        stations=residual + step[: residual.size].reshape(residual.shape),
        station_weight=station_weight,
    )


def _by_images(network: Network, state: State) -> State:
    """Return the state with control points where their images meet, where these meet well and control is far off.

    Images are linear near their point only; control is linear everywhere.
    """
    ground, far = state.ground.copy(), state.squares > _FAR
    for group in network.control_groups:
        if group.rays.shape[1] < 2:
            continue
        for part in group.some(far[group.point]):
            part = replace(part, known=False)
            start = nearest_ground(network.with_unknown_points(), state, part, 0.0)
            met, _ = settle_group(network, state, part, start)
            squares = point_squares(network, state, part, met)
            good = squares < _MEETS * part.rays.shape[1]
            ground[part.point[good]] = met[good]
    return replace(state, ground=ground)


def _checks_of(network: Network, piece: Piece, cofactors: Cofactors, step: FloatArray) -> PointChecks:
    E, rays = piece.E, piece.group.rays
    k = len(rays)
    a, b = propagation.image_partials(network, piece)
    v, weight = E.normals.residual.reshape(k, -1), network.weight[rays].reshape(k, -1)
    known = E.normals.priors
    if known is not None:
        a_known, b_known = propagation.prior_partials(piece)
        a, b = np.concatenate([a, a_known], axis=1), np.concatenate([b, b_known], axis=1)
        v = np.concatenate([v, -known.deviation], axis=1)
        weight = np.concatenate([weight, known.weight], axis=1)
    unknowns = network.unknowns(piece.group, E.extras.index)
    return PointChecks(
        point=piece.group.point,
        rays=rays,
        residual=v + (b @ E.shift[..., None])[..., 0] + (a @ step[unknowns][..., None])[..., 0],
        weight=weight,
        partials=a,
        ground=b,
        inverse=E.inverse,
        unknowns=unknowns,
        photo=piece.photo,
        extras=E.extras.index,
        cofactors=cofactors,
        decorrelation=None if known is None else known.decorrelation,
    )


def dropped(
    v: FloatArray, weight: FloatArray, Q: FloatArray, checked: float, mixed: FloatArray | None = None
) -> Drop:
    """Return what groups of observations explain: residuals and weights (k, s), cofactors (k, s, s) adjusted.

    The errors are those of the observations, or what `mixed` (k, s, s) makes of these.
    """
    root = np.sqrt(weight)
    used = root > 0.0
    share = np.eye(v.shape[1]) * used[:, None, :] - root[:, :, None] * Q * root[:, None, :]
    values, vectors = np.linalg.eigh(0.5 * (share + np.swapaxes(share, 1, 2)))
    tested = values > checked
    inverse = np.where(tested, 1.0 / np.where(tested, values, 1.0), 0.0)
    u = np.einsum("kij,ki->kj", vectors, root * v)
    sigma = np.where(used, 1.0 / np.where(used, root, 1.0), 0.0)
    spread = vectors * inverse[:, None, :]
    blind = np.einsum("kij,kj->ki", np.square(vectors), ~tested * 1.0) > 0.5
    variance = np.einsum("kij,kij->ki", spread, vectors) * np.square(sigma)
    error = -sigma * np.einsum("kij,kj->ki", spread, u)
    if mixed is not None:
        error = np.einsum("kij,kj->ki", mixed, error)
        root = mixed @ (sigma[:, :, None] * vectors * np.sqrt(inverse)[:, None, :])
        variance = np.square(root).sum(axis=2)
    return Drop(
        squares=np.einsum("kj,kj->k", np.square(u), inverse),
        parameters=np.count_nonzero(tested, axis=1),
        error=error,
        sigma=np.where(blind | ~used, np.nan, np.sqrt(variance)),
    )


def as_on_cards(network: Network, point: int, component: IntArray, error: FloatArray) -> FloatArray:
    """Return errors of components (s,) of control as its card has them, from those of what has the weights."""
    T = network.priors.decorrelation
    return error if T is None else np.linalg.solve(T[point][np.ix_(component, component)], error)


def put_in_again(v: FloatArray, weight: FloatArray, Q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return residuals and cofactors of groups of observations that take part, from those by all others alone.

    Residuals (k, s) and cofactors (k, s, s) of what the others predict; they come in with weights (k, s): with
    G = P^1/2 Q P^1/2, P^1/2 v becomes (1 + G)^-1 P^1/2 v, and G becomes 1 - (1 + G)^-1.
    """
    root, unit = np.sqrt(weight), np.eye(v.shape[1])
    left = np.linalg.inv(unit + root[:, :, None] * Q * root[:, None, :])
    return np.einsum("kij,kj->ki", left, root * v) / root, (unit - left) / (root[:, :, None] * root[:, None, :])
