"""Pages for a 132-column printer: sections of lines laid out on pages of 60 lines."""

from __future__ import annotations

import csv
import datetime
import io
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from musatpy.errors import printable, without_names

PAGE_WIDTH = 132
PAGE_LINES = 60

_HEADER_LINES = 2  # the header and a blank line
BODY_LINES = PAGE_LINES - _HEADER_LINES
GAP = 2  # blank lines between two sections of a page
MOST_PAGES = 40  # of a brief listing, those of the answer and the index included
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


def page_texts(
    pages: Sequence[Sequence[str]], header: Callable[[int], str], *, carriage_control: bool, caution: str = ""
) -> Iterator[str]:
    """Yield the listing page by page, each below `header(page number)`, and below what is to be said on every page.

    With `carriage_control`, ASA characters stand in column 1 (`1` new page, `0` after a blank line, `-` after two,
    blank next line) and the text from column 2 on; otherwise a form feed starts every page but the first.
    """
    for number, body in enumerate(pages, start=1):
        page = [header(number), f"*** {caution.upper()} ***" if caution else "", *body]
        if not "".join(page).isprintable():  # names of soundings and photos come from anybody's files
            page = [printable(line).replace("\n", "\\n") for line in page]
        if carriage_control:
            page = list(_with_control(page))
        elif number > 1:
            page[0] = "\f" + page[0]
        yield "\n".join(page) + "\n"


def headed(title: str, date: datetime.date | None = None) -> Callable[[int], str]:
    """Return the header of a page by its number: a title, a date where there is one, and the number."""
    day = date.isoformat() if date else ""
    return lambda page: f"{title}{f'{day}  PAGE {page:6d}':>{PAGE_WIDTH - len(title)}}"


def print_titled(
    kind: str,
    title: str,
    sections: Sequence[Section],
    caution: str = "",
    *,
    mark: str = "",
    carriage_control: bool = False,
    date: datetime.date | None = None,
) -> str:
    """Return sections as a listing of a kind, whose pages are `headed` by it, its title and a mark of its worth."""
    header = headed(f"MUSATPY  {kind}  {title:<60.60}  {mark}", date)
    return "".join(page_texts(paginate(sections), header, carriage_control=carriage_control, caution=caution))


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


_LABEL_WIDTH = 50


def text_of(lines: Iterable[str]) -> str:
    """Return the text of lines, safe for a terminal."""
    return printable("".join(f"{line}\n" for line in lines))


def labelled(values: Mapping[str, str]) -> list[str]:
    """Return one line per entry, the label led to its value by dots."""
    return [f"{label + ' ':.<{_LABEL_WIDTH}} {value}" for label, value in values.items()]


def wrapped(sentences: Iterable[str], *, lead: str = "") -> list[str]:
    """Return the sentences broken to the width of the paper, each behind `lead` and indented below it."""
    lines: list[str] = []
    for sentence in sentences:
        lines += textwrap.wrap(
            sentence, width=PAGE_WIDTH, initial_indent=lead, subsequent_indent=" " * len(lead)
        ) or [lead.rstrip()]
    return lines


def by_kind(texts: Sequence[str], *, shown: int) -> list[list[str]]:
    """Return the lines of texts by kind: texts that differ in names and numbers only.

    Of each kind `shown` texts, and how many more there are.
    """
    kinds: dict[str, list[str]] = {}
    for text in texts:
        kinds.setdefault(without_names(text), []).append(text)
    return [
        wrapped(alike[:shown], lead="- ") + ([f"and {len(alike) - shown} more of this kind"] * (len(alike) > shown))
        for alike in kinds.values()
    ]


_FORMULA = re.compile(r"\s*[=+\-@]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def csv_files(sections: Iterable[Section], listing: Path) -> dict[Path, bytes]:
    """Return the files in a folder beside a `listing`: tables by their titles, `Air Bases` in `air_bases.csv`."""
    folder = listing.with_name(f"{listing.stem}_tables")
    tables = ((section.title, section.values) for section in sections if section.values is not None)
    return {folder / f"{_name(title)}.csv": _text(values()).encode() for title, values in tables}


def _name(title: str) -> str:
    text = re.sub(r": \d+$", "", title.split("\n")[0])  # how many rows there are
    return "_".join(re.findall(r"[a-z0-9.]+", text.lower()))


def _text(rows: Cells) -> str:
    """Return the rows of a table below its heads; a second head of a name is numbered."""
    file = io.StringIO()
    heads, *values = rows
    counts = [heads[:number].count(head) + 1 for number, head in enumerate(heads)]
    names = [f"{head} {count}" if count > 1 else head for head, count in zip(heads, counts, strict=True)]
    csv.writer(file, lineterminator="\n").writerows([names, *([_cell(value) for value in row] for row in values)])
    return file.getvalue()


def _cell(value: Any) -> Any:
    """Return what stands in a cell: nothing for a number that does not exist, and a text that stays one."""
    if isinstance(value, str):
        return as_text(value)
    return "" if value is None or (isinstance(value, float) and not math.isfinite(value)) else value


def as_text(text: str) -> str:
    """Return a text as spreadsheets take it for one: a blank stands before what they would compute.

    No id begins with a blank, and who strips them, as every reader of this program does, has the text again.
    """
    return f" {text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text
