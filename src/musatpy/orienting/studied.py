"""The study of the geometry of an answer, and its pictures."""

from __future__ import annotations

from musatpy.orientation.twomedia import pictures
from musatpy.orientation.twomedia.study import Study, study
from musatpy.orienting.answer import Answer
from musatpy.orienting.strip_answer import StripAnswer

_STARTS = 25  # of each level: a hundred in all


def studied(answer: Answer | StripAnswer, title: str) -> tuple[Study, dict[str, bytes]]:
    """Return the study, and pictures (PNG) by their names: correlations, basins, precision where the water is free.

    Of a strip it is that of the triplet that determines the water least, and there is a picture of its errors.
    Raises `MusatError` without the extra `plots`.
    """
    oriented = answer.strip.models[answer.plane[2]].oriented if isinstance(answer, StripAnswer) else answer.oriented
    result = study(oriented, starts=_STARTS)
    drawn = {
        "correlations": pictures.correlation_picture(oriented),
        "basins": pictures.basins_picture(result.basins, title),
    }
    if result.precision is not None:
        drawn["precision"] = pictures.precision_picture(result.precision, title, answer.scene.spec.limit)
    if isinstance(answer, StripAnswer):
        differences = None if answer.against is None else answer.against.position
        drawn["strip"] = pictures.strip_picture(answer.photos, answer.position_sigma, differences, title)
    return result, drawn
