"""Two listings, number by number: sections and rows find each other, then the fields of each pair are weighed."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass

from musatpy.reportdiff.align import Alignment, align
from musatpy.reportdiff.findings import Difference, Finding, Place
from musatpy.reportdiff.judge import Field, Judge, Spot, looks_at_rows
from musatpy.reportdiff.listing import PHOTO, POINT, Column, Row, Section, ids_named, sections_of, squeezed
from musatpy.reportdiff.paper import Line, paper_of
from musatpy.reportdiff.rules import Rules
from musatpy.reportdiff.tally import Tally
from musatpy.reportdiff.tokens import Placed, Token, parse, tokens_of

_DIGITS = re.compile(r"\d+")


def compare_listings(a: str, b: str, rules: Rules, names: tuple[str, str]) -> Difference:
    """Return what differs between the texts of two listings."""
    judge = Judge(rules)
    both = [sections_of(paper_of(text, rules.layout), rules.layout) for text in (a, b)]
    tallies = [_Pair(judge, *pair).tally() for pair in _pairs_of_sections(both[0], both[1])]
    return Difference(
        a=names[0],
        b=names[1],
        findings=tuple(finding for tally in tallies for finding in tally.findings),
        sections=tuple(tally.summary() for tally in tallies),
        rules=judge.uses(),
    )


def _pairs_of_sections(
    a: Sequence[Section], b: Sequence[Section]
) -> Iterator[tuple[Section | None, Section | None, bool]]:
    """Yield sections of one title, with whether they stand elsewhere, and those of one listing only."""
    keys = _section_keys(a), _section_keys(b)
    titles = tuple([section.title for section in sections] for sections in (a, b))
    found = align(keys, (titles[0], titles[1]), lambda side, row: keys[side][row], strict=True)
    partner = dict(found.pairs)
    only_b = iter(found.only_b)
    later = next(only_b, None)
    for n, section in enumerate(a):
        other = partner.get(n)
        while later is not None and other is not None and later < other:
            yield None, b[later], False
            later = next(only_b, None)
        yield section, None if other is None else b[other], n in found.moved
    while later is not None:
        yield None, b[later], False
        later = next(only_b, None)


def _section_keys(sections: Sequence[Section]) -> list[Hashable]:
    """Return titles without their numbers, with how many of the same stand before."""
    counts: Counter[str] = Counter()
    keys: list[Hashable] = []
    for section in sections:
        title = _DIGITS.sub("#", section.title)
        keys.append((title, counts[title]))
        counts[title] += 1
    return keys


@dataclass(eq=False)
class _Names:
    """Columns of two tables by their headings: which is compared with which."""

    pairs: list[tuple[int, int]]
    only: tuple[list[Column], list[Column]]

    @classmethod
    def of(cls, a: Sequence[Column], b: Sequence[Column]) -> _Names:
        keys = [_occurrences([column.name for column in columns]) for columns in (a, b)]
        places = {key: n for n, key in enumerate(keys[1])}
        pairs = [(n, places[key]) for n, key in enumerate(keys[0]) if key in places]
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


class _Pair:
    """One section of both listings, or of one only."""

    def __init__(self, judge: Judge, a: Section | None, b: Section | None, moved: bool) -> None:
        self.judge = judge
        self.a = a or Section("")
        self.b = b or Section("")
        self.lonely = "A" if b is None else "B" if a is None else ""
        self.moved = moved
        self.title = (a or self.b).title
        self.result = Tally(self.title or "(before the first title)")
        self.rules = judge.of_section([section.title for section in (a, b) if section])
        self.pending = [n for n in self.rules if judge.is_open(n)]
        self.columns = _Names.of(self.a.columns, self.b.columns)
        if not (self.a.columns and self.b.columns):
            self.columns = _Names([(-1, -1)], ([], []))
        self.angles = self.a.angles or self.b.angles
        self.tables = self.a.grouped and self.b.grouped
        self.asks_rows = any(looks_at_rows(judge.rules[n]) for n in self.rules)

    def tally(self) -> Tally:
        """Compare, and return what was found."""
        if self.lonely:
            self.only_here()
            return self.result
        if self.moved and not self.about_section(self.a, "order"):
            lines = self.a.titles or [line for line, _ in self.a.lines[:1]]
            others = self.b.titles or [line for line, _ in self.b.lines[:1]]
            self.result.found(self.finding("order", a=place_of(lines), b=place_of(others), row="(the section)"))
        self.titles()
        self.headings()
        rows = self.a.rows, self.b.rows
        alignment = self.alignment(rows)
        later = iter(alignment.only_b)
        waiting = next(later, None)
        partner = dict(alignment.pairs)
        for n, row in enumerate(rows[0]):
            other = partner.get(n)
            while waiting is not None and other is not None and waiting < other:
                self.only_row(None, rows[1][waiting])
                waiting = next(later, None)
            if other is None:
                self.only_row(row, None)
            else:
                self.rows(row, rows[1][other], n in alignment.moved)
        while waiting is not None:
            self.only_row(None, rows[1][waiting])
            waiting = next(later, None)
        return self.result

    def alignment(self, rows: tuple[Sequence[Row], Sequence[Row]]) -> Alignment:
        """Return which row of A belongs to which row of B."""
        ids = tuple([row.ids if any(row.ids) else () for row in side] for side in rows)
        texts = tuple([row.line.text for row in side] for side in rows)

        def coarse(side: int, row: int) -> Hashable:
            placed = tokens_of(texts[side][row])
            return tuple(one.token.text if one.token.value is None else f"{one.token.value:.1e}" for one in placed)

        return align((ids[0], ids[1]), (texts[0], texts[1]), coarse, strict=self.a.grouped and self.b.grouped)

    def only_here(self) -> None:
        """Take a section that the other listing has not: one finding, unless rules allow it."""
        section = self.a if self.lonely == "A" else self.b
        lines = section.titles or [section.lines[0][0]]
        if not self.about_section(section, self.lonely):
            text = f"{len(section.lines)} rows"
            place = place_of(lines)
            self.result.found(
                Finding(
                    kind="section",
                    section=self.title,
                    a=text if self.lonely == "A" else None,
                    b=text if self.lonely == "B" else None,
                    place_a=place if self.lonely == "A" else Place(),
                    place_b=place if self.lonely == "B" else Place(),
                )
            )

    def about_section(self, section: Section, side: str) -> str:
        """Return the name of the rule that allows a whole section in one listing only, or elsewhere."""
        spot = spot_of(section, None, None, None)
        return self.judge.about_row(self.judge.of_row(self.rules, spot), spot, side)

    def titles(self) -> None:
        """Compare the lines of the title, each with its like."""
        pairs = list(zip(self.a.titles, self.b.titles, strict=False))
        for one, other in pairs:
            self.rows(Row(one, ("(title)",), -1), Row(other, ("(title)",), -1), False)
        for line in self.a.titles[len(pairs) :]:
            self.only_row(Row(line, ("(title)",), -1), None)
        for line in self.b.titles[len(pairs) :]:
            self.only_row(None, Row(line, ("(title)",), -1))

    def headings(self) -> None:
        """Report columns that one listing has and the other not, once."""
        for side, columns, section in zip("AB", self.columns.only, (self.a, self.b), strict=True):
            for column in columns:
                spot = spot_of(section, None, None, None)
                among = self.judge.of_field(
                    self.judge.of_row(self.rules, spot),
                    spot,
                    Field(0, section.columns.index(column) + 1, column.name),
                )
                rule = self.judge.about_value(among, None, None)
                if rule is None or not rule.skip:
                    here, line = f"only in {side}", section.head[0]
                    self.result.found(
                        Finding(
                            kind="column",
                            section=self.title,
                            row="(headings)",
                            column=column.name,
                            a=here if side == "A" else None,
                            b=here if side == "B" else None,
                            place_a=place_of([line]) if side == "A" else Place(),
                            place_b=place_of([line]) if side == "B" else Place(),
                        )
                    )

    def only_row(self, a: Row | None, b: Row | None) -> None:
        """Take a row that the other listing has not."""
        row = a or b
        if row is None:
            return
        spot = spot_of(self.a, self.b, a, b)
        among = self.judge.of_row(self.rules, spot)
        if not self.judge.about_row(among, spot, "A" if a else "B"):
            kind = "only in A" if a else "only in B"
            text = squeezed(row.line.text)
            self.result.found(
                self.finding(
                    kind,
                    row=name_of(row),
                    a=place_of([a.line] if a else []),
                    b=place_of([b.line] if b else []),
                    text=text,
                )
            )

    def rows(self, a: Row, b: Row, moved: bool) -> None:
        """Compare two rows that belong together."""
        self.result.rows += 1
        same = a[0][0] == b[0][0] or (not self.tables and a[0][0].split() == b[0][0].split())
        if same and not moved and not self.pending:
            return
        spot = spot_of(self.a, self.b, a, b) if self.asks_rows else _NO_SPOT
        if same and self.pending:
            self.touch(a, spot)
        if moved and not self.judge.about_row(self.judge.of_row(self.rules, spot), spot, "order"):
            self.result.found(self.finding("order", row=name_of(a), a=place_of([a.line]), b=place_of([b.line])))
        if not same:
            self.fields(a, b, spot)

    def touch(self, row: Row, spot: Spot) -> None:
        """Mark the rules that select something in rows that do not differ."""
        if not self.judge.of_row(self.pending, spot):
            return
        among = self.judge.of_row(self.rules, spot)
        for field, placed in self.fields_of(self.a, row, self.with_angles(among)):
            for one in placed:
                own = _spanning(field, [one])
                self.judge.about_value(self.judge.of_field(among, spot, own), one.token, one.token)
        self.judge.touch_rows(among, spot)
        self.pending = [n for n in self.pending if self.judge.is_open(n)]

    def with_angles(self, among: Sequence[int]) -> bool:
        """Tell whether degrees, minutes and seconds of a row are read as one."""
        return self.angles or any(
            rule.arcsec is not None and rule.angle == "dms" for rule in (self.judge.rules[n] for n in among)
        )

    def fields_of(self, section: Section, row: Row, angles: bool) -> list[tuple[Field, list[Placed]]]:
        """Return the fields of a row by columns; without columns every token is a field."""
        found = []
        for column, placed in section.cells(row.line.text, angles=angles and row.block >= 0):
            if column >= 0:
                found.append((Field(column, column + 1, section.columns[column].name), placed))
            else:
                found += [(Field(-1, n, ""), [one]) for n, one in enumerate(placed, start=1)]
        return found

    def fields(self, a: Row, b: Row, spot: Spot) -> None:
        """Weigh the fields of two rows of different texts."""
        among = self.judge.of_row(self.rules, spot)
        angles = self.with_angles(among)
        if self.tables and a.block >= 0:
            texts = self.a.fields(a.line.text), self.b.fields(b.line.text)
            if texts[0] and texts[1]:
                self.table_row(texts[0], texts[1], (a, b), spot, among, angles)
                return
        if self.a.columns and self.b.columns and a.block >= 0:
            cells = [
                dict(section.cells(row.line.text, angles=angles)) for section, row in ((self.a, a), (self.b, b))
            ]
            for one, other in self.columns.pairs:
                column = self.a.columns[one] if one >= 0 else None
                field = Field(one, one + 1, column.name if column else "")
                self.cell(field, column, cells[0].get(one, []), cells[1].get(other, []), (a, b), spot, among)
            return
        placed = [
            [one for _, inside in section.cells(row.line.text, angles=angles and row.block >= 0) for one in inside]
            for section, row in ((self.a, a), (self.b, b))
        ]
        self.cell(Field(-1, 0, ""), None, placed[0], placed[1], (a, b), spot, among)

    def table_row(
        self,
        texts_a: Sequence[str],
        texts_b: Sequence[str],
        rows: tuple[Row, Row],
        spot: Spot,
        among: Sequence[int],
        angles: bool,
    ) -> None:
        """Weigh the fields of two rows of tables that keep to their columns: most of them are the same text."""
        for one, other in self.columns.pairs[1:]:
            text_a, text_b = texts_a[one], texts_b[other]
            if text_a == text_b:
                continue
            word_a, word_b = text_a.strip(), text_b.strip()
            if word_a == word_b:
                continue
            column = self.a.columns[one]
            single = parse(word_a) if word_a and " " not in word_a else ()
            other_single = parse(word_b) if word_b and " " not in word_b else ()
            if len(single) == len(other_single) == 1:
                end = column.start + len(text_a.rstrip())
                field = Field(one, one + 1, column.name, end - len(word_a), end)
                self.token(field, column, single[0], other_single[0], rows, spot, among)
            else:
                a = self.a.tokens_in(one, text_a, angles=angles)
                b = self.b.tokens_in(other, text_b, angles=angles)
                self.cell(Field(one, one + 1, column.name), column, a, b, rows, spot, among)

    def cell(
        self,
        field: Field,
        column: Column | None,
        a: list[Placed],
        b: list[Placed],
        rows: tuple[Row, Row],
        spot: Spot,
        among: Sequence[int],
    ) -> None:
        """Weigh the tokens of one cell; in none, every token is a field of its own."""
        start, end_a, end_b = 0, len(a), len(b)
        if len(a) != len(b):
            while start < min(end_a, end_b) and a[start].token.text == b[start].token.text:
                start += 1
            while min(end_a, end_b) > start and a[end_a - 1].token.text == b[end_b - 1].token.text:
                end_a, end_b = end_a - 1, end_b - 1
            own = _spanning(field, [*a[start:end_a], *b[start:end_b]], start + 1)
            rule = self.judge.about_value(self.judge.of_field(among, spot, own), None, None)
            if rule is None or not rule.skip:
                texts = [
                    " ".join(one.token.text for one in part) or None for part in (a[start:end_a], b[start:end_b])
                ]
                name = rule.name if rule else "exact"
                self.result.found(self.weighed("text", own, rows, texts[0], texts[1], rule=name))
            return
        pairs = _pairs_of_fields(a, b) if len(a) > 1 else [(a[0], b[0])] if a else []
        for n, (one, other) in enumerate(pairs, start=1):
            if one.token.text != other.token.text:
                self.token(_spanning(field, [one, other], n), column, one.token, other.token, rows, spot, among)

    def token(
        self,
        field: Field,
        column: Column | None,
        a: Token,
        b: Token,
        rows: tuple[Row, Row],
        spot: Spot,
        among: Sequence[int],
    ) -> None:
        """Weigh two tokens of different texts."""
        rule = self.judge.about_value(self.judge.of_field(among, spot, field), a, b) if among else None
        verdict = self.judge.weigh(rule, a, b)
        if verdict.skipped or (verdict.passes and not verdict.difference):
            return
        kind = "overflow" if "overflow" in (a.kind, b.kind) else "text"
        if verdict.difference is not None:
            kind = "angle" if a.kind == "angle" else "number"
        unit = verdict.unit or (column.unit if column and verdict.difference is not None else "")
        if (
            verdict.passes
            and verdict.difference is not None
            and not self.result.is_larger(unit, verdict.difference)
        ):
            self.result.passed += 1
            return
        finding = self.weighed(
            kind, field, rows, a.text, b.text, rule=verdict.rule, difference=verdict.difference,
            last_digits=verdict.last_digits, unit=unit,
        )  # fmt: skip
        self.result.found(finding, passes=verdict.passes)

    def weighed(
        self, kind: str, field: Field, rows: tuple[Row, Row], a: str | None, b: str | None, **more: object
    ) -> Finding:
        """Return a finding in a field of two rows."""
        return Finding(
            kind=kind,  # type: ignore[arg-type]
            section=self.result.title,
            row=name_of(rows[0]),
            column=field.heading or (f"field {field.number}" if field.number else ""),
            a=a,
            b=b,
            place_a=place_of([rows[0].line]),
            place_b=place_of([rows[1].line]),
            **more,  # type: ignore[arg-type]
        )

    def finding(self, kind: str, *, row: str, a: Place, b: Place, text: str | None = None) -> Finding:
        """Return a finding about a whole row."""
        return Finding(
            kind=kind,  # type: ignore[arg-type]
            section=self.result.title,
            row=row,
            a=text if kind == "only in A" else None,
            b=text if kind == "only in B" else None,
            place_a=a,
            place_b=b,
        )


_NO_SPOT = Spot((), (), (), lambda column: (), lambda column: ())


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


def place_of(lines: Sequence[Line]) -> Place:
    """Return where the first of some lines stands."""
    return Place(page=lines[0].page, line=lines[0].number) if lines else Place()


def name_of(row: Row) -> str:
    """Return what a row is called: its ids, or how it begins."""
    return " ".join(one for one in row.ids if one) or squeezed(row.line.text)[:40]


def _spanning(field: Field, placed: Sequence[Placed], number: int = 1) -> Field:
    """Return a field with its columns of print; in no column its number counts the fields of the row."""
    start, end = placed[0].start, placed[0].end
    for one in placed[1:]:
        start, end = min(start, one.start), max(end, one.end)
    return Field(field.column, field.number if field.column >= 0 else number, field.heading, start, end)


def spot_of(a: Section, b: Section | None, row_a: Row | None, row_b: Row | None) -> Spot:
    """Return a pair of rows as rules see it; without rows it is the section itself."""
    rows = [(section, row) for section, row in ((a, row_a), (b, row_b)) if section is not None and row is not None]
    if not rows:
        lines = a.titles or [line for line, _ in a.lines[:1]]
        return Spot(tuple(line.page for line in lines[:1]), (), (), lambda column: (), lambda column: ())
    section, row = rows[0]
    names = tuple(one for name in row.ids for one in (name, *name.split()))
    return Spot(
        (row.line.page,),
        tuple(one.line.text for _, one in rows),
        names,
        lambda column: ids_named(section, row, column, PHOTO),
        lambda column: ids_named(section, row, column, POINT),
        by_row=section.grouped or not section.columns,
    )
