"""The triplets of a strip one after the other, each started from the one before it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.geometry.similarity import Similarity
from musatpy.orientation.twomedia.oriented import OrientationError, Oriented, orient
from musatpy.orientation.twomedia.pair import along_axes
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Plane, Sights
from musatpy.orientation.twomedia.triplet import TRIPLET


@dataclass(frozen=True, kw_only=True, eq=False)
class Triplet:
    """Three photos of a strip, `first` and the next two, as a model in axes of its own.

    points (k,) are the rows in the strip of the points that it has, in their order, with their places (k, 3),
    covariances (k, 3, 3) for unit weight and rays (k,); left_out (o,) the rows of its outliers.
    """

    first: int
    oriented: Oriented
    points: IntArray
    place: FloatArray
    covariance: FloatArray
    rays: IntArray
    left_out: IntArray

    def moved(self, move: Similarity) -> Orientation:
        """Return its photos (1,) and the water in other axes."""
        at = self.oriented.at
        normal = move.rotation @ np.append(-at.slope, 1.0)
        normal /= normal[2]
        level = move.scale * at.level / (move.rotation @ np.append(-at.slope, 1.0))[2] + normal @ move.shift
        return Orientation(
            attitude=attitude_from_matrix(move.turn(attitude_matrix(at.attitude)))[None],
            station=move.apply(at.station)[None],
            slope=-normal[None, :2],
            level=np.atleast_1d(level),
            index=np.atleast_1d(at.index),
        )

    def plane(self, move: Similarity) -> FloatArray:
        """Return slopes and level (3,) of the water in other axes."""
        at = self.moved(move)
        return np.append(at.slope[0], at.level[0])


def triplets(sights: Sights, index: float, equal: bool = False) -> Iterator[Triplet]:
    """Yield the triplets of a strip, whose images are sorted by their photos, over water of which nothing is known.

    Raises `OrientationError`.
    """
    begin = np.searchsorted(sights.photo, np.arange(len(sights.photos) + 1))
    near: Orientation | None = None
    for first in range(len(sights.photos) - 2):
        rows = np.arange(begin[first], begin[first + 3])
        count = np.bincount(sights.point[rows], minlength=len(sights.points))
        rows = rows[count[sights.point[rows]] >= 2]
        part, points = _part(sights, rows, first)
        try:
            oriented = orient(part, TRIPLET, Plane(index=index), equal=equal, near=near)
        except OrientationError as error:
            raise type(error)(f"STRIP: photos {', '.join(part.photos)}: {error}") from error
        place = oriented.points
        kept = np.flatnonzero((oriented.rays >= 2) & np.isfinite(place).all(axis=1))
        triplet = Triplet(
            first=first,
            oriented=oriented,
            points=points[kept],
            place=place[kept],
            covariance=oriented.point_covariance()[kept],
            rays=oriented.rays[kept],
            left_out=points[oriented.outliers],
        )
        near = _next(triplet)
        yield triplet


def _part(sights: Sights, rows: IntArray, first: int) -> tuple[Sights, IntArray]:
    """Return images `rows` (n,) of three photos, without control, and the rows of their points in the strip."""
    points, point = np.unique(sights.point[rows], return_inverse=True)
    nothing = np.full((len(points), 3), np.nan)
    part = Sights(
        photos=sights.photos[first : first + 3],
        points=sights.points[points],
        photo=sights.photo[rows] - first,
        point=point,
        image=sights.image[rows],
        image_sigma=sights.image_sigma[rows],
        wet=sights.wet[points],
        control=nothing,
        control_sigma=np.zeros(nothing.shape),
    )
    return part, points


def _next(before: Triplet) -> Orientation:
    """Return the start (1,) of a triplet by the one before it, whose flight goes on as it went."""
    at = before.oriented.at
    base = at.station[2] - at.station[1]
    length = float(np.linalg.norm(base))
    M = attitude_matrix(at.attitude[1])
    turn = along_axes(M @ base / length).T @ M
    three = before.moved(Similarity(scale=1.0 / length, rotation=turn, shift=-turn @ at.station[1] / length))
    new = 2.0 * three.station[:, 2] - three.station[:, 1]
    return replace(
        three,
        attitude=np.concatenate([three.attitude[:, 1:], three.attitude[:, 2:]], axis=1),
        station=np.concatenate([three.station[:, 1:], new[:, None]], axis=1),
    )
