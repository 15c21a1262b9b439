"""How far the observations of points are checked by the rest, in a linear adjustment.

For a group S of observations that may all be wrong (Baarda 1968, alternatives of several dimensions), with
r = P v and R = P Qvv P, the sum of squares falls by r_S' R_SS^-1 r_S when they are given up, and their errors
are -R_SS^-1 r_S. One factor of the normal equations serves for all groups.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from musatpy.adjustment import reliability
from musatpy.adjustment.network import Network, first_rows
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.propagation import pieces
from musatpy.adjustment.reliability import Piece
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.scene import IMAGES_CHECKED, OTHERS_CHECKED
from musatpy.model import Block


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
    control: IntArray  # (k,) row of the control, -1 for none
    member: IntArray  # (k,) row of the equal elevations, -1 for none
    residual: FloatArray  # (k, o) adjusted minus observed
    weight: FloatArray  # (k, o)
    partials: FloatArray  # (k, o, T) by the unknowns, the point following
    ground: FloatArray  # (k, o, 3) by the point
    inverse: FloatArray  # (k, 3, 3) of the normal equations of the point
    unknowns: IntArray  # (k, T) of the normal equations
    photo: IntArray  # (k, m)
    extras: IntArray  # (k, X) further unknowns
    cofactors: Cofactors  # of the unknowns

    @property
    def has_priors(self) -> bool:
        """Whether anything is known of any of the points."""
        return bool((self.weight[:, 2 * self.rays.shape[1] :] > 0.0).any())

    @cached_property
    def squares(self) -> FloatArray:
        """(k,) weighted squares of the residuals."""
        return np.asarray(np.sum(self.weight * np.square(self.residual), axis=1))

    @cached_property
    def cofactor(self) -> FloatArray:
        """(k, o, o) cofactors of the adjusted observations."""
        by_stations = self.cofactors.cofactors_of(self.photo, self.extras, self.partials)
        return by_stations + self.ground @ self.inverse @ np.swapaxes(self.ground, 1, 2)

    def part(self, taken: BoolArray) -> PointChecks:
        """Return some of the points."""
        rows = {one.name: getattr(self, one.name)[taken] for one in fields(self) if one.name != "cofactors"}
        return PointChecks(**rows, cofactors=self.cofactors)

    def drop(self, rows: IntArray) -> Drop:
        """Return what the observations `rows` (s,) of every point explain."""
        checked = IMAGES_CHECKED if rows.max(initial=0) < 2 * self.rays.shape[1] else OTHERS_CHECKED
        return dropped(
            self.residual[:, rows], self.weight[:, rows], self.cofactor[:, rows[:, None], rows[None]], checked
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedPoints:
    """The points of a network with their checks, each at its best for the stations."""

    network: Network  # with the weights of what is in
    state: State  # at which it is linear
    points: tuple[PointChecks, ...]

    def some(self, points: BoolArray) -> CheckedPoints:
        """Return some of them (p,)."""
        parts = tuple(checks.part(points[checks.point]) for checks in self.points)
        return CheckedPoints(network=self.network, state=self.state, points=parts)


def checked_points(
    block: Block, network: Network, state: State, cofactors: Cofactors, step: FloatArray
) -> CheckedPoints:
    """Return the points of a network after a step (u,), by the `cofactors` of its unknowns."""
    control, member = (
        first_rows(table.point, len(block.points.ids)) for table in (block.control, block.equal_elevations)
    )
    every = (piece for group in network.groups for _, piece in pieces(network, state, group, cofactors))
    points = tuple(_checks_of(network, piece, cofactors, control, member, step) for piece in every)
    return CheckedPoints(network=network, state=state, points=points)


def _checks_of(
    network: Network, piece: Piece, cofactors: Cofactors, control: IntArray, member: IntArray, step: FloatArray
) -> PointChecks:
    E, rays = piece.E, piece.group.rays
    k = len(rays)
    a, b = reliability.image_partials(network, piece)
    v, weight = E.normals.residual.reshape(k, -1), network.weight[rays].reshape(k, -1)
    known = E.normals.priors
    if known is not None:
        a_known, b_known = reliability.prior_partials(piece)
        a, b = np.concatenate([a, a_known], axis=1), np.concatenate([b, b_known], axis=1)
        v = np.concatenate([v, -known.deviation], axis=1)
        weight = np.concatenate([weight, known.weight], axis=1)
    unknowns = network.unknowns(piece.group, E.extras.index)
    return PointChecks(
        point=piece.group.point,
        rays=rays,
        control=control[piece.group.point],
        member=member[piece.group.point],
        residual=v + (b @ E.shift[..., None])[..., 0] + (a @ step[unknowns][..., None])[..., 0],
        weight=weight,
        partials=a,
        ground=b,
        inverse=E.inverse,
        unknowns=unknowns,
        photo=piece.photo,
        extras=E.extras.index,
        cofactors=cofactors,
    )


def dropped(v: FloatArray, weight: FloatArray, Q: FloatArray, checked: float) -> Drop:
    """Return what groups of observations explain: residuals and weights (k, s), cofactors (k, s, s) adjusted."""
    root = np.sqrt(weight)
    used = root > 0.0
    share = np.eye(v.shape[1]) * used[:, None, :] - root[:, :, None] * Q * root[:, None, :]
    values, vectors = np.linalg.eigh(0.5 * (share + np.swapaxes(share, 1, 2)))
    tested = values > checked
    inverse = np.where(tested, 1.0 / np.where(tested, values, 1.0), 0.0)
    u = np.einsum("kij,ki->kj", vectors, root * v)
    sigma = np.where(used, 1.0 / np.where(used, root, 1.0), 0.0)
    solved = vectors * inverse[:, None, :]
    blind = np.einsum("kij,kj->ki", np.square(vectors), ~tested * 1.0) > 0.5
    variance = np.einsum("kij,kij->ki", solved, vectors) * np.square(sigma)
    return Drop(
        squares=np.einsum("kj,kj->k", np.square(u), inverse),
        parameters=np.count_nonzero(tested, axis=1),
        error=-sigma * np.einsum("kij,kj->ki", solved, u),
        sigma=np.where(blind | ~used, np.nan, np.sqrt(variance)),
    )


def put_in_again(v: FloatArray, weight: FloatArray, Q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return residuals and cofactors of groups of observations that take part, from those by all others alone.

    Residuals (k, s) and cofactors (k, s, s) of what the others predict; they come in with weights (k, s): with
    G = P^1/2 Q P^1/2, P^1/2 v becomes (1 + G)^-1 P^1/2 v, and G becomes 1 - (1 + G)^-1.
    """
    root, unit = np.sqrt(weight), np.eye(v.shape[1])
    left = np.linalg.inv(unit + root[:, :, None] * Q * root[:, None, :])
    return np.einsum("kij,kj->ki", left, root * v) / root, (unit - left) / (root[:, :, None] * root[:, None, :])
