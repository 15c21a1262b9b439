"""Normal equations of photos and global unknowns: added up point by point, solved, inverted, asked what is free."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from musatpy.adjustment.sparse import Pattern, SparseFactor, factorise, upper_triangle
from musatpy.arrays import FloatArray, IntArray

SINGULAR = 1e-10  # smallest eigenvalue of the scaled matrix: healthy strips have 1e-5, six digits are left here
ILL_DETERMINED = 1e-8  # below which the normals are suspicious enough to say so
PARAMETERS = ("east", "north", "up", "X-tilt", "Y-tilt", "heading", "water level")
_SUBSPACE = 20  # weak directions looked for at once
_FEW = 4  # of them do, in two rounds, where only the smallest eigenvalue is asked for
_SHARE = 1e-3  # of the weakest direction, which four random vectors all stay below by a chance of (8e-4)^4
_ROUNDS = 4  # of inverse iteration: weak eigenvalues stand apart from the others by many powers of ten


@dataclass(frozen=True, kw_only=True, eq=False)
class Bordered:
    """A symmetric matrix of n photos (sparse blocks of q x q) bordered by g global unknowns, which are few."""

    pattern: Pattern
    blocks: FloatArray  # (e, q, q)
    border: FloatArray  # (n q, g)
    corner: FloatArray  # (g, g)

    @property
    def size(self) -> int:
        """Number of unknowns n q + g."""
        return len(self.border) + len(self.corner)

    def diagonal(self) -> FloatArray:
        """Return the diagonal (n q + g,)."""
        of_photos = np.einsum("nii->ni", self.of_single_photos()).reshape(-1)
        return np.concatenate([of_photos, np.diagonal(self.corner)])

    def of_single_photos(self) -> FloatArray:
        """Return the blocks (n, q, q) of every photo."""
        return self.blocks[self.pattern.diagonal]

    def scaled(self, scale: FloatArray) -> Self:
        """Return the matrix with rows and columns multiplied by `scale` (n q + g,)."""
        split = len(self.border)
        photo, level = scale[:split].reshape(self.pattern.count, -1), scale[split:]
        i, j = self.pattern.pairs.T
        blocks = self.blocks * photo[i][:, :, None]
        blocks *= photo[j][:, None, :]
        return replace(
            self,
            blocks=blocks,
            border=self.border * scale[:split, None] * level,
            corner=self.corner * level[:, None] * level,
        )

    def holding(self, held: IntArray) -> Self:
        """Return the matrix with rows and columns of `held` unknowns of photos zero."""
        if not len(held):
            return self
        free = np.ones(self.size)
        free[held] = 0.0
        return self.scaled(free)


@dataclass(frozen=True, kw_only=True, eq=False)
class NormalMatrix(Bordered):
    """The matrix N of normal equations."""

    def damped(self, damping: float) -> NormalMatrix:
        """Return the matrix plus `damping` times the unit matrix."""
        if not damping:
            return self
        blocks = self.blocks.copy()
        blocks[self.pattern.diagonal] += damping * np.eye(blocks.shape[1])
        return replace(self, blocks=blocks, corner=self.corner + damping * np.eye(len(self.corner)))

    def sensible(self) -> bool:
        """Return whether its elements are numbers, those of the diagonal positive: no points that have run away."""
        parts = (self.blocks, self.border, self.corner)
        return all(bool(np.isfinite(part).all()) for part in parts) and bool((self.diagonal() > 0.0).all())

    def times(self, x: FloatArray) -> FloatArray:
        """Return the product with vectors x (n q + g, r)."""
        split, count = len(self.border), self.pattern.count
        photo, level = x[:split].reshape(count, -1, x.shape[1]), x[split:]
        i, j = self.pattern.pairs.T
        out = self.pattern.firsts.sums(self.blocks @ photo[j])
        seconds = self.pattern.seconds
        out[seconds.rows] += seconds.sums(np.swapaxes(self.blocks, 1, 2) @ photo[i])
        top = out.reshape(split, -1) + self.border @ level
        return np.concatenate([top, self.border.T @ x[:split] + self.corner @ level])


@dataclass(frozen=True, kw_only=True, eq=False)
class Sums:
    """Normal equations of points added up by pairs of photos and by photos."""

    pairs: IntArray  # (e,) rows of the pattern
    blocks: FloatArray  # (e, q, q)
    photos: IntArray  # (n,)
    rhs: FloatArray  # (n, q)


def summed(pattern: Pattern, photo: IntArray, blocks: FloatArray, rhs: FloatArray) -> Sums:
    """Return the sums of the normal equations of k points on m photos.

    photo (k, m) ascending, blocks (k, m (m + 1)/2, q, q) as `np.triu_indices(m)` has them, rhs (k, m, q).
    """
    pairs, photos = pattern.runs(photo)
    return Sums(
        pairs=pairs.rows,
        blocks=pairs.sums(blocks.reshape(-1, *blocks.shape[2:])),
        photos=photos.rows,
        rhs=photos.sums(rhs.reshape(-1, rhs.shape[2])),
    )


def upper(matrix: FloatArray) -> FloatArray:
    """Return the blocks (k, m (m + 1)/2, q, q) of the upper triangle of matrices (k, m, q, m, q)."""
    i, j = upper_triangle(matrix.shape[1])
    return np.swapaxes(matrix, 2, 3)[:, i, j]


class NormalEquations:
    """N dx = rhs with q unknowns for each of n photos and g global ones, to be added up."""

    def __init__(self, pattern: Pattern, border: int) -> None:
        self.pattern = pattern
        n, q = pattern.count, pattern.size
        self._blocks = np.zeros((len(pattern.pairs), q, q))
        self._border = np.zeros((n, q, border))
        self._corner = np.zeros((border, border))
        self._rhs = np.zeros((n, q))
        self._border_rhs = np.zeros(border)

    def add_sums(self, sums: Sums) -> None:
        """Add what several points have in sum."""
        self._blocks[sums.pairs] += sums.blocks
        self._rhs[sums.photos] += sums.rhs

    @property
    def sums(self) -> tuple[FloatArray, FloatArray]:
        """The blocks (e, q, q) and the right sides (n, q), for who adds to them by itself."""
        return self._blocks, self._rhs

    def add_rows(self, index: IntArray, partials: FloatArray, weight: FloatArray, residual: FloatArray) -> None:
        """Add r observations of X unknowns each, counted photo by photo, then the global ones: index (r, X)."""
        q, split = self.pattern.size, self._rhs.size
        weighted = partials * weight[:, None]
        rhs, products = -weighted * residual[:, None], weighted[:, :, None] * partials[:, None, :]
        of_photo = index < split
        np.add.at(self._rhs.reshape(-1), index[of_photo], rhs[of_photo])
        np.add.at(self._border_rhs, index[~of_photo] - split, rhs[~of_photo])
        i, j = (
            np.broadcast_to(index[:, :, None], products.shape),
            np.broadcast_to(index[:, None, :], products.shape),
        )
        both = (i < split) & (j < split) & (i // q <= j // q)
        photo = self.pattern.find(i[both] // q, j[both] // q)
        np.add.at(self._blocks, (photo, i[both] % q, j[both] % q), products[both])
        edge, corner = (i < split) & (j >= split), (i >= split) & (j >= split)
        np.add.at(self._border, (i[edge] // q, i[edge] % q, j[edge] - split), products[edge])
        np.add.at(self._corner, (i[corner] - split, j[corner] - split), products[corner])

    def add_border(self, photo: IntArray, index: IntArray, border: FloatArray) -> None:
        """Add photo-global terms of k points: photo (k, m), global index (k, X), border (k, m, q, X)."""
        if (index == index[0]).all():  # lenses, a water level: a sum for each photo is several times as fast
            _, photos = self.pattern.runs(photo)
            sums = photos.sums(border.reshape(-1, *border.shape[2:]))
            for number, column in enumerate(index[0].tolist()):
                self._border[photos.rows, :, column] += sums[..., number]
            return
        _, q, g = self._border.shape
        rows = photo[:, :, None, None] * q + np.arange(q)[:, None]
        np.add.at(self._border.reshape(-1), rows * g + index[:, None, None], border)

    def add_corner(self, index: IntArray, corner: FloatArray, rhs: FloatArray) -> None:
        """Add global terms: index (k, X), corner (k, X, X), rhs (k, X)."""
        if (index == index[0]).all():
            index, corner, rhs = index[:1], corner.sum(axis=0)[None], rhs.sum(axis=0)[None]
        np.add.at(self._corner, (index[:, :, None], index[:, None, :]), corner)
        np.add.at(self._border_rhs, index, rhs)

    def finished(self, held: IntArray | None = None) -> tuple[NormalMatrix, FloatArray]:
        """Return matrix and right side (n q + g,); `held` photo unknowns, and what nothing observes, are zero."""
        n, q, g = self._border.shape
        border = self._border.reshape(n * q, g)
        matrix = NormalMatrix(pattern=self.pattern, blocks=self._blocks, border=border, corner=self._corner)
        rhs = np.concatenate([self._rhs.reshape(-1), self._border_rhs])
        if held is not None:
            matrix = matrix.holding(held)
            rhs[held] = 0.0
        free = np.einsum("nii->ni", matrix.of_single_photos()) == 0.0
        matrix.blocks[self.pattern.diagonal] += free[:, :, None] * np.eye(q)
        np.einsum("ii->i", matrix.corner)[np.diagonal(matrix.corner) == 0.0] = 1.0
        return matrix, rhs


@dataclass(frozen=True, kw_only=True, eq=False)
class Cofactors(Bordered):
    """The elements of N^-1 that points ask for: of photos that meet, of photos and globals, of globals."""

    def of_photos(self, photo: IntArray) -> FloatArray:
        """Return the cofactors (k, m q, m q) of the unknowns of photos (k, m) that meet each other."""
        k, m = photo.shape
        q = self.pattern.size
        i, j = upper_triangle(m)
        first, second = photo[:, i], photo[:, j]
        upper = self.blocks[self.pattern.find(np.minimum(first, second), np.maximum(first, second))]
        turned = first > second
        if turned.any():
            upper[turned] = np.swapaxes(upper[turned], 1, 2)
        out = np.empty((k, m, q, m, q))
        out[:, j, :, i] = np.moveaxis(np.swapaxes(upper, 2, 3), 1, 0)
        out[:, i, :, j] = np.moveaxis(upper, 1, 0)
        return out.reshape(k, m * q, m * q)

    def times(self, factor: float) -> Cofactors:
        """Return the cofactors multiplied by a factor; those of a lost run may be infinite."""
        with np.errstate(invalid="ignore"):
            parts = {name: getattr(self, name) * factor for name in ("blocks", "border", "corner")}
        return replace(self, **parts)

    def between(self, i: IntArray, j: IntArray) -> FloatArray:
        """Return the cofactors (r, X, Y) of unknowns i (r, X) and j (r, Y), counted photo by photo, then the global
        ones; photos of one row meet.
        """
        q, split = self.pattern.size, len(self.border)
        i, j = np.broadcast_arrays(i[:, :, None], j[:, None, :])
        i, j = np.minimum(i, j), np.maximum(i, j)
        out = np.empty(i.shape)
        both, corner = j < split, i >= split
        edge = ~both & ~corner
        out[both] = self.blocks[self.pattern.find(i[both] // q, j[both] // q), i[both] % q, j[both] % q]
        out[edge] = self.border[i[edge], j[edge] - split]
        out[corner] = self.corner[i[corner] - split, j[corner] - split]
        return out

    def with_border(self, photo: IntArray, index: IntArray) -> FloatArray:
        """Return the cofactors (k, m q + X, m q + X) of photos (k, m) and global unknowns (k, X)."""
        k, m = photo.shape
        if not index.shape[1]:
            return self.of_photos(photo)
        split = m * self.pattern.size
        out = np.empty((k, split + index.shape[1], split + index.shape[1]))
        out[:, :split, :split] = self.of_photos(photo)
        rows, g = self.pattern.rows(photo), len(self.corner)  # taken by one number, in half of the time
        out[:, :split, split:] = self.border.take(g * rows[:, :, None] + index[:, None, :])
        out[:, split:, :split] = np.swapaxes(out[:, :split, split:], 1, 2)
        out[:, split:, split:] = self.corner[index[:, :, None], index[:, None, :]]
        return out

    def cofactors_of(self, photo: IntArray, index: IntArray, partials: FloatArray) -> FloatArray:
        """Return the cofactors (k, o, o) of functions with partials (k, o, m q + X) by what `with_border` has.

        Block by block, which takes a fifth of the time of writing them into matrices first.
        """
        (k, m), q, o = photo.shape, self.pattern.size, partials.shape[1]
        split = m * q
        by_stations, by_globals = partials[..., :split], partials[..., split:]
        out = np.zeros((k, o, o))
        for j in range(m):
            first, second = photo[:, : j + 1], photo[:, j, None]
            blocks = self.blocks.take(
                self.pattern.find(np.minimum(first, second), np.maximum(first, second)), axis=0
            )
            turned = first > second
            if turned.any():
                blocks[turned] = np.swapaxes(blocks[turned], 1, 2)
            blocks[:, j] *= 0.5  # the sum is added to its transpose
            of_photo = by_stations[..., : (j + 1) * q] @ blocks.reshape(k, (j + 1) * q, q)
            out += of_photo @ np.swapaxes(by_stations[..., j * q : (j + 1) * q], 1, 2)
        if index.shape[1]:
            rows, g = self.pattern.rows(photo), len(self.corner)  # taken by one number, in half of the time
            border = self.border.take(g * rows[:, :, None] + index[:, None, :])
            corner = 0.5 * self.corner.take(g * index[:, :, None] + index[:, None, :])
            out += (by_stations @ border + by_globals @ corner) @ np.swapaxes(by_globals, 1, 2)
        return out + np.swapaxes(out, 1, 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Factor:
    """Factor of the scaled and bordered normal matrix."""

    matrix: NormalMatrix  # scaled
    scale: FloatArray
    sparse: SparseFactor
    solved_border: FloatArray  # (n q, g) S^-1 U
    corner: tuple[FloatArray, bool]  # factor of C - U' S^-1 U

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Return N^-1 rhs, (u,)."""
        return self.solve_scaled((rhs * self.scale)[:, None])[:, 0] * self.scale

    def solve_scaled(self, rhs: FloatArray) -> FloatArray:
        """Return the solutions (u, r) of the scaled system."""
        split = len(self.solved_border)
        photo = self.sparse.solve(rhs[:split])
        if len(rhs) == split:
            return photo
        level = cho_solve(self.corner, rhs[split:] - self.matrix.border.T @ photo)
        return np.concatenate([photo - self.solved_border @ level, level])

    def is_weak(self, limit: float) -> bool:
        """Return whether the smallest eigenvalue of the scaled matrix is estimated below a limit.

        A random vector has a share of about one in the weakest direction, which N^-1 multiplies by the inverse of
        the eigenvalue: where all of some vectors stay short, it is above the limit but by a chance of 1e-12.
        Otherwise it comes by inverse iteration.
        """
        solved = self.solve_scaled(_start(self, _FEW))
        if limit * np.linalg.norm(solved, axis=0).max() < _SHARE:
            return False
        values, _ = _weakest(self, _FEW, rounds=2)
        return not values[0] >= limit

    def cofactors(self) -> Cofactors:
        """Return the elements of N^-1 inside the pattern."""
        q = self.matrix.pattern.size
        g = len(self.matrix.corner)
        corner = cho_solve(self.corner, np.eye(g)) if g else np.empty((0, 0))  # SciPy before 1.14 solves none of 0
        border = -self.solved_border @ corner
        blocks = self.sparse.selected_inverse()
        if g:
            i, j = self.matrix.pattern.pairs.T
            Y = self.solved_border.reshape(self.matrix.pattern.count, q, g)
            blocks -= border.reshape(Y.shape)[i] @ np.swapaxes(Y[j], 1, 2)
        inverse = Cofactors(pattern=self.matrix.pattern, blocks=blocks, border=border, corner=corner)
        return inverse.scaled(self.scale)


