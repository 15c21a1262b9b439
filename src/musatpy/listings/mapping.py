"""Where the numbers of a listing stand in its record, as the reports state it."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

from musatpy.listings.printed import numbered
from musatpy.listings.sections import columns_of
from musatpy.reports.origin import Mapped, Origin
from musatpy.reports.table import Report, Table


@lru_cache(maxsize=1)
def mapped_sections() -> tuple[Mapped, ...]:
    """Return all sections that have numbers in the record."""
    from musatpy.reports.statements import statements  # two listings need them not

    found = (one if isinstance(one, Mapped) else _mapped(one) for one in statements())
    return tuple(one for one in found if one.table or one.layout == "labels")


def mapped_section(title: str) -> Mapped | None:
    """Return what is known of the section of a title, None where it has no numbers in the record."""
    return next((one for one in mapped_sections() if re.fullmatch(one.title, title)), None)


def _mapped(report: Report[Any]) -> Mapped:
    ids: dict[str, str] = {}
    columns: dict[str, Origin] = {}
    for layout in report.layouts():
        names = numbered([column.name for column in columns_of(Table(layout).head())])
        for name, column in zip(names, layout, strict=True):
            if column.origin and column.is_id:
                ids[name] = column.origin.field
            elif column.origin:
                columns[name] = column.origin
    return Mapped(
        title=report.pattern or re.escape(report.title),
        table=report.place,
        ids=ids,
        columns=columns,
        nested=report.nested,
        expand=report.expand,
        take=report.take,
        leave=report.leave,
        words=report.words,
        some=report.some,
        unnamed=report.unnamed,
    )
