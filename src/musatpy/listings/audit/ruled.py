"""Tables below a rule of dashes, which shows their columns: stations, points, control, residuals.

What a column holds shows in its cells: counts, numbers of so many decimals, angles, or words. A row that does not
stand in its columns, or has a cell unlike the others, is read with the repairs of scanned text: each of its words
belongs to the column that it stands in most.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from itertools import chain, groupby, pairwise, zip_longest
from operator import itemgetter
from typing import NamedTuple

from musatpy.errors import Problem
from musatpy.listings.audit.cells import Kind, all_are, read_cells
from musatpy.listings.audit.columns import Cells, Spans, sliced
from musatpy.listings.audit.headings import audited_tables, names_of, put_right
from musatpy.listings.audit.notes import Notes
from musatpy.listings.audit.scan import Line
from musatpy.listings.audit.spelling import canonical, lookalike, noisy_pattern, respelt
from musatpy.listings.audit.structures import RepairKind, Table
from musatpy.listings.lines import CUT

_RULE = re.compile(r"^-+(?:  -+)+$")
_CONTINUED = " (continued)"
_CONTINUES = re.compile(rf"[\W_]*{noisy_pattern('continued')}\W*$", re.I)
_KINDS: Mapping[Kind, re.Pattern[str]] = {
    "count": re.compile(r"-?\d+"),
    "number": re.compile(r"-?\d*\.\d+(?:E[+-]\d+)?"),
    "angle": re.compile(r"-?\d+ +\d+ +\d*\.\d+"),
}
_BROKEN = re.compile(r"[^A-Za-z]*\d[^A-Za-z]*|[\d.lIOo\u2022]+")  # a number, or what noise makes of one
_OVERFLOW = re.compile(r"\*+")
_NAMES = ("Photo", "Point", "Camera", "Group", "Mark")  # headings of ids
_UNIFORM = 0.8  # of the numbers of a column must have the decimals that all should have
_MOST = 0.6  # of the cells of a column must be of one kind
_RARE, _FREQUENT = 2, 3  # a word as rare as this is one as frequent as that, where noise alone makes the difference
_NONE: Counter[str] = Counter()  # words of a column that has none
JOB_HEADING, JOB_ROWS = "Points", ("triangulated", "not triangulated", "all")  # of the plate residuals of the job
_JOB_WORDS = {canonical(word): word for word in JOB_ROWS}
_NUMBERS = 0.4  # of the words of a row at least have a digit
_MARKS = ("*", '"')  # of our tables, a large residual and arc seconds; no stray characters
# How titles of our listings begin; those of the tables that the audit uses are taken whole.
BEGINNINGS = ("Blunders: ", "Input: ", "Passes Of ", "Plate Reduction: ", "Statistics: ", "Water: ")


@cache
def titles() -> tuple[str, ...]:
    """Return the titles of the tables of our listings that are more than a beginning."""
    from musatpy.reports.statements import table_titles  # a listing is read before it is known to be ours

    return tuple(title for title in table_titles() if title in audited_tables() or not title.startswith(BEGINNINGS))


@cache
def _known() -> dict[str, str]:
    """Return the titles by their canonical form, the first where several have one."""
    return {canonical(title): title for title in reversed(titles())}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Raw:
    """A table as its lines stand."""

    title: str
    line: int
    head: Line  # the first of its headings
    headings: tuple[str, ...]
    units: tuple[str, ...]
    right: tuple[bool, ...]  # headings that end where their column does: those of numbers
    pages: list[tuple[Spans, list[Line]]]  # the columns of each page, and its rows

    @cached_property
    def rows(self) -> list[Line]:
        """The rows of all pages."""
        return list(chain.from_iterable(rows for _, rows in self.pages))

    @cached_property
    def cells(self) -> list[Cells]:
        """The cells of each column."""
        return self._parted[0]

    @property
    def loose(self) -> list[int]:
        """Which rows do not stand in their columns: each word is in the column that it stands in most."""
        return self._parted[1]

    @cached_property
    def columns(self) -> list[Cells]:
        """The cells of each column, of the rows that stand in their columns."""
        if not self.loose:
            return self.cells
        loose = set(self.loose)
        return [Cells([cell for n, cell in enumerate(column) if n not in loose]) for column in self.cells]

    @cached_property
    def _parted(self) -> tuple[list[Cells], list[int]]:
        parts: list[list[Cells]] = []
        loose: list[int] = []
        done = 0
        for spans, pages in groupby(self.pages, key=itemgetter(0)):  # most tables have one set of columns
            rows = [line.text for _, lines in pages for line in lines]
            columns, others = _cells(rows, spans)
            parts.append(columns)
            loose += [done + n for n in others]
            done += len(rows)
        if len(parts) == 1:
            return parts[0], loose
        return [Cells(list(chain.from_iterable(column))) for column in zip(*parts, strict=True)], loose


@dataclass(frozen=True, kw_only=True)
class _Column:
    """What a column holds: numbers of a kind, or words (None); their decimals where all have the same."""

    heading: str
    kind: Kind | None
    decimals: int | None

    @property
    def name(self) -> str:
        """What is common to columns of the same words: `Point` of a second `Point`."""
        first, *rest = self.heading.split(" ")
        return first if first in _NAMES and rest and rest[-1].isdigit() else self.heading


def tables_of(lines: Sequence[Line], notes: Notes) -> list[Table]:
    """Return the ruled tables in their order, pages of one table together."""
    lines = [line._replace(text=line.text.expandtabs()) if "\t" in line.text else line for line in lines]
    tables: list[_Raw] = []
    titles = set()
    for at, line in enumerate(lines):
        if not line.text.startswith("-") or not _RULE.match(line.text):
            continue
        table, continued = _titled(_raw(lines, at), notes)
        titles.add(table.line)
        before = tables[-1] if tables and continued and tables[-1].title == table.title else None
        if before and len(before.headings) != len(table.headings):
            notes.lost(line, f"a page of '{table.title}' that has other columns than the page before")
        elif before:
            before.pages.extend(table.pages)
            continue
        headings = put_right(table.title, table.head, table.headings, notes)
        tables.append(replace(table, headings=headings))
    _note_without_rule(lines, titles, notes)
    columns = [tuple(map(_column, raw.headings, raw.units, raw.right, raw.columns)) for raw in tables]
    with_columns = list(zip(tables, columns, strict=True))
    words = _Words(with_columns)
    notes.ids.update(words.ids())
    return [_table(*table, words, notes) for table in with_columns]


def whole_tables(tables: Sequence[Table], worded: Sequence[Line]) -> tuple[Table, ...]:
    """Return the tables without those that a brief listing has cut to their worst rows."""
    cuts = [line.number for line in worded if CUT.match(line.text)]
    ends = [*(table.line for table in tables[1:]), math.inf]
    return tuple(
        table
        for table, end in zip(tables, ends, strict=False)
        if not any(table.line < number < end for number in cuts)
    )


def _note_without_rule(lines: Sequence[Line], titles: set[int], notes: Notes) -> None:
    """Note titles that no table belongs to: the rule below its headings is not legible."""
    wanted = {canonical(title) + end: title for title in audited_tables() for end in ("", canonical(_CONTINUED))}
    for line in lines:
        title = wanted.get(line.canonical)
        if title and line.number not in titles:
            notes.lost(line, f"the rule of dashes below the headings of '{title}' is not legible")


def _raw(lines: Sequence[Line], at: int) -> _Raw:
    top = at
    while top > 0 and lines[top - 1].text:
        top -= 1
    head = _headed(lines[at].text, tuple(line.text for line in lines[top:at]))
    above = next((lines[n] for n in range(top - 1, -1, -1) if lines[n].text), lines[at])
    return _Raw(
        title=above.text.strip(),
        line=above.number,
        head=lines[top],
        headings=head.headings,
        units=head.units,
        right=head.right,
        pages=[(head.spans, list(_rows(lines, at + 1, head.spans)))],
    )


class _Head(NamedTuple):
    """The headings of a table, which are the same on each of its pages."""

    spans: Spans
    headings: tuple[str, ...]
    units: tuple[str, ...]
    right: tuple[bool, ...]


@lru_cache(maxsize=256)
def _headed(rule: str, texts: tuple[str, ...]) -> _Head:
    """Return what lines of headings say above a rule."""
    spans = tuple(match.span() for match in re.finditer(r"-+", rule))
    head = [[text[slice(*span)].strip() for text in texts] for span in spans]
    parts = [[part for part in words if part] for words in head]
    return _Head(
        spans=spans,
        headings=names_of(parts),
        units=tuple(words[1] if len(words) > 1 else "" for words in parts),
        right=tuple(
            any(re.match(r" .*\S$", text[start:end].ljust(end - start)) for text in texts) for start, end in spans
        ),
    )


def _rows(lines: Sequence[Line], first: int, spans: Spans) -> Iterator[Line]:
    """Yield rows until two blank lines, or one blank line and then prose that stands across the columns."""
    before = lines[first - 1]
    for at in range(first, len(lines)):
        line = lines[at]
        if not line.text:
            if not before.text:
                return
        else:
            if (not before.text or before.text[0] == "-") and _ends(line, before, spans):
                return
            yield line
        before = line


def _ends(line: Line, before: Line, spans: Spans) -> bool:
    """Tell whether a line is no row but prose behind a table."""
    if before.text and not _RULE.match(before.text):
        return False
    if _in_columns(spans).fullmatch(line.text.ljust(spans[-1][1])):
        return False
    words = line.text.split()
    return sum(bool(re.search(r"\d", word)) for word in words) < _NUMBERS * len(words)


def _cells(rows: Sequence[str], spans: Spans) -> tuple[list[Cells], list[int]]:
    """Return the cells of each column, and which rows do not stand in the columns."""
    width = spans[-1][1]
    texts = [row.ljust(width) for row in rows]
    columns = sliced(texts, spans)
    if columns is not None:
        return columns, []
    row = _in_columns(spans)
    are_loose = [row.fullmatch(text) is None for text in texts]
    cells = [
        _parted(text, spans) if is_loose else [text[start:end].strip() for start, end in spans]
        for text, is_loose in zip(texts, are_loose, strict=True)
    ]
    columns = [Cells(column) for column in zip(*cells, strict=True)]
    return columns, [n for n, is_loose in enumerate(are_loose) if is_loose]


@lru_cache(maxsize=64)
def _in_columns(spans: Spans) -> re.Pattern[str]:
    """Return the pattern of a row that stands in columns: nothing is between them."""
    gaps = [rf"[^\S\n]{{{start - end}}}" for (_, end), (start, _) in pairwise(spans)]
    cells = [f".{{{end - start}}}" for start, end in spans]
    return re.compile(f".{{{spans[0][0]}}}" + "".join(chain(*zip_longest(cells, gaps, fillvalue=""))))


def _titled(raw: _Raw, notes: Notes) -> tuple[_Raw, bool]:
    """Return a table with its title put right, and whether it continues one; a title that is unknown is noted."""
    title = _CONTINUES.sub("", raw.title)
    continued = title != raw.title
    read = _known().get(canonical(title))
    for beginning in BEGINNINGS if read is None else ():
        noisy = re.match(rf"{noisy_pattern(beginning)}\W*", title, re.I)
        if noisy:
            read = title if title.startswith(beginning) else beginning + title[noisy.end() :]
            break
    if read is None and raw.pages[0][1]:
        notes.lost(Line(raw.line, raw.title), f"a table under the unknown title '{raw.title}'")
    whole = (title if read is None else read) + _CONTINUED * continued
    if whole != raw.title:
        notes.repairs.extend(respelt(raw.line, raw.title, whole))
    return replace(raw, title=whole.removesuffix(_CONTINUED)), continued


class _Words:
    """How often the words of a listing stand in its columns of words, by the headings of these."""

    def __init__(self, tables: Sequence[tuple[_Raw, tuple[_Column, ...]]]) -> None:
        self._counts: dict[str, Counter[str]] = {}
        self._best: dict[tuple[str, str], str] = {}
        for raw, columns in tables:
            for column, cells in zip(columns, raw.columns, strict=True):
                if column.kind is None:
                    self._counts.setdefault(column.name, Counter()).update(filter(None, cells))
        for name, counts in self._counts.items():
            for word, _ in counts.most_common():
                self._best.setdefault((name, lookalike(word)), word)

    def put_right(self, column: _Column, word: str) -> str:
        """Return a word as the listing has it elsewhere, where that differs by the noise of a scan alone."""
        if column.heading == JOB_HEADING and canonical(word) in _JOB_WORDS:
            return _JOB_WORDS[canonical(word)]
        counts = self._counts.get(column.name, _NONE)
        if counts[word] > _RARE:
            return word
        best = self._best.get((column.name, lookalike(word)), word)
        return best if counts[best] >= _FREQUENT else word

    def rare(self, column: _Column, words: set[str]) -> set[str]:
        """Return the words that may be others under noise: of ids, those that do not stand in many places."""
        counts = self._counts.get(column.name, _NONE)
        return {word for word in words if counts[word] <= _RARE or not word.isalnum()}

    def ids(self) -> set[str]:
        """Return the ids of photos and points that stand in more than one place."""
        return {word for name in ("Photo", "Point") for word, n in self._counts.get(name, {}).items() if n > 1}


def _column(heading: str, unit: str, right: bool, column: Cells) -> _Column:
    """Return what a column of a table holds."""
    if heading.split(" ")[0] in _NAMES:
        return _Column(heading=heading, kind=None, decimals=None)
    if column.decimals is not None:
        return _Column(heading=heading, kind="number", decimals=column.decimals)
    cells = [cell for cell in column if cell]
    likely = {name: pattern for name, pattern in _KINDS.items() if cells and pattern.fullmatch(cells[0])}
    kinds = [name for name, pattern in likely.items() if all_are(pattern.pattern, cells)]
    if not kinds:
        counts = Counter(cells)
        shares = {
            name: sum(counts[cell] for cell in counts if pattern.fullmatch(cell))
            for name, pattern in _KINDS.items()
        }
        kinds = sorted(shares, key=lambda kind: -shares[kind])
        if shares[kinds[0]] < _MOST * len(cells) or not cells:
            by_unit: Kind | None = "angle" if unit.startswith("D  M") else "number" if right else None
            return _Column(heading=heading, kind=by_unit, decimals=None)
    kind = kinds[0]
    of_kind = [cell for cell in cells if _KINDS[kind].fullmatch(cell)] if len(kinds) > 1 else cells
    most, count = _decimals(of_kind[0]), len(of_kind)
    if not all_are(_exactly(kind, most), of_kind):
        ((most, count),) = Counter([_decimals(cell) for cell in of_kind]).most_common(1)
    return _Column(heading=heading, kind=kind, decimals=most if count >= _UNIFORM * len(cells) else None)


def _exactly(kind: Kind, decimals: int) -> str:
    """Return the pattern of what is of a kind and has so many decimals."""
    number = rf"\d*\.\d{{{decimals}}}"
    return {"count": r"-?\d+", "number": f"-?{number}", "angle": rf"-?\d+ +\d+ +{number}"}[kind]


def _decimals(cell: str) -> int:
    return len(cell.partition(".")[2])


def _table(raw: _Raw, columns: tuple[_Column, ...], words: _Words, notes: Notes) -> Table:
    """Return a table; a cell that is not legible is noted, and blank."""
    illegible: dict[int, set[str]] = {}
    put_right = []
    for column, cells, standing in zip(columns, raw.cells, raw.columns, strict=True):
        doubtful = _doubtful(column, standing, words)
        rows = [n for n, cell in enumerate(cells) if cell in doubtful] if doubtful else []
        repaired = list(cells) if rows or raw.loose else []
        for n in sorted({*rows, *raw.loose}):
            line, text = raw.rows[n], cells[n]
            read = _cell(line.number, column, text, words, notes)
            if read is None:
                illegible.setdefault(line.number, set()).add(column.heading)
                expected = f"a {column.kind} in the column '{column.heading}' of '{raw.title}'"
                notes.unreadable.append(
                    Problem(file=notes.file, line=line.number, found=text, expected=expected, text=line.text)
                )
            repaired[n] = read or ""
        put_right.append(Cells(repaired) if repaired else cells)
    return Table(
        title=raw.title,
        line=raw.line,
        headings=raw.headings,
        units=raw.units,
        lines=[line.number for line in raw.rows],
        columns=dict(zip(raw.headings, put_right, strict=True)),
        illegible_cells={line: frozenset(headings) for line, headings in illegible.items()},
    )


def _doubtful(column: _Column, cells: Cells, words: _Words) -> set[str]:
    """Return the cells of a column that are not to be read as they stand, or of which something is to be noted."""
    kind, decimals = column.kind, column.decimals
    if kind and decimals is not None and decimals == cells.decimals:
        return set()
    if kind and decimals is not None and all_are(rf"|\*+|{_exactly(kind, decimals)}", cells):
        return set()
    rare = words.rare(column, set(cells)) if column.name in _NAMES else set(cells)
    return {cell for cell in rare if _is_doubtful(column, cell, words)}


def _is_doubtful(column: _Column, cell: str, words: _Words) -> bool:
    scratch = Notes("")
    return _cell(0, column, cell, words, scratch) != cell or bool(scratch.repairs)


def _parted(text: str, spans: Spans) -> list[str]:
    """Return the words of a row by the columns that they stand in most, or nearest to."""
    parts: list[list[str]] = [[] for _ in spans]
    for word in re.finditer(r"\S+", text):
        inside = [min(word.end(), end) - max(word.start(), start) for start, end in spans]
        parts[max(range(len(spans)), key=lambda n: inside[n])].append(word[0])
    return [" ".join(words) for words in parts]


def _cell(line: int, column: _Column, text: str, words: _Words, notes: Notes) -> str | None:
    """Return a cell as it is to be read, its repairs noted; None where it is not legible."""
    if not text or text in _MARKS or (column.kind and _legible(column, text)):
        return text
    if not re.search(r"[^\W_]|\*", text):
        notes.repair(line, RepairKind.STRAY, text)
        return ""
    if column.kind is None:
        read = words.put_right(column, text)
        if read == text and not column.heading.startswith(_NAMES) and _BROKEN.fullmatch(text):
            return _number(line, text, notes)
        if read != text:
            notes.repairs.extend(respelt(line, text, read))
        return read
    reading = read_cells(tuple(text.split()), [column.kind])
    if reading is None or not _legible(column, reading.texts[0]):
        return None
    notes.repairs.extend(reading.repairs(line))
    return reading.texts[0]


def _number(line: int, text: str, notes: Notes) -> str | None:
    """Return a number in a column that does not tell its kind."""
    if any(kind.fullmatch(text) for kind in _KINDS.values()):
        return text
    if re.search(r"\w {2,}\w", text):  # two numbers
        return text
    kinds: tuple[Kind, ...] = ("number", "angle") if "." in text else ("number", "count", "angle")
    readings = [read_cells(tuple(text.split()), [kind]) for kind in kinds]
    reading = next((reading for reading in readings if reading), None)
    if reading is not None:
        notes.repairs.extend(reading.repairs(line))
    return reading.texts[0] if reading else text


def _legible(column: _Column, text: str) -> bool:
    if _OVERFLOW.fullmatch(text) or column.kind is None:
        return True
    if column.decimals is None:  # numbers of several kinds
        return any(kind.fullmatch(text) for kind in _KINDS.values())
    return bool(_KINDS[column.kind].fullmatch(text)) and column.decimals == _decimals(text)
