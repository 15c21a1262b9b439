"""Which blocks of photos meet in the normal matrix, and how what points have adds up to them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from musatpy.adjustment.dissection import Elimination
from musatpy.arrays import FloatArray, IntArray, order_of


@dataclass(frozen=True, kw_only=True, eq=False)
class SumsByRow:
    """How values (k, ...) with repeated rows are added up: sorted by row, and summed run by run."""

    order: IntArray  # (k,)
    rows: IntArray  # the different rows, ascending
    start: IntArray  # first of each in the order

    @classmethod
    def of(cls, rows: IntArray) -> SumsByRow:
        """Return the runs of rows (k,)."""
        order = order_of(rows)
        different, start = np.unique(rows[order], return_index=True)
        return cls(order=order, rows=different, start=start)

    def sums(self, values: FloatArray) -> FloatArray:
        """Return the sums of values (k, ...) by row."""
        return np.add.reduceat(values[self.order], self.start, axis=0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pattern:
    """The blocks (i, j), i <= j, of a symmetric matrix of v x v blocks of `size` unknowns, diagonal included."""

    count: int  # v
    size: int
    pairs: IntArray  # (e, 2), ascending by i and j, every (i, i) among them
    place: FloatArray | None = None  # (v, 3) of the blocks, where who meets whom goes by places

    @classmethod
    def of(cls, count: int, size: int, cliques: Iterable[IntArray], place: FloatArray | None = None) -> Pattern:
        """Return the pattern in which the blocks of each row of the arrays `cliques` (k, m) meet one another."""
        keys = [np.arange(count) * (count + 1)]
        for clique in cliques:
            i, j = np.triu_indices(clique.shape[1], 1)
            low, high = np.minimum(clique[:, i], clique[:, j]), np.maximum(clique[:, i], clique[:, j])
            keys.append((low * count + high).reshape(-1))
        key = np.sort(np.concatenate(keys))  # which is several times as fast as the hashing of `np.unique`
        key = key[np.append(True, key[1:] != key[:-1])]
        pairs = np.stack(np.divmod(key, count), axis=1)
        return cls(count=count, size=size, pairs=pairs, place=place)

    @property
    def order(self) -> int:
        """Number of unknowns, rows of the matrix: v times size."""
        return self.count * self.size

    def rows(self, blocks: IntArray) -> IntArray:
        """Return the numbers (k, m size) of the unknowns of blocks (k, m)."""
        rows = blocks[:, :, None] * self.size + np.arange(self.size)
        return rows.reshape(len(blocks), blocks.shape[1] * self.size)

    @cached_property
    def keys(self) -> IntArray:
        """(e,) ascending numbers of the pairs."""
        return self.pairs[:, 0] * self.count + self.pairs[:, 1]

    @cached_property
    def diagonal(self) -> IntArray:
        """(v,) rows of `pairs` of the blocks (i, i)."""
        return self.find(np.arange(self.count), np.arange(self.count))

    def find(self, i: IntArray, j: IntArray) -> IntArray:
        """Return the rows of `pairs` of blocks (i, j), i <= j. Every one must be there."""
        return np.searchsorted(self.keys, i * self.count + j)

    @cached_property
    def firsts(self) -> SumsByRow:
        """How what pairs have adds to their first blocks: all of them, as each meets itself."""
        return SumsByRow.of(self.pairs[:, 0])

    @cached_property
    def seconds(self) -> SumsByRow:
        """How what pairs of two blocks have adds to the second ones; what those of one have is left."""
        apart = np.flatnonzero(self.pairs[:, 0] != self.pairs[:, 1])
        runs = SumsByRow.of(self.pairs[apart, 1])
        return replace(runs, order=apart[runs.order])

    @cached_property
    def _runs(self) -> dict[tuple[int, bytes], tuple[SumsByRow, SumsByRow]]:
        return {}

    def runs(self, photo: IntArray) -> tuple[SumsByRow, SumsByRow]:
        """Return how points with photos (k, m) add to their pairs, in the order of `triu_indices`, and to photos.

        Every iteration adds the same points again: what was sorted once is kept.
        """
        key = (photo.shape[1], photo.tobytes())
        if key not in self._runs:
            i, j = np.triu_indices(photo.shape[1])
            pairs = self.find(photo[:, i], photo[:, j]).reshape(-1)
            self._runs[key] = (SumsByRow.of(pairs), SumsByRow.of(photo.reshape(-1)))
        return self._runs[key]

    @cached_property
    def elimination(self) -> Elimination:
        """The order of elimination of the unknowns, and its fronts."""
        return Elimination.of(self.count, self.size, self.pairs, self.place)
