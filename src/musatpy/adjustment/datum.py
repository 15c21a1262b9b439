"""What holds a block, and what of it nothing holds: the motions that are free, in words, and free networks.

The iteration of a free network holds as many station unknowns as there are free motions, which changes no image.
The result is then moved so that the triangulated points stay, in the least squares sense, where the given stations
first put them, and the covariances with it: the S-transformation of Baarda (1973), by which they have the least
trace over the points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import qr

from musatpy.adjustment.collinear import Elimination, eliminate
from musatpy.adjustment.ground import point_normals
from musatpy.adjustment.iteration import State
from musatpy.adjustment.kinds import UNKNOWNS
from musatpy.adjustment.network import Network, PointGroup, kept_axes, unknown_name
from musatpy.adjustment.normals import Cofactors, Factor, NormalMatrix, weak_directions
from musatpy.adjustment.parameters import Effect
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.collinearity import attitude_from_matrix, skew, wrapped
from musatpy.geometry.similarity import Similarity
from musatpy.model import Block, Datum
from musatpy.model.tables import finite_rows

DATUM = (
    "shift east",
    "shift north",
    "shift up",
    "rotation about east",
    "rotation about north",
    "rotation about up",
    "scale",
)
RUN_AWAY = "stations or points have run away, so it cannot be said which of them are free"
_FREE = 0.9  # share of a datum motion that must lie among the weak directions
_NAMED_SHARE = 0.2  # of the largest part of a motion, for a part to be named
_OF_PARAMETERS = 0.1  # share of parameters in a weak direction that is theirs, and none of the datum
_NAMED = 4  # unknowns named for one weak direction
_CYCLES = 10  # of the move to the inner constraints: its rotations are finite, two or three serve
_HELD = 1e-11  # of the scaled normal matrix: rounding holds a motion by 1e-12
_FIRMLY = 1e-9  # about where a scale has a sigma of 1 %: less than that is no datum
_REST = 1e-6  # m, the last of them


@dataclass(frozen=True, kw_only=True, eq=False)
class Freedom:
    """The d similarity motions of a block that nothing holds, or next to nothing.

    Known tides alone, for instance, hold the scale of a block by next to nothing.
    """

    directions: FloatArray  # (u, d) in the unknowns of the normal equations
    motions: FloatArray  # (7, d) the same of the seven similarity motions about `centre`
    centre: FloatArray  # (3,)
    held: IntArray  # (d,) unknowns of the normal equations that the iteration holds instead
    weak: int  # of the d motions, those held by next to nothing

    @property
    def count(self) -> int:
        """Number of free motions d."""
        return len(self.held)


NOTHING_FREE = Freedom(
    directions=np.zeros((0, 0)),
    motions=np.zeros((7, 0)),
    centre=np.zeros(3),
    held=np.zeros(0, dtype=np.int64),
    weak=0,
)


def freedom(network: Network, state: State, matrix: NormalMatrix, loosest: float = np.inf) -> Freedom:
    """Return the free motions of a block with the normal matrix `matrix` at `state`; none if it makes no sense.

    Free are rotations of a sigma beyond `loosest` rad too.
    """
    if not matrix.sensible():
        return NOTHING_FREE  # points have run away: the iteration says so
    centre = state.position.mean(axis=0)
    scale = 1.0 / np.sqrt(matrix.diagonal())
    scaled = datum_motions(network, state, centre) / scale[:, None]
    basis, triangle = np.linalg.qr(scaled)
    inverse = np.linalg.inv(triangle)
    resistance = basis.T @ matrix.scaled(scale).times(basis)
    values, vectors = np.linalg.eigh(resistance - inverse.T @ _by_ridge(network, state, centre) @ inverse)
    rotation = np.linalg.norm((inverse @ vectors)[3:6], axis=0)
    vectors = vectors[:, (values < _FIRMLY) | (values < np.square(rotation / loosest))]
    if not vectors.size:
        return NOTHING_FREE
    free = basis @ vectors
    # the first pivots are the unknowns by which the directions can be told apart best
    pivots = qr(free[: network.pattern.order].T, mode="economic", pivoting=True)[2]
    return Freedom(
        directions=free * scale[:, None],
        motions=inverse @ vectors,
        centre=centre,
        held=np.sort(pivots[: free.shape[1]]),
        weak=int(np.count_nonzero((values > _HELD) & (values < _FIRMLY))),
    )


def _by_ridge(network: Network, state: State, centre: FloatArray) -> FloatArray:
    """Return (7, 7) what the ridge of single points, which observes nothing, holds of the motions about `centre`.

    Where rays meet at small angles under water that is next to nothing known, it can be all that holds a scale.
    """
    out = np.zeros((7, 7))
    for group in network.groups:
        if not group.kept:
            ground = state.ground[group.point]
            ridge = point_normals(network, state, group, ground, stations=False).ridge
            G = point_motions(network, centre, ground)
            out += np.einsum("k,kia,kib->ab", ridge, G, G)
    return out


@dataclass(frozen=True, kw_only=True, eq=False)
class InnerConstraints:
    """The S-transformation of the cofactors of a block whose unknowns `freedom.held` were held."""

    freedom: Freedom
    H: FloatArray  # (u, d) free directions
    K: FloatArray  # (d, u)
    M: FloatArray  # (d, d)
    RQ: FloatArray  # (d, u)
    inverse: FloatArray  # (d, d) (E'H)^-1

    def cofactors(self, Q: Cofactors) -> Cofactors:
        """Return the cofactors of stations and globals, Q - H K - K'H' + H M H'."""
        n, q = Q.pattern.count, Q.pattern.size
        split = n * q
        H, K = self.H[:split].reshape(n, q, -1), np.moveaxis(self.K[:, :split].reshape(-1, n, q), 0, -1)
        i, j = Q.pattern.pairs.T
        HM = H @ self.M
        blocks = Q.blocks + HM[i] @ _t(H[j]) - H[i] @ _t(K[j]) - K[i] @ _t(H[j])
        Hs, He, Ks, Ke = self.H[:split], self.H[split:], self.K[:, :split], self.K[:, split:]
        border = Q.border + Hs @ self.M @ He.T - Hs @ Ke - Ks.T @ He.T
        corner = Q.corner + He @ self.M @ He.T - He @ Ke - Ke.T @ He.T
        return replace(Q, blocks=blocks, border=border, corner=corner)

    def points(
        self, network: Network, group: PointGroup, Q: FloatArray, E: Elimination, constrained: bool
    ) -> FloatArray:
        """Return the cofactors (k, 3, 3) of eliminated points from those of the held block, in the axes of E.

        `Q` (k, 3, 3) and `E` are of the group; `constrained` points took part in the solution, and so in the
        constraints.
        """
        return self.of_points(network.unknowns(group, E.extras.index), -E.F, np.eye(3), Q, E, constrained)

    def of_points(
        self, columns: IntArray, a: FloatArray, b: FloatArray, Q: FloatArray, E: Elimination, constrained: bool
    ) -> FloatArray:
        """Return the cofactors (k, r, r) of r quantities of each point from those of the held block, Q (k, r, r).

        They have the partials a (k, r, T) by the unknowns `columns` (k, T), which the point follows, the first of
        them those of its elimination, and b (r, 3) or (k, r, 3) by what else moves the point.
        """
        G = a @ self.H[columns]
        crossed = -np.swapaxes(self.RQ.T[columns], 1, 2) @ _t(a)
        if constrained:
            F = E.F
            point = -F @ self.H[columns[:, : F.shape[2]]]
            crossed = crossed + _t(point) @ E.free_inverse @ _t(b)
        K = self.inverse @ crossed
        return Q - G @ K - _t(K) @ _t(G) + G @ self.M @ _t(G)

    def restored(self, network: Network, state: State, cross: FloatArray, known: BoolArray) -> FloatArray:
        """Return what the constraints add (u, c) to the effect of errors of c parameters on the held block.

        `network` has the parameters in its border, in the columns `known` (g,); `cross` (u, c) are the normals
        between unknowns and parameters.
        """
        split = network.pattern.order
        H = np.zeros((split + len(known), self.H.shape[1]))
        H[np.concatenate([np.ones(split, dtype=bool), ~known])] = self.H
        R = np.zeros_like(H)
        for group in network.groups:
            if not group.kept:
                E = eliminate(network, state, group)
                F, columns = E.F, network.unknowns(group, E.extras.index)
                np.add.at(R, columns, _t(F) @ -F @ H[columns])
        return self.H @ self.inverse @ (R[split:][known].T - self.RQ @ cross)


