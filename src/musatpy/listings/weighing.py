"""Two files, section by section: rows find each other by their names, then the fields of each pair are weighed.

Two listings have sections by titles, columns by headings, and in them what stands in the cells of two rows.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Sequence
from functools import partial
from itertools import zip_longest
from typing import Any, NamedTuple

from musatpy.errors import count_of
from musatpy.listings.findings import Difference, Discrepancy, FindingKind, PagePlace, SectionSummary
from musatpy.listings.lines import PrintedLine, paper_of
from musatpy.listings.rules import (
    FieldSpot,
    Rules,
    RuleSet,
    RuleUse,
    Spot,
    allows,
    decider,
    measured,
    of_row,
    of_section,
    passes,
    still_open,
)
from musatpy.listings.sections import PHOTO, POINT, ListingRow, ListingSection, numbered, sections_of
from musatpy.listings.tokens import PlacedToken, Token

Texts = tuple[str | None, str | None]  # of A and of B
NOWHERE = PagePlace()
_OVERFLOW = re.compile(r"\*{2,}")


class Cell(NamedTuple):
    """One field of two rows that belong together: what stands there in A and in B."""

    field: FieldSpot
    unit: str
    a: Sequence[PlacedToken]
    b: Sequence[PlacedToken]
    sigmas: float | None = None  # the difference of two numbers in sigmas, where it is known


class RowPair(NamedTuple):
    """Two rows that belong together, or one alone: their name and places, and the rules that select them."""

    name: str = ""
    a: PagePlace = NOWHERE
    b: PagePlace = NOWHERE
    spot: Spot = Spot()
    among: RuleSet = ()


class SectionComparison:
    """A section of A and of B, or of one only: its rules, and what was found.

    `rows` are those of both; a row has `ids`, a `name` that findings call it by, a `text` and a `place`.
    """

    counts_digits = True  # numbers have a last digit
    counts_order = True  # a row that stands elsewhere is a difference
    rows: tuple[Sequence[Any], Sequence[Any]]

    def __init__(self, rules: RuleSet, title: str, titles: Sequence[str]) -> None:
        self.result = SectionSummary(title)
        self.rules = of_section(rules, titles)
        self.pending = still_open(self.rules)

    def spot_of(self, row: Any, side: int, other: Any = None) -> Spot:
        """Return a row of A (side 0) or B, or two that belong together, as rules see them."""
        raise NotImplementedError

    def are_same(self, a: Any, b: Any) -> bool:
        """Tell whether two rows have nothing that could differ."""
        raise NotImplementedError

    def cells(self, a: Any, b: Any, among: RuleSet) -> Iterator[Cell]:
        """Yield the fields of two rows that may differ, and all where it is open whether rules are of use."""
        raise NotImplementedError

    def compare_rows(self, *, strict: bool) -> None:
        """Compare the rows, each with its partner by their names (see `aligned`)."""
        a, b = self.rows
        for n, other, moved in aligned(a, b, strict=strict):
            if n is not None and other is not None:
                self.pair_of_rows(a[n], b[other], moved and self.counts_order)
            else:
                self.lonely_row(a[n] if n is not None else b[other or 0], int(n is None))

    def pair_of_rows(self, a: Any, b: Any, moved: bool) -> None:
        """Compare two rows that belong together."""
        self.result.rows += 1
        same = self.are_same(a, b)
        if same and not moved and not self.pending:
            return
        spot = self.spot_of(a, 0, b) if self.rules else Spot()
        pair = RowPair(a.name, a.place, b.place, spot, of_row(self.rules, spot))
        if moved and not allows(pair.among, pair.spot, "order"):
            self.found("order", pair)
        if not same or still_open(pair.among):
            for cell in self.cells(a, b, pair.among):
                self.weigh_cell(pair, cell)
        self.pending = still_open(self.pending)

    def lonely_row(self, row: Any, side: int) -> None:
        """Take a row that the other file has not, unless rules allow it."""
        if not self.allowed(self.spot_of(row, side), "AB"[side]):
            kind: FindingKind = "only in B" if side else "only in A"
            self.lonely(kind, side, row.text, row.name, row.place)

    def lonely(
        self, kind: FindingKind, side: int, text: str, name: str = "", place: PagePlace = NOWHERE, column: str = ""
    ) -> None:
        """Take what only one file has."""
        pair = RowPair(name, b=place) if side else RowPair(name, place)
        self.found(kind, pair, (None, text) if side else (text, None), column)

    def allowed(self, spot: Spot, side: str) -> bool:
        """Tell whether a rule allows a row in one file only (`A`, `B`), or elsewhere (`order`)."""
        return allows(of_row(self.rules, spot), spot, side)

    def rule(
        self, pair: RowPair, field: FieldSpot, a: Token | None = None, b: Token | None = None
    ) -> RuleUse | None:
        """Return the rule that decides about two values of a field, None for exactly equal."""
        return decider(pair.among, pair.spot, field, a, b) if pair.among else None

    def weigh_cell(self, pair: RowPair, cell: Cell) -> None:
        """Weigh the tokens of one cell; in no column, every token is a field of its own.

        Of a cell with more tokens in one file, or several words that differ, what is left without those equal at
        both ends is a finding.
        """
        a, b, is_open = cell.a, cell.b, bool(still_open(pair.among))
        if len(a) == len(b) and (len(a) == 1 or not _only_words_differ(a, b)):
            for n, (of_a, of_b) in enumerate(zip(a, b, strict=True), start=1):
                if is_open or of_a.token.text != of_b.token.text:
                    self.weigh(pair, _spanning(cell.field, [of_a, of_b], n), cell, of_a.token, of_b.token)
            return
        for n, placed in enumerate(a if is_open else (), start=1):
            self.rule(pair, _spanning(cell.field, [placed], n), placed.token, placed.token)
        texts = [[placed.token.text for placed in side] for side in (a, b)]
        shorter, start, end = min(map(len, texts)), 0, 0
        while start < shorter and texts[0][start] == texts[1][start]:
            start += 1
        while end < shorter - start and texts[0][-1 - end] == texts[1][-1 - end]:
            end += 1
        rest = [placed for side in (a, b) for placed in side[start : len(side) - end]]
        left_a, left_b = (" ".join(side[start : len(side) - end]) or None for side in texts)
        field = _spanning(cell.field, rest, start + 1)
        use = self.rule(pair, field)
        if use is None or not use.rule.skip:
            self.found("text", pair, (left_a, left_b), field.name, rule=use.name if use else "exact")

    def weigh(self, pair: RowPair, field: FieldSpot, cell: Cell, a: Token, b: Token) -> None:
        """Weigh two tokens of a field, and take their difference where there is one."""
        use = self.rule(pair, field, a, b)
        rule, name = (use.rule, use.name) if use else (None, "exact")
        texts = (a.text or None, b.text or None)
        if a.text == b.text or (rule and rule.skip):
            return
        if a.value is None or b.value is None or a.kind != b.kind:
            kind: FindingKind = "overflow" if "overflow" in (a.kind, b.kind) else "text"
            self.found(kind, pair, texts, field.name, rule=name)
            return
        difference, last, unit = measured(rule, a, b)
        if not difference and (a.kind == "angle" or a.negative_degrees == b.negative_degrees):
            return
        is_within = passes(rule, a, b, difference, last, cell.sigmas)
        if is_within and use:
            use.passed += 1
        if not difference:  # `-0` are degrees: their sign is that of what stands behind them
            if not is_within:
                self.found("text", pair, texts, field.name, rule=name)
            return
        self.found(
            "angle" if a.kind == "angle" else "number",
            pair,
            texts,
            field.name,
            passes=is_within,
            rule=name,
            sigmas=cell.sigmas,
            difference=difference,
            unit=unit or cell.unit,
            last_digits=last if self.counts_digits else None,
        )

    def found(
        self,
        kind: FindingKind,
        pair: RowPair,
        texts: Texts = (None, None),
        column: str = "",
        *,
        passes: bool = False,
        **more: Any,
    ) -> None:
        """Take a finding, with the `texts` of A and of B."""
        section, (a, b) = self.result.title, texts
        finding = Discrepancy(kind, section, pair.name, column, a, b, place_a=pair.a, place_b=pair.b, **more)
        self.result.add(finding, passes=passes)


def aligned(a: Sequence[Any], b: Sequence[Any], *, strict: bool) -> Iterator[tuple[int | None, int | None, bool]]:
    """Yield the rows of A, each with its partner in B, and whether that stands elsewhere; between them rows of B.

    A row goes by its ids, or without any by its text. As many rows of A as of B between two pairs are taken for
    each other one by one; with `strict` only those without ids are.
    """
    counted_a, counted_b = _counted(a), _counted(b)
    places = {key: n for n, key in enumerate(counted_b)}
    partners = {n: places[key] for n, key in enumerate(counted_a) if key in places}
    kept = _in_order(list(partners.items()))
    taken = set(partners.values())
    for (a0, b0), (a1, b1) in zip([(-1, -1), *kept], [*kept, (len(a), len(b))], strict=True):
        rows = [n for n in range(a0 + 1, a1) if n not in partners]
        others = [m for m in range(b0 + 1, b1) if m not in taken]
        alike: dict[int, int] = {}
        if len(rows) == len(others):
            pairs = zip(rows, others, strict=True)
            alike = {n: m for n, m in pairs if not (strict and (any(a[n].ids) or any(b[m].ids)))}
        for n in range(a0 + 1, a1):
            yield n, partners.get(n, alike.get(n)), n in partners
        paired = set(alike.values())
        yield from ((None, m, False) for m in others if m not in paired)
        if a1 < len(a):
            yield a1, b1, False


def _counted(rows: Iterable[Any]) -> list[Hashable]:
    """Return the ids of each row, or else its words, with how many of the same stand before."""
    counts: Counter[Hashable] = Counter()
    counted: list[Hashable] = []
    for row in rows:
        key = row.ids if any(row.ids) else (row.text,)
        counted.append((key, counts[key]))
        counts[key] += 1
    return counted


def _in_order(pairs: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the longest run of pairs, sorted by the first numbers, whose second ones grow (patience sorting).

    `difflib` takes the square of rows for it: 54 s for 20,000 of which every two stand the other way round.
    """
    tails: list[int] = []
    ends: list[int] = []  # the pair that ends the best run of each length
    before: list[int] = []
    for n, (_, b) in enumerate(pairs):
        length = bisect_left(tails, b)
        before.append(ends[length - 1] if length else -1)
        tails[length : length + 1], ends[length : length + 1] = [b], [n]
    longest = []
    n = ends[-1] if ends else -1
    while n >= 0:
        longest.append(pairs[n])
        n = before[n]
    return longest[::-1]


