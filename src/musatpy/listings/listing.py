"""Two listings: their sections by titles, columns by headings, and what stands in the cells of two rows."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import zip_longest

from musatpy.listings.compare import Cell, Comparison, Pair, aligned
from musatpy.listings.findings import Difference, Place, RuleUse, SectionSummary
from musatpy.listings.judge import Field, RuleSet, Spot, of_row, read_angles
from musatpy.listings.lines import Line, paper_of
from musatpy.listings.rules import Rules
from musatpy.listings.sections import PHOTO, POINT, Row, Section, numbered, sections_of

_OVERFLOW = re.compile(r"\*{2,}")


def compare_listings(a: str, b: str, rules: Rules, names: tuple[str, str]) -> Difference:
    """Return what differs between the texts of two listings."""
    uses = [RuleUse(rule) for rule in rules.rules]
    first, second = (sections_of(paper_of(text, rules.layout), rules.layout) for text in (a, b))
    found = [
        compare_sections(uses, None if n is None else first[n], None if m is None else second[m], moved=moved)
        for n, m, moved in aligned(first, second, strict=True)
    ]
    return Difference(*names, tuple(found), tuple(uses), tuple(overflows(found)))


def overflows(sections: Sequence[SectionSummary]) -> list[str]:
    """Return what is to be said of sections with asterisks in both files."""
    counts = [(section.title, section.overflowed) for section in sections if section.overflowed]
    return [
        f"{title}: {count} field{'s' * (count > 1)} of asterisks in both, whose numbers are not known"
        for title, count in counts
    ]


def compare_sections(rules: RuleSet, a: Section | None, b: Section | None, *, moved: bool) -> SectionSummary:
    """Return what differs between two sections, or what is to be said of a section of one file only."""
    comparison = _Sections(rules, a or Section(""), b or Section(""), [one.title for one in (a, b) if one])
    if a is None or b is None:
        comparison.only_section(int(a is None))
    else:
        comparison.around_rows(moved=moved)
        comparison.compare_rows(strict=a.grouped and b.grouped)
    return comparison.result


def compare_rows(rules: RuleSet, a: Section, b: Section) -> SectionSummary:
    """Return what differs between the rows of two sections of one title, in any order and in columns of both."""
    comparison = _Sections(rules, a, b, [a.title])
    comparison.counts_order = False
    comparison.compare_rows(strict=a.grouped and b.grouped)
    return comparison.result


class _Sections(Comparison):
    """One section of both listings, or of one only."""

    def __init__(self, rules: RuleSet, a: Section, b: Section, titles: Sequence[str]) -> None:
        super().__init__(rules, titles[0] or "(before the first title)", titles)
        self.sections = self.a, self.b = a, b
        self.rows = a.rows, b.rows
        self.in_columns = bool(a.columns and b.columns)
        self.names = [numbered([column.name for column in section.columns]) for section in self.sections]

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
            self.lonely("section", side, "1 row" if count == 1 else f"{count} rows", place=_place_of(lines))

    def around_rows(self, *, moved: bool) -> None:
        """Compare titles and headings, and where the sections stand."""
        first, second = map(_first_lines, self.sections)
        spot = Spot(pages=tuple(line.page for line in first))
        if moved and not self.allowed(spot, "order"):
            self.found("order", Pair("(the section)", _place_of(first), _place_of(second)))
        titles = [[Row(line, ("(title)",), -1) for line in section.titles] for section in self.sections]
        for a, b in zip_longest(*titles):
            if a and b:
                self.pair_of_rows(a, b, False)
            else:
                self.lonely_row(a or b, int(a is None))
        for side, (section, names) in enumerate(zip(self.sections, self.names, strict=True)):
            for n, name in enumerate(names if self.in_columns else ()):
                if name not in self.names[1 - side]:
                    self.lonely_column(side, n, section)

    def lonely_column(self, side: int, number: int, section: Section) -> None:
        """Report a column that only one listing has, once."""
        spot, name = Spot(pages=tuple(line.page for line in _first_lines(section))), section.columns[number].name
        use = self.rule(Pair(spot=spot, among=of_row(self.rules, spot)), Field(0, number + 1, name))
        if use is None or not use.rule.skip:
            self.lonely("column", side, f"only in {'AB'[side]}", "(headings)", _place_of(section.head[:1]), name)

    def are_same(self, a: Row, b: Row) -> bool:
        texts = a.line.text, b.line.text
        if "**" in texts[0] and "**" in texts[1]:
            self.result.overflowed += _overflows_in_both(self.a, a, b)
        return texts[0] == texts[1] or (not self.in_columns and texts[0].split() == texts[1].split())

    def cells(self, a: Row, b: Row, among: RuleSet) -> Iterator[Cell]:
        angles = a.block >= 0 and (self.a.angles or self.b.angles or read_angles(among))
        first, second = (
            dict(section.cells(row.line.text, angles=angles))
            for section, row in zip(self.sections, (a, b), strict=True)
        )
        if not self.in_columns or a.block < 0:
            whole = [[placed for inside in side.values() for placed in inside] for side in (first, second)]
            yield Cell(Field(), "", whole[0], whole[1])
            return
        yield Cell(Field(), "", first.get(-1, ()), second.get(-1, ()))
        for n, name in enumerate(self.names[0]):
            if name in self.names[1]:
                column, other = self.a.columns[n], self.names[1].index(name)
                if (name in self.a.blank and n not in first) or (name in self.b.blank and other not in second):
                    continue
                yield Cell(Field(n, n + 1, column.name), column.unit, first.get(n, ()), second.get(other, ()))


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


def _place_of(lines: Sequence[Line]) -> Place:
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