def inner_constraints(network: Network, state: State, factor: Factor, free: Freedom) -> InnerConstraints:
    """Return the inner constraints over all points of the solution; `factor` is that of the held block."""
    H = free.directions
    d = H.shape[1]
    R, EQE, EH = np.zeros((len(H), d)), np.zeros((d, d)), np.zeros((d, d))
    for group in network.groups:
        if group.kept:
            columns = network.pattern.order + network.border.kept_columns(group.point)
            G = H[columns]
            np.add.at(R, columns, -G)
        else:
            E = eliminate(network, state, group)
            F, columns = E.F, network.unknowns(group, E.extras.index)
            G = -F @ H[columns]
            np.add.at(R, columns, _t(F) @ G)
            EQE += np.einsum("kid,kij,kje->de", G, E.free_inverse, G)
        EH += np.einsum("kid,kie->de", G, G)
    moving = R.copy()
    moving[free.held] = 0.0
    RQ = np.stack([factor.solve(column) for column in moving.T])
    RQ[:, free.held] = 0.0
    inverse = np.asarray(np.linalg.inv(EH), dtype=float)
    return InnerConstraints(
        freedom=free,
        H=H,
        K=-inverse @ RQ,
        M=inverse @ (EQE + RQ @ R) @ inverse.T,
        RQ=RQ,
        inverse=inverse,
    )


