"""Pages for a 132-column printer: sections of lines laid out on pages of 60 lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from musatpy.errors import printable

PAGE_WIDTH = 132
PAGE_LINES = 60

_HEADER_LINES = 2  # the header and a blank line
BODY_LINES = PAGE_LINES - _HEADER_LINES
GAP = 2  # blank lines between two sections of a page
_FEWEST_ROWS = 4  # rows that a page break leaves together with their heading


Cells = list[list[Any]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Section:
    """A titled run of lines; where it goes over to a new page, title and column headings are printed again."""

    title: str  # one or more lines, parted by line feeds
    head: Sequence[str] = ()  # column headings
    lines: Sequence[str] = ()
    new_page: bool = False  # starts a page
    together: bool = False  # never broken, unless longer than a page
    worst: Sequence[int] = ()  # lines that a brief listing may cut, the worst, which it cuts last, first
    values: Callable[[], Cells] | None = None  # of a table: its heads and rows at full precision

    def top(self, *, continued: bool = False) -> list[str]:
        """Return title, a blank line and column headings."""
        first, *others = self.title.split("\n")
        return [f"{first} (continued)" if continued else first, *others, "", *self.head]


def paginate(sections: Sequence[Section]) -> list[list[str]]:
    """Return the pages, each a list of at most 58 body lines (headers not included)."""
    return laid_out(sections)[0]


def laid_out(sections: Sequence[Section]) -> tuple[list[list[str]], list[int]]:
    """Return the pages as `paginate` does, and the number of the page, from 1, on which each section begins."""
    pages: list[list[str]] = [[]]
    starts = []
    for section in sections:
        if pages[-1] and (section.new_page or not _fits(section, pages[-1])):
            pages.append([])
        elif pages[-1]:
            pages[-1] += [""] * GAP
        starts.append(len(pages))
        pages[-1] += section.top()
        done = 0
        while len(section.lines) - done > (room := BODY_LINES - len(pages[-1])):
            pages[-1] += section.lines[done : done + room]
            done += room
            while not pages[-1][-1]:  # a blank line before the page break is one too many
                pages[-1].pop()
            pages.append(section.top(continued=True))
        pages[-1] += section.lines[done:]
    return pages, starts


def print_pages(
    pages: Sequence[Sequence[str]], header: Callable[[int], str], *, carriage_control: bool, caution: str = ""
) -> str:
    """Return the listing: every page below `header(page number)`, and below what is to be said on every page.

    With `carriage_control`, ASA characters stand in column 1 (`1` new page, `0` after a blank line, `-` after two,
    blank next line) and the text from column 2 on; otherwise a form feed starts every page but the first.
    """
    return "".join(page_texts(pages, header, carriage_control=carriage_control, caution=caution))


def page_texts(
    pages: Sequence[Sequence[str]], header: Callable[[int], str], *, carriage_control: bool, caution: str = ""
) -> Iterator[str]:
    """Yield the text of `print_pages` page by page."""
    for number, body in enumerate(pages, start=1):
        page = [header(number), f"*** {caution.upper()} ***" if caution else "", *body]
        if not "".join(page).isprintable():  # names of soundings and photos come from anybody's files
            page = [printable(line).replace("\n", "\\n") for line in page]
        if carriage_control:
            page = list(_with_control(page))
        elif number > 1:
            page[0] = "\f" + page[0]
        yield "\n".join(page) + "\n"


def print_titled(title: str, sections: Sequence[Section], caution: str = "") -> str:
    """Return sections as a listing whose pages have a title and their number above them, and a caution."""
    pages, _ = laid_out(sections)
    return print_pages(
        pages,
        lambda page: f"{title}{f'PAGE {page:6d}':>{PAGE_WIDTH - len(title)}}",
        carriage_control=False,
        caution=caution,
    )


def _fits(section: Section, page: Sequence[str]) -> bool:
    rows = len(section.lines)
    if not section.together:
        rows = min(rows, _FEWEST_ROWS)
    return len(page) + GAP + len(section.top()) + rows <= BODY_LINES


def _with_control(page: Sequence[str]) -> Iterator[str]:
    """Yield the lines of a page with ASA control characters; blank lines become double and triple spacing."""
    yield "1" + page[0]
    skipped = 0
    for line in page[1:]:
        if not line and skipped < 2:
            skipped += 1
            continue
        yield " 0-"[skipped] + line
        skipped = 0
