"""What a notebook shows below a cell whose value is a solution or a block."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from musatpy.model import Block, Solution
from musatpy.reports import bathymetric, positions
from musatpy.reports.editing import edited
from musatpy.statistics import Statistics

_ROWS = 12  # of a table that are shown
_REASONS = 5
_TEXT = 200  # characters of a title or a reason
_REPORTS = (positions.POSITIONS, bathymetric.DEPTHS, positions.GROUND_POINTS)


def to_html(shown: Solution | Block) -> str:
    """Return the verdict, the main numbers and the first rows of stations, depths and points of a solution as HTML.

    Of a block, its options and the sizes of its tables. At most 50 kB, with nothing but tables and paragraphs.
    """
    if isinstance(shown, Block):
        counts = [(name, str(table.count)) for name, table in shown.tables().items() if table.count]
        return "\n".join([_head(shown), _table(("Table", "Rows"), counts)])
    return "\n".join(_of_solution(Statistics(shown)))


def _head(block: Block) -> str:
    title = block.titles[0] if block.titles else "Job without a title"
    options = block.options
    words = ", ".join([f"MUSAT-{options.program}", options.system, options.refraction])
    return f"<p><strong>{_text(title)}</strong><br>{_text(words)}</p>"


def _of_solution(statistics: Statistics) -> Iterable[str]:
    solution, verdict = statistics.solution, statistics.verdict
    yield _head(statistics.block)
    numbers = [
        f"sigma0 {solution.sigma0:.4f}",
        f"degrees of freedom: {solution.degrees_of_freedom}",
        f"iterations: {len(solution.iterations)}",
    ]
    yield f"<p><strong>{_text(verdict.grade)}</strong>: {_text(', '.join(numbers))}</p>"
    reasons = [f"<li>{_text(f'{one.grade.lower()}: {one.text}')}</li>" for one in verdict.reasons[:_REASONS]]
    if len(verdict.reasons) > _REASONS:
        reasons.append(f"<li>and {len(verdict.reasons) - _REASONS} more</li>")
    if reasons:
        yield f"<ul>{''.join(reasons)}</ul>"
    for report in _REPORTS:  # the first rows of a table of the listing, as they are printed
        table = report.values(statistics)
        count, columns = table.count, report.side_by_side(table)
        if count:
            texts = [edited(str(column.edit), column.printed(table)[:_ROWS]) for column in columns]
            below = f"{count} rows, of which {_ROWS} are shown" if count > _ROWS else ""
            headings = [str(column.heading) for column in columns]
            yield _table(headings, zip(*texts, strict=True), report.title, below)


def _table(headings: Sequence[str], rows: Iterable[Sequence[str]], title: str = "", below: str = "") -> str:
    head = "".join(f'<th scope="col">{_text(" ".join(heading.split()))}</th>' for heading in headings)
    body = "".join(
        "<tr>" + "".join(f"<td>{_text(' '.join(cell.split()))}</td>" for cell in row) + "</tr>\n" for row in rows
    )
    caption = f"<caption>{_text(title)}</caption>" if title else ""
    end = f"<p>{_text(below)}</p>" if below else ""
    return f"<table>{caption}\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table>{end}"


def _text(text: str) -> str:
    return escape(text if len(text) <= _TEXT else f"{text[:_TEXT]}...")
