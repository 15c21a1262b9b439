"""A sea as heights on a grid, bicubic between: least squares with its curvature observed as zero.

Coefficients of bicubic splines are estimated from the heights of the points, and, at every node, from s_xx, s_yy
and sqrt(2) s_xy observed as 0 with a sigma: the curvature that the sea has by nature, in 1/m. It is given, or found
as the one under which the heights are most likely (restricted maximum likelihood).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.refraction.surface import Gridded
from musatpy.sea.stereo.spectrum import mean_spacing
from musatpy.sea.stereo.surface_points import SurfacePoints

_DEGREE = 3
_LOCAL = _DEGREE + 1  # splines that are not zero at a place, each way


@dataclass(frozen=True, kw_only=True, eq=False)
class SplineRows:
    """Linear functions of the coefficients: which (n, 16), and by what factor (n, 16)."""

    index: IntArray
    factor: FloatArray

    def matrix(self, count: int) -> Any:
        """Return the functions as a sparse matrix (n, count)."""
        from scipy.sparse import csr_array  # heavy

        n, local = self.index.shape
        start = np.arange(0, n * local + 1, local)
        return csr_array((self.factor.reshape(-1), self.index.reshape(-1), start), shape=(n, count))


def rows(x: FloatArray, y: FloatArray, xy: FloatArray, dx: int = 0, dy: int = 0) -> SplineRows:
    """Return the spline over nodes x (nx,), y (ny,), or its derivatives, at places (n, 2).

    The coefficient of (i, j) has the index i ny + j. Places outside are taken to the edge.
    """
    along, i = _local(x, np.clip(xy[:, 0], x[0], x[-1]), dx)
    across, j = _local(y, np.clip(xy[:, 1], y[0], y[-1]), dy)
    index = (i[:, :, None] * len(y) + j[:, None, :]).reshape(len(xy), -1)
    return SplineRows(index=index, factor=(along[:, :, None] * across[:, None, :]).reshape(len(xy), -1))


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


MOST_NODES = 3000  # their covariance is a full matrix
_BRIDGED = 4  # neighbours with points, of eight, among which a cell without any is interpolated; 3 is the outside
_FREE = 3  # a plane has no curvature
_WEIGHT_PASSES = 2
_SIGMAS = (-4.0, 1.0)  # decades of curvature that are searched, as parts of that of a wave of one spacing


@dataclass(frozen=True, kw_only=True, eq=False)
class EndlessGrid(Gridded):
    """A gridded surface that answers everywhere: where it is known is asked of its `GridSurface`."""

    def covers(self, xy: FloatArray, time: ArrayLike = 0.0) -> BoolArray:
        """Tell of every place (...) that it is known."""
        return np.ones(xy.shape[:-1], dtype=bool)


def _cell(nodes: FloatArray, at: FloatArray) -> IntArray:
    return np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, len(nodes) - 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class GridSurface:
    """Heights over nodes x (nx,), y (ny,) m about `origin` (2,) m of the job.

    coefficients (nx ny,) of the splines; normal (width + 1, nx ny) the lower bands of their inverse covariance;
    known (nx - 1, ny - 1) the cells that have points, or are surrounded by such; curvature (1/m) its sigma.
    """

    origin: FloatArray
    x: FloatArray
    y: FloatArray
    coefficients: FloatArray
    normal: FloatArray
    known: BoolArray
    curvature: float

    @property
    def level(self) -> float:
        """Mean height of the nodes, m."""
        return float(self.surface.height.mean())

    @cached_property
    def surface(self) -> EndlessGrid:
        """The surface, about the origin."""
        nodes = rows(self.x, self.y, node_places(self.x, self.y))
        height = np.sum(nodes.factor * self.coefficients[nodes.index], axis=1)
        return EndlessGrid(x=self.x, y=self.y, height=height.reshape(len(self.x), len(self.y)))

    @cached_property
    def covariance(self) -> FloatArray:
        """(nx ny, nx ny) m2 the covariance of the coefficients."""
        from scipy.linalg import cho_solve_banded, cholesky_banded  # heavy

        factor = cholesky_banded(self.normal, lower=True)
        return cho_solve_banded((factor, True), np.eye(len(self.coefficients)))

    def covers(self, xy: FloatArray) -> BoolArray:
        """Tell which places (..., 2) m about the origin lie in cells that are known."""
        i, j = (_cell(nodes, xy[..., axis]) for axis, nodes in enumerate((self.x, self.y)))
        inside = [(xy[..., k] >= n[0]) & (xy[..., k] <= n[-1]) for k, n in enumerate((self.x, self.y))]
        return inside[0] & inside[1] & self.known[i, j]

    def shape_covariance(self, xy: FloatArray) -> FloatArray:
        """Return (n, 3k, 3k) the joint covariance of height and gradient at places (n, k, 2) m about the origin."""
        n, k, _ = xy.shape
        kinds = [rows(self.x, self.y, xy.reshape(-1, 2), *order) for order in ((0, 0), (1, 0), (0, 1))]
        index = kinds[0].index.reshape(n, k, -1)  # of the coefficients that count
        design = np.stack([kind.factor for kind in kinds], axis=1).reshape(n, k, 3, -1)
        out = np.empty((n, k, 3, k, 3))
        for i in range(k):
            for j in range(k):
                C = self.covariance[index[:, i, :, None], index[:, j, None, :]]
                out[:, i, :, j, :] = design[:, i] @ C @ np.swapaxes(design[:, j], 1, 2)
        return out.reshape(n, 3 * k, 3 * k)


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """The nodes of a grid over points, about an origin; curvature (1/m) where it is given."""

    x: FloatArray
    y: FloatArray
    curvature: float | None = None

    @property
    def spacing(self) -> float:
        """Between nodes, the smaller one of both ways, m."""
        return min(float(self.x[1] - self.x[0]), float(self.y[1] - self.y[0]))

    @property
    def count(self) -> int:
        """How many nodes there are."""
        return len(self.x) * len(self.y)

    @cached_property
    def stiffness(self) -> FloatArray:
        """Lower bands of the normals of the observations of curvature, their sigma 1."""
        nodes = node_places(self.x, self.y)
        total: Any = 0.0
        for order, times in (((2, 0), 1.0), ((0, 2), 1.0), ((1, 1), 2.0)):
            matrix = rows(self.x, self.y, nodes, *order).matrix(self.count)
            total = total + times * (matrix.T @ matrix)
        return banded(total.tocsr(), bandwidth(len(self.y)))


def mesh(xy: FloatArray, spacing: float | None = None, curvature: float | None = None) -> Mesh:
    """Return a grid over places (n, 2), by default so wide that one point falls on a cell on the average.

    Raises `ValueError` where it has too many nodes.
    """
    wide = mean_spacing(xy) if spacing is None else spacing
    low, extent = xy.min(axis=0), np.ptp(xy, axis=0)
    count = np.maximum(3, np.ceil(extent / wide - 1e-9).astype(int))
    if np.prod(count + 1.0) > MOST_NODES:
        raise ValueError(f"a grid of {count[0] + 1} by {count[1] + 1} nodes: at most {MOST_NODES} are estimated")
    start = low - (count * wide - extent) / 2.0
    x, y = (start[axis] + wide * np.arange(count[axis] + 1) for axis in (0, 1))
    return Mesh(x=x, y=y, curvature=curvature)


def cell_counts(grid: Mesh, xy: FloatArray) -> IntArray:
    """Return (nx - 1, ny - 1) how many of the places (n, 2) lie in each cell."""
    out = np.zeros((len(grid.x) - 1, len(grid.y) - 1), dtype=np.int64)
    np.add.at(out, (_cell(grid.x, xy[:, 0]), _cell(grid.y, xy[:, 1])), 1)
    return out


def known_cells(grid: Mesh, xy: FloatArray) -> BoolArray:
    """Return the cells (nx - 1, ny - 1) with points (n, 2), and those that are surrounded: by 4 of 8 neighbours."""
    from scipy.ndimage import convolve  # heavy

    filled = cell_counts(grid, xy) > 0
    around = convolve(filled.astype(int), np.ones((3, 3), dtype=int), mode="constant")
    return filled | (around >= _BRIDGED)


def estimate(points: SurfacePoints, origin: FloatArray, grid: Mesh) -> GridSurface:
    """Return the surface of least squares over a grid, with its covariance by sigmas given."""
    xy, z = points.position[:, :2] - origin, points.position[:, 2]
    at, level = rows(grid.x, grid.y, xy), float(np.mean(z))
    slopes = [rows(grid.x, grid.y, xy, *order) for order in ((1, 0), (0, 1))]
    gradient = np.zeros((len(z), 2))
    for _ in range(_WEIGHT_PASSES):
        weight = 1.0 / points.height_variance(gradient)
        matrix, above = at.matrix(grid.count), z - level  # about a level, lest large heights lose digits
        weighted = matrix.multiply(weight[:, None]).tocsr()
        bands, right = banded((matrix.T @ weighted).tocsr(), bandwidth(len(grid.y))), np.asarray(weighted.T @ above)
        solve = partial(_solved, grid, bands, right, float(weight @ np.square(above)))
        curvature = _likeliest(solve, grid.spacing) if grid.curvature is None else grid.curvature
        c, N, _ = solve(curvature)
        gradient = np.column_stack([np.sum(slope.factor * c[slope.index], axis=1) for slope in slopes])
    return GridSurface(
        origin=origin,
        x=grid.x,
        y=grid.y,
        coefficients=c + level,  # splines add up to one
        normal=N,
        known=known_cells(grid, xy),
        curvature=curvature,
    )


def _solved(
    grid: Mesh, bands: FloatArray, right: FloatArray, total: float, curvature: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return the coefficients, the normals with curvature, and -2 log likelihood but for a constant.

    From the normals of the heights alone, in bands, their right side, and the sum of squares of the heights.
    """
    from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded  # heavy

    N = bands + grid.stiffness / curvature**2
    try:
        factor = cholesky_banded(N, lower=True)
    except LinAlgError:
        return np.zeros(grid.count), N, np.inf
    c = cho_solve_banded((factor, True), right)
    logs = 2.0 * float(np.sum(np.log(factor[0]))) + 2.0 * (grid.count - _FREE) * np.log(curvature)
    return c, N, total - float(right @ c) + logs


def _likeliest(solve: Callable[[float], tuple[FloatArray, FloatArray, float]], spacing: float) -> float:
    """Return the sigma of curvature under which the heights are most likely."""
    from scipy.optimize import minimize_scalar  # heavy

    def minus_log(decade: float) -> float:
        return solve(10.0**decade)[2]

    # a wave of one spacing, a thousandth of it high, has a curvature of the order of its inverse
    coarse = np.arange(_SIGMAS[0], _SIGMAS[1] + 0.1, 0.5) - np.log10(spacing)
    best = int(np.argmin([minus_log(decade) for decade in coarse]))
    low, high = coarse[max(best - 1, 0)], coarse[min(best + 1, len(coarse) - 1)]
    minimum = minimize_scalar(minus_log, bounds=(low, high), method="bounded", options={"xatol": 0.01})
    return float(10.0**minimum.x)