def _spanning(field: FieldSpot, placed: Sequence[PlacedToken], number: int) -> FieldSpot:
    """Return a field with its columns of print; in no column its number counts the fields of the row."""
    start, end = min(field.start for field in placed), max(field.end for field in placed)
    return FieldSpot(field.column, field.number or number, field.heading, start, end)


def _only_words_differ(a: Sequence[PlacedToken], b: Sequence[PlacedToken]) -> bool:
    """Tell whether several tokens differ, and all of them are words."""
    kinds = [
        {of_a.token.kind, of_b.token.kind} for of_a, of_b in zip(a, b, strict=True) if of_a.token != of_b.token
    ]
    return len(kinds) > 1 and all(kind == {"word"} for kind in kinds)


def compare_listings(a: str, b: str, rules: Rules, names: tuple[str, str]) -> Difference:
    """Return what differs between the texts of two listings."""
    uses = [RuleUse(rule) for rule in rules.rules]
    first, second = (sections_of(paper_of(text, rules.layout), rules.layout) for text in (a, b))
    found = []
    for n, m, moved in aligned(first, second, strict=True):
        comparison = _Sections(uses, None if n is None else first[n], None if m is None else second[m])
        comparison.compare(moved=moved)
        found.append(comparison.result)
    return Difference(*names, tuple(found), tuple(uses), tuple(overflows(found)))


