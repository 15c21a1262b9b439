"""Readings of a model that are plate measurements of the run itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import BoolArray, IntArray

if TYPE_CHECKING:
    from musatpy.compilation.compiled import CompiledModel

_SAME = 1e-6  # mm


def points_of_run(model: CompiledModel) -> IntArray:
    """Return the rows (k,) of the points of the run by the names of the readings, -1 where it has none."""
    number = {name: row for row, name in enumerate(model.stereo.run.block.points.ids.tolist())}
    return np.array([number.get(name, -1) for name in model.readings.ids.tolist()], dtype=np.int64)


def are_of_run(model: CompiledModel, rows: IntArray, points: IntArray) -> BoolArray:
    """Return which readings `rows` (r,) are the plate measurements of `points` (r,) of the run on both photos."""
    plates = model.stereo.run.block.plates
    measured = dict(zip(zip(plates.photo.tolist(), plates.point.tolist(), strict=True), plates.xy, strict=True))
    same = np.zeros(len(rows), dtype=bool)
    for place, (row, point) in enumerate(zip(rows.tolist(), points.tolist(), strict=True)):
        xy = [measured.get((photo, point)) for photo in model.stereo.photos]
        same[place] = all(
            given is not None and np.abs(model.readings.xy[row, side] - given).max() <= _SAME
            for side, given in enumerate(xy)
        )
    return same


def on_both_photos(model: CompiledModel, point: int) -> bool:
    """Return whether the run has used a point on both photos of a model."""
    run = model.stereo.run
    photos = run.block.plates.photo[run.triangulated & (run.block.plates.point == point)]
    return set(model.stereo.photos) <= set(photos.tolist())
