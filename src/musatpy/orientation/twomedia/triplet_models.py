"""What an oriented triplet says of a strip: its quantities, and what errors of its images do to them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry.similarity import Similarity
from musatpy.orientation.twomedia.moved import Moved, moved_attitudes, moved_places, moved_planes
from musatpy.orientation.twomedia.oriented import Oriented
from musatpy.orientation.twomedia.propagation import gains, image_partials
from musatpy.orientation.twomedia.rays import PHOTO, WATER, Orientation

PLANE, POINTS = 6, 7  # rows of the quantities: attitude and station of three photos, the plane, then the points


@dataclass(frozen=True, kw_only=True, eq=False)
class TripletModel:
    """A triplet of a strip as a model in axes of its own.

    photos are `first` and the next two; points (k,) rows in the strip, left_out (o,) those of its outliers; value
    (7 + k, 3) attitude and station of each photo, slopes and level of the water, then the points. Errors of the
    images, 2 n coordinates in columns from `column` of those of the strip, with `variance` (2 n,): by_image (22, 2
    n) of the vector of the orientation; of each point by its own coordinates `own` (k, 6), -1 for none, in
    own_by_image (k, 3, 6), and by the orientation in by_vector (k, 3, 22). by_plane (22, 3) of the vector by the
    plane where that is held, None else.
    """

    first: int
    oriented: Oriented
    points: IntArray
    left_out: IntArray
    value: FloatArray
    column: int
    variance: FloatArray
    by_image: FloatArray
    own: IntArray
    own_by_image: FloatArray
    by_vector: FloatArray
    by_plane: FloatArray | None

    @property
    def columns(self) -> slice:
        """The coordinates of its images among those of the strip."""
        return slice(self.column, self.column + len(self.variance))

    def influence(self, rows: IntArray) -> FloatArray:
        """Return the partials (r, 3, 2 n) of quantities `rows` (r,) by errors of the images."""
        by_image = self._by_vector(rows, self.by_image)
        here = np.flatnonzero(rows >= POINTS)
        point = rows[here] - POINTS
        own, coordinate = np.nonzero(self.own[point] >= 0)
        places = self.own[point[own], coordinate]
        by_image[here[own], :, places] += self.own_by_image[point[own], :, coordinate]
        return by_image

    def _by_own(self, rows: IntArray) -> Any:
        """Return the sparse partials (3 r, 2 n) of quantities by their own images, the orientation held."""
        from scipy.sparse import csr_array  # it takes long to load, and few orient strips

        point = rows - POINTS
        place = np.repeat(np.maximum(self.own[point], 0), 3, axis=0)
        values = np.where((point >= 0)[:, None, None], self.own_by_image[point], 0.0)
        size = place.shape[1]
        ends = np.arange(0, place.size + 1, size)
        return csr_array((values.ravel(), place.ravel(), ends), shape=(len(place), len(self.variance)))

    def _by_vector(self, rows: IntArray, by: FloatArray) -> FloatArray:
        """Return the partials (r, 3, c) of quantities by what moves the vector of the orientation by (22, c)."""
        result = np.empty((len(rows), 3, by.shape[1]))
        of_vector = rows < POINTS
        result[of_vector] = by[3 * rows[of_vector, None] + np.arange(3)]
        result[~of_vector] = self.by_vector[rows[~of_vector] - POINTS] @ by
        return result

    def on_ground(self, move: Similarity, rows: IntArray) -> Moved:
        """Return quantities `rows` (r,) in other axes, in which a plane that is held stays when `move` changes."""
        there = self.moved(move, rows)
        if self.by_plane is None:
            return there
        plane = self.moved(move, np.array([PLANE]))
        back = -np.linalg.solve(plane.by_old[0], plane.by_change[0])
        by_plane = there.by_old @ self._by_vector(rows, self.by_plane)
        return replace(there, by_change=there.by_change + by_plane @ back)

    def over(self, move: Similarity, plane: FloatArray) -> TripletModel:
        """Return the model over a plane (3,) of other axes, if it holds one: changed to first order."""
        if self.by_plane is None:
            return self
        change = moved_planes(move.inverse(), plane[None]).value[0] - self.value[PLANE]
        return replace(self, value=self.value + self._by_vector(np.arange(len(self.value)), self.by_plane) @ change)

    def moved(self, move: Similarity, rows: IntArray) -> Moved:
        """Return quantities `rows` (r,) in other axes."""
        value = np.empty((len(rows), 3))
        by_old, by_change = np.empty((len(rows), 3, 3)), np.empty((len(rows), 3, 7))
        attitude = (rows < PLANE) & (rows % 2 == 0)
        cases = ((attitude, moved_attitudes), (rows == PLANE, moved_planes))
        for kind, moved in (*cases, (~attitude & (rows != PLANE), moved_places)):
            if not kind.any():
                continue
            part = moved(move, self.value[rows[kind]])
            value[kind], by_old[kind], by_change[kind] = part.value, part.by_old, part.by_change
        return Moved(value=value, by_old=by_old, by_change=by_change)


def shared_covariance(
    first: TripletModel, rows_first: IntArray, second: TripletModel, rows_second: IntArray
) -> FloatArray:
    """Return the covariance (3 r, 3 s) of quantities of two triplets by the images that both have."""
    one, other = overlap(first.columns, second.columns)
    variance = first.variance[one]
    weighted, by_image = first.by_image[:, one] * variance, second.by_image[:, other]
    own, own_other = first._by_own(rows_first)[:, one], second._by_own(rows_second)[:, other]
    P, Q = (
        part._by_vector(rows, np.eye(len(part.by_image))).reshape(3 * len(rows), -1)
        for part, rows in ((first, rows_first), (second, rows_second))
    )
    by_first = P @ (weighted @ by_image.T) + own @ (variance * by_image).T
    return by_first @ Q.T + P @ (own_other @ weighted.T).T + (own.multiply(variance) @ own_other.T).toarray()


def overlap(first: slice, second: slice) -> tuple[slice, slice]:
    """Return what two spans of coordinates have in common, as places in each."""
    start = max(first.start, second.start)
    stop = max(start, min(first.stop, second.stop))
    return slice(start - first.start, stop - first.start), slice(start - second.start, stop - second.start)


def triplet_model(oriented: Oriented, first: int, points: IntArray, images: IntArray, start: int) -> TripletModel:
    """Return the model of a triplet that begins at photo `first` of a strip.

    `points` (p,) are the rows of its points in the strip, `images` (n,) those of its images, from `start` on.
    """
    place = oriented.points
    kept = np.flatnonzero((oriented.rays >= 2) & np.isfinite(place).all(axis=1))
    kept = kept[np.argsort(points[kept])]
    at = oriented.at
    value = np.concatenate(
        [
            np.stack([at.attitude, at.station], axis=1).reshape(2 * at.photos, 3),
            np.append(at.slope, at.level)[None],
            place[kept],
        ]
    )
    column = 2 * (images - start)
    width = int(column.max()) + 2
    variance = np.zeros(width)
    variance[column], variance[column + 1] = np.square(oriented.problem.image_sigma).T
    own, own_by_image, by_vector = _of_points(oriented, kept, column)
    return TripletModel(
        first=first,
        oriented=oriented,
        points=points[kept],
        left_out=points[oriented.outliers],
        value=value,
        column=2 * start,
        variance=variance,
        by_image=_by_image(oriented, column, width),
        own=own,
        own_by_image=own_by_image,
        by_vector=by_vector,
        by_plane=None if oriented.problem.unknown[-WATER:-1].any() else _by_plane(oriented),
    )


def _by_plane(oriented: Oriented) -> FloatArray:
    """Return the partials (22, 3) of an orientation by slopes and level of the plane that it holds."""
    by_plane = np.zeros((len(oriented.problem.unknown), 3))
    for gain, part in zip(gains(oriented.problem, oriented.adjusted), oriented.adjusted.linear, strict=True):
        by_plane -= np.sum(gain @ part.by_unknown[0][..., -WATER:-1], axis=0)
    by_plane[-WATER:-1] = np.eye(3)
    return by_plane


def _by_image(oriented: Oriented, column: IntArray, width: int) -> FloatArray:
    """Return the partials (22, 2 n) of an orientation by errors of its images."""
    problem, adjusted = oriented.problem, oriented.adjusted
    by_image = np.zeros((len(problem.unknown), width))
    for group, part, gain in zip(problem.groups, adjusted.linear, gains(problem, adjusted), strict=True):
        carried = -gain @ part.by_values[0]
        place = (column[group.images][..., None] + np.arange(2)).reshape(len(group.images), -1)
        np.add.at(by_image.T, place, np.swapaxes(carried[..., : place.shape[1]], 1, 2))
    return by_image


def _of_points(oriented: Oriented, kept: IntArray, column: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return own columns (k, 6) of points, and their partials by these and by the orientation."""
    size = PHOTO * oriented.method.photos + WATER
    row = np.full(len(oriented.sights.points), -1)
    row[kept] = np.arange(len(kept))
    own = np.full((len(kept), 6), -1)
    own_by_image, by_vector = np.zeros((len(kept), 3, 6)), np.zeros((len(kept), 3, size))
    place = oriented.points
    for rows in oriented.sights.rows_by_count():
        rows = rows[row[oriented.sights.point[rows[:, 0]]] >= 0]
        point = oriented.sights.point[rows[:, 0]]
        by_point, by_unknown = image_partials(oriented.problem, oriented.adjusted, rows, place[point])
        here, width = row[point], 2 * rows.shape[1]
        weight = 1.0 / np.square(oriented.problem.image_sigma[rows]).reshape(len(rows), width, 1)
        across = np.swapaxes(weight * by_point, 1, 2)
        gain = np.linalg.solve(across @ by_point, across)
        own[here, :width] = (column[rows][..., None] + np.arange(2)).reshape(len(rows), width)
        own_by_image[here, :, :width] = gain
        by_vector[here] = -gain @ by_unknown
    return own, own_by_image, by_vector


def orientation_in(oriented: Oriented, move: Similarity) -> Orientation:
    """Return the orientation (1,) of a model in other axes."""
    at = oriented.at
    plane = moved_planes(move, np.append(at.slope, at.level)[None]).value
    return Orientation(
        attitude=moved_attitudes(move, at.attitude).value[None],
        station=move.apply(at.station)[None],
        slope=plane[:, :2],
        level=plane[:, 2],
        index=np.atleast_1d(at.index),
    )
