"""Names that do not go into the columns of a listing: it prints short ones, and this page says whose they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.formats.short_ids import short_names
from musatpy.model import Block, Cause, Finding
from musatpy.reports.pages import Section
from musatpy.reports.table import sheet
from musatpy.statistics import Statistics

_WIDTH = 8
_KINDS = (("photos", "photo", "P"), ("points", "point", "T"))


def with_short_names(statistics: Statistics) -> tuple[Statistics, list[Section]]:
    """Return statistics as a listing has them, and the page of names; the same where all names fit."""
    block, solution = statistics.block, statistics.solution
    renamed: dict[str, dict[str, str]] = {}
    for table, _, prefix in _KINDS:
        names = getattr(block, table).ids.tolist()
        short = short_names(names, _WIDTH, prefix)
        if short != names:
            renamed[table] = dict(zip(names, short, strict=True))
    if not renamed:
        return statistics, []
    photos, points = (renamed.get(table, {}) for table, _, _ in _KINDS)

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
        block=_renamed(block, renamed),
        findings=tuple(map(finding, solution.findings)),
        causes=tuple(map(cause, solution.causes)),
    )
    kinds = [kind for table, kind, _ in _KINDS for _ in renamed.get(table, {})]
    pairs = [pair for names in renamed.values() for pair in names.items()]
    columns = sheet(
        ("Kind", "A6", kinds),
        ("Printed", "A8", [new for _, new in pairs]),
        ("Name", "A100", [old for old, _ in pairs]),
    )
    page = Section(title="Names", head=columns.head(), lines=columns.lines(None), new_page=True)
    return Statistics(short_solution), [page]


def _renamed(block: Block, renamed: dict[str, dict[str, str]]) -> Block:
    """Return the block with other names."""
    tables = {
        name: replace(getattr(block, name), ids=np.array([of[old] for old in getattr(block, name).ids.tolist()]))
        for name, of in renamed.items()
    }
    return replace(block, **tables)