def factorised(matrix: NormalMatrix, damping: float = 0.0) -> Factor | None:
    """Return the factor of N + damping diag(N), or None where it is not positive definite."""
    if not matrix.sensible():
        return None
    scale = 1.0 / np.sqrt(matrix.diagonal())
    scaled = matrix.scaled(scale).damped(damping)
    try:
        sparse = factorise(scaled.pattern, scaled.blocks)
        solved = sparse.solve(scaled.border) if scaled.border.size else scaled.border
        corner = cho_factor(scaled.corner - scaled.border.T @ solved, lower=True)
    except LinAlgError:
        return None
    return Factor(matrix=scaled, scale=scale, sparse=sparse, solved_border=solved, corner=corner)


def weak_directions(matrix: NormalMatrix, limit: float) -> tuple[FloatArray, FloatArray]:
    """Return scale (u,) and orthonormal weak directions (u, w) of the scaled matrix.

    Weak are those whose eigenvalues lie below `limit`, and those as small as the smallest where none does; at most
    twenty are found.
    """
    damping = SINGULAR
    factor = factorised(matrix, damping)
    while factor is None:  # rounding can leave eigenvalues below zero
        damping *= 10.0
        factor = factorised(matrix, damping)
    values, vectors = _weakest(factor, _SUBSPACE, _ROUNDS)
    values = values - damping
    return factor.scale, vectors[:, values < max(limit, 10.0 * values[0])]


def _weakest(factor: Factor, count: int, rounds: int) -> tuple[FloatArray, FloatArray]:
    """Return some smallest eigenvalues, ascending, and vectors of a factorised matrix, by inverse iteration."""
    vectors = _start(factor, count)
    for _ in range(rounds):
        vectors, _ = np.linalg.qr(factor.solve_scaled(vectors))
    values, turn = np.linalg.eigh(vectors.T @ factor.matrix.times(vectors))
    return values, vectors @ turn


def _start(factor: Factor, count: int) -> FloatArray:
    """Return random vectors (u, count), fewer for few unknowns: the same deck must always give the same listing."""
    size = factor.matrix.size
    return np.random.default_rng(0).normal(size=(size, min(count, size)))
