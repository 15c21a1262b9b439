"""What the errors of two stations, of the water and of pointing do to what is compiled of them."""

from __future__ import annotations

import numpy as np

from musatpy.adjustment.iteration import LEVEL
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.propagation import Piece
from musatpy.adjustment.sparse import Pattern
from musatpy.arrays import FloatArray
from musatpy.compilation.triangulation import Triangulation


def joint_covariances(run: Triangulation, network: Network) -> Cofactors:
    """Return the covariances of stations and water in the pattern of a network."""
    return covariances_in(run, network.pattern, network.border.size)


def covariances_in(run: Triangulation, pattern: Pattern, size: int) -> Cofactors:
    """Return the covariances of stations that meet in a pattern, and of `size` quantities of the water."""
    q = pattern.size
    blocks = np.zeros((len(pattern.pairs), q, q))
    blocks[pattern.diagonal, :6, :6] = run.covariance
    place = {pair: row for row, pair in enumerate(map(tuple, pattern.pairs.tolist()))}
    for pair, covariance in zip(map(tuple, run.pairs.photo.tolist()), run.pairs.covariance, strict=True):
        if pair in place:
            blocks[place[pair], :6, :6] = covariance
    if run.levels is not None and q > LEVEL:
        levels = run.levels
        known = [(place[pair], row) for row, pair in enumerate(map(tuple, levels.photo.tolist())) if pair in place]
        at, row = np.array(known, dtype=np.int64).reshape(-1, 2).T
        blocks[at, :6, LEVEL], blocks[at, LEVEL, :6] = levels.of_first[row], levels.of_second[row]
        blocks[at, LEVEL, LEVEL] = levels.level[row]
    border, corner = np.zeros((pattern.count, q, size)), np.zeros((size, size))
    if run.water is not None:
        border[:, :6], corner[:] = run.water.stations, run.water.covariance
        if q > LEVEL and len(run.water.levels):
            border[:, LEVEL] = run.water.levels
    return Cofactors(pattern=pattern, blocks=blocks, border=border.reshape(pattern.order, size), corner=corner)


def y_parallax(network: Network, piece: Piece) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return how far right images (k,) mm are off the rays of left ones, sigmas, and the share of pointing in them.

    The four image coordinates of a point have one condition a'dl = 0 with a'B = 0, B their partials by the point:
    the right image is off its epipolar curve by a'(read - adjusted) over the length of its part of a, positive
    along y.
    """
    N, E = piece.E.normals, piece.E
    k, m = piece.group.rays.shape
    a = _left_null(N.B.reshape(k, 2 * m, 3)).reshape(k, m, 2)
    right = int(np.argmax(piece.group.rays[0])) if k else 1  # those of the left photo come first
    size = np.linalg.norm(a[:, right], axis=1) * np.where(a[:, right, 1] < 0.0, -1.0, 1.0)
    a /= size[:, None, None]
    off = -np.einsum("kma,kma->k", a, N.residual)
    by_station = np.einsum("kma,kmaq->kmq", a, N.images.by_station).reshape(k, -1)
    J = np.concatenate([by_station, np.einsum("kma,kmax->kx", a, E.extras.images)], axis=1)
    variance = np.einsum("ki,kij,kj->k", J, piece.Q, J)
    pointing = np.einsum("kma,kma->k", np.square(a), 1.0 / network.weight[piece.group.rays])
    variance += pointing
    return off, np.sqrt(variance), pointing / variance


def _left_null(B: FloatArray) -> FloatArray:
    """Return the rows a (k, 4) with a'B = 0 of matrices B (k, 4, 3): their cofactors."""
    rows = np.arange(4)
    minors = [np.linalg.det(B[:, rows != row]) for row in rows]
    return np.stack([minor if row % 2 == 0 else -minor for row, minor in enumerate(minors)], axis=1)
