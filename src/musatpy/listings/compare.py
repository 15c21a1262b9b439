"""Two listings, number by number: sections and rows find each other, then the fields of each pair are weighed."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from musatpy.listings.align import Alignment, align
from musatpy.listings.findings import Difference, Finding, Place
from musatpy.listings.judge import NO_SPOT, AnySpot, Field, Judge
from musatpy.listings.lines import paper_of
from musatpy.listings.pairing import SectionPair, pairs_of_sections
from musatpy.listings.rules import Rules
from musatpy.listings.sections import Column, Row, Section, sections_of, squeezed
from musatpy.listings.tally import Tally
from musatpy.listings.tokens import parse
from musatpy.listings.weighing import (
    ColumnPairs,
    RowPair,
    Weigher,
    name_of,
    overflows_in_both,
    place_of,
    spot_of,
)


def compare_listings(a: str, b: str, rules: Rules, names: tuple[str, str]) -> Difference:
    """Return what differs between the texts of two listings."""
    judge = Judge(rules)
    both = [sections_of(paper_of(text, rules.layout), rules.layout) for text in (a, b)]
    tallies = [_Pair(judge, pair).tally() for pair in pairs_of_sections(both[0], both[1])]
    return Difference(
        a=names[0],
        b=names[1],
        findings=tuple(finding for tally in tallies for finding in tally.findings),
        sections=tuple(tally.summary() for tally in tallies),
        rules=judge.uses(),
        not_compared=tuple(f"{tally.title}: {_asterisks(tally.untold)}" for tally in tallies if tally.untold),
    )


def _asterisks(count: int) -> str:
    fields = "1 field" if count == 1 else f"{count} fields"
    return f"{fields} of asterisks in both, whose numbers are not known"


def _coarse(text: str) -> tuple[str, ...]:
    """Return the fields of a row, numbers with two digits: what rows of nearly equal numbers have in common."""
    chunks = text.split()
    try:  # of a row of numbers only, all at once
        return tuple(("%.1e " * len(chunks) % tuple(map(float, chunks))).split())
    except ValueError:  # words, numbers that run together, D exponents
        pass
    found: list[str] = []
    for chunk in chunks:
        try:
            found.append(f"{float(chunk):.1e}")
        except ValueError:
            tokens = parse(chunk)
            found += [token.text if token.value is None else f"{token.value:.1e}" for token in tokens]
    return tuple(found)


class _Pair:
    """One section of both listings, or of one only."""

    def __init__(self, judge: Judge, pair: SectionPair) -> None:
        self.judge = judge
        self.pair = pair
        self.a = pair.a or Section("")
        self.b = pair.b or Section("")
        self.title = (pair.a or self.b).title
        self.result = Tally(self.title or "(before the first title)")
        self.rules = judge.of_section([section.title for section in (pair.a, pair.b) if section])
        self.pending = judge.open(self.rules)
        columns = ColumnPairs.of(self.a.columns, self.b.columns, pair.columns)
        self.weigher = Weigher(judge, self.a, self.b, columns, self.result)
        self.asks_rows = judge.asks_rows(self.rules)

    def tally(self) -> Tally:
        """Compare, and return what was found."""
        if self.pair.columns is None:
            self.around_rows()
        if not self.pair.lonely:
            self.all_rows()
        return self.result

    def around_rows(self) -> None:
        """Compare titles and headings, and where the sections stand."""
        if self.pair.lonely:
            self.only_here()
            return
        if self.pair.moved and not self.about_section(self.a, "order"):
            lines = self.a.titles or [line for line, _ in self.a.lines[:1]]
            others = self.b.titles or [line for line, _ in self.b.lines[:1]]
            self.result.found(self.finding("order", a=place_of(lines), b=place_of(others), row="(the section)"))
        self.titles()
        self.headings()

    def all_rows(self) -> None:
        """Compare the rows, each with its partner."""
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

    def alignment(self, rows: tuple[Sequence[Row], Sequence[Row]]) -> Alignment:
        """Return which row of A belongs to which row of B."""
        ids = tuple([row.ids if any(row.ids) else () for row in side] for side in rows)
        texts = tuple([row.line.text for row in side] for side in rows)

        def coarse(side: int, row: int) -> Hashable:
            return _coarse(texts[side][row])

        return align((ids[0], ids[1]), (texts[0], texts[1]), coarse, strict=self.a.grouped and self.b.grouped)

    def only_here(self) -> None:
        """Take a section that the other listing has not: one finding, unless rules allow it.

        Of a table whose columns stand in other tables there, what is left are the columns that do not.
        """
        side = self.pair.lonely
        section = self.a if side == "A" else self.b
        if self.pair.elsewhere:
            self.only_columns(side, section, section.columns)
        elif not self.about_section(section, side):
            text = "1 row" if len(section.lines) == 1 else f"{len(section.lines)} rows"
            place = place_of(section.titles or [section.lines[0][0]])
            self.result.found(
                Finding(
                    kind="section",
                    section=self.result.title,
                    a=text if side == "A" else None,
                    b=text if side == "B" else None,
                    place_a=place if side == "A" else Place(),
                    place_b=place if side == "B" else Place(),
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
        for side, columns, section in zip("AB", self.weigher.columns.only, (self.a, self.b), strict=True):
            self.only_columns(side, section, columns)

    def only_columns(self, side: str, section: Section, columns: Sequence[Column]) -> None:
        """Report columns that only one listing has, in any of its tables."""
        for column in columns:
            if column.name in self.pair.elsewhere:
                continue
            spot = spot_of(section, None, None, None)
            field = Field(0, section.columns.index(column) + 1, column.name)
            among = self.judge.of_field(self.judge.of_row(self.rules, spot), spot, field)
            rule = self.judge.about_value(among, None, None)
            if rule is None or not rule.skip:
                here, place = f"only in {side}", place_of(section.head[:1])
                self.result.found(
                    Finding(
                        kind="column",
                        section=self.result.title,
                        row="(headings)",
                        column=column.name,
                        a=here if side == "A" else None,
                        b=here if side == "B" else None,
                        place_a=place if side == "A" else Place(),
                        place_b=place if side == "B" else Place(),
                    )
                )

    def only_row(self, a: Row | None, b: Row | None) -> None:
        """Take a row that the other listing has not."""
        row = a or b
        if row is None or self.pair.columns is not None:
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
        if "**" in a[0][0] and "**" in b[0][0]:
            self.result.untold += overflows_in_both(self.a, a, b)
        same = a[0][0] == b[0][0]
        if not same and not self.weigher.tables:
            same = a[0][0].split() == b[0][0].split()
        if same and not moved and not self.pending:
            return
        spot = spot_of(self.a, self.b, a, b) if self.asks_rows else NO_SPOT
        if same and self.pending:
            self.touch(a, spot)
        if moved and not self.judge.about_row(self.judge.of_row(self.rules, spot), spot, "order"):
            self.result.found(self.finding("order", row=name_of(a), a=place_of([a.line]), b=place_of([b.line])))
        if not same:
            self.weigher.weigh(RowPair(a, b, spot, self.judge.of_row(self.rules, spot)))

    def touch(self, row: Row, spot: AnySpot) -> None:
        """Mark the rules that select something in a row that does not differ."""
        if self.judge.of_row(self.pending, spot):
            self.weigher.touch(row, spot, self.judge.of_row(self.rules, spot))
            self.pending = self.judge.open(self.pending)

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
