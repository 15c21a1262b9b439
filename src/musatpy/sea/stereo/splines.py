"""Bicubic splines over a grid as linear functions of their coefficients.

The knots are those of the interpolating spline of `refraction.surface.Gridded` (all nodes but the second and the
last but one, "not a knot"), so that the spline of the coefficients and the surface of the node heights are one and
the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray

_DEGREE = 3
_LOCAL = _DEGREE + 1  # splines that are not zero at a place, each way


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Linear functions of the coefficients: which (n, 16), and by what factor (n, 16)."""

    index: IntArray
    factor: FloatArray

    def matrix(self, count: int) -> Any:
        """Return the functions as a sparse matrix (n, count)."""
        from scipy.sparse import csr_array  # heavy

        n, local = self.index.shape
        start = np.arange(0, n * local + 1, local)
        return csr_array((self.factor.reshape(-1), self.index.reshape(-1), start), shape=(n, count))


def rows(x: FloatArray, y: FloatArray, xy: FloatArray, dx: int = 0, dy: int = 0) -> Rows:
    """Return the spline over nodes x (nx,), y (ny,), or its derivatives, at places (n, 2).

    The coefficient of (i, j) has the index i ny + j. Places outside are taken to the edge.
    """
    along, i = _local(x, np.clip(xy[:, 0], x[0], x[-1]), dx)
    across, j = _local(y, np.clip(xy[:, 1], y[0], y[-1]), dy)
    index = (i[:, :, None] * len(y) + j[:, None, :]).reshape(len(xy), -1)
    return Rows(index=index, factor=(along[:, :, None] * across[:, None, :]).reshape(len(xy), -1))


def _local(nodes: FloatArray, at: FloatArray, order: int) -> tuple[FloatArray, IntArray]:
    """Return the splines (n, 4) that are not zero at places (n,), differentiated, and their numbers (n, 4)."""
    from scipy.interpolate import BSpline  # heavy

    knots = np.concatenate([[nodes[0]] * _LOCAL, nodes[2:-2], [nodes[-1]] * _LOCAL])
    last = np.clip(np.searchsorted(knots, at, side="right") - 1, _DEGREE, len(nodes) - 1)
    number = last[:, None] + np.arange(-_DEGREE, 1)
    every = BSpline(knots, np.eye(len(nodes)), _DEGREE)(at, nu=order)
    return np.take_along_axis(every, number, axis=1), number


def node_places(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the nodes (nx ny, 2)."""
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def banded(matrix: Any, width: int) -> FloatArray:
    """Return the lower bands (width + 1, n) of a symmetric sparse matrix, as scipy's banded solvers take them."""
    out = np.zeros((width + 1, matrix.shape[0]))
    for band in range(width + 1):
        out[band, : matrix.shape[0] - band] = matrix.diagonal(-band)
    return out


def bandwidth(ny: int) -> int:
    """Return the bandwidth of normal equations of a grid with ny columns."""
    return _DEGREE * ny + _DEGREE
