"""The points of a compilation, in the record and in the listing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from musatpy.arrays import FloatArray
from musatpy.model import CoordinateSystem
from musatpy.reports.columns import position_columns, vector
from musatpy.reports.fields import Field, Group, Rows, same
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.stated_record import WORDS
from musatpy.reports.table import Choice, Column, Report, key
from musatpy.reports.wording import place_columns, place_sigma_columns
from musatpy.statistics import Words
from musatpy.statistics.analyses import words_of

if TYPE_CHECKING:
    from musatpy.compilation.answers import StatedPoints
    from musatpy.compilation.compiled import Compiled

POINTS: Rows[Compiled, Compiled] = Rows(
    "points",
    "one row per reading",
    same,
    (
        Field("model", "string", "model id", lambda c: c.model_ids),
        Field("point", "string", "point or feature", lambda c: c.deck.stages.ids[c.rows]),
        Field("class", "string", "G, P, S, R", lambda c: c.deck.stages.kind[c.rows]),
        Field("submerged", "boolean", "flagged so", lambda c: c.submerged),
        Field("position", "3 number?", "true", lambda c: c.gathered("position"), "rad, rad, m (GEOG) or m"),
        Field("sigma", "3 number?", "east north up", lambda c: c.sigma, "m"),
        Field("covariance", "3x3 number?", "of east, north, up", lambda c: c.gathered("covariance"), "m2"),
        Field(
            "apparent", "3 number?", "where the straight rays meet", lambda c: c.apparent, "rad, rad, m (GEOG) or m"
        ),
        Field("model_position", "3 number?", "true, in the model", lambda c: c.in_models[0], "m", exact=True),
        Field("model_apparent", "3 number?", "apparent, in the model", lambda c: c.in_models[1], "m", exact=True),
        Field("water_level", "number?", "mean of both photos, there", lambda c: c.gathered("water_level"), "m"),
        Field("depth", "number?", "below that", lambda c: c.gathered("depth"), "m"),
        Field("depth_sigma", "number?", "of the depth", lambda c: c.gathered("depth_sigma"), "m"),
        Field("datum_depth", "number?", "below the sounding datum", lambda c: c.datum_depth[0], "m"),
        Field("datum_depth_sigma", "number?", "of that", lambda c: c.datum_depth[1], "m"),
        Field("incidence", "2 number?", "of wet rays, in air", lambda c: c.incidences, "rad"),
        Field("wet", "2 boolean", "the ray goes through the water", lambda c: c.gathered("wet")),
        Field(
            "y_parallax", "number?", "by which the right image is off its epipolar curve",
            lambda c: c.gathered("y_parallax"), "mm",
        ),
        Field("y_parallax_test", "number?", "over its sigma, as a normal variable", lambda c: c.parallax_test),
        Field("remark", "string?", "why it has no depth, or a y-parallax beyond its limit", lambda c: c.remarks),
        Field("reason", "string?", "why it has no position", lambda c: c.reasons),
    ),
)  # fmt: skip
STATED_POINTS: Rows[Compiled, tuple[Compiled, StatedPoints]] = Rows(
    "points",
    "one row per reading; null where the system does not reach",
    lambda c: None if c.answer is None else (c, c.answer),
    (
        Field("model", "string", "model id", lambda a: a[0].model_ids),
        Field("point", "string", "point or feature", lambda a: a[0].deck.stages.ids[a[0].rows]),
        Field("position", "3 number?", "true", lambda a: a[1].position, "that of the coordinates", exact=True),
        Field(
            "covariance",
            "3x3 number?",
            "of that",
            lambda a: a[1].covariance,
            "that of the coordinates, squared",
            exact=True,
        ),
        Field(
            "apparent",
            "3 number?",
            "where straight rays meet",
            lambda a: a[1].apparent,
            "that of the coordinates",
            exact=True,
        ),
    ),
)  # fmt: skip
ANSWER: Group[Compiled, Compiled] = Group(
    "stated",
    "the points as the run states its answer (SYS OUT); null where that is in the system of the job",
    lambda c: None if c.run.stated is None else c,
    (Group[Any, Words]("answer", "how it is stated", lambda c: _words(c), WORDS), STATED_POINTS),
    optional=True,
)
RECORD = (POINTS, ANSWER)


def _words(compiled: Compiled) -> Words | None:
    return words_of(compiled.run.stated, compiled.run.block)


_NAMES: tuple[Column[Any], ...] = (key("Model", "A8", "model"), key("Point", "A8", "point"))
_PLACE = position_columns("position", 4)
_APPARENT = position_columns("apparent", 4)


def in_system(place: Choice[Any]) -> Choice[Any]:
    """Return the columns of positions in the system of a job."""
    angular, plane = place.variants

    def of(compiled: Compiled) -> tuple[Column[Any], ...]:
        return angular if compiled.run.block.options.system == CoordinateSystem.GEOGRAPHIC else plane

    return replace(place, of=of)


POINT_TABLE: Report[Any] = Report(
    title="Point Compilation: True Coordinates",
    table=POINTS,
    columns=(
        *_NAMES,
        Column("Class", "A5", shows="class"),
        Column("Bath", "A4", shows=Origin(field="submerged", true="B")),
        in_system(_PLACE),
        *vector([f"Sigma {axis}\nm" for axis in ("E", "N", "U")], ("F8.3",) * 3, shows="sigma"),
        Column("Depth\nm", "F8.3", shows="depth"),
        Column("Sigma\nm", "F7.3", shows="depth_sigma"),
    ),
)
APPARENT_TABLE: Report[Any] = Report(
    title="Point Compilation: Apparent Coordinates, And True Ones In The Model",
    table=POINTS,
    columns=(
        *_NAMES,
        in_system(_APPARENT),
        *vector([f"Model {axis}\nm" for axis in "XYZ"], ("F10.3",) * 3, shows="model_position"),
    ),
)
RAY_TABLE: Report[Any] = Report(
    title="Point Compilation: Water And Rays",
    table=POINTS,
    columns=(
        *_NAMES,
        Column("Water\nm", "F9.3", shows="water_level"),
        Column("Below datum\nm", "F11.3", shows="datum_depth"),
        Column("Sigma\nm", "F7.3", shows="datum_depth_sigma"),
        Column("Incid. L\ndegrees", "F8.3", shows="incidence[0]"),
        Column("Incid. R\ndegrees", "F8.3", shows="incidence[1]"),
        Column("Wet\nleft", "A4", shows=Origin(field="wet[0]", true="W")),
        Column("Wet\nright", "A5", shows=Origin(field="wet[1]", true="W")),
        Column("py\num", "F9.2", shows="y_parallax"),
        Column("Test py", "F7.2", shows="y_parallax_test"),
        Column("Remark", "A22", shows="remark"),
    ),
)
# What the answer of the run is stated in: the record has it in words of its own.
ANSWER_TABLES: tuple[Report[Any], Report[Any]] = (
    Report(title="Point Compilation: True Coordinates Of The Answer", columns=()),
    Report(title="Point Compilation: Apparent Coordinates Of The Answer", columns=()),
)
STATED = (POINT_TABLE, *ANSWER_TABLES, APPARENT_TABLE, RAY_TABLE)


def sections_of(compiled: Compiled) -> list[Section]:
    """Return the tables of points."""
    words = _words(compiled)
    answer = [] if words is None else [report.section(compiled) for report in _answer(words)]
    return [
        POINT_TABLE.section(compiled, new_page=True),
        *answer[:1],
        APPARENT_TABLE.section(compiled),
        *answer[1:],
        RAY_TABLE.section(compiled),
    ]


def _answer(words: Words) -> Iterator[Report[Any]]:
    """Yield the tables of the points as an answer is stated."""

    def of(name: str) -> Any:
        return lambda compiled: getattr(compiled.answer, name)

    def sigmas(compiled: Any) -> FloatArray:
        values: FloatArray = compiled.answer.sigma if words.of_system else compiled.sigma
        return values

    columns = (place_columns(words, of("position"), 3), place_columns(words, of("apparent"), 3))
    more = (place_sigma_columns(words, sigmas), ())
    for report, places, others in zip(ANSWER_TABLES, columns, more, strict=True):
        names: tuple[Column[Any], ...] = (
            Column("Model", "A8", lambda c: c.model_ids),
            Column("Point", "A8", lambda c: c.deck.stages.ids[c.rows]),
        )
        yield replace(report, columns=(*names, *places, *others))
