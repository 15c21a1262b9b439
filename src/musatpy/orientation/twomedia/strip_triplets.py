"""The triplets of a strip one after the other, each started from the one before it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from musatpy.arrays import IntArray
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.similarity import Similarity
from musatpy.model.options import PlaneTreatment
from musatpy.orientation.twomedia.oriented import OrientationError, Oriented, orient, settled
from musatpy.orientation.twomedia.pair import along_axes
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Plane, Sights
from musatpy.orientation.twomedia.triplet import TRIPLET
from musatpy.orientation.twomedia.triplet_models import TripletModel, orientation_in, triplet_model


def triplets(
    sights: Sights, planes: Sequence[Plane], before: Sequence[TripletModel] | None = None, equal: bool = False
) -> Iterator[TripletModel]:
    """Yield the triplets of a strip, whose images are sorted by their photos, with what each knows of the water.

    From nothing, or from those of a pass `before`, without the points that were out there. Raises
    `OrientationError`.
    """
    begin = np.searchsorted(sights.photo, np.arange(len(sights.photos) + 1))
    model: TripletModel | None = None
    for first, plane in enumerate(planes):
        rows = np.arange(begin[first], begin[first + 3])
        count = np.bincount(sights.point[rows], minlength=len(sights.points))
        rows = rows[count[sights.point[rows]] >= 2]
        part, points = _part(sights, rows, first)
        try:
            if before is not None:
                oriented = _again(part, plane, before[first].oriented, equal)
            else:
                near = None if model is None else _near(model)
                oriented = orient(part, TRIPLET, plane, equal=equal, near=near)
        except OrientationError as error:
            raise type(error)(f"STRIP: photos {', '.join(part.photos)}: {error}") from error
        left = rows[~oriented.outliers[part.point]]
        model = triplet_model(oriented, first, points, left, int(begin[first]))
        yield model


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


def _again(part: Sights, plane: Plane, before: Oriented, equal: bool) -> Oriented:
    """Return a triplet as it was before, over the plane that is known now."""
    near = Orientation.of(before.at.vector[None])
    if plane.treatment is PlaneTreatment.KNOWN:
        near = replace(near, slope=np.array([plane.slope]), level=np.array([plane.level]))
    return settled(part, TRIPLET, plane, near, before.outliers, equal)


def _near(before: TripletModel) -> Orientation:
    """Return the start (1,) of a triplet by the one before it, whose flight goes on as it went."""
    at = before.oriented.at
    base = at.station[2] - at.station[1]
    length = float(np.linalg.norm(base))
    M = attitude_matrix(at.attitude[1])
    turn = along_axes(M @ base / length).T @ M
    move = Similarity(scale=1.0 / length, rotation=turn, shift=-turn @ at.station[1] / length)
    three = orientation_in(before.oriented, move)
    new = 2.0 * three.station[:, 2] - three.station[:, 1]
    return replace(
        three,
        attitude=np.concatenate([three.attitude[:, 1:], three.attitude[:, 2:]], axis=1),
        station=np.concatenate([three.station[:, 1:], new[:, None]], axis=1),
    )
