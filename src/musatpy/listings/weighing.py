"""Two rows that belong together -> what differs between their fields."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from musatpy.listings.findings import Finding, FindingKind, Place
from musatpy.listings.judge import AnySpot, Field, Judge, RuleSet, Spot
from musatpy.listings.lines import Line
from musatpy.listings.rules import Rule
from musatpy.listings.sections import Column, Row, Section, photos_of, points_of, squeezed, with_parts
from musatpy.listings.tally import Tally
from musatpy.listings.tokens import Placed, Token

_OVERFLOW = re.compile(r"\*{2,}")


@dataclass(eq=False)
class ColumnPairs:
    """Columns of two tables by their headings: which is compared with which."""

    pairs: list[tuple[int, int]]  # (-1, -1) first: what stands in no column
    only: tuple[list[Column], list[Column]]

    @classmethod
    def of(cls, a: Sequence[Column], b: Sequence[Column], wanted: frozenset[str] | None = None) -> ColumnPairs:
        """Return the pairs of columns of one heading, of all or some; none where one table has no headings."""
        if not (a and b):
            return cls([(-1, -1)], ([], []))
        keys = [_occurrences([column.name for column in columns]) for columns in (a, b)]
        places = {key: n for n, key in enumerate(keys[1])}
        pairs = [(n, places[key]) for n, key in enumerate(keys[0]) if key in places]
        if wanted is not None:
            return cls([(n, other) for n, other in pairs if a[n].name in wanted], ([], []))
        only_a = [a[n] for n, key in enumerate(keys[0]) if key not in places]
        only_b = [b[n] for n, key in enumerate(keys[1]) if key not in set(keys[0])]
        return cls([(-1, -1), *pairs], (only_a, only_b))


def _occurrences(names: Sequence[str]) -> list[tuple[str, int]]:
    """Return names, each with how many of the same stand before."""
    counts: Counter[str] = Counter()
    found = []
    for name in names:
        found.append((name, counts[name]))
        counts[name] += 1
    return found


@dataclass(frozen=True, eq=False)
class RowPair:
    """Two rows that belong together, with the rules that select something in them."""

    a: Row
    b: Row
    spot: AnySpot
    among: RuleSet

    @cached_property
    def where(self) -> tuple[str, Place, Place]:
        """What the row is called, and where it stands in A and in B."""
        return name_of(self.a), place_of([self.a.line]), place_of([self.b.line])


class Weigher:
    """Weighs the fields of rows of two sections."""

    def __init__(self, judge: Judge, a: Section, b: Section, columns: ColumnPairs, result: Tally) -> None:
        self.judge = judge
        self.a = a
        self.b = b
        self.result = result
        self.columns = columns
        self.angles = a.angles or b.angles
        self.tables = a.grouped and b.grouped

    def with_angles(self, among: RuleSet) -> bool:
        """Tell whether degrees, minutes and seconds of a row are read as one."""
        return self.angles or self.judge.reads_angles(among)

    def fields_of(self, row: Row, among: RuleSet) -> list[tuple[Field, list[Placed]]]:
        """Return the fields of a row of A by columns; without columns every token is a field."""
        found = []
        angles = self.with_angles(among) and row.block >= 0
        for column, placed in self.a.cells(row.line.text, angles=angles):
            if column >= 0:
                found.append((Field(column, column + 1, self.a.columns[column].name), placed))
            else:
                found += [(Field(-1, n, ""), [one]) for n, one in enumerate(placed, start=1)]
        return found

    def touch(self, row: Row, spot: AnySpot, among: RuleSet) -> None:
        """Let the rules of a row that does not differ decide about its values, so that it is known that they do."""
        for field, placed in self.fields_of(row, among):
            for one in placed:
                own = spanning(field, [one])
                self.judge.about_value(self.judge.of_field(among, spot, own), one.token, one.token)
        self.judge.touch_rows(among, spot)

    def weigh(self, both: RowPair) -> None:
        """Weigh the fields of two rows of different texts."""
        a, b = both.a, both.b
        angles = self.with_angles(both.among) and a.block >= 0
        if self.tables and a.block >= 0:
            texts = self.a.fields(a.line.text), self.b.fields(b.line.text)
            if texts[0] and texts[1]:
                self.table_row(texts[0], texts[1], both, angles)
                return
        sides = (self.a, a), (self.b, b)
        if self.a.columns and self.b.columns and a.block >= 0:
            cells = [dict(section.cells(row.line.text, angles=angles)) for section, row in sides]
            for one, other in self.columns.pairs:
                column = self.a.columns[one] if one >= 0 else None
                field = Field(one, one + 1, column.name if column else "")
                self.cell(field, column, cells[0].get(one, []), cells[1].get(other, []), both)
            return
        placed = [
            [one for _, inside in section.cells(row.line.text, angles=angles) for one in inside]
            for section, row in sides
        ]
        self.cell(Field(-1, 0, ""), None, placed[0], placed[1], both)

    def table_row(self, texts_a: Sequence[str], texts_b: Sequence[str], both: RowPair, angles: bool) -> None:
        """Weigh the fields of two rows of tables that keep to their columns."""
        for one, other in self.columns.pairs[1:]:
            if texts_a[one].strip() != texts_b[other].strip():
                self.table_field(one, texts_a[one], texts_b[other], both, angles)

    def table_field(self, n: int, text_a: str, text_b: str, both: RowPair, angles: bool) -> None:
        """Weigh what stands in one column of two rows of tables."""
        column = self.a.columns[n]
        a, b = (self.a.tokens_in(n, text, angles=angles) for text in (text_a, text_b))
        self.cell(_field_of(column, n), column, a, b, both)

    def cell(
        self, field: Field, column: Column | None, a: Sequence[Placed], b: Sequence[Placed], both: RowPair
    ) -> None:
        """Weigh the tokens of one cell; in none, every token is a field of its own."""
        start, end_a, end_b = 0, len(a), len(b)
        if len(a) != len(b):
            while start < min(end_a, end_b) and a[start].token.text == b[start].token.text:
                start += 1
            while min(end_a, end_b) > start and a[end_a - 1].token.text == b[end_b - 1].token.text:
                end_a, end_b = end_a - 1, end_b - 1
            own = spanning(field, [*a[start:end_a], *b[start:end_b]], start + 1)
            rule = self.judge.about_value(self.judge.of_field(both.among, both.spot, own), None, None)
            if rule is None or not rule.skip:
                texts = [
                    " ".join(one.token.text for one in part) or None for part in (a[start:end_a], b[start:end_b])
                ]
                self.found("text", own, both, texts[0], texts[1], rule=rule.name if rule else "exact")
            return
        pairs = _pairs_of_fields(a, b) if len(a) > 1 else [(a[0], b[0])] if a else []
        unit = column.unit if column else ""
        for n, (one, other) in enumerate(pairs, start=1):
            if one.token.text != other.token.text:
                self.token(spanning(field, [one, other], n), unit, one.token, other.token, both)

    def token(self, field: Field, unit: str, a: Token, b: Token, both: RowPair) -> None:
        """Weigh two tokens of different texts."""
        judge = self.judge
        rule = None
        if both.among:
            rule = judge.about_value(judge.of_field(both.among, both.spot, field), a, b)
        self.weighed(rule, _heading(field), unit, a, b, both)

    def weighed(self, rule: Rule | None, heading: str, unit: str, a: Token, b: Token, both: RowPair) -> None:
        """Weigh two tokens of different texts, about which a rule decides."""
        passes, name, skipped, difference, last_digits, own_unit = self.judge.weigh(rule, a, b)
        if skipped or (passes and not difference):
            return
        kind: FindingKind
        if difference is None:
            kind = "overflow" if "overflow" in (a.kind, b.kind) else "text"
            unit = own_unit
        else:
            kind = "angle" if a.kind == "angle" else "number"
            unit = own_unit or unit
        row, place_a, place_b = both.where
        self.result.found(
            Finding(
                kind=kind, section=self.result.title, row=row, column=heading, a=a.text, b=b.text,
                difference=difference, unit=unit, last_digits=last_digits, rule=name,
                place_a=place_a, place_b=place_b,
            ),
            passes=passes,
        )  # fmt: skip

    def found(
        self, kind: FindingKind, field: Field, both: RowPair, a: str | None, b: str | None, *, rule: str
    ) -> None:
        """Take a finding in a field that is no difference of two tokens."""
        row, place_a, place_b = both.where
        self.result.found(
            Finding(
                kind=kind, section=self.result.title, row=row, column=_heading(field), a=a, b=b, rule=rule,
                place_a=place_a, place_b=place_b,
            )
        )  # fmt: skip


def _field_of(column: Column, number: int) -> Field:
    return Field(number, number + 1, column.name, column.start, column.end)


def _heading(field: Field) -> str:
    return field.heading or (f"field {field.number}" if field.number else "")


def _pairs_of_fields(a: Sequence[Placed], b: Sequence[Placed]) -> list[tuple[Placed, Placed]]:
    """Return tokens in pairs, words that differ one after the other put together."""
    found: list[tuple[Placed, Placed]] = []
    for one, other in zip(a, b, strict=True):
        words = one.token.kind == other.token.kind == "word" and one.token.text != other.token.text
        if (
            words
            and found
            and found[-1][0].token.kind == "word"
            and found[-1][0].token.text != found[-1][1].token.text
        ):
            found[-1] = _joined(found[-1][0], one), _joined(found[-1][1], other)
        else:
            found.append((one, other))
    return found


def _joined(first: Placed, second: Placed) -> Placed:
    gap = " " if second.start > first.end else ""
    return Placed(Token("word", f"{first.token.text}{gap}{second.token.text}"), first.start, second.end)


def overflows_in_both(section: Section, a: Row, b: Row) -> int:
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
    return " ".join([one for one in row.ids if one]) or squeezed(row.line.text)[:40]


def spanning(field: Field, placed: Sequence[Placed], number: int = 1) -> Field:
    """Return a field with its columns of print; in no column its number counts the fields of the row."""
    start, end = placed[0].start, placed[0].end
    for one in placed[1:]:
        start, end = min(start, one.start), max(end, one.end)
    return Field(field.column, field.number if field.column >= 0 else number, field.heading, start, end)


class RowSpot:
    """Two rows that belong together, or one, as rules see them; what no rule asks for is not looked up."""

    __slots__ = ("_other", "_row", "_section", "by_row")

    def __init__(self, section: Section, row: Row, other: Row | None) -> None:
        self._section = section
        self._row = row
        self._other = other
        self.by_row = section.by_row

    @property
    def pages(self) -> tuple[int, ...]:
        """The page of the row."""
        return (self._row.line.page,)

    @property
    def texts(self) -> tuple[str, ...]:
        """The row as printed in both listings."""
        text, other = self._row.line.text, self._other
        return (text,) if other is None or other.line.text == text else (text, other.line.text)

    @property
    def ids(self) -> tuple[str, ...]:
        """What the row is about, and the parts of names of several words."""
        return with_parts(self._row.ids)

    def photos(self, column: int) -> tuple[str, ...]:
        """Return the photos of the field in a column."""
        return photos_of(self._section, self._row, column)

    def points(self, column: int) -> tuple[str, ...]:
        """Return the points of the field in a column."""
        return points_of(self._section, self._row, column)


def spot_of(a: Section, b: Section | None, row_a: Row | None, row_b: Row | None) -> AnySpot:
    """Return a pair of rows as rules see it; without rows it is the section itself."""
    if row_a is not None:
        return RowSpot(a, row_a, row_b)
    if row_b is not None and b is not None:
        return RowSpot(b, row_b, None)
    lines = a.titles or [line for line, _ in a.lines[:1]]
    return Spot(pages=tuple(line.page for line in lines[:1]))
