"""What may be given only once: definitions, measurements, members."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from musatpy.arrays import IntArray, TextArray
from musatpy.errors import Problem
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import naming, table_of

_READ_AGAIN = ("plates", "fiducial_measurements")  # of raw plates, whose readings are no measurements


def repeats(*keys: IntArray) -> Iterator[tuple[int, int]]:
    """Yield (row, first row) for every row whose keys, (k,) each, stood together before; a key of -1 is none."""
    named = np.flatnonzero(np.all([key >= 0 for key in keys], axis=0))
    combined = np.zeros(len(named), dtype=np.int64)
    for key in keys:
        combined = combined * (key.max(initial=0) + 1) + key[named]
    _, first, inverse = np.unique(combined, return_index=True, return_inverse=True)
    for place in np.flatnonzero(first[inverse] != np.arange(len(named))):
        yield int(named[place]), int(named[first[inverse[place]]])


def repeated_cards(draft: Draft) -> Iterator[Problem]:
    """Yield the cards that say again what a card before gave; of two ends the order does not matter."""
    for role, rows in draft.rows.items():
        once = () if draft.raw and role in _READ_AGAIN else (one for spec in rows.specs for one in spec.once)
        for names, message in dict.fromkeys(once):
            paths = [f"{table_of(role)}.{name}" for name in names.split()]
            keys, texts = zip(*(key for path in paths for key in _keys(draft, role, path)), strict=True)
            for row, first in repeats(*keys):
                text = message.format(*(column[row] for column in texts))
                yield draft.problem(role, row, f"{text} {draft.place(role, first)}", path=paths[-1])


def _keys(draft: Draft, role: str, path: str) -> Iterator[tuple[IntArray, TextArray]]:
    """Yield (k,) numbers of what the cards of a role say, -1 for a blank, and (k,) that; the lower end first."""
    values = draft.rows[role][path]
    if values.dtype.kind == "f":
        yield np.where(np.isnan(values), -1, values).astype(np.int64), values
        return
    table = next((table for table in ("cameras", "photos", "points") if naming(table).get(role) == path), None)
    numbers, texts = (
        column.reshape(len(values), math.prod(values.shape[1:]))
        for column in (draft.links(table)[role] if table else numbered(values), values)
    )
    order = np.argsort(numbers, axis=1)
    yield from zip(np.take_along_axis(numbers, order, 1).T, np.take_along_axis(texts, order, 1).T, strict=True)


def repeated_members(draft: Draft) -> Iterator[Problem]:
    """Yield the points that are twice in equal elevation groups: a point has one level."""
    role, points = "equal_elevations", draft.point["equal_elevations"]
    for place, first in repeats(points.ravel()):
        row, column = divmod(place, points.shape[1])
        where = draft.place(role, first // points.shape[1])
        message = f"point {draft.point_ids[points[row, column]]} is already in an equal elevation group {where}"
        yield draft.problem(role, row, message, path="equal_elevations.point", component=column)


def numbered(texts: TextArray) -> IntArray:
    """Return a number for each different text, -1 for a blank one."""
    unique, numbers = np.unique(texts, return_inverse=True)
    return np.where(unique[numbers] == "", -1, numbers) if texts.size else np.zeros(texts.shape, dtype=np.int64)
