"""TRIPLET: three photos at once, by the intersections of their rays and one scale.

Okamoto and Mori (1974), (31) to (33) and (46): five points on all three photos, or more on two. The model stands
in the axes of the first base, whose length is given, with omega of photo 1 at 0.
"""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.orientation.relative import model_points
from musatpy.orientation.resection import resections
from musatpy.orientation.twomedia.conditions import intersection, triple
from musatpy.orientation.twomedia.helmert import Group
from musatpy.orientation.twomedia.pair import PAIR_INDEPENDENT, independent_starts
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Method, Plane, Sights

_LEAST_ERROR = 1e-7  # of an image (tangent)
_SHARED = 4  # points of the resection of photo 3: three, and one that tells its solutions apart


def starts(sights: Sights, plane: Plane, base: float) -> Orientation:
    """Return starts (s,): the pair of photos 1 and 2 for air, and photo 3 by resection from its apparent points."""
    pair = independent_starts(sights, plane, base)
    _, images = sights.common((0, 1, 2))
    models = pair.attitude.reshape(len(pair.level), -1)
    _, first, model = np.unique(models, axis=0, return_index=True, return_inverse=True)
    attitude, station = (values[model] for values in _resected(pair[first], images))
    kept = np.isfinite(station).all(axis=1)
    return Orientation(
        attitude=np.concatenate([pair.attitude, attitude[:, None]], axis=1)[kept],
        station=np.concatenate([pair.station, station[:, None]], axis=1)[kept],
        slope=pair.slope[kept],
        level=pair.level[kept],
        index=pair.index[kept],
    )


def _resected(pair: Orientation, images: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return attitudes and stations (s, 3) of photo 3 in models (s,) of photos 1 and 2, NaN without a solution.

    images (3, k, 2) of the points.
    """
    M = attitude_matrix(pair.attitude)
    first, second = M[:, 0], M[:, 1]
    base = first @ (pair.station[:, 1] - pair.station[:, 0])[..., None]
    X, _ = model_points(images[:1], images[1:2], second @ np.swapaxes(first, 1, 2), base[..., 0])
    places = X @ first + pair.station[:, :1]
    attitude, station = np.full((2, len(M), 3), np.nan)
    for row, straight in enumerate(resections(images[2], places, first[:, 2], _LEAST_ERROR)):
        if straight is not None:
            attitude[row], station[row] = attitude_from_matrix(straight.M), straight.C
    return attitude, station


def groups(sights: Sights) -> tuple[Group, ...]:
    """Return two coplanarities and one scale of points on three photos, one coplanarity of those on two."""
    rows = sights.rows((0, 1, 2))
    seen = rows >= 0
    cases = [(triple, (0, 1, 2))] + [(intersection, pair) for pair in ((0, 1), (1, 2), (0, 2))]
    parts = []
    for condition, photos in cases:
        points = seen[:, photos].all(axis=1) & (seen.sum(axis=1) == len(photos))
        if points.any():
            parts.append(Group(condition=condition, photos=photos, images=rows[points][:, photos]))
    return tuple(parts)


def _coplanarities(sights: Sights) -> tuple[Group, ...]:
    """Return the coplanarities alone: the scale is none until the rays nearly meet."""
    rows = sights.rows((0, 1, 2))
    pairs = ((0, 1), (1, 2), (0, 2))
    points = [np.flatnonzero((rows[:, pair] >= 0).all(axis=1)) for pair in pairs]
    return tuple(
        Group(condition=intersection, photos=pair, images=rows[common][:, pair])
        for pair, common in zip(pairs, points, strict=True)
        if len(common)
    )


TRIPLET = Method(
    name="TRIPLET",
    photos=3,
    groups=groups,
    approach=_coplanarities,
    unknown=PAIR_INDEPENDENT.unknown + (True,) * 6,
    starts=starts,
    shared=_SHARED,
)
