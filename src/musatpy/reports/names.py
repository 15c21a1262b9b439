"""Names that do not go into the columns of a listing: it prints short ones, and this page says whose they are."""

from __future__ import annotations

from dataclasses import replace

from musatpy.formats.short_ids import short_block
from musatpy.model import Cause, Finding
from musatpy.reports.pages import Section
from musatpy.reports.table import sheet
from musatpy.statistics import Statistics

_KINDS = {"photos": "photo", "points": "point"}


def with_short_names(statistics: Statistics) -> tuple[Statistics, list[Section]]:
    """Return statistics as a listing has them, and the page of names; the same where all names fit."""
    solution = statistics.solution
    block, renamed = short_block(statistics.block, _KINDS)
    if not renamed:
        return statistics, []
    photos, points = ({old: new for of, new, old in renamed if of == table} for table in _KINDS)

    def finding(one: Finding) -> Finding:
        return replace(one, photo=photos.get(one.photo, one.photo), point=points.get(one.point, one.point))

    def cause(one: Cause) -> Cause:
        return replace(
            one,
            photos=tuple(photos.get(name, name) for name in one.photos),
            points=tuple(points.get(name, name) for name in one.points),
        )

    short_solution = replace(
        solution,
        block=block,
        findings=tuple(map(finding, solution.findings)),
        causes=tuple(map(cause, solution.causes)),
    )
    columns = sheet(
        ("Kind", "A6", [_KINDS[table] for table, _, _ in renamed]),
        ("Printed", "A8", [new for _, new, _ in renamed]),
        ("Name", "A100", [old for _, _, old in renamed]),
    )
    page = Section(title="Names", head=columns.head(), lines=columns.lines(None), new_page=True)
    return Statistics(short_solution), [page]
