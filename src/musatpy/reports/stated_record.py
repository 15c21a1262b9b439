"""The part of the JSON record that is in the words of SYS cards: how deck and answer are stated, and the answer."""

from __future__ import annotations

from musatpy.reports.encoding import Json, Rows, plain, rows
from musatpy.statistics import Statistics, Words


def stated(statistics: Statistics) -> dict[str, Json] | None:
    """Return the statements and the answer, None in a job without such cards."""
    if statistics.answer_words is None:
        return None
    return {
        "input": None if statistics.given_words is None else _words(statistics.given_words),
        "answer": _words(statistics.answer_words),
        "stations": _stations(statistics),
        "points": _points(statistics),
    }


def _words(words: Words) -> dict[str, Json]:
    spec, statement = words.spec, words.statement
    return {
        "kind": spec.kind,
        "definition": spec.definition or None,
        "geoid": spec.geoid or None,
        "origin": None if spec.origin is None else list(spec.origin),
        "false_origin": None if spec.false is None else list(spec.false),
        "axes": spec.axes,
        "angles": spec.angles,
        "unit": spec.unit.value,
        "sigmas": spec.sigmas,
        "text": statement.text,
        "coordinates": list(words.names),
        "coordinate_units": list(words.units),
    }


def _stations(statistics: Statistics) -> Rows:
    answer = statistics.answer
    if answer is None:
        return []
    count = len(statistics.block.photos.ids)
    found, none = answer.factors, [None] * count
    return rows(
        photo=statistics.block.photos.ids,
        position=answer.position,
        angles=answer.angles,
        matrix=answer.matrix,
        covariance=answer.covariance,
        tide=answer.tide,
        undulation=answer.undulation,
        convergence=none if found is None else plain(found.convergence),
        scale=none if found is None else [list(one) for one in zip(*_scales(statistics), strict=True)],
    )


def _scales(statistics: Statistics) -> tuple[list[Json], list[Json]]:
    """Return the scales of the map along meridian and parallel."""
    answer = statistics.answer
    if answer is None or answer.factors is None:
        raise ValueError("the answer is on no map")
    return plain(answer.factors.meridian_scale), plain(answer.factors.parallel_scale)


def _points(statistics: Statistics) -> Rows:
    answer = statistics.answer
    if answer is None:
        return []
    return rows(
        point=statistics.block.points.ids,
        position=answer.points,
        covariance=answer.point_covariance,
    )
