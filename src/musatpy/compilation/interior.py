"""The interior orientation of stages that were read raw: their readings as refined plate coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.model.compilation import Compilation
from musatpy.model.reduction import Reduced
from musatpy.reduction.readings_job import reduce


def refined_stages(deck: Compilation) -> tuple[Compilation, Reduced | None]:
    """Return the deck with refined plate coordinates, and what their reduction did, None of refined ones.

    Readings on photos whose plates were refused have none. Raises `DeckError` as `reduction.readings_job.reduce`.
    """
    if deck.raw is None:
        return deck, None
    block, reduced = reduce(deck.raw)
    photo, row = block.photos.ids[block.plates.photo], block.points.ids[block.plates.point].astype(np.int64)
    xy: FloatArray = np.full_like(deck.stages.xy, np.nan)
    for side, photos in enumerate((deck.models.left, deck.models.right)):
        here = photo == photos[deck.stages.model[row]]
        xy[row[here], side] = block.plates.xy[here]
    return replace(deck, stages=replace(deck.stages, xy=xy), raw=None), _by_names(reduced, deck.stages.ids)


def _by_names(reduced: Reduced, names: TextArray) -> Reduced:
    """Return a reduction with the names of the readings in place of their numbers."""

    def named(numbers: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(dict.fromkeys(str(names[int(number)]) for number in numbers))

    points = reduced.given.points
    given = replace(reduced.given, points=replace(points, ids=names[points.ids.astype(np.int64)]))
    plates = (
        replace(plate, beyond_reseau=named(plate.beyond_reseau), beyond_table=named(plate.beyond_table))
        for plate in reduced.plates
    )
    return replace(reduced, given=given, plates=tuple(plates))
