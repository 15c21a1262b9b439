"""Which unknowns a singular or ill-determined normal matrix leaves free, in words."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import PARAMETERS, NormalMatrix, weak_directions
from musatpy.adjustment.unknowns import State

FloatArray = NDArray[np.float64]

DATUM = (
    "shift east",
    "shift north",
    "shift up",
    "rotation about east",
    "rotation about north",
    "rotation about up",
    "scale",
)
_FREE = 0.9  # share of a datum motion that must lie among the weak directions
_NAMED_SHARE = 0.2  # of the largest part of a motion, for a part to be named
_NAMED = 4  # unknowns named for one weak direction


def describe_weakness(
    network: Network, state: State, matrix: NormalMatrix, limit: float, photo_ids: list[str], group_ids: list[str]
) -> list[str]:
    """Return one sentence for every way in which the solution is free, weaker than `limit` (relative)."""
    scale, weak = weak_directions(matrix, limit)
    if weak.shape[1] == 0:
        return []
    motions = _datum_motions(network, state) / scale[:, None]
    motions /= np.linalg.norm(motions, axis=0)
    sentences, weak = _name_datum(motions, weak)
    # an orthogonal basis of what is left: each direction names the unknowns that it moves most
    u, singular_values, _ = np.linalg.svd(weak, full_matrices=False)
    for direction in u[:, singular_values > 0.5].T:
        sentences.append(_name_direction(direction, network.photos, photo_ids, group_ids))
    return sentences


def _name_datum(motions: FloatArray, weak: FloatArray) -> tuple[list[str], FloatArray]:
    """Return sentences on motions of the whole block among the weak directions (u, w), and the other ones."""
    basis, _ = np.linalg.qr(motions)
    u, cosines, _ = np.linalg.svd(weak.T @ basis)
    whole = weak @ u[:, : len(cosines)][:, cosines > _FREE]  # weak directions that move the block as a whole
    if whole.shape[1] == 0:
        return [], weak
    share = np.linalg.norm(whole.T @ motions, axis=0)
    names = [name for name, part in zip(DATUM, share, strict=True) if part > _FREE]
    sentences = []
    if names:
        sentences.append(f"the block as a whole is free in {', '.join(names)}: the control does not hold it")
    named, _ = np.linalg.qr(motions[:, share > _FREE])
    left, sizes, _ = np.linalg.svd(whole - named @ (named.T @ whole), full_matrices=False)
    for direction in left[:, sizes > 0.5].T:
        parts = np.abs(np.linalg.lstsq(motions, direction, rcond=None)[0])
        names = [name for name, part in zip(DATUM, parts, strict=True) if part > _NAMED_SHARE * parts.max()]
        sentences.append(f"the block as a whole is free in one motion, of {' with '.join(names)}")
    return sentences, weak - whole @ (whole.T @ weak)


def _name_direction(direction: FloatArray, photos: int, photo_ids: list[str], group_ids: list[str]) -> str:
    size = np.abs(direction)
    largest = [int(i) for i in np.argsort(-size)[:_NAMED] if size[i] > 0.1 * size.max()]
    names = []
    for i in largest:
        if i < 6 * photos:
            names.append(f"photo {photo_ids[i // 6]} {PARAMETERS[i % 6]}")
        else:
            names.append(f"level of group {group_ids[i - 6 * photos]}")
    return f"not determined, alone or against each other: {', '.join(names)}"


def _datum_motions(network: Network, state: State) -> FloatArray:
    """Return the seven similarity motions of the block (u, 7), in the unknowns of the normal equations."""
    n, axes = network.photos, network.axes
    centre = state.position.mean(axis=0)
    arm = state.position - centre
    local = network.frame.axes(centre)
    motions = np.zeros((6 * n + network.levels, 7))
    # M of a rotated block is M R^T: dM = -M [a]x, solved for the three angles of each photo
    inverse = np.linalg.pinv(state.dM.reshape(n, 3, 9).swapaxes(1, 2))
    for k in range(3):
        a = local[k]
        shift = np.zeros((n, 6))
        shift[:, :3] = axes @ a
        motions[: 6 * n, k] = shift.reshape(-1)
        turn = np.zeros((n, 6))
        turn[:, :3] = np.einsum("nij,nj->ni", axes, np.cross(a, arm))
        cross = np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
        turn[:, 3:] = np.einsum("nij,nj->ni", inverse, -(state.M @ cross).reshape(n, 9))
        motions[: 6 * n, 3 + k] = turn.reshape(-1)
    grow = np.zeros((n, 6))
    grow[:, :3] = np.einsum("nij,nj->ni", axes, arm)
    motions[: 6 * n, 6] = grow.reshape(-1)
    motions[6 * n :, 2] = 1.0
    motions[6 * n :, 6] = state.levels - network.frame.height(centre)
    return motions
