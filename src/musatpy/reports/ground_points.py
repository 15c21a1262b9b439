"""Adjusted ground points with their sigmas, and the points that took no part, with the reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import PointStatus
from musatpy.reports import stated
from musatpy.reports.encoding import names
from musatpy.reports.fields import ENU, POSITION_UNIT, Field, Rows, same
from musatpy.reports.headings import along_axes, position
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.reports.text import wrapped
from musatpy.reports.wording import place_columns, place_sigma_columns
from musatpy.statistics import Statistics, Words


def _reasons(statistics: Statistics) -> list[str | None]:
    reasons = statistics.solution.points.reasons
    return [reasons.get(row) for row in range(len(statistics.block.points.ids))]


POINTS = Rows[Statistics, Statistics](
    "points",
    "one row per ground point",
    same,
    (
        Field("point", "string", "point id", lambda s: s.block.points.ids, heading="Point", edit="A8", is_id=True),
        Field("bathymetric", "boolean", "submerged", lambda s: s.block.points.bathymetric, heading="Bath",
              edit="A4", words={True: "B", False: ""}),
        Field("dry", "boolean", "flagged as dry for certain", lambda s: s.block.points.dry, heading="Dry",
              edit="A3", words={True: "D", False: ""}, when=lambda t: bool(t["dry"].any())),
        Field("status", "string", "what became of it", lambda s: names(PointStatus, s.solution.points.status),
              choices=("triangulated", "intersected", "not_determined"), heading="Status", edit="A14",
              words={"not_determined": "not determined"}),
        Field("reason", "string?", "why it has no position, or took no part", _reasons, heading="Reason",
              edit="A80", words={None: "no reason given"}),
        Field("rays", "integer", "plate measurements used for the position", lambda s: s.solution.points.rays,
              heading="Rays", edit="I4"),
        Field("position", "3 number?", "adjusted", lambda s: s.solution.points.position, POSITION_UNIT,
              heading=position(3)),
        Field("sigma", "3 number?", f"a posteriori, {ENU}", lambda s: s.point_sigmas, "m",
              heading=along_axes("Sigma ")),
        Field("covariance", "3x3 number?", "a posteriori, of east, north, up",
              lambda s: s.solution.points.covariance, "m2"),
    ),
)  # fmt: skip


def _in_words(statistics: Statistics, words: Words) -> Report[Statistics]:
    """Return the table with coordinates and sigmas in the words of the answer."""
    rows = statistics.solution.points.status != PointStatus.NOT_DETERMINED
    places = (
        *place_columns(words, lambda s: _stated(s)[rows], 3),
        *place_sigma_columns(words, lambda s: s.answer_point_sigmas[rows]),
    )
    return replace(GROUND_POINTS, columns=(*GROUND_POINTS.columns[:-2], *places))


def _stated(statistics: Statistics) -> FloatArray:
    assert statistics.answer is not None
    return statistics.answer.points


GROUND_POINTS: Report[Statistics] = Report(
    title="Adjusted Ground Points",
    table=POINTS,
    which=lambda t: np.flatnonzero(t["status"] != "not_determined"),
    worst=lambda t: np.linalg.norm(t["sigma"], axis=1),
    columns=("point", "bathymetric", "dry", "status", "rays", "position", "sigma"),
)
NO_PART: Report[Statistics] = Report(
    title="Points That Took No Part, Or Have No Position",
    layout="texts",
    table=POINTS,
    which=lambda t: np.flatnonzero(t["status"] != "triangulated"),
    columns=("point", "status", "reason"),
)
STATED = (GROUND_POINTS, NO_PART)


def sections(statistics: Statistics) -> list[Section]:
    """Return the points that have a position, and the reasons why others have none or took no part."""
    words = statistics.answer_words
    sections = [
        (_in_words(statistics, words) if words else GROUND_POINTS).section(statistics, new_page=True),
        *(stated.far_points(statistics, words) if words else []),
    ]
    _, *rows = NO_PART.cells(statistics)
    lines = [line for point, status, why in rows for line in wrapped([why], lead=f"{point:<8.8}  {status:<14}  ")]
    return [*sections, Section(title=NO_PART.title, lines=lines, worst=range(len(lines)))] if lines else sections
