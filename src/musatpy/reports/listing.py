"""The listing of a job: the answer, an index, and every report, on pages for a 132-column printer."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any

from musatpy.formats.short_ids import short_block
from musatpy.model import Solution
from musatpy.model.progress import Progress, begin
from musatpy.reports import answer
from musatpy.reports.fields import Document
from musatpy.reports.pages import MOST_PAGES, Section, headed, laid_out, page_texts, paginate
from musatpy.reports.table import Labels, Report, Texts, sheet
from musatpy.statistics import Statistics

_PAGES = (  # modules of this room
    "titles echo reduction iterations blunders analyses bathymetric adjusted_water parameters statistical_tests "
    "common_errors positions control kinds residuals"
)
_OF_OTHERS = (  # of programs that most jobs need not
    "orientation orientation_strip compilation compilation_bottom compilation_points soundings"
)


def _modules(names: str) -> tuple[ModuleType, ...]:
    return tuple(import_module(f"musatpy.reports.{name}") for name in names.split())


REPORTS = _modules(_PAGES)

_FRONT_PAGES = 2
_NAMED = {"photos": "photo", "points": "point"}  # tables whose names may be too long for columns
_ALL = 10**9
# Rows of tables that have to be cut: first those of statistics, then those of points, stations last.
_STEPS = (
    *((40, _ALL, rows) for rows in (_ALL, 400, 300, 200, 150, 100)),
    *((20, rows, rows) for rows in (300, 200, 100, 70, 50, 35, 20)),
)
_STATISTICS, _STATIONS = ("Statistics: ", "Plate Residuals By Photo"), "Adjusted Exposure Stations"


def uncut(statistics: Statistics) -> list[Section]:
    """Return the sections of a brief listing with all of their rows: `brief` of pages that have it, else all.

    Where `brief` is None, the page is left out.
    """
    pages = [getattr(page, "brief", page.sections) for page in REPORTS]
    return [section for page in pages if page for section in page(statistics)]


def brief_sections(statistics: Statistics) -> list[Section]:
    """Return the sections of the brief listing."""
    whole = shortened = uncut(statistics)
    for limits in _STEPS:
        if len(paginate(shortened)) <= MOST_PAGES - _FRONT_PAGES:
            break
        shortened = [_cut(section, limits[_kind(section.title)]) for section in whole]
    return shortened


def _kind(title: str) -> int:
    """Return which of the limits of a step a table has."""
    return 0 if title.startswith(_STATISTICS) else 1 if title.startswith(_STATIONS) else 2


def _cut(section: Section, rows: int) -> Section:
    """Return a table with no more than so many of its rows, the worst, in the order that they had."""
    count = len(section.worst)
    if count <= rows:
        return section
    left_out = set(section.worst[rows:])
    lines = [line for number, line in enumerate(section.lines) if number not in left_out]
    return replace(section, lines=[*lines, "", f"Only the worst {rows} of {count} rows are listed here."], worst=())


_TITLE_WIDTH = 68


def listing(
    solution: Solution, *, carriage_control: bool = False, date: datetime.date | None = None, brief: bool = False
) -> str:
    """Return the listing of a solution, converged or not.

    Pages have 60 lines of 132 columns, `carriage_control` puts ASA characters before them. A `brief` listing has
    neither the echo of the input nor residuals, and of tables that would fill more than 40 pages the worst rows.
    The text depends on nothing but the arguments; a `date` is printed only where one is given.
    """
    shown, sections = in_columns(Statistics(solution), brief=brief)
    return "".join(printed(shown, sections, carriage_control=carriage_control, date=date))


def in_columns(
    statistics: Statistics, *, brief: bool = False, progress: Progress | None = None
) -> tuple[Statistics, list[Section]]:
    """Return statistics with names that go into columns, and their sections; the last one is of these names."""
    shown, names = with_short_names(statistics)
    return shown, [*sections_of(shown, brief=brief, progress=progress), *names]


def with_short_names(statistics: Statistics) -> tuple[Statistics, list[Section]]:
    """Return statistics with names that go into columns, and the page that says whose they are.

    They are the same where all names fit.
    """
    solution = statistics.solution
    block, renamed = short_block(statistics.block, _NAMED)
    if not renamed:
        return statistics, []
    photos, points = ({old: new for of, new, old in renamed if of == table} for table in _NAMED)
    findings = (
        replace(one, photo=photos.get(one.photo, one.photo), point=points.get(one.point, one.point))
        for one in solution.findings
    )
    causes = (
        replace(
            one,
            photos=tuple(photos.get(name, name) for name in one.photos),
            points=tuple(points.get(name, name) for name in one.points),
        )
        for one in solution.causes
    )
    short = replace(solution, block=block, findings=tuple(findings), causes=tuple(causes))
    columns = sheet(
        ("Kind", "A6", [_NAMED[table] for table, _, _ in renamed]),
        ("Printed", "A8", [new for _, new, _ in renamed]),
        ("Name", "A100", [old for _, _, old in renamed]),
    )
    page = Section(title="Names", head=columns.head(), lines=columns.lines(None), new_page=True)
    return Statistics(short), [page]


def sections_of(statistics: Statistics, *, brief: bool = False, progress: Progress | None = None) -> list[Section]:
    """Return what the pages of a listing behind the answer say."""
    if brief:
        begin(progress, "listing: report", 1, 1)
        return brief_sections(statistics)
    sections: list[Section] = []
    for number, report in enumerate(REPORTS, 1):
        begin(progress, "listing: report", number, len(REPORTS))
        sections += report.sections(statistics)
    return sections


def printed(
    statistics: Statistics, sections: Sequence[Section], *, carriage_control: bool, date: datetime.date | None
) -> Iterator[str]:
    """Return the listing with these sections, page by page; of a run that is not accepted every page says so."""
    options, titles = statistics.block.options, statistics.block.titles
    mark = answer.MARKS.get(statistics.verdict.grade, "")
    room = _TITLE_WIDTH - len(mark) - 2 * bool(mark)
    title = titles[0][:room] if titles else ""
    left = f"MUSATPY  MUSAT-{options.program}  {title:<{room}}{'  ' * bool(mark)}{mark}"
    body, starts = laid_out(sections)
    names = [section.title.split("\n")[0] for section in sections]
    count = _FRONT_PAGES  # the first pages have as many lines wherever the others begin
    while len(front := _front(statistics, names, [count + start for start in starts])) != count:
        count = len(front)
    return page_texts([*front, *body], headed(left, date), carriage_control=carriage_control)


def _front(statistics: Statistics, names: Sequence[str], starts: Sequence[int]) -> list[list[str]]:
    """Return the pages of the answer and the index, of sections with these titles that begin on these pages."""
    places = dict(reversed(list(zip(names, starts, strict=True))))

    def page_of(beginning: str) -> int:
        return places.get(beginning) or next(
            (page for name, page in zip(names, starts, strict=True) if name.startswith(beginning)), 0
        )

    first = answer.sections(statistics, page_of)
    pages, _ = laid_out([*first, answer.index(names, starts, new_page=False)])
    if len(pages) == len(laid_out(first)[0]):
        return pages
    return laid_out([*first, answer.index(names, starts, new_page=True)])[0]


@cache
def statements() -> tuple[Report[Any] | Labels | Texts, ...]:
    """Return the tables of all pages of all listings, and what else has numbers of the record, the answer first."""
    pages = (answer, *REPORTS, *_modules(_OF_OTHERS))
    return tuple(table for page in pages for table in getattr(page, "STATED", ()))


def documents() -> Iterator[Document[Any]]:
    """Yield what states the records of other programs than that of jobs."""
    yield from (one for page in _modules(_OF_OTHERS) for one in vars(page).values() if isinstance(one, Document))
