"""Which unknowns a singular or ill-determined normal matrix leaves free, in words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from musatpy.adjustment.kinds import UNKNOWNS
from musatpy.adjustment.kinds.measured import kept_axes
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import PARAMETERS, NormalMatrix, weak_directions
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.geometry.rotations import skew
from musatpy.model import Block, Datum

DATUM = (
    "shift east",
    "shift north",
    "shift up",
    "rotation about east",
    "rotation about north",
    "rotation about up",
    "scale",
)
RUN_AWAY = "stations or points have run away: what is free of them cannot be told"
_FREE = 0.9  # share of a datum motion that must lie among the weak directions
_NAMED_SHARE = 0.2  # of the largest part of a motion, for a part to be named
_NAMED = 4  # unknowns named for one weak direction


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
    sentences, weak = _name_datum(motions, weak, holder)
    # an orthogonal basis of what is left: each direction names the unknowns that it moves most
    u, singular_values, _ = np.linalg.svd(weak, full_matrices=False)
    name = unknown_name(network, block)
    for direction in u[:, singular_values > 0.5].T:
        sentences.append(_name_direction(direction, name))
    return sentences


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


def unknown_name(network: Network, block: Block) -> Callable[[int], str]:
    """Return what names the unknowns of the normal equations of a block."""
    q, split, photos = network.pattern.size, network.pattern.order, block.photos.ids.tolist()
    rest = network.border.names(block.points.ids.tolist())

    def name(unknown: int) -> str:
        if unknown < split:
            return f"photo {photos[unknown // q]} {PARAMETERS[unknown % q]}"
        return rest[unknown - split]

    return name


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
