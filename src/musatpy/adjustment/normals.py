"""Normal equations of stations and levels: added up point by point, solved, inverted, and asked what is free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpocon

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SINGULAR = 1e-12  # reciprocal condition of the scaled matrix: healthy strips have 1e-5, four digits are left here
ILL_DETERMINED = 1e-9  # below which the normals are suspicious enough to say so
PARAMETERS = ("east", "north", "up", "X-tilt", "Y-tilt", "heading")


class NormalEquations:
    """N dx = rhs with six unknowns for each of n photos and one for each of g levels.

    Kept as (n, n) blocks of 6 x 6 and a border for the levels, so that another store can take its place.
    """

    def __init__(self, photos: int, levels: int) -> None:
        self.photos, self.levels = photos, levels
        self._blocks = np.zeros((photos, photos, 6, 6))
        self._border = np.zeros((photos, 6, levels))
        self._corner = np.zeros((levels, levels))
        self._rhs = np.zeros((photos, 6))
        self._level_rhs = np.zeros(levels)

    def add(self, photo: IntArray, matrix: FloatArray, rhs: FloatArray) -> None:
        """Add those of k points on m photos: photo (k, m), matrix (k, m, 6, m, 6), rhs (k, m, 6)."""
        n = self.photos
        key = (photo[:, :, None] * n + photo[:, None, :]).reshape(-1)
        order = np.argsort(key, kind="stable")
        pairs, start = np.unique(key[order], return_index=True)
        blocks = np.swapaxes(matrix, 2, 3).reshape(-1, 6, 6)
        self._blocks.reshape(n * n, 6, 6)[pairs] += np.add.reduceat(blocks[order], start, axis=0)
        np.add.at(self._rhs, photo.reshape(-1), rhs.reshape(-1, 6))

    def add_diagonal(self, weight: FloatArray, rhs: FloatArray) -> None:
        """Add direct observations of the station unknowns: weight and rhs (n, 6)."""
        index = np.arange(self.photos)
        self._blocks[index, index] += weight[:, :, None] * np.eye(6)
        self._rhs += rhs

    def add_levels(self, level: IntArray, weight: FloatArray, rhs: FloatArray) -> None:
        """Add the contributions (k,) of points to their own levels `level` (k,)."""
        np.add.at(self._corner, (level, level), weight)
        np.add.at(self._level_rhs, level, rhs)

    def add_border(self, photo: IntArray, level: IntArray, matrix: FloatArray) -> None:
        """Add station-level terms: photo (k, m), level (k,), matrix (k, m, 6)."""
        columns = np.broadcast_to(level[:, None], photo.shape)
        border = np.moveaxis(self._border, 2, 1)  # (n, g, 6), a view
        np.add.at(border, (photo.reshape(-1), columns.reshape(-1)), matrix.reshape(-1, 6))

    def dense(self) -> tuple[FloatArray, FloatArray]:
        """Return matrix (6n + g, 6n + g) and right side; unknowns that nothing observes are held at zero."""
        n, g = self.photos, self.levels
        matrix = np.empty((6 * n + g, 6 * n + g))
        matrix[: 6 * n, : 6 * n] = self._blocks.transpose(0, 2, 1, 3).reshape(6 * n, 6 * n)
        matrix[: 6 * n, 6 * n :] = self._border.reshape(6 * n, g)
        matrix[6 * n :, : 6 * n] = self._border.reshape(6 * n, g).T
        matrix[6 * n :, 6 * n :] = self._corner
        diagonal = np.einsum("ii->i", matrix)
        diagonal[diagonal == 0.0] = 1.0
        return matrix, np.concatenate([self._rhs.reshape(-1), self._level_rhs])

    def unobserved_photos(self) -> IntArray:
        """Return the photos none of whose unknowns is observed by anything."""
        index = np.arange(self.photos)
        trace = np.einsum("nii->n", self._blocks[index, index])
        return np.flatnonzero(trace == 0.0)


@dataclass(frozen=True, kw_only=True)
class Factor:
    """Cholesky factor of the scaled normal matrix, and how well it is conditioned."""

    factor: tuple[FloatArray, bool]
    scale: FloatArray
    reciprocal_condition: float

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Return N^-1 rhs."""
        return np.asarray(cho_solve(self.factor, rhs * self.scale) * self.scale)

    def inverse(self) -> FloatArray:
        """Return N^-1, whole."""
        inverse = cho_solve(self.factor, np.diag(self.scale), check_finite=False)
        return np.asarray(self.scale[:, None] * inverse)


def factorise(matrix: FloatArray, damping: float = 0.0) -> Factor | None:
    """Return the factor of N + damping diag(N), or None where it is not positive definite."""
    scale = 1.0 / np.sqrt(np.diagonal(matrix))
    scaled = matrix * scale * scale[:, None]
    np.einsum("ii->i", scaled)[:] = 1.0 + damping
    norm = float(np.abs(scaled).sum(axis=0).max())
    try:
        factor = cho_factor(scaled, lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        return None
    condition, _ = dpocon(factor[0], norm, uplo="L")
    return Factor(factor=factor, scale=scale, reciprocal_condition=float(condition))


def weak_directions(matrix: FloatArray, limit: float) -> tuple[FloatArray, FloatArray]:
    """Return scale (u,) and the eigenvectors (u, w) of the weak eigenvalues of the scaled matrix.

    Weak are those below `limit` of the largest, and those as small as the smallest where none is.
    """
    scale = 1.0 / np.sqrt(np.diagonal(matrix))
    values, vectors = np.linalg.eigh(matrix * scale * scale[:, None])
    return scale, vectors[:, values < max(limit * values[-1], 10.0 * values[0])]
