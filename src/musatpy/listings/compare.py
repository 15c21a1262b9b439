"""Two listings, number by number: sections and rows find each other, then the fields of each pair are weighed."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence

from musatpy.listings.align import align
from musatpy.listings.findings import Difference, Place, Tally
from musatpy.listings.judge import Field, Judge, RuleSet, Spot, read_angles, still_open
from musatpy.listings.lines import Line, paper_of
from musatpy.listings.rules import Rules
from musatpy.listings.sections import PHOTO, POINT, Column, Row, Section, numbered, sections_of, squeezed
from musatpy.listings.tokens import Placed, Token
from musatpy.listings.weighing import Comparison, RowPair, Where

_OVERFLOW = re.compile(r"\*{2,}")
_NO_FIELD = Field(-1, 0, "")
_Cell = tuple[Field, str, Sequence[Placed], Sequence[Placed]]  # with its unit, and what A and B have there


_DIGITS = re.compile(r"\d+")


def compare_listings(a: str, b: str, rules: Rules, names: tuple[str, str]) -> Difference:
    """Return what differs between the texts of two listings."""
    judge = Judge(rules)
    both = [sections_of(paper_of(text, rules.layout), rules.layout) for text in (a, b)]
    tallies = [compare_sections(judge, *pair) for pair in _pairs_of_sections(both[0], both[1])]
    return Difference.of(names, tallies, judge.rules, overflows(tallies))


def overflows(tallies: Sequence[Tally]) -> list[str]:
    """Return what is to be said of sections with asterisks in both files."""
    counts = [(tally.title, tally.overflowed) for tally in tallies if tally.overflowed]
    return [
        f"{title}: {count} field{'s' * (count > 1)} of asterisks in both, whose numbers are not known"
        for title, count in counts
    ]


def _pairs_of_sections(
    a: Sequence[Section], b: Sequence[Section]
) -> Iterator[tuple[Section | None, Section | None, bool]]:
    """Yield the sections of one title, in their order, whether they stand elsewhere, and those of one file only."""
    titles = [[_DIGITS.sub("#", section.title) or " " for section in sections] for sections in (a, b)]
    for n, other, moved in align((titles[0], titles[1]), (titles[0], titles[1]), strict=True):
        yield None if n is None else a[n], None if other is None else b[other], moved


def compare_sections(judge: Judge, a: Section | None, b: Section | None, moved: bool = False) -> Tally:
    """Return what differs between two sections, or what is to be said of a section of one file only."""
    return _Sections(judge, a, b).tally(moved=moved)


class _Sections(Comparison):
    """One section of both listings, or of one only."""

    def __init__(self, judge: Judge, a: Section | None, b: Section | None) -> None:
        self.alone = "A" if b is None else "B" if a is None else ""
        self.a, self.b = a or Section(""), b or Section("")
        title = (a or self.b).title
        super().__init__(
            judge, title or "(before the first title)", [section.title for section in (a, b) if section]
        )
        self.pending = still_open(self.rules)
        self.columns, self.lonely_columns = _pairs_of_columns(self.a.columns, self.b.columns)

    def tally(self, *, moved: bool) -> Tally:
        """Compare, and return what was found."""
        if self.alone:
            self.only_here(self.a if self.alone == "A" else self.b)
        else:
            self.around_rows(moved=moved)
            self.all_rows()
        return self.result

    def around_rows(self, *, moved: bool) -> None:
        """Compare titles and headings, and where the sections stand."""
        if moved and not self.allows(spot_of(self.a), "order"):
            places = [
                place_of(section.titles or [line for line, _ in section.lines[:1]]) for section in (self.a, self.b)
            ]
            self.finding("order", Where("(the section)", *places))
        rows = [[Row(line, ("(title)",), -1) for line in section.titles] for section in (self.a, self.b)]
        for a, b in zip(*rows, strict=False):
            self.rows(a, b, False)
        common = min(map(len, rows))
        for side, titles in zip("AB", rows, strict=True):
            for row in titles[common:]:
                self.only(row, side)
        for side, columns in zip("AB", self.lonely_columns, strict=True):
            self.only_columns(side, columns)

    def all_rows(self) -> None:
        """Compare the rows, each with its partner."""
        rows = self.a.rows, self.b.rows
        ids = [[row.ids if any(row.ids) else () for row in side] for side in rows]
        texts = [[row.line.text for row in side] for side in rows]
        strict = self.a.grouped and self.b.grouped
        for n, other, moved in align((ids[0], ids[1]), (texts[0], texts[1]), strict=strict):
            if n is not None and other is not None:
                self.rows(rows[0][n], rows[1][other], moved)
            elif n is not None:
                self.only(rows[0][n], "A")
            elif other is not None:
                self.only(rows[1][other], "B")

    def only_here(self, section: Section) -> None:
        """Take a section that the other listing has not: one finding, unless rules allow it."""
        if not self.allows(spot_of(section), self.alone):
            text = "1 row" if len(section.lines) == 1 else f"{len(section.lines)} rows"
            where = Where(a=place_of(section.titles or [section.lines[0][0]]))
            self.lonely("section", self.alone, text, where)

    def only_columns(self, side: str, columns: Sequence[Column]) -> None:
        """Report columns that only one listing has, once."""
        section = self.a if side == "A" else self.b
        for column in columns:
            both = self.pair(Where(), spot_of(section))
            field = Field(0, section.columns.index(column) + 1, column.name)
            decider = self.rule(both, field, None, None)
            if decider is None or not decider.rule.skip:
                where = Where("(headings)", place_of(section.head[:1]))
                self.lonely("column", side, f"only in {side}", where, column.name)

    def only(self, row: Row, side: str) -> None:
        """Take a row that the other listing has not."""
        spot = spot_of(self.a if side == "A" else self.b, row)
        self.only_row(spot, side, squeezed(row.line.text), Where(name_of(row), place_of([row.line])))

    def rows(self, a: Row, b: Row, moved: bool) -> None:
        """Compare two rows that belong together."""
        self.result.rows += 1
        texts = a.line.text, b.line.text
        if "**" in texts[0] and "**" in texts[1]:
            self.result.overflowed += _overflows_in_both(self.a, a, b)
        same = texts[0] == texts[1]
        if not same and not (self.a.columns and self.b.columns):
            same = texts[0].split() == texts[1].split()
        if same and not moved and not self.pending:
            return
        where = Where(name_of(a), place_of([a.line]), place_of([b.line]))
        both = self.pair(where, spot_of(self.a, a, b)) if self.rules else RowPair(where)
        if moved:
            self.elsewhere(both)
        if not same:
            for field, unit, fields_a, fields_b in self.cells(a, b, both.among):
                self.cell(field, unit, fields_a, fields_b, both)
        elif still_open(both.among):
            self.touch(a, both)
            self.pending = still_open(self.pending)

    def touch(self, row: Row, both: RowPair) -> None:
        """Let the rules of a row that does not differ decide about its values, so that it is known that they do."""
        for column, placed in self.a.cells(row.line.text, angles=self.reads_angles(row, both.among)):
            field = Field(column, column + 1, self.a.columns[column].name if column >= 0 else "")
            for n, piece in enumerate(placed, start=1):
                self.rule(both, _spanning(field, [piece], n), piece.token, piece.token)
        self.judge.touch_rows(both.among, both.spot)

    def reads_angles(self, row: Row, among: RuleSet) -> bool:
        """Tell whether degrees, minutes and seconds of a row are read as one."""
        return row.block >= 0 and (self.a.angles or self.b.angles or read_angles(among))

    def cells(self, a: Row, b: Row, among: RuleSet) -> Iterator[_Cell]:
        """Yield the cells of two rows: by columns where both have some, else the whole rows as one."""
        angles = self.reads_angles(a, among)
        sides = [section.cells(row.line.text, angles=angles) for section, row in ((self.a, a), (self.b, b))]
        if not (self.a.columns and self.b.columns) or a.block < 0:
            fields_a, fields_b = ([placed for _, inside in cells for placed in inside] for cells in sides)
            yield _NO_FIELD, "", fields_a, fields_b
            return
        cells = dict(sides[0]), dict(sides[1])
        yield _NO_FIELD, "", cells[0].get(-1, []), cells[1].get(-1, [])
        for n, other in self.columns:
            column = self.a.columns[n]
            yield Field(n, n + 1, column.name), column.unit, cells[0].get(n, []), cells[1].get(other, [])

    def cell(self, field: Field, unit: str, a: Sequence[Placed], b: Sequence[Placed], both: RowPair) -> None:
        """Weigh the tokens of one cell; in no column, every token is a field of its own."""
        if len(a) != len(b):
            self.unequal(field, a, b, both)
            return
        for n, (of_a, of_b) in enumerate(_pairs_of_fields(a, b), start=1):
            if of_a.token.text != of_b.token.text:
                self.weigh(both, _spanning(field, [of_a, of_b], n), unit, of_a.token, of_b.token)

    def unequal(self, field: Field, a: Sequence[Placed], b: Sequence[Placed], both: RowPair) -> None:
        """Take a cell with more tokens in one listing: what is left of it without those equal at both ends."""
        start, ends = 0, [len(a), len(b)]
        while start < min(ends) and a[start].token.text == b[start].token.text:
            start += 1
        while min(ends) > start and a[ends[0] - 1].token.text == b[ends[1] - 1].token.text:
            ends = [end - 1 for end in ends]
        rest = a[start : ends[0]], b[start : ends[1]]
        text_a, text_b = (" ".join(placed.token.text for placed in part) or None for part in rest)
        self.unpaired(both, _spanning(field, [*rest[0], *rest[1]], start + 1), (text_a, text_b))

    def name_of(self, field: Field) -> str:
        """Return the heading of a field, or its number in the row."""
        return field.heading or (f"field {field.number}" if field.number else "")


def _pairs_of_columns(
    a: Sequence[Column], b: Sequence[Column]
) -> tuple[list[tuple[int, int]], tuple[list[Column], list[Column]]]:
    """Return the pairs of columns of one heading, and those of one table only; none where one has no headings."""
    if not (a and b):
        return [], ([], [])
    keys = [numbered([column.name for column in columns]) for columns in (a, b)]
    places = {key: n for n, key in enumerate(keys[1])}
    pairs = [(n, places[key]) for n, key in enumerate(keys[0]) if key in places]
    only = [
        [column for column, key in zip(columns, keys_here, strict=True) if key not in others]
        for columns, keys_here, others in ((a, keys[0], keys[1]), (b, keys[1], keys[0]))
    ]
    return pairs, (only[0], only[1])


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


def name_of(row: Row) -> str:
    """Return what a row is called: its ids, or how it begins."""
    return " ".join([name for name in row.ids if name]) or squeezed(row.line.text)[:40]


def spot_of(section: Section, row: Row | None = None, other: Row | None = None) -> Spot:
    """Return a row, or two that belong together, as rules see it; without a row it is the section itself."""
    if row is None:
        lines = section.titles or [line for line, _ in section.lines[:1]]
        return Spot(pages=tuple(line.page for line in lines[:1]))
    texts = (row.line.text,) if other is None else (row.line.text, other.line.text)
    return Spot(
        pages=(row.line.page,),
        texts=texts,
        ids=_with_parts(row.ids),
        photos=lambda column: _about(section, row, column, PHOTO),
        points=lambda column: _about(section, row, column, POINT),
        by_row=section.by_row,
    )


def _about(section: Section, row: Row, column: int, pattern: re.Pattern[str]) -> tuple[str, ...]:
    """Return the photos, or the points, that a field of a row is about."""
    if section.grouped:
        return _with_parts([row.ids[place] for place in section.named_ids[pattern] if place < len(row.ids)])
    if not pattern.match(section.label_heading):  # which says what the headings of columns, or the labels, name
        return ()
    across = column >= 0 and section.columns[column].name
    return (across,) if across and across.split()[0].isalnum() and len(row.ids) == 1 else row.ids[:1]


def _with_parts(ids: Sequence[str]) -> tuple[str, ...]:
    """Return ids, and the parts of those of several words."""
    return (*ids, *(part for name in ids if " " in name for part in name.split()))
