"""The study of the geometry of an answer, and its pictures."""

from __future__ import annotations

from musatpy.orientation.twomedia import pictures
from musatpy.orientation.twomedia.study import OrientationStudy, study
from musatpy.orienting.answer import Answer
from musatpy.orienting.strip_answer import StripAnswer


def studied(answer: Answer | StripAnswer, title: str) -> tuple[OrientationStudy, dict[str, bytes]]:
    """Return the study, and pictures (PNG) by their names: correlations, basins, precision where the water is free.

    Of a strip it is that of the triplet that determines the water least; where the strip has sigmas, there is a
    picture of them. Raises `MusatError` without the extra `plots`.
    """
    oriented = (
        answer.strip.triplets[answer.strip.weakest].oriented if isinstance(answer, StripAnswer) else answer.oriented
    )
    result = study(oriented)
    drawn = {
        "correlations": pictures.correlation_picture(oriented),
        "basins": pictures.basins_picture(result.basins, title),
    }
    if result.precision is not None:
        drawn["precision"] = pictures.precision_picture(result.precision, title, answer.scene.spec.limit)
    if isinstance(answer, StripAnswer) and answer.solution is not None:
        drawn["strip"] = pictures.strip_picture(
            answer.photos, answer.position_sigma, answer.chain_difference, title
        )
    return result, drawn
