"""Two listings: their sections by titles, columns by headings, and what stands in the cells of two rows."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial

from musatpy.listings.compare import Comparison, Key, Pair, aligned
from musatpy.listings.findings import Difference, Place, RuleUse, Tally
from musatpy.listings.judge import Field, RuleSet, Spot, read_angles
from musatpy.listings.lines import Line, paper_of
from musatpy.listings.rules import Rules
from musatpy.listings.sections import PHOTO, POINT, Column, Row, Section, numbered, sections_of, squeezed
from musatpy.listings.tokens import Placed, Token

_OVERFLOW = re.compile(r"\*{2,}")
_DIGITS = re.compile(r"\d+")


def compare_listings(a: str, b: str, rules: Rules, names: tuple[str, str]) -> Difference:
    """Return what differs between the texts of two listings."""
    uses = [RuleUse(rule) for rule in rules.rules]
    first, second = (sections_of(paper_of(text, rules.layout), rules.layout) for text in (a, b))
    keys: list[list[Key]] = [
        [(_DIGITS.sub("#", section.title) or " ", "") for section in sections] for sections in (first, second)
    ]
    tallies = []
    for n, m, moved in aligned(keys[0], keys[1], strict=True):
        pair = None if n is None else first[n], None if m is None else second[m]
        tallies.append(compare_sections(uses, *pair, moved=moved))
    return Difference.of(names, tallies, uses, overflows(tallies))


def overflows(tallies: Sequence[Tally]) -> list[str]:
    """Return what is to be said of sections with asterisks in both files."""
    counts = [(tally.title, tally.overflowed) for tally in tallies if tally.overflowed]
    return [
        f"{title}: {count} field{'s' * (count > 1)} of asterisks in both, whose numbers are not known"
        for title, count in counts
    ]


def compare_sections(rules: RuleSet, a: Section | None, b: Section | None, *, moved: bool) -> Tally:
    """Return what differs between two sections, or what is to be said of a section of one file only."""
    if a is not None and b is not None:
        return compare_rows(rules, a, b, whole=True, moved=moved)
    comparison = _Sections(rules, a, b)
    comparison.only_section(int(a is None))
    return comparison.result


def compare_rows(rules: RuleSet, a: Section, b: Section, *, whole: bool = False, moved: bool = False) -> Tally:
    """Return what differs between the rows of two sections, in columns of both; with `whole`, around them too."""
    comparison = _Sections(rules, a, b)
    if whole:
        comparison.around_rows(moved=moved)
    texts = [[(row.ids if any(row.ids) else (), row.line.text) for row in side] for side in comparison.rows]
    comparison.compare_rows((texts[0], texts[1]), strict=a.grouped and b.grouped)
    return comparison.result


class _Sections(Comparison):
    """One section of both listings, or of one only."""

    def __init__(self, rules: RuleSet, a: Section | None, b: Section | None) -> None:
        titles = [section.title for section in (a, b) if section]
        super().__init__(rules, titles[0] or "(before the first title)", titles)
        self.sections = self.a, self.b = a or Section(""), b or Section("")
        self.rows = self.a.rows, self.b.rows
        self.columns, self.lonely_columns = _pairs_of_columns(self.a.columns, self.b.columns)

    def name_of(self, row: Row) -> str:
        return " ".join(filter(None, row.ids)) or squeezed(row.line.text)[:40]

    def place_of(self, row: Row) -> Place:
        return place_of([row.line])

    def text_of(self, row: Row) -> str:
        return squeezed(row.line.text)

    def spot_of(self, row: Row, side: int, other: Row | None = None) -> Spot:
        section = self.sections[side]
        texts = (row.line.text,) if other is None else (row.line.text, other.line.text)
        about = [partial(_about, section, row, pattern) for pattern in (PHOTO, POINT)]
        return Spot((row.line.page,), texts, _with_parts(row.ids), about[0], about[1], section.by_row)

    def only_section(self, side: int) -> None:
        """Take a section that the other listing has not: one finding, unless rules allow it."""
        lines = _first_lines(self.sections[side])
        if not self.allowed(Spot(pages=tuple(line.page for line in lines)), "AB"[side]):
            count = len(self.sections[side].lines)
            self.lonely("section", side, "1 row" if count == 1 else f"{count} rows", place=place_of(lines))

    def around_rows(self, *, moved: bool) -> None:
        """Compare titles and headings, and where the sections stand."""
        first, second = map(_first_lines, self.sections)
        spot = Spot(pages=tuple(line.page for line in first))
        if moved and not self.allowed(spot, "order"):
            self.found("order", Pair("(the section)", place_of(first), place_of(second)))
        titles = [[Row(line, ("(title)",), -1) for line in section.titles] for section in self.sections]
        for a, b in zip(*titles, strict=False):
            self.pair_of_rows(a, b, False)
        for side, rest in enumerate((titles[0][len(titles[1]) :], titles[1][len(titles[0]) :])):
            for row in rest:
                self.lonely_row(row, side)
        for side, (section, columns) in enumerate(zip(self.sections, self.lonely_columns, strict=True)):
            for column in columns:
                self.lonely_column(side, column, section)

    def lonely_column(self, side: int, column: Column, section: Section) -> None:
        """Report a column that only one listing has, once."""
        spot = Spot(pages=tuple(line.page for line in _first_lines(section)))
        field = Field(0, section.columns.index(column) + 1, column.name)
        use = self.rule(Pair(spot=spot, among=self.judged(spot)), field)
        if use is None or not use.rule.skip:
            place = place_of(section.head[:1])
            self.lonely("column", side, f"only in {'AB'[side]}", "(headings)", place, column.name)

    def are_same(self, a: Row, b: Row) -> bool:
        texts = a.line.text, b.line.text
        if "**" in texts[0] and "**" in texts[1]:
            self.result.overflowed += _overflows_in_both(self.a, a, b)
        both_tables = self.a.columns and self.b.columns
        return texts[0] == texts[1] or (not both_tables and texts[0].split() == texts[1].split())

    def weigh_fields(self, a: Row, b: Row, pair: Pair) -> None:
        angles = self.reads_angles(a, pair.among)
        cells = [
            section.cells(row.line.text, angles=angles) for section, row in zip(self.sections, (a, b), strict=True)
        ]
        if not (self.a.columns and self.b.columns) or a.block < 0:
            fields = [[placed for _, inside in side for placed in inside] for side in cells]
            self.weigh_cell(Field(), "", fields[0], fields[1], pair)
            return
        first, second = map(dict, cells)
        self.weigh_cell(Field(), "", first.get(-1, []), second.get(-1, []), pair)
        for n, other in self.columns:
            column = self.a.columns[n]
            field = Field(n, n + 1, column.name)
            self.weigh_cell(field, column.unit, first.get(n, []), second.get(other, []), pair)

    def weigh_cell(self, field: Field, unit: str, a: Sequence[Placed], b: Sequence[Placed], pair: Pair) -> None:
        """Weigh the tokens of one cell; in no column, every token is a field of its own.

        Of a cell with more tokens in one listing, what is left without those equal at both ends is a finding.
        """
        if len(a) == len(b):
            for n, (of_a, of_b) in enumerate(_pairs_of_fields(a, b), start=1):
                if of_a.token.text != of_b.token.text:
                    self.weigh(pair, _spanning(field, [of_a, of_b], n), unit, of_a.token, of_b.token)
            return
        texts = [[placed.token.text for placed in side] for side in (a, b)]
        shorter, start, end = min(map(len, texts)), 0, 0
        while start < shorter and texts[0][start] == texts[1][start]:
            start += 1
        while end < shorter - start and texts[0][-1 - end] == texts[1][-1 - end]:
            end += 1
        rest = [placed for side in (a, b) for placed in side[start : len(side) - end]]
        left_a, left_b = (" ".join(side[start : len(side) - end]) or None for side in texts)
        self.unpaired(pair, _spanning(field, rest, start + 1), (left_a, left_b))

    def fields_of(self, row: Row, pair: Pair) -> Iterator[tuple[Field, Token | None]]:
        for column, inside in self.a.cells(row.line.text, angles=self.reads_angles(row, pair.among)):
            field = Field(column, column + 1, self.a.columns[column].name if column >= 0 else "")
            yield from ((_spanning(field, [placed], n), placed.token) for n, placed in enumerate(inside, start=1))

    def reads_angles(self, row: Row, among: RuleSet) -> bool:
        """Tell whether degrees, minutes and seconds of a row are read as one."""
        return row.block >= 0 and (self.a.angles or self.b.angles or read_angles(among))


def _pairs_of_columns(a: Sequence[Column], b: Sequence[Column]) -> tuple[list[tuple[int, int]], list[list[Column]]]:
    """Return the pairs of columns of one heading, and those of one table only; none where one has no headings."""
    if not (a and b):
        return [], [[], []]
    first, second = (numbered([column.name for column in columns]) for columns in (a, b))
    pairs = [(n, second.index(key)) for n, key in enumerate(first) if key in second]
    only_a = [column for column, key in zip(a, first, strict=True) if key not in second]
    only_b = [column for column, key in zip(b, second, strict=True) if key not in first]
    return pairs, [only_a, only_b]


def _spanning(field: Field, placed: Sequence[Placed], number: int) -> Field:
    """Return a field with its columns of print; in no column its number counts the fields of the row."""
    start, end = min(field.start for field in placed), max(field.end for field in placed)
    return Field(field.column, field.number if field.column >= 0 else number, field.heading, start, end)


def _pairs_of_fields(a: Sequence[Placed], b: Sequence[Placed]) -> list[tuple[Placed, Placed]]:
    """Return tokens in pairs, words that differ one after the other put together."""
    pairs: list[tuple[Placed, Placed]] = []
    joins = False  # the pair before is of words that differ
    for of_a, of_b in zip(a, b, strict=True):
        differ = of_a.token.kind == of_b.token.kind == "word" and of_a.token.text != of_b.token.text
        if differ and joins:
            pairs[-1] = _joined(pairs[-1][0], of_a), _joined(pairs[-1][1], of_b)
        else:
            pairs.append((of_a, of_b))
        joins = differ
    return pairs


def _joined(first: Placed, second: Placed) -> Placed:
    gap = " " if second.start > first.end else ""
    return Placed(Token("word", f"{first.token.text}{gap}{second.token.text}"), first.start, second.end)


def _overflows_in_both(section: Section, a: Row, b: Row) -> int:
    """Return how many numbers of a row did not fit their fields in both listings, so that nobody can compare them.

    Asterisks at the beginning of a line draw attention to it, and those of a row of marks across the columns of a
    table (the frame with the largest residuals) mark these.
    """
    marks = bool(section.columns) and not section.grouped and not any(map(str.isdigit, a.line.text))
    if marks or a.block < 0 or a.line.text.lstrip().startswith("*"):
        return 0
    fields = [Counter(_OVERFLOW.findall(row.line.text)) for row in (a, b)]
    return (fields[0] & fields[1]).total()


def place_of(lines: Sequence[Line]) -> Place:
    """Return where the first of some lines stands."""
    return Place(page=lines[0].page, line=lines[0].number) if lines else Place()


def _first_lines(section: Section) -> Sequence[Line]:
    return section.titles[:1] or [line for line, _ in section.lines[:1]]


def _about(section: Section, row: Row, pattern: re.Pattern[str], column: int) -> tuple[str, ...]:
    """Return the photos, or the points, that the field of a row in a column is about."""
    if section.grouped:
        return _with_parts([row.ids[place] for place in section.named_ids[pattern] if place < len(row.ids)])
    if not pattern.match(section.label_heading):  # which says what the headings of columns, or the labels, name
        return ()
    across = column >= 0 and section.columns[column].name
    return (across,) if across and across.split()[0].isalnum() and len(row.ids) == 1 else row.ids[:1]


def _with_parts(ids: Sequence[str]) -> tuple[str, ...]:
    """Return ids, and the parts of those of several words."""
    return (*ids, *(part for name in ids if " " in name for part in name.split()))