def overflows(sections: Sequence[SectionSummary]) -> list[str]:
    """Return what is to be said of sections with asterisks in both files."""
    return [
        f"{section.title}: {count_of(count, 'field')} of asterisks in both, whose numbers are not known"
        for section in sections
        if (count := section.overflowed)
    ]


def compare_rows(
    rules: RuleSet, a: tuple[ListingSection, Sequence[ListingRow]], b: tuple[ListingSection, Sequence[ListingRow]]
) -> SectionSummary:
    """Return what differs between rows of two sections of one title, in any order and in columns of both."""
    comparison = _Sections(rules, a[0], b[0])
    comparison.rows, comparison.counts_order = (a[1], b[1]), False
    comparison.compare_rows(strict=a[0].grouped and b[0].grouped)
    return comparison.result


class _Sections(SectionComparison):
    """One section of both listings, or of one only."""

    def __init__(self, rules: RuleSet, a: ListingSection | None, b: ListingSection | None) -> None:
        titles = [section.title for section in (a, b) if section]
        super().__init__(rules, titles[0] or "(before the first title)", titles)
        self.lacking = [section is None for section in (a, b)]
        self.sections = self.a, self.b = a or ListingSection(""), b or ListingSection("")
        self.rows = self.a.rows, self.b.rows
        self.in_columns = bool(self.a.columns and self.b.columns)
        self.names = [numbered([column.name for column in section.columns]) for section in self.sections]

    def spot_of(self, row: ListingRow, side: int, other: ListingRow | None = None) -> Spot:
        section = self.sections[side]
        texts = (row.line.text,) if other is None else (row.line.text, other.line.text)
        about = [partial(_about, section, row, pattern) for pattern in (PHOTO, POINT)]
        return Spot((row.line.page,), texts, _with_parts(row.ids), about[0], about[1], section.by_row)

    def compare(self, *, moved: bool) -> None:
        """Compare the sections; one that the other listing has not is one finding, unless rules allow it."""
        if not any(self.lacking):
            self.around_rows(moved=moved)
            self.compare_rows(strict=self.a.grouped and self.b.grouped)
            return
        side = int(self.lacking[0])
        lines, count = _first_lines(self.sections[side]), len(self.sections[side].lines)
        if not self.allowed(Spot(pages=tuple(line.page for line in lines)), "AB"[side]):
            self.lonely("section", side, count_of(count, "row"), place=_place_of(lines))

    def around_rows(self, *, moved: bool) -> None:
        """Compare titles and headings, and where the sections stand."""
        first, second = map(_first_lines, self.sections)
        spot = Spot(pages=tuple(line.page for line in first))
        if moved and not self.allowed(spot, "order"):
            self.found("order", RowPair("(the section)", _place_of(first), _place_of(second)))
        titles = [[ListingRow(line, ("(title)",), -1) for line in section.titles] for section in self.sections]
        for a, b in zip_longest(*titles):
            if a and b:
                self.pair_of_rows(a, b, False)
            else:
                self.lonely_row(a or b, int(a is None))
        for side, (section, names) in enumerate(zip(self.sections, self.names, strict=True)):
            for n, name in enumerate(names if self.in_columns else ()):
                if name not in self.names[1 - side]:
                    self.lonely_column(side, n, section)

    def lonely_column(self, side: int, number: int, section: ListingSection) -> None:
        """Report a column that only one listing has, once."""
        spot, name = Spot(pages=tuple(line.page for line in _first_lines(section))), section.columns[number].name
        use = self.rule(RowPair(spot=spot, among=of_row(self.rules, spot)), FieldSpot(0, number + 1, name))
        if use is None or not use.rule.skip:
            self.lonely("column", side, f"only in {'AB'[side]}", "(headings)", _place_of(section.head[:1]), name)

    def are_same(self, a: ListingRow, b: ListingRow) -> bool:
        texts = a.line.text, b.line.text
        if "**" in texts[0] and "**" in texts[1]:
            self.result.overflowed += _overflows_in_both(self.a, a, b)
        return texts[0] == texts[1] or (not self.in_columns and texts[0].split() == texts[1].split())

    def cells(self, a: ListingRow, b: ListingRow, among: RuleSet) -> Iterator[Cell]:
        of_angles = any(use.rule.arcsec is not None and use.rule.angle == "dms" for use in among)
        angles = a.block >= 0 and (self.a.angles or self.b.angles or of_angles)
        first, second = (
            dict(section.cells(row.line.text, angles=angles))
            for section, row in zip(self.sections, (a, b), strict=True)
        )
        if not self.in_columns or a.block < 0:
            whole = [[placed for inside in side.values() for placed in inside] for side in (first, second)]
            yield Cell(FieldSpot(), "", whole[0], whole[1])
            return
        yield Cell(FieldSpot(), "", first.get(-1, ()), second.get(-1, ()))
        for n, name in enumerate(self.names[0]):
            if name in self.names[1]:
                column, other = self.a.columns[n], self.names[1].index(name)
                if (name in self.a.blank and n not in first) or (name in self.b.blank and other not in second):
                    continue
                yield Cell(FieldSpot(n, n + 1, column.name), column.unit, first.get(n, ()), second.get(other, ()))


def _overflows_in_both(section: ListingSection, a: ListingRow, b: ListingRow) -> int:
    """Return how many numbers of a row did not fit their fields in both listings, so that nobody can compare them.

    Asterisks at the beginning of a line draw attention to it, and those of a row without numbers mark columns.
    """
    is_mark = section.columns and not section.grouped and not any(map(str.isdigit, a.line.text))
    fields = [Counter(_OVERFLOW.findall(row.line.text)) for row in (a, b)]
    return 0 if is_mark or a.block < 0 or a.text.startswith("*") else (fields[0] & fields[1]).total()


def _place_of(lines: Sequence[PrintedLine]) -> PagePlace:
    return PagePlace(page=lines[0].page, line=lines[0].number) if lines else PagePlace()


def _first_lines(section: ListingSection) -> Sequence[PrintedLine]:
    return section.titles[:1] or [line for line, _ in section.lines[:1]]


def _about(section: ListingSection, row: ListingRow, pattern: re.Pattern[str], column: int) -> tuple[str, ...]:
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
