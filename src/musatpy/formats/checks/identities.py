"""What may be given only once: definitions, measurements, members."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.arrays import IntArray, TextArray
from musatpy.errors import Problem
from musatpy.formats.draft import Draft


def repeats(*keys: IntArray) -> Iterator[tuple[int, int]]:
    """Yield (row, first row) for every row whose keys, (k,) each, stood together before; a key of -1 is none."""
    named = np.flatnonzero(np.all([key >= 0 for key in keys], axis=0))
    combined = np.zeros(len(named), dtype=np.int64)
    for key in keys:
        combined = combined * (key.max(initial=0) + 1) + key[named]
    _, first, inverse = np.unique(combined, return_index=True, return_inverse=True)
    for place in np.flatnonzero(first[inverse] != np.arange(len(named))):
        yield int(named[place]), int(named[first[inverse[place]]])


def repeated_definitions(draft: Draft) -> Iterator[Problem]:
    """Yield the cameras, stations, attitudes, tides and control points that a card before gave."""
    cameras, photos, points = draft.camera_ids, draft.photo_ids, draft.point_ids
    for role, path, noun, links, ids in (
        ("cameras", "cameras.ids", "camera", draft.camera, cameras),
        ("stations", "photos.ids", "the station of photo", draft.photo, photos),
        ("attitudes", "photos.ids", "the attitude of photo", draft.photo, photos),
        ("tides", "photos.ids", "the tide of photo", draft.photo, photos),
        ("control", "control.point", "control point", draft.point, points),
    ):
        for row, first in repeats(links[role]):
            name = f"{noun} {ids[links[role][row]]}"
            yield draft.problem(role, row, f"{name} is already given {_on_line(draft, role, first)}", path=path)


def repeated_measurements(draft: Draft) -> Iterator[Problem]:
    """Yield the points that are measured twice on one photo; raw plates may have them read again and again."""
    if draft.raw:
        return
    photo, point = draft.photo["plates"], draft.point["plates"]
    for row, first in repeats(photo, point):
        names = f"point {draft.point_ids[point[row]]} is already measured on photo {draft.photo_ids[photo[row]]}"
        yield draft.problem("plates", row, f"{names} {_on_line(draft, 'plates', first)}", path="plates.point")


def repeated_fiducials(draft: Draft) -> Iterator[Problem]:
    """Yield the fiducial marks that are given twice for a camera, or measured twice on a photo that is not raw."""
    for role, path, noun, links, ids in (
        ("fiducials", "fiducials.ids", "camera", draft.camera, draft.camera_ids),
        ("fiducial_measurements", "fiducial_measurements.ids", "photo", draft.photo, draft.photo_ids),
    ):
        if draft.raw and noun == "photo":
            continue
        marks = draft.rows[role][path]
        for row, first in repeats(links[role], numbered(marks)):
            name = f"mark {marks[row]} of {noun} {ids[links[role][row]]}"
            yield draft.problem(role, row, f"{name} is already given {_on_line(draft, role, first)}", path=path)


def repeated_bases(draft: Draft) -> Iterator[Problem]:
    """Yield the air bases whose two photos a card before joined."""
    ends = np.sort(draft.photo["air_bases"], axis=1)
    for row, first in repeats(ends[:, 0], ends[:, 1]):
        name = f"the base between photos {' and '.join(draft.photo_ids[ends[row]])}"
        message = f"{name} is already given {_on_line(draft, 'air_bases', first)}"
        yield draft.problem("air_bases", row, message, path="air_bases.photo")


def repeated_members(draft: Draft) -> Iterator[Problem]:
    """Yield the points that are twice in equal elevation groups: a point has one level."""
    points = draft.point["equal_elevations"]
    width = points.shape[1]
    for place, first in repeats(points.ravel()):
        row, column = divmod(place, width)
        name = f"point {draft.point_ids[points[row, column]]} is already in an equal elevation group"
        message = f"{name} {_on_line(draft, 'equal_elevations', first // width)}"
        path = "equal_elevations.point"
        yield draft.problem("equal_elevations", row, message, path=path, component=column)


def numbered(texts: TextArray) -> IntArray:
    """Return a number for each different text, -1 for a blank one."""
    unique, numbers = np.unique(texts, return_inverse=True)
    return np.where(unique[numbers] == "", -1, numbers) if len(texts) else np.zeros(0, dtype=np.int64)


def _on_line(draft: Draft, role: str, row: int) -> str:
    return f"on line {draft.rows[role].lines[row]}"
