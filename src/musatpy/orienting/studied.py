"""The study of the geometry of an answer, and its pictures."""

from __future__ import annotations

from musatpy.orientation.twomedia import pictures
from musatpy.orientation.twomedia.study import Study, study
from musatpy.orienting.answer import Answer

_STARTS = 25  # of each level: a hundred in all


def studied(answer: Answer, title: str) -> tuple[Study, dict[str, bytes]]:
    """Return the study, and pictures (PNG) by their names: correlations, basins, precision where the water is free.

    Raises `MusatError` without the extra `plots`.
    """
    result = study(answer.oriented, starts=_STARTS)
    drawn = {
        "correlations": pictures.correlation_picture(answer.oriented),
        "basins": pictures.basins_picture(result.basins, title),
    }
    if result.precision is not None:
        drawn["precision"] = pictures.precision_picture(result.precision, title, answer.scene.spec.limit)
    return result, drawn
