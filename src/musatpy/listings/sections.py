"""Pages -> sections of rows: titles, headings, where columns stand; what goes over a page is one again."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Sequence, Set
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from musatpy.listings.findings import PagePlace
from musatpy.listings.lines import Paper, PrintedLine
from musatpy.listings.rules import ListingLayout
from musatpy.listings.tokens import PlacedToken, angle_of, begins_with_number, tokens_of, with_angles

PAGE_HEADERS = "Page headers"
_INDEX = "Index Of Pages"  # where pages break does not count

_RULE = re.compile(r"\s*[-=_][-=_\s]*[-=_]{2}\s*")
_GROUP = re.compile(r"[-=_]{1,}")
_DIGITS = re.compile(r"\d+")
_CELL = re.compile(r"\S+(?: \S+)*")
_DMS = re.compile(r"\bD +M +S\b|\bdeg\w*,? *min\w*,? *sec|\bDMS\b", re.IGNORECASE)
_CONTINUED = re.compile(r"(?<![\s,(-])[\s,(-]*+\b(?:continued|cont\.|cont'd|contd\.?)\)?\s*$", re.IGNORECASE)
_ID_HEADING = re.compile(
    r"(?:photo|frame|image|camera|station|exposure|point|control|group|unknown|with|pass|iteration|comp\.|mark|"
    r"strip|model|id|name|no\.?)(?=\b|$|\s)",
    re.IGNORECASE,
)
PHOTO = re.compile(r"photo|frame|image|exposure|camera with", re.IGNORECASE)
POINT = re.compile(r"point|control", re.IGNORECASE)
_UNITS = re.compile(r"\(?(m|mm|um|km|ft|microns?|arc sec|sec|rad|deg|degrees|gon|sigmas?|%)\)?", re.IGNORECASE)
_UNIT_BEHIND = re.compile(r"\((m|mm|um)\)$", re.IGNORECASE)
_TITLE_LINES, _HEAD_LINES = 6, 4


class PrintColumn(NamedTuple):
    """One column of a table."""

    name: str  # its heading lines, one blank apart, without the unit
    unit: str
    angle: bool  # degrees, minutes, seconds
    start: int
    end: int  # not included


class ListingRow(NamedTuple):
    """One line of a section that is neither title, heading nor rule."""

    line: PrintedLine
    ids: tuple[str, ...]  # what it is about: photo, point, ... or its label
    block: int  # rows between two rules have one number

    @property
    def name(self) -> str:
        """What findings call it."""
        return " ".join(filter(None, self.ids)) or self.text[:40]

    @property
    def text(self) -> str:
        """Its words, one blank apart."""
        return squeezed(self.line.text)

    @property
    def place(self) -> PagePlace:
        """Where it stands."""
        return PagePlace(page=self.line.page, line=self.line.number)


@dataclass(eq=False)
class ListingSection:
    """A titled run of rows; filled while pages are read."""

    title: str
    titles: list[PrintedLine] = field(default_factory=list)
    head: list[PrintedLine] = field(default_factory=list)  # rules included
    lines: list[tuple[PrintedLine, int]] = field(default_factory=list)  # with their block
    ruled: bool = False  # rules stand between rows
    blank: Set[str] = frozenset()  # columns that may be blank, whatever the other file has there

    @property
    def ids(self) -> tuple[str, ...]:
        """What it is called, whatever numbers its title has."""
        return (_DIGITS.sub("#", self.title) or " ",)

    @cached_property
    def head_texts(self) -> frozenset[str]:
        """The heading lines."""
        return frozenset(line.text for line in self.head)

    @cached_property
    def angles(self) -> bool:
        """True where title or headings speak of degrees, minutes and seconds."""
        return any(_DMS.search(line.text) for line in (*self.titles, *self.head))

    @cached_property
    def columns(self) -> tuple[PrintColumn, ...]:
        """The columns, none where there are no headings with a rule below them."""
        return tuple(columns_of([line.text for line in self.head]))

    @cached_property
    def grouped(self) -> bool:
        """True where the rule below the headings shows every column by its own dashes."""
        return bool(self.head) and len(_GROUP.findall(self.head[-1].text)) > 1

    @cached_property
    def label_heading(self) -> str:
        """How the headings begin, above the labels of the rows."""
        texts = [line.text.strip() for line in self.head if not is_rule(line.text)]
        return texts[-1] if texts else ""

    @cached_property
    def by_row(self) -> bool:
        """True where all fields of a row are about the same photos and points: no heading names one."""
        return self.grouped or not self.columns

    @cached_property
    def starts(self) -> list[int]:
        """Where the columns begin."""
        return [column.start for column in self.columns]

    @cached_property
    def id_columns(self) -> tuple[int, ...]:
        """The columns that name what a row is about: the first, and those after it whose headings say so.

        Where they name several rows alike, more columns with such headings help.
        """
        if not self.grouped:
            return ()
        named = [n == 0 or bool(_ID_HEADING.match(column.name)) for n, column in enumerate(self.columns)]
        leading = tuple(range(named.index(False))) if False in named else tuple(range(len(named)))
        texts = [line.text for line, _ in self.lines]
        end = self.columns[leading[-1]].end
        if len({text[:end].rstrip() for text in texts}) == len(texts):
            return leading
        return tuple(n for n, is_named in enumerate(named) if is_named)

    @cached_property
    def named_ids(self) -> dict[re.Pattern[str], list[int]]:
        """Which of the ids of a row of the table name photos, and which points."""
        headings = [self.columns[n].name for n in self.id_columns]
        return {kind: [n for n, name in enumerate(headings) if kind.match(name)] for kind in (PHOTO, POINT)}

    @cached_property
    def rows(self) -> list[ListingRow]:
        """All rows with their ids."""
        if self.grouped:
            texts = [line.text for line, _ in self.lines]
            spans = [(self.columns[n].start, self.columns[n].end) for n in self.id_columns]
            ids = zip(*([text[start:end].strip() for text in texts] for start, end in spans), strict=True)
            rows = [
                ListingRow(line, (label_of(line[0]),) if self.is_note(line[0]) else names, block)
                for (line, block), names in zip(self.lines, ids, strict=True)
            ]
        else:
            rows = [ListingRow(line, (label_of(line.text),), block) for line, block in self.lines]
        return _sharing_ids(rows) if self.ruled else rows

    @cached_property
    def template(self) -> re.Pattern[str]:
        """A row of a table whose fields all stay within their columns: one group for each column."""
        parts, place = [], 0
        for column in self.columns:
            parts.append(f" {{{column.start - place}}}(.{{{column.end - column.start}}})")
            place = column.end
        return re.compile("".join(parts) + " *")

    def is_note(self, text: str) -> bool:
        """Tell whether a line among the rows is a sentence: words that run over the gaps between columns."""
        if text[:1].isdigit() or self.template.fullmatch(text.ljust(self.columns[-1].end)):
            return False
        words = text.split()
        return sum(word[0].isalpha() for word in words) > max(3, len(words) // 2)

    def cells(self, text: str, *, angles: bool) -> list[tuple[int, list[PlacedToken]]]:
        """Return the tokens of a row by columns; column -1 holds what stands before the columns, or in none.

        With `angles`, degrees, minutes and seconds are one token: where headings speak of them, only below these.
        """
        placed = tokens_of(text)
        if not self.columns or (self.grouped and self.is_note(text)):
            return [(-1, with_angles(placed) if angles else placed)]
        label = _CELL.match(text)
        cells: dict[int, list[PlacedToken]] = {}
        for piece in with_angles(placed) if angles and not self.grouped else placed:
            cells.setdefault(self._column_of(piece, label.end() if label else 0), []).append(piece)
        for n, inside in cells.items() if angles and self.grouped else ():
            if len(inside) == 3 and (self.columns[n].angle or not self.angles):
                angle = angle_of([piece.token for piece in inside])
                cells[n] = [PlacedToken(angle, inside[0].start, inside[-1].end)] if angle else inside
        return sorted(cells.items())

    def _column_of(self, piece: PlacedToken, label: int) -> int:
        """Return the column of a token: the last whose dashes begin before its end, or whose heading ends nearest.

        Without dashes for each column, what stands before the end of the `label` of a row is in column -1.
        """
        if self.grouped:
            return max(bisect_right(self.starts, piece.end - 1) - 1, 0)
        if piece.start < label or (piece.end <= self.columns[0].start and piece.token.kind != "number"):
            return -1
        return min(range(len(self.columns)), key=lambda n: abs(self.columns[n].end - piece.end))


def squeezed(text: str) -> str:
    """Return a text with one blank between words."""
    return " ".join(text.split())


def is_rule(text: str) -> bool:
    """Tell whether a line is drawn: hyphens, equal signs, underscores."""
    return bool(text) and text.lstrip()[0] in "-=_" and _RULE.fullmatch(text) is not None


def label_of(text: str) -> str:
    """Return what a row without headings is about: its words up to a number or dots, or the integer before them.

    Empty where the row begins with a real number.
    """
    label: list[str] = []
    for word in text.split():
        if word.isdigit() and not label:
            return word
        if word.startswith("..") or begins_with_number(word):
            break
        label.append(word)
    return " ".join(label).rstrip("=:")


def columns_of(head: Sequence[str]) -> list[PrintColumn]:
    """Return the columns below headings, none where there are none."""
    if not head:
        return []
    texts = [text for text in head if not is_rule(text)]
    groups = [(match.start(), match.end()) for match in _GROUP.finditer(head[-1])]
    if len(groups) > 1:
        columns = []
        for start, end in groups:
            parts = [squeezed(text[start:end]) for text in texts]
            columns.append(_column([part for part in parts if part], start, end))
        return columns
    cells = list(_CELL.finditer(texts[-1]))
    if cells and cells[0].start() == 0:
        cells = cells[1:]  # the heading of the labels
    return [_column([squeezed(cell[0])], cell.start(), cell.end()) for cell in cells]


def numbered(names: Sequence[str]) -> list[str]:
    """Return headings, a second one of a name as `name#2`."""
    counts: Counter[str] = Counter()
    keys = []
    for name in names:
        counts[name] += 1
        keys.append(f"{name}#{counts[name]}" if counts[name] > 1 else name)
    return keys


def _column(parts: Sequence[str], start: int, end: int) -> PrintColumn:
    name = " ".join(parts)
    if len(parts) > 1 and (unit := _UNITS.fullmatch(parts[-1])):
        return PrintColumn(" ".join(parts[:-1]), unit[1].lower(), False, start, end)
    if len(parts) > 1 and _DMS.fullmatch(parts[-1]):
        return PrintColumn(" ".join(parts[:-1]), "", True, start, end)
    in_brackets = _UNIT_BEHIND.search(name)
    return PrintColumn(name, in_brackets[1].lower() if in_brackets else "", bool(_DMS.search(name)), start, end)


def _sharing_ids(rows: list[ListingRow]) -> list[ListingRow]:
    """Give the rows between two rules the id that one of them has, where the others are indented."""
    blocks: dict[int, list[ListingRow]] = {}
    for row in rows:
        blocks.setdefault(row.block, []).append(row)
    shared: list[ListingRow] = []
    for block in blocks.values():
        heads = [row for row in block if row.line.text[:1].strip()]
        if len(block) > 1 and len(heads) == 1:
            name = heads[0].line.text.split(None, 1)[0]
            for row in block:
                words = row.line.text.split()
                label = next((word for word in reversed(words) if word.isalpha()), words[0])
                shared.append(row._replace(ids=(name, label)))
        else:
            shared += block
    return shared


def sections_of(paper: Paper, layout: ListingLayout) -> list[ListingSection]:
    """Return the sections of a listing, the page headers first; an index of pages is none."""
    headers = ListingSection(PAGE_HEADERS, lines=[(line, 0) for line in paper.headers])
    reader = _PageReader(layout)
    for page in paper.pages:
        reader.page(page)
    sections = [section for section in (headers, *reader.sections) if section.lines or section.titles]
    return [section for section in sections if section.title != _INDEX]


class _PageReader:
    """Reads page after page; knows the section that it is in."""

    def __init__(self, layout: ListingLayout) -> None:
        self.layout = layout
        self.sections = [ListingSection("")]
        self.block = 0

    def page(self, lines: Sequence[PrintedLine]) -> None:
        """Read one page."""
        place, blanks = 0, 2  # a page starts like a section
        while place < len(lines):
            line = lines[place]
            end = self.title_end(lines, place, blanks) if line.text else place
            if end > place:
                place, blanks = self.section(lines, place, end), 0
                continue
            if line.text:
                self.row(line)
            blanks = 0 if line.text else blanks + 1
            place += 1

    def row(self, line: PrintedLine) -> None:
        """Take a line as a row, a rule, or the headings once more."""
        section = self.sections[-1]
        if is_rule(line.text):
            section.ruled = section.ruled or bool(section.lines)
            self.block += 1
        elif line.text not in section.head_texts:
            section.lines.append((line, self.block))

    def section(self, lines: Sequence[PrintedLine], start: int, end: int) -> int:
        """Begin a section with a title, unless the last one goes on; return the place behind its headings."""
        place = _first_written(lines, end)
        below = _head_end(lines, place)
        head = [line for line in lines[place:below] if line.text]
        text, last = squeezed(lines[start].text), self.sections[-1]
        title = _CONTINUED.sub("", text)
        if title != last.title or (title == text and {line.text for line in head} != last.head_texts):
            self.sections.append(ListingSection(title, titles=list(lines[start:end]), head=head))
        return below if head and head[0].text in self.sections[-1].head_texts else end

    def title_end(self, lines: Sequence[PrintedLine], place: int, blanks: int) -> int:
        """Return the end of a title that begins here; `place` if none does.

        Titles are lines of words behind two blank lines, or behind one where headings follow, and before another.
        """
        if self.layout.section:
            return place + any(pattern.search(lines[place].text) for pattern in self.layout.section)
        end = place
        while blanks and end < len(lines) and end - place < _TITLE_LINES and _is_title(lines[end].text):
            end += 1
        follows = _first_written(lines, end)
        if end == place or follows in (end, len(lines)):
            return place
        return end if blanks >= 2 or _head_end(lines, follows) > follows else place


def _first_written(lines: Sequence[PrintedLine], place: int) -> int:
    while place < len(lines) and not lines[place].text:
        place += 1
    return place


def _head_end(lines: Sequence[PrintedLine], start: int) -> int:
    """Return the end of headings: rules, some lines without a real number, a rule; `start` where there are none."""
    place = start
    while place < len(lines) and is_rule(lines[place].text):
        place += 1
    texts = place
    while place < len(lines) and place - texts < _HEAD_LINES and lines[place].text:
        if is_rule(lines[place].text):
            return place + 1 if place > texts else start
        if _REAL.search(lines[place].text):
            return start
        place += 1
    if place < len(lines) and place > texts and is_rule(lines[place].text):
        return place + 1
    return start


_REAL = re.compile(r"\d\.\d|(?<!\w)\.\d")


def _is_title(text: str) -> bool:
    """Tell whether a line is made of words: it begins with one, and numbers are the smaller part."""
    if not text or is_rule(text) or ". . ." in text or "...." in text or "===" in text:
        return False
    words = text.split()
    if not (words[0][0].isalpha() or words[0][0] in "(\"'"):
        return False
    letters = sum(character.isalpha() for character in text)
    return letters > 2 * sum(character.isdigit() for character in text)