def moved_to(network: Network, state: State, free: Freedom, first: FloatArray) -> tuple[State, float]:
    """Return the state moved freely so that its points lie about `first` (p, 3), and how far it was moved, m."""
    points = np.concatenate([group.point for group in network.groups])
    known = points[finite_rows(first[points])]
    start = state.position
    for _ in range(_CYCLES):
        G = point_motions(network, free.centre, state.ground[known]) @ free.motions
        gap = first[known] - state.ground[known]
        t, *_ = np.linalg.lstsq(G.reshape(-1, G.shape[2]), gap.reshape(-1), rcond=None)
        state = _moved(network, state, free.centre, free.motions @ t)
        if np.abs(G @ t).max() < _REST:
            break
    return state, float(np.abs(state.position - start).max())


def _moved(network: Network, state: State, centre: FloatArray, move: FloatArray) -> State:
    """Return the state after a similarity: shift and turn along the axes at `centre`, and growth about it."""
    axes = network.frame.axes(centre)
    shift, angle, growth = move[:3] @ axes, move[3:6] @ axes, move[6]
    size = float(np.linalg.norm(angle))
    a = angle / size if size > 0.0 else angle
    cross = skew(a)
    R = np.eye(3) + np.sin(size) * cross + (1.0 - np.cos(size)) * cross @ cross
    attitude = attitude_from_matrix(state.M @ R.T @ _t(state.axes))
    grow = 1.0 + growth
    level = Similarity(scale=grow, rotation=axes @ R @ axes.T, shift=move[:3])
    for kind in UNKNOWNS:
        state = kind.transformed(network, state, centre, level)
    return replace(
        state,
        position=centre + grow * (state.position - centre) @ R.T + shift,
        attitude=wrapped(attitude, state.attitude),
        ground=centre + grow * (state.ground - centre) @ R.T + shift,
    )


def _t(a: FloatArray) -> FloatArray:
    return np.swapaxes(a, -1, -2)


def describe_weakness(
    network: Network, state: State, matrix: NormalMatrix, limit: float, block: Block
) -> list[str]:
    """Return one sentence for every way in which the solution is free, weaker than `limit` (relative)."""
    scale, weak = weak_directions(matrix, limit)
    if weak.shape[1] == 0:
        return []
    motions = datum_motions(network, state, state.position.mean(axis=0)) / scale[:, None]
    size = np.linalg.norm(motions, axis=0)
    motions /= np.where(size > 0.0, size, 1.0)  # a single photo has no scale
    if not (np.isfinite(motions).all() and np.isfinite(weak).all()):
        return [RUN_AWAY]
    holder = "no observation holds" if block.options.datum is Datum.FREE else "the control does not hold"
    name = unknown_name(network, block)
    of_parameters, weak = _name_parameters(network, weak, name)
    sentences, weak = _name_datum(motions, weak, holder)
    # an orthogonal basis of what is left: each direction names the unknowns that it moves most
    u, singular_values, _ = np.linalg.svd(weak, full_matrices=False)
    for direction in u[:, singular_values > 0.5].T:
        sentences.append(_name_direction(direction, name))
    return [*of_parameters, *sentences]


