"""Film deformation by a reseau: bilinear in each cell between four crosses.

In a cell with corners P_k, k = 1..4, a point has the coordinates s, t of

    P(s, t) = (1-s)(1-t) P_1 + s (1-t) P_2 + (1-s) t P_3 + s t P_4 = sum N_k(s, t) P_k

found in the measured cell by Newton's method and used in the calibrated one. So the crosses go to their calibrated
places exactly, and neighbouring cells agree along their common side.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.reduction.planar import inverse, solve

_STEPS = 20
_EDGE = 1e-9  # of a cell: a point on the border of the grid lies inside
_FOUND = 1e-9  # mm: where the iteration has not come so near, the cell has no such point


@dataclass(frozen=True, kw_only=True, eq=False)
class Reseau:
    """The crosses of one plate: r rows and c columns of them, at least two; NaN where a cross was not measured."""

    calibrated: FloatArray  # (r, c, 2) mm
    measured: FloatArray  # (r, c, 2) mm

    def __post_init__(self) -> None:
        if self.calibrated.shape != self.measured.shape or min(self.calibrated.shape[:2]) < 2:
            raise ValueError("a reseau has at least two rows and columns of crosses, calibrated as measured")
        if not len(self._cells):
            raise ValueError("no cell of the reseau has its four crosses measured")

    @cached_property
    def _cells(self) -> IntArray:
        """Corners (n, 4) of the cells whose crosses were all measured, as rows of the flattened grid."""
        rows, columns = self.calibrated.shape[:2]
        first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1)
        cells = first[:, None] + np.array([0, 1, columns, columns + 1])
        known = np.isfinite(self.measured + self.calibrated).all(axis=-1).reshape(-1)
        return cells[known[cells].all(axis=1)]

    def apply(self, xy: FloatArray) -> FloatArray:
        """Return points (m, 2) mm freed from the deformation of the film."""
        corners, st, _ = self._located(xy)
        return _place(self.calibrated.reshape(-1, 2)[corners], st)

    def inside(self, xy: FloatArray) -> BoolArray:
        """Return whether points (m, 2) lie within cells with all their crosses; others follow the nearest cell."""
        return self._located(xy)[2]

    def partials(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (m, 2, 2) of the moved points by the points; at a side, of one of its cells."""
        corners, st, _ = self._located(xy)
        by_st = [_by_st(grid.reshape(-1, 2)[corners], st) for grid in (self.calibrated, self.measured)]
        return by_st[0] @ inverse(by_st[1])

    def _located(self, xy: FloatArray) -> tuple[IntArray, FloatArray, BoolArray]:
        """Return where points (m, 2) lie among the measured crosses: corners (m, 4) of cells, rows of the flattened
        grid, s and t (m, 2) there, and whether (m,) they are inside.

        Beyond the grid, and in a cell with a cross missing, the nearest cell serves: the one that a point leaves by
        the least part of its side.
        """
        corner = self.measured.reshape(-1, 2)[self._cells]  # (n, 4, 2)
        st = _inverse_bilinear(xy[:, None, :], corner[None])  # (m, n, 2)
        excess = np.maximum(np.abs(st - 0.5).max(axis=-1) - 0.5, 0.0)
        excess = np.where(np.isfinite(excess), excess, np.inf)
        best, point = excess.argmin(axis=1), np.arange(len(xy))
        return self._cells[best], st[point, best], excess[point, best] <= _EDGE

    def deformation(self) -> FloatArray:
        """Return calibrated minus measured crosses (r, c, 2), mm."""
        return self.calibrated - self.measured


def _by_st(corner: FloatArray, st: FloatArray) -> FloatArray:
    """Return dP/d(s, t), (..., 2, 2)."""
    s, t = st[..., :1], st[..., 1:]
    P1, P2, P3, P4 = (corner[..., k, :] for k in range(4))
    return np.stack([(1 - t) * (P2 - P1) + t * (P4 - P3), (1 - s) * (P3 - P1) + s * (P4 - P2)], axis=-1)


def _place(corner: FloatArray, st: FloatArray) -> FloatArray:
    s, t = st[..., 0], st[..., 1]
    shape = np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], axis=-1)  # N_k(s, t)
    return np.einsum("...k,...ki->...i", shape, corner)


def _inverse_bilinear(xy: FloatArray, corner: FloatArray) -> FloatArray:
    """Return (s, t) of points in cells, broadcast; NaN where a cell has none."""
    st = np.full(np.broadcast_shapes(xy.shape, (*corner.shape[:-2], 2)), 0.5)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for _ in range(_STEPS):
            step = solve(_by_st(corner, st), xy - _place(corner, st))
            st = st + step
            if not np.nanmax(np.abs(step), initial=0.0) > 1e-13 * max(1.0, np.nanmax(np.abs(st), initial=0.0)):
                break
        settled = np.abs(xy - _place(corner, st)).max(axis=-1, keepdims=True) < _FOUND
    return np.where(settled, st, np.nan)
