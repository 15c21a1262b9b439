"""Samples of differences in numbers, and the orders of S-44, as tables of a page."""

from __future__ import annotations

from collections.abc import Sequence

from musatpy.page.accuracy import Depths, Sample
from musatpy.page.cells import cell_text, count_of, number_text
from musatpy.page.parts import Head, PageTable
from musatpy.page.stated import anchor_of, rows_at
from musatpy.plots.tables import Tables, part
from musatpy.reports import analyses
from musatpy.soundings.s44 import source

SAMPLES = "Control And Check Points: Adjusted Minus Given"
ORDERS = "Orders Of S-44 Met By The Depths"
_METRES = "m"
_UNITS = {"rad": "° ′ ″"}


def sample_table(every: Sequence[Sample]) -> PageTable:
    """Return samples of control and check points in numbers, as the analyses of the listing define them."""
    rows = []
    for sample in every:
        s = sample.statistics
        values = [number_text(value, 3) for value in (s.mean, s.rms, s.deviation, s.maximum)]
        rows.append([sample.what, sample.component, f"{s.size:,}", *values, s.maximum_id])
    return PageTable(
        title=SAMPLES,
        anchor=anchor_of(SAMPLES),
        heads=[
            Head(text="Points", is_id=True, is_text=True),
            Head(text="Component", is_id=True, is_text=True),
            Head(text="Number"),
            *(Head(text=text, unit=_METRES) for text in ("Mean", "RMS", "Standard deviation", "Maximum")),
            Head(text="At point", is_text=True),
        ],
        rows=rows,
        total=len(rows),
        note="Components of control are those that took part. Depths are positive downwards.",
    )


def analysis_table(tables: Tables, path: str, title: str, row: str, *, folded: bool = True) -> PageTable | None:
    """Return one of the standard analyses, a row for each component; None where the record has none."""
    table = part(tables, path)
    components = rows_at(table, range(len(table.get("component", ()))))
    if not components:
        return None
    rows = []
    for values in components:
        unit = str(values.get("unit", _METRES))
        numbers = [cell_text(analyses.EDITS[unit], values[name]) for _, name in analyses.ROWS]
        head = [values["component"], _UNITS.get(unit, unit), f"{values['size']:,}"]
        rows.append([*head, *numbers, values["maximum_id"] or ""])
    return PageTable(
        title=title,
        anchor=anchor_of(title),
        heads=[
            Head(text="Component", is_id=True, is_text=True),
            Head(text="Unit", is_text=True),
            *(Head(text=text) for text in ("Sample Size", *(label for label, _ in analyses.ROWS))),
            Head(text=f"{row} with Max. Difference", is_text=True),
        ],
        rows=rows,
        total=len(rows),
        folded=folded,
    )


def orders_table(depths: Depths) -> PageTable | None:
    """Return how many submerged points meet each order of S-44; None where no depth has a covariance."""
    count, shares = int(depths.ranked.sum()), depths.shares()
    if not count:
        return None
    return PageTable(
        title=ORDERS,
        anchor=anchor_of(ORDERS),
        heads=[
            Head(text="Order", is_id=True, is_text=True),
            Head(text="Points that meet it"),
            Head(text="Share", unit="%"),
        ],
        rows=[[order, f"{met:,}", number_text(100.0 * met / count, 1)] for order, met in shares],
        total=len(shares),
        note=f"{source()}, by the sigmas of {count_of(count, 'submerged point')}.",
    )