def _name_parameters(
    network: Network, weak: FloatArray, name: Callable[[int], str]
) -> tuple[list[str], FloatArray]:
    """Return sentences on weak directions (u, w) that change images by parameters, and the other ones."""
    columns = [
        network.pattern.order + network.border.numbers(kind)
        for kind, known in network.parameters.items()
        if known.effect_in is Effect.IMAGE
    ]
    if not columns:
        return [], weak
    rows = np.concatenate(columns)
    _, sizes, turn = np.linalg.svd(weak[rows])
    count = int((sizes > _OF_PARAMETERS).sum())
    sentences = []
    for direction in (weak @ turn[:count].T).T:
        first = name(int(rows[np.abs(direction[rows]).argmax()]))
        sentences.append(f"{_name_direction(direction, name)}; hold {first}, or give it a sigma")
    return sentences, weak @ turn[count:].T


def _name_datum(motions: FloatArray, weak: FloatArray, holder: str) -> tuple[list[str], FloatArray]:
    """Return sentences on motions of the whole block among the weak directions (u, w), and the other ones."""
    basis, _ = np.linalg.qr(motions)
    turn, cosines, _ = np.linalg.svd(weak.T @ basis)
    whole = weak @ turn[:, : len(cosines)][:, cosines > _FREE]  # weak directions that move the block as a whole
    if whole.shape[1] == 0:
        return [], weak
    share = np.linalg.norm(whole.T @ motions, axis=0)
    names = [name for name, part in zip(DATUM, share, strict=True) if part > _FREE]
    sentences = []
    if names:
        sentences.append(f"the block as a whole is free in {', '.join(names)}: {holder} it")
    named, _ = np.linalg.qr(motions[:, share > _FREE])
    left, sizes, _ = np.linalg.svd(whole - named @ (named.T @ whole), full_matrices=False)
    for direction in left[:, sizes > 0.5].T:
        parts = np.abs(np.linalg.lstsq(motions, direction, rcond=None)[0])
        names = [name for name, part in zip(DATUM, parts, strict=True) if part > _NAMED_SHARE * parts.max()]
        sentences.append(f"the block as a whole is free in one motion, of {' with '.join(names)}")
    return sentences, weak - whole @ (whole.T @ weak)


def _name_direction(direction: FloatArray, name: Callable[[int], str]) -> str:
    size = np.abs(direction)
    largest = [int(i) for i in np.argsort(-size)[:_NAMED] if size[i] > 0.1 * size.max()]
    return f"not determined, alone or against each other: {', '.join(name(i) for i in largest)}"


def point_motions(network: Network, centre: FloatArray, ground: FloatArray) -> FloatArray:
    """Return what the seven similarity motions about `centre` do to ground points (k, 3), (k, 3, 7)."""
    axes, arm = network.frame.axes(centre), ground - centre
    turns = np.cross(axes[None], arm[:, None])  # (k, 3 axes, 3)
    shifts = np.broadcast_to(axes, turns.shape)
    return np.concatenate([np.swapaxes(shifts, 1, 2), np.swapaxes(turns, 1, 2), arm[..., None]], axis=2)


def datum_motions(network: Network, state: State, centre: FloatArray) -> FloatArray:
    """Return the seven similarity motions about `centre` (u, 7), in the unknowns of the normal equations.

    Known water takes part in none of them: its level and tilt move only where they are unknown.
    """
    n, q, axes, border = network.photos, network.pattern.size, network.axes, network.border
    arm = state.position - centre
    local = network.frame.axes(centre)
    motions = np.zeros((q * n + border.size, 7))
    kept = state.ground[border.kept]
    kept_moves = kept_axes(network, kept) @ point_motions(network, centre, kept)
    motions[q * n + border.first_kept :] = kept_moves.reshape(-1, 7)
    # M of a rotated block is M R^T: dM = -M [a]x, solved for the three angles of each photo
    inverse = np.linalg.pinv(state.dM.reshape(n, 3, 9).swapaxes(1, 2))
    for k in range(3):
        a = local[k]
        shift = np.zeros((n, q))
        shift[:, :3] = axes @ a
        motions[: q * n, k] = shift.reshape(-1)
        turn = np.zeros((n, q))
        turn[:, :3] = np.einsum("nij,nj->ni", axes, np.cross(a, arm))
        turn[:, 3:6] = np.einsum("nij,nj->ni", inverse, -(state.M @ skew(a)).reshape(n, 9))
        motions[: q * n, 3 + k] = turn.reshape(-1)
    grow = np.zeros((n, q))
    grow[:, :3] = np.einsum("nij,nj->ni", axes, arm)
    motions[: q * n, 6] = grow.reshape(-1)
    for kind in UNKNOWNS:
        kind.put_motions(network, state, centre, motions)
    return motions
