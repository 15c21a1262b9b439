"""Adjusted ground points with their sigmas, and the points that took no part, with the reason."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import IntArray
from musatpy.model import PointStatus
from musatpy.reports import stated
from musatpy.reports.columns import metric_columns, point_column, position_columns
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table, worst_first
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics

STATUS = {
    PointStatus.TRIANGULATED: "triangulated",
    PointStatus.INTERSECTED: "intersected",
    PointStatus.NOT_DETERMINED: "not determined",
}


def sections(statistics: Statistics) -> list[Section]:
    """Return the points that have a position, and the reasons why others have none or took no part."""
    words = statistics.answer_words
    if words is None:
        places = (
            *position_columns(statistics.block, lambda s: s.solution.points.position[_determined(s)], 3),
            *metric_columns(statistics.block, lambda s: s.point_sigmas[_determined(s)], sigma=True),
        )
    else:
        places = stated.point_columns(words, _determined(statistics))
    table = Table(
        (
            point_column(_determined),
            Column("Bath", "A4", lambda s: np.where(s.block.points.bathymetric[_determined(s)], "B", "")),
            Column("Status", "A14", _status),
            Column("Rays", "I4", lambda s: s.solution.points.rays[_determined(s)]),
            *places,
        )
    )
    found = [
        Section(
            title="Adjusted Ground Points",
            head=table.head(),
            lines=table.lines(statistics),
            new_page=True,
            worst=worst_first(np.linalg.norm(statistics.point_sigmas[_determined(statistics)], axis=1)).tolist(),
        )
    ]
    found += stated.far_points(statistics, words) if words else []
    reasons = _reasons(statistics)
    if reasons:
        title = "Points That Took No Part, Or Have No Position"
        found.append(Section(title=title, lines=reasons, worst=range(len(reasons))))
    return found


def _determined(statistics: Statistics) -> IntArray:
    return np.flatnonzero(statistics.solution.points.status != PointStatus.NOT_DETERMINED)


def _status(statistics: Statistics) -> list[str]:
    status = statistics.solution.points.status[_determined(statistics)]
    return [STATUS[PointStatus(value)] for value in status.tolist()]


def _reasons(statistics: Statistics) -> list[str]:
    points, ids = statistics.solution.points, statistics.block.points.ids
    lines: list[str] = []
    for row in np.flatnonzero(points.status != PointStatus.TRIANGULATED).tolist():
        status = STATUS[PointStatus(int(points.status[row]))]
        lines += wrapped([points.reasons.get(row, "no reason given")], lead=f"{ids[row]:<8.8}  {status:<14}  ")
    return lines
