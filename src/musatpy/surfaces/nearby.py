"""A surface as the plane of the points about each place: no triangles, and nothing where points are few."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.surfaces.tin import FEW, INSIDE, SurfaceValues

_THIN = 1e-6  # of the squared extent along: points on a line make no plane


def planes_at(places: FloatArray, xy: FloatArray, z: FloatArray, sigma: FloatArray, radius: float) -> SurfaceValues:
    """Return at places (m, 2) the planes by least squares of points xy (n, 2), z (n,) within a radius, m.

    They are weighted by sigma (n,), where all have one. Three that are not on a line are the fewest,
    and where a plane is worse than a point, all being to one side, there is none.
    """
    from scipy.spatial import KDTree  # it takes long to load

    about: Any = KDTree(xy).query_ball_point(places, radius, return_sorted=True)  # a list of rows for each place
    count = np.array([len(rows) for rows in about], dtype=np.int64)
    place, point = np.repeat(np.arange(len(places)), count), np.concatenate([*about, []]).astype(np.int64)
    offset = (xy[point] - places[place]) / radius
    A = np.column_stack([np.ones(len(point)), offset])
    weight = 1.0 / np.square(sigma[point]) if (sigma > 0.0).all() else np.ones(len(point))
    N, b, plain = np.zeros((len(places), 3, 3)), np.zeros((len(places), 3)), np.zeros((len(places), 3, 3))
    np.add.at(N, place, weight[:, None, None] * A[:, :, None] * A[:, None, :])
    np.add.at(b, place, (weight * z[point])[:, None] * A)
    np.add.at(plain, place, A[:, :, None] * A[:, None, :])
    good = np.flatnonzero((count >= 3) & _spread(plain, count))
    good = good[np.linalg.inv(plain[good])[:, 0, 0] <= 1.0]
    value, gradient = np.full(len(places), np.nan), np.full((len(places), 2), np.nan)
    deviation = np.full(len(places), np.nan)
    Q = np.linalg.inv(N[good])
    x = np.einsum("kij,kj->ki", Q, b[good])
    value[good], gradient[good] = x[:, 0], x[:, 1:] / radius
    deviation[good] = np.sqrt(Q[:, 0, 0]) if (sigma > 0.0).all() else 0.0
    reason = np.full(len(places), FEW)
    reason[good] = INSIDE
    return SurfaceValues(value=value, gradient=gradient, sigma=deviation, reason=reason)


def _spread(N: FloatArray, count: IntArray) -> BoolArray:
    """Return whether points spread across a line, by their sums of squares N (m, 3, 3) about the places."""
    number = np.maximum(count, 1)
    mean = N[:, 0, 1:] / number[:, None]
    scatter = N[:, 1:, 1:] / number[:, None, None] - mean[:, :, None] * mean[:, None, :]
    least, largest = np.linalg.eigvalsh(scatter).T
    return np.asarray(least > _THIN * largest)
