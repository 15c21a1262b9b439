"""The factor of normal equations that differ in a few points from others, whose factor and inverse are known.

With N' = N + U C U', C diagonal, G = N^-1 U and K = (C^-1 + U'G)^-1 (Sherman and Morrison, Woodbury; Hager 1989,
"Updating the inverse of a matrix", equation 2): N'^-1 = N^-1 - G K G'. N' is positive definite, as N is, where
C^-1 + U'G has as many negative eigenvalues as C.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.linalg import eigvalsh

from musatpy.adjustment.normals import Cofactors, Factor
from musatpy.arrays import FloatArray, IntArray

_NOTHING = 1e-12  # eigenvalue of the change, beside the unit diagonal of the scaled matrix
_LEFT = 1e-6  # of what a direction was determined by: with less left of it the digits are lost


@dataclass(frozen=True, kw_only=True, eq=False)
class UpdatedFactor(Factor):
    """The factor of N' by that of N, whose `matrix` it shows."""

    columns: FloatArray  # (u, r) G, scaled
    middle: FloatArray  # (r, r) K

    @classmethod
    def of(cls, factor: Factor, index: IntArray, change: FloatArray) -> UpdatedFactor | None:
        """Return the factor of N plus `change` (s, s) in the rows `index` (s,).

        None where too little of a direction is left.
        """
        assert not isinstance(factor, UpdatedFactor), "changes are told from the same matrix"
        scale = factor.scale[index]
        values, vectors = np.linalg.eigh(change * scale[:, None] * scale)
        some = np.abs(values) > _NOTHING
        values, U = values[some], np.zeros((len(factor.scale), np.count_nonzero(some)))
        U[index] = vectors[:, some]
        columns = factor.solve_scaled(U) if U.size else U
        # |C|^1/2 (C^-1 + U'G) |C|^1/2: its eigenvalues are 1 where nothing else determines these directions
        root = np.sqrt(np.abs(values))
        inner = np.diag(np.sign(values)) + root[:, None] * (U.T @ columns) * root
        inner = 0.5 * (inner + inner.T)
        left = eigvalsh(inner)
        if np.count_nonzero(left < 0.0) != np.count_nonzero(values < 0.0) or (np.abs(left) < _LEFT).any():
            return None
        middle = root[:, None] * np.linalg.inv(inner) * root
        parts = {one.name: getattr(factor, one.name) for one in fields(Factor)}
        return cls(columns=columns, middle=middle, **parts)

    def solve_scaled(self, rhs: FloatArray) -> FloatArray:
        """Return the solutions (u, r) of the scaled system."""
        return super().solve_scaled(rhs) - self.columns @ (self.middle @ (self.columns.T @ rhs))

    def cofactors(self) -> Cofactors:
        """Return the elements of N'^-1 inside the pattern."""
        return self.updated(super().cofactors())

    def cofactors_of(self, photo: IntArray, index: IntArray, partials: FloatArray) -> FloatArray:
        """Return what `Cofactors.cofactors_of` does, without any others."""
        return super().cofactors_of(photo, index, partials) - self.fall_of(photo, index, partials)

    def fall(self, photo: IntArray, index: IntArray) -> FloatArray:
        """Return N^-1 - N'^-1 of what `Cofactors.with_border` takes."""
        return self._fall(self._of(photo, index))

    def fall_of(self, photo: IntArray, index: IntArray, partials: FloatArray) -> FloatArray:
        """Return by how much the cofactors of functions with some partials are smaller than those by N^-1."""
        return self._fall(partials @ self._of(photo, index))

    def _of(self, photo: IntArray, index: IntArray) -> FloatArray:
        """Return the rows (k, m q + X, r) of G of unknowns of photos (k, m) and others (k, X)."""
        rows = np.concatenate([self.matrix.pattern.rows(photo), self.matrix.pattern.order + index], axis=1)
        return np.asarray(self._columns[rows])

    def _fall(self, G: FloatArray) -> FloatArray:
        return np.asarray(G @ self.middle @ np.swapaxes(G, 1, 2))

    def updated(self, cofactors: Cofactors) -> Cofactors:
        """Return the elements of N'^-1 of those of N^-1."""
        pattern, split = cofactors.pattern, len(cofactors.border)
        photo, level = self._columns[:split], self._columns[split:]
        of_photo = photo.reshape(pattern.count, pattern.size, -1)
        by_middle = (photo @ self.middle).reshape(of_photo.shape)
        i, j = pattern.pairs.T
        return replace(
            cofactors,
            blocks=cofactors.blocks - by_middle[i] @ np.swapaxes(of_photo[j], 1, 2),
            border=cofactors.border - photo @ self.middle @ level.T,
            corner=cofactors.corner - level @ self.middle @ level.T,
        )

    @property
    def _columns(self) -> FloatArray:
        return self.columns * self.scale[:, None]
