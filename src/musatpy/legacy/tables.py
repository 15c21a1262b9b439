"""Tables below a rule of dashes, which shows their columns: stations, points, control, residuals."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise

from musatpy.legacy.layout import Line
from musatpy.legacy.structures import Row, Table

_RULE = re.compile(r"^-{2,}(?:  -{2,})+$")
_CONTINUED = " (continued)"
_OPTION = re.compile(r"^(?P<name>\w.*?) \.{2,} (?P<value>\S.*)$")


def options_of(lines: Sequence[Line]) -> dict[str, str]:
    """Return the rows `name ..... value` of the options and the summary."""
    matches = (_OPTION.match(line.text) for line in lines)
    return {match["name"]: match["value"] for match in matches if match}


def tables_of(lines: Sequence[Line]) -> list[Table]:
    """Return the ruled tables in their order, pages of one table together."""
    tables: list[Table] = []
    for at, line in enumerate(lines):
        if not _RULE.match(line.text):
            continue
        table = _table(lines, at)
        title = table.title.removesuffix(_CONTINUED)
        if tables and title != table.title and tables[-1].title == title:
            last = tables.pop()
            table = Table(title=title, line=last.line, headings=last.headings, rows=last.rows + table.rows)
        tables.append(table)
    return tables


def _table(lines: Sequence[Line], at: int) -> Table:
    spans = [match.span() for match in re.finditer(r"-+", lines[at].text)]
    top = at
    while top > 0 and lines[top - 1].text:
        top -= 1
    head = [line.text for line in lines[top:at]]
    headings = tuple(_heading(head, span) for span in spans)
    above = next((line for line in reversed(lines[:top]) if line.text), lines[at])
    return Table(
        title=above.text.strip(),
        line=above.number,
        headings=headings,
        rows=tuple(_rows(lines, at + 1, headings, spans)),
    )


def _heading(head: Sequence[str], span: tuple[int, int]) -> str:
    """Return the upper line of a heading: the lower one is the unit where there are two."""
    parts = [text[slice(*span)].strip() for text in head]
    return next((part for part in parts if part), "")


def _rows(
    lines: Sequence[Line], first: int, headings: Sequence[str], spans: Sequence[tuple[int, int]]
) -> Iterator[Row]:
    """Yield rows until two blank lines, or a line that stands across the columns."""
    blanks = 0
    for at in range(first, len(lines)):
        line = lines[at]
        blanks = 0 if line.text else blanks + 1
        if not line.text and blanks < 2:
            continue
        gaps = [line.text[end:start] for (_, end), (start, _) in pairwise(spans)]
        if blanks == 2 or "".join(gaps).strip() or len(line.text) > spans[-1][1]:
            return
        cells = (line.text[slice(*span)].strip() for span in spans)
        yield Row(line=line.number, cells=dict(zip(headings, cells, strict=True)))
