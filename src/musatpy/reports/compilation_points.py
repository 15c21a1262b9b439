"""The points of a compilation, in the record and in the listing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.reports.fields import POSITION_UNIT, Field, Group, Rows, same
from musatpy.reports.headings import position
from musatpy.reports.pages import Section
from musatpy.reports.stated_record import WORDS
from musatpy.reports.table import Report
from musatpy.reports.wording import of_job, place_columns, place_sigma_columns
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
        Field("model", "string", "model id", lambda c: c.model_ids, heading="Model", edit="A8", is_id=True),
        Field("point", "string", "point or feature", lambda c: c.deck.stages.ids[c.rows], heading="Point",
              edit="A8", is_id=True),
        Field("class", "string", "G, P, S, R", lambda c: c.deck.stages.kind[c.rows], heading="Class", edit="A5"),
        Field("submerged", "boolean", "flagged so", lambda c: c.submerged, heading="Bath", edit="A4",
              words={True: "B", False: ""}),
        Field("position", "3 number?", "true", lambda c: c.gathered("position"), POSITION_UNIT,
              heading=position(4)),
        Field("sigma", "3 number?", "east north up", lambda c: c.sigma, "m",
              heading=[f"Sigma {axis}\nm" for axis in ("E", "N", "U")], edit="F8.3"),
        Field("covariance", "3x3 number?", "of east, north, up", lambda c: c.gathered("covariance"), "m2"),
        Field("apparent", "3 number?", "where the straight rays meet", lambda c: c.apparent, POSITION_UNIT,
              heading=position(4)),
        Field("model_position", "3 number?", "true, in the model", lambda c: c.in_models[0], "m", exact=True,
              heading=[f"Model {axis}\nm" for axis in "XYZ"], edit="F10.3"),
        Field("model_apparent", "3 number?", "apparent, in the model", lambda c: c.in_models[1], "m", exact=True),
        Field("water_level", "number?", "mean of both photos, there", lambda c: c.gathered("water_level"), "m",
              heading="Water\nm", edit="F9.3"),
        Field("depth", "number?", "below that", lambda c: c.gathered("depth"), "m", heading="Depth\nm",
              edit="F8.3"),
        Field("depth_sigma", "number?", "of the depth", lambda c: c.gathered("depth_sigma"), "m",
              heading="Sigma\nm", edit="F7.3"),
        Field("datum_depth", "number?", "below the sounding datum", lambda c: c.datum_depth[0], "m",
              heading="Below datum\nm", edit="F11.3"),
        Field("datum_depth_sigma", "number?", "of that", lambda c: c.datum_depth[1], "m", heading="Sigma\nm",
              edit="F7.3"),
        Field("incidence", "2 number?", "of wet rays, in air", lambda c: c.incidences, "rad",
              heading=("Incid. L\ndegrees", "Incid. R\ndegrees"), edit="F8.3"),
        Field("wet", "2 boolean", "the ray goes through the water", lambda c: c.gathered("wet")),
        Field("y_parallax", "number?", "by which the right image is off its epipolar curve",
              lambda c: c.gathered("y_parallax"), "mm", heading="py\num", edit="F9.2"),
        Field("y_parallax_test", "number?", "over its sigma, as a normal variable", lambda c: c.parallax_test,
              heading="Test py", edit="F7.2"),
        Field("remark", "string?", "why it has no depth, or a y-parallax beyond its limit", lambda c: c.remarks,
              heading="Remark", edit="A22"),
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
        Field("covariance", "3x3 number?", "of that", lambda a: a[1].covariance, "that of the coordinates, squared",
              exact=True),
        Field("apparent", "3 number?", "where straight rays meet", lambda a: a[1].apparent,
              "that of the coordinates", exact=True),
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


POINT_TABLE: Report[Any] = Report(
    title="Point Compilation: True Coordinates",
    table=POINTS,
    worst=lambda t: np.linalg.norm(t["sigma"], axis=1),
    columns=("model", "point", "class", "submerged", "position", "sigma", "depth", "depth_sigma"),
)
APPARENT_TABLE: Report[Any] = Report(
    title="Point Compilation: Apparent Coordinates, And True Ones In The Model",
    table=POINTS,
    columns=("model", "point", "apparent", "model_position"),
)
RAY_TABLE: Report[Any] = Report(
    title="Point Compilation: Water And Rays",
    table=POINTS,
    worst=lambda t: np.abs(t["y_parallax_test"]),
    columns=(
        "model",
        "point",
        "water_level",
        "datum_depth",
        "datum_depth_sigma",
        "incidence",
        POINTS.column("wet[0]", "Wet\nleft", "A4", words={True: "W", False: ""}),
        POINTS.column("wet[1]", "Wet\nright", "A5", words={True: "W", False: ""}),
        "y_parallax",
        "y_parallax_test",
        "remark",
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
        names: tuple[Field[Any], ...] = (
            of_job("Model", "A8", lambda c: c.model_ids),
            of_job("Point", "A8", lambda c: c.deck.stages.ids[c.rows]),
        )
        yield replace(report, columns=(*names, *places, *others))
