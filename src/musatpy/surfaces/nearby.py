"""A surface as the plane of the points about each place: no triangles, and nothing where points are few."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.surfaces.tin import FEW, INSIDE, SurfaceValues

_PAIRS = 1_000_000  # of places and points that are in memory at a time
_THIN = 1e-6  # of the squared extent along: points on a line make no plane


def planes_at(places: FloatArray, xy: FloatArray, z: FloatArray, sigma: FloatArray, radius: float) -> SurfaceValues:
    """Return at places (m, 2) the planes by least squares of points xy (n, 2), z (n,) within a radius, m.

    They are weighted by sigma (n,), where all have one. Three that are not on a line are the fewest,
    and where a plane is worse than a point, all being to one side, there is none.
    """
    from scipy.spatial import KDTree  # it takes long to load

    tree = KDTree(xy)
    pairs = np.cumsum(tree.query_ball_point(places, radius, return_length=True))
    blocks = np.split(places, np.flatnonzero(np.diff(pairs // _PAIRS)) + 1)
    parts = [_planes(block, tree.query_ball_point(block, radius), (xy, z, sigma), radius) for block in blocks]
    columns = zip(*((part.value, part.gradient, part.sigma, part.reason) for part in parts), strict=True)
    value, gradient, deviation, reason = (np.concatenate(column) for column in columns)
    return SurfaceValues(value=value, gradient=gradient, sigma=deviation, reason=reason)


def _planes(places: FloatArray, rows: Any, points: tuple[FloatArray, ...], radius: float) -> SurfaceValues:
    """Return the planes at places (m, 2) of their `rows` (m lists) of points."""
    xy, z, sigma = points
    count = np.array([len(near) for near in rows], dtype=np.int64)
    place, point = np.repeat(np.arange(len(places)), count), np.concatenate([*rows, []]).astype(np.int64)
    A = np.column_stack([np.ones(len(point)), (xy[point] - places[place]) / radius])
    weighted = bool((sigma > 0.0).all())
    weight = 1.0 / np.square(sigma[point]) if weighted else np.ones(len(point))
    N, plain, b = np.zeros((len(places), 3, 3)), np.zeros((len(places), 3, 3)), np.zeros((len(places), 3))
    np.add.at(N, place, weight[:, None, None] * A[:, :, None] * A[:, None, :])
    np.add.at(plain, place, A[:, :, None] * A[:, None, :])
    np.add.at(b, place, (weight * z[point])[:, None] * A)
    good = np.flatnonzero((count >= 3) & _spread(plain, count))
    good = good[np.linalg.inv(plain[good])[:, 0, 0] <= 1.0]
    value, gradient = np.full(len(places), np.nan), np.full((len(places), 2), np.nan)
    deviation, reason = np.full(len(places), np.nan), np.full(len(places), FEW)
    Q = np.linalg.inv(N[good])
    x = np.einsum("kij,kj->ki", Q, b[good])
    value[good], gradient[good], reason[good] = x[:, 0], x[:, 1:] / radius, INSIDE
    deviation[good] = np.sqrt(Q[:, 0, 0]) if weighted else 0.0
    return SurfaceValues(value=value, gradient=gradient, sigma=deviation, reason=reason)


def _spread(N: FloatArray, count: IntArray) -> BoolArray:
    """Return whether points spread across a line, by their sums of squares N (m, 3, 3) about the places."""
    number = np.maximum(count, 1)
    mean = N[:, 0, 1:] / number[:, None]
    scatter = N[:, 1:, 1:] / number[:, None, None] - mean[:, :, None] * mean[:, None, :]
    least, largest = np.linalg.eigvalsh(scatter).T
    return np.asarray(least > _THIN * largest)
