"""Adjusted ground points with their sigmas, and the points that took no part, with the reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.arrays import IntArray
from musatpy.model import PointStatus
from musatpy.reports import result_record, stated
from musatpy.reports.columns import metric_columns, position_columns
from musatpy.reports.origin import Mapped, Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Choice, Column, Report, key, worst_first
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics

_STATUS = {"not_determined": "not determined"}  # of the record: in words

_DRY = Column[Statistics]("Dry", "A3", shows=Origin(field="dry", true="D"))
_POSITION, _SIGMAS = position_columns("position", 3), metric_columns("sigma", "Sigma ")


def _in_words(statistics: Statistics, part: Choice[Statistics], number: int) -> tuple[Column[Statistics], ...]:
    """Return the columns of coordinates (0) or sigmas (1) in the words of the answer, or those of the job."""
    words = statistics.answer_words
    return part.of(statistics) if words is None else stated.point_columns(words, _determined(statistics))[number]


GROUND_POINTS: Report[Statistics] = Report(
    title="Adjusted Ground Points",
    table=result_record.POINTS,
    rows=lambda s: _determined(s),
    leave={"status": ("not_determined",)},
    words={"status": _STATUS},
    columns=(
        key("Point", "A8", "point"),
        Column("Bath", "A4", shows=Origin(field="bathymetric", true="B")),
        Choice(((_DRY,),), lambda s: (_DRY,) if s.block.points.dry.any() else ()),
        Column("Status", "A14", shows="status"),
        Column("Rays", "I4", shows="rays"),
        replace(_POSITION, of=lambda s: _in_words(s, _POSITION, 0)),
        replace(_SIGMAS, of=lambda s: _in_words(s, _SIGMAS, 1)),
    ),
)
NO_PART = Mapped(
    title="Points That Took No Part, Or Have No Position",
    layout="texts",
    table="points",
    ids={"Point": "point", "Status": "status", "Reason": "reason"},
    take={"status": ("intersected", "not_determined")},
    words={"status": _STATUS, "reason": {"None": "no reason given"}},
)
STATED = (GROUND_POINTS, NO_PART)


def sections(statistics: Statistics) -> list[Section]:
    """Return the points that have a position, and the reasons why others have none or took no part."""
    worst = worst_first(np.linalg.norm(statistics.point_sigmas[_determined(statistics)], axis=1)).tolist()
    sections = [GROUND_POINTS.section(statistics, new_page=True, worst=worst)]
    words = statistics.answer_words
    sections += stated.far_points(statistics, words) if words else []
    reasons = _reasons(statistics)
    if reasons:
        sections.append(Section(title=NO_PART.title, lines=reasons, worst=range(len(reasons))))
    return sections


def _determined(statistics: Statistics) -> IntArray:
    return np.flatnonzero(statistics.solution.points.status != PointStatus.NOT_DETERMINED)


def _reasons(statistics: Statistics) -> list[str]:
    points, ids = statistics.solution.points, statistics.block.points.ids
    lines: list[str] = []
    for row in np.flatnonzero(points.status != PointStatus.TRIANGULATED).tolist():
        status = PointStatus(int(points.status[row])).name.lower().replace("_", " ")
        lines += wrapped([points.reasons.get(row, "no reason given")], lead=f"{ids[row]:<8.8}  {status:<14}  ")
    return lines
