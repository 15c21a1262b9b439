"""The part of the record that is in the words of SYS cards: how deck and answer are stated, and the answer."""

from __future__ import annotations

from typing import Any

from musatpy.reports.fields import Field, Group, Rows
from musatpy.reports.values import Json, plain
from musatpy.statistics import Statistics, Words

Answer = tuple[Statistics, Any]  # and what the systems make of its solution

WORDS: tuple[Field[Words], ...] = (
    Field("kind", "enum", "kind of coordinate system", lambda w: w.spec.kind,
          choices=("GEOG", "GEOC", "LOCL", "TANG", "PROJ")),
    Field("definition", "string?", "code, PROJ string or WKT of a projected system",
          lambda w: w.spec.definition or None),
    Field("geoid", "string?", "grid file of the geoid model to which heights refer",
          lambda w: w.spec.geoid or None),
    Field("origin", "3 number or null", "latitude, longitude, height of the origin of a tangent plane",
          lambda w: w.spec.origin, "rad, rad, m"),
    Field("false_origin", "3 number or null", "coordinates of this origin; null: zeros", lambda w: w.spec.false,
          "m"),
    Field("axes", "enum", "what attitudes refer to", lambda w: w.spec.axes, choices=("VERT", "GRID", "GEOC")),
    Field("angles", "enum", "form of attitudes", lambda w: w.spec.angles, choices=("OPK", "POK", "ATS", "MATR")),
    Field("unit", "enum", "of angles on cards and in the listing", lambda w: w.spec.unit,
          choices=("DMS", "DEG", "GON", "RAD")),
    Field("sigmas", "enum", "what the sigmas of cards and listing are of", lambda w: w.spec.sigmas,
          choices=("LOCL", "SYST")),
    Field("text", "string", "all this in words", lambda w: w.statement.text),
    Field("coordinates", "3 string", "names of the coordinates", lambda w: w.names),
    Field("coordinate_units", "3 string", "their units in this record", lambda w: w.units),
)  # fmt: skip
_COORDINATES = "that of the coordinates"


def _convergence(answer: Any) -> list[Json]:
    factors = answer.factors
    return [None] * len(answer.tide) if factors is None else plain(factors.convergence)


def _scales(answer: Any) -> list[Json]:
    """Return the scales of the map along meridian and parallel."""
    factors = answer.factors
    if factors is None:
        return [None] * len(answer.tide)
    scales = plain(factors.meridian_scale), plain(factors.parallel_scale)
    return [list(pair) for pair in zip(*scales, strict=True)]


STATIONS: Rows[Statistics, Answer] = Rows(
    "stations",
    "one row per photo; null where the system does not reach",
    of=lambda s: None if s.answer is None else (s, s.answer),
    fields=(
        Field("photo", "string", "photo id", lambda a: a[0].block.photos.ids),
        Field("position", "3 number?", "adjusted", lambda a: a[1].position, _COORDINATES, exact=True),
        Field("angles", "3 number?", "adjusted, in the order of the form; null where attitudes are matrices",
              lambda a: a[1].angles, "rad"),
        Field("matrix", "3x3 number?", "adjusted, from the axes of attitudes to the photo", lambda a: a[1].matrix,
              exact=True),
        Field("covariance", "6x6 number?",
              "a posteriori, of position and angles (of small rotations about the axes where attitudes are "
              "matrices); null for angles that turn about one line", lambda a: a[1].covariance,
              "those of position and angles", exact=True),
        Field("tide", "number?",
              "height of the water surface, adjusted where that is unknown, in heights of the system",
              lambda a: a[1].tide, "m"),
        Field("undulation", "number?", "height of the geoid above the ellipsoid; 0 without one",
              lambda a: a[1].undulation, "m"),
        Field("convergence", "number?", "from true to grid north, clockwise; null where there is no map",
              lambda a: _convergence(a[1]), "rad"),
        Field("scale", "2 number? or null", "map over ellipsoid, along meridian and parallel",
              lambda a: _scales(a[1])),
    ),
)  # fmt: skip
POINTS: Rows[Statistics, Answer] = Rows(
    "points",
    "one row per ground point; null where not determined or not reached",
    of=lambda s: None if s.answer is None else (s, s.answer),
    fields=(
        Field("point", "string", "point id", lambda a: a[0].block.points.ids),
        Field("position", "3 number?", "adjusted", lambda a: a[1].points, _COORDINATES, exact=True),
        Field("covariance", "3x3 number?", "a posteriori", lambda a: a[1].point_covariance,
              f"{_COORDINATES}, squared", exact=True),
    ),
)  # fmt: skip
STATED = Group[Statistics, Statistics](
    "stated",
    "the answer in the words of SYS cards; null in a job without any",
    of=lambda s: None if s.answer_words is None else s,
    fields=(
        Group[Statistics, Words](
            "input",
            "how the deck is stated; null: in the system of the options",
            of=lambda s: s.given_words,
            fields=WORDS,
            optional=True,
        ),
        Group[Statistics, Words]("answer", "how the answer is stated", of=lambda s: s.answer_words, fields=WORDS),
        STATIONS,
        POINTS,
    ),
    optional=True,
)
