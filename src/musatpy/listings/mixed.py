"""A listing against a record: every printed number must be the record's number at its printed precision."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property
from typing import Any, NamedTuple

from musatpy.errors import Problem
from musatpy.listings.align import align
from musatpy.listings.findings import Difference, Finding, FindingKind, Place
from musatpy.listings.judge import NO_SPOT, AnySpot, Field, Judge, RuleSet, Spot, Verdict
from musatpy.listings.lines import CannotCompareError, paper_of
from musatpy.listings.mapping import mapped_section
from musatpy.listings.printed import Cells, is_zero, numbered, sentences, unbroken
from musatpy.listings.recorded import (
    LONGEST,
    SHOWN_DIGITS,
    expanded,
    id_text,
    nested,
    token_of,
    unit_named,
    value_of,
)
from musatpy.listings.records import Number, at, keys_of, read_json
from musatpy.listings.rules import Rule, Rules
from musatpy.listings.sections import Row, Section, sections_of
from musatpy.listings.tally import Tally
from musatpy.listings.tokens import Token, tokens_of
from musatpy.listings.weighing import name_of, place_of, spot_of
from musatpy.reports.origin import Mapped, Origin
from musatpy.reports.table import PRINTED

_FIXED = [f"%.{decimals}f" for decimals in range(LONGEST + SHOWN_DIGITS + 1)]
_MORE = re.compile(r"and \d+ more\b")  # texts that are not printed
_CUT = re.compile(r"Only the worst \d+ of \d+ rows ")
_PLAIN = re.compile(rf"[+-]?\d*\.\d{{1,{LONGEST}}}|\d+", re.ASCII)  # not `-0`, which may be degrees


def compare_with_record(a: str, b: str, rules: Rules, names: tuple[str, str], *, listing: int) -> Difference:
    """Return what differs between a listing and a record; `listing` says which of the two is the listing."""
    judge = Judge(rules)
    texts = (a, b)
    content = read_json(texts[1 - listing], names[1 - listing])
    if not isinstance(content, dict):
        problem = Problem(
            file=names[1 - listing], message="is no record of a run, and cannot be held against a listing"
        )
        raise CannotCompareError([problem])
    tallies, notes = [], []
    for section in sections_of(paper_of(texts[listing], rules.layout), rules.layout):
        mapped = mapped_section(section.title)
        if mapped is None:
            notes.append(section.title or "lines before the first title")
            continue
        found = _Pair(judge, section, mapped, content, listing)
        tallies.append(found.tally())
        notes += found.notes()
    if not tallies:
        problem = Problem(file=names[listing], message="has no section with numbers of a record")
        raise CannotCompareError([problem])
    return Difference(
        a=names[0],
        b=names[1],
        findings=tuple(finding for tally in tallies for finding in tally.findings),
        sections=tuple(tally.summary() for tally in tallies),
        rules=judge.uses(),
        not_compared=tuple(notes),
    )


class Entry(NamedTuple):
    """One row of the record that is printed: its ids as the listing has them, and its fields."""

    ids: tuple[str, ...]
    fields: Mapping[str, Any]


@dataclass(eq=False)
class _Shown:
    """A row of the listing, what the record has of it, and the rules that select something in it."""

    row: Row
    fields: Mapping[str, Any]
    spot: AnySpot
    among: RuleSet

    @cached_property
    def where(self) -> tuple[str, Place]:
        """What the row is called, and where it stands in the listing."""
        return name_of(self.row), place_of([self.row.line])


class _Column(NamedTuple):
    """A column of a table, and where the record has its numbers."""

    number: int
    own: Field
    unit: str
    scale: float  # of the printed unit
    source: Origin
    keys: tuple[str | int, ...]  # of its field, none where that is not printed as it is
    unless: int  # the column that leaves this one blank with a zero, -1 for none
    unit_in: int  # the column that says the unit, -1 for none

    def plain_number(self, fields: Mapping[str, Any]) -> float | None:
        """Return the record's number in the unit printed, None where it is not a field as it is."""
        value: Any = fields
        try:
            for key in self.keys:
                value = value[key]
        except (KeyError, IndexError, TypeError):
            return None
        return float(value) / self.scale if type(value) is Number else None


_NO_PLACE = Place()
_A_NUMBER = Token("number", "1", Decimal(1))  # rules choose numbers by kind, not by size


class _Pair:
    """A section of the listing and what the record has of it."""

    def __init__(
        self, judge: Judge, section: Section, mapped: Mapped, content: Mapping[str, Any], listing: int
    ) -> None:
        self.judge = judge
        self.section = section
        self.mapped = mapped
        self.content = content
        self.listing = listing
        self.side = "AB"[listing]
        self.other = "AB"[1 - listing]
        self.rules = judge.of_section([section.title])
        self.result = Tally(section.title)
        self.unknown: Counter[str] = Counter()
        self.cut = False  # a table says that it has not all rows

    def notes(self) -> list[str]:
        """Return what of the section was not compared."""
        kinds = [f"{what} ({count} rows)" if count > 1 else what for what, count in self.unknown.items()]
        return [f"{self.section.title}: {', '.join(kinds)}"] if kinds else []

    def tally(self) -> Tally:
        """Compare, and return what was found."""
        {"rows": self.table, "across": self.across, "xyz": self.components, "labels": self.labels,
         "texts": self.texts}[self.mapped.layout]()  # fmt: skip
        return self.result

    def table(self) -> None:
        """Compare a table with a row for each entry."""
        names = numbered([column.name for column in self.section.columns])
        if not names:
            self.unknown["rows without headings"] += len(self.section.lines)
            return
        ids = [names.index(name) for name in self.mapped.ids if name in names]
        entries = self.entries()
        rows = list(self.rows_of(ids, {entry.ids for entry in entries}))
        columns = self.columns(names)
        self.leave_out(names, {*ids, *(one.number for one in columns), *(one.unit_in for one in columns)})
        cells_of = {row.line.number: cells for row, cells, _ in rows}
        for found, entry in self.pairs([(row, key) for row, _, key in rows], entries):
            if found is None or entry is None:
                self.lonely(found, entry)
            else:
                self.result.rows += 1
                self.row(self.shown(found, entry.fields), cells_of[found.line.number], columns)

    def rows_of(
        self, ids: Sequence[int], known: Collection[tuple[str, ...]]
    ) -> Iterator[tuple[Row, Cells, tuple[str, ...]]]:
        """Yield the rows of the table with their ids; not the sentences below it, nor the ends of these."""
        after_note = -1
        for row in self.section.rows:
            cells = Cells(self.section, row.line.text)
            key = tuple([cells.text(n) for n in ids])
            if is_cut := bool(_CUT.match(row.line.text) or _MORE.match(row.line.text)):
                self.cut = True
            if is_cut or cells.is_note or (row.line.number == after_note and key not in known):
                self.unknown["notes"] += 1
                after_note = row.line.number + 1
            else:
                yield row, cells, key

    def leave_out(self, names: Sequence[str], taken: Collection[int]) -> None:
        """Name the columns that the record has nothing of."""
        for n, column in enumerate(self.section.columns[: len(names)]):
            if n not in taken:
                self.unknown[f"column {column.name}" if column.name else "a column without a heading"] += 1

    def columns(self, names: Sequence[str]) -> list[_Column]:
        """Return the columns that the record has something of."""
        found = []
        for n, (name, column) in enumerate(zip(names, self.section.columns, strict=True)):
            if source := self.mapped.columns.get(name):
                unless, unit_in = (names.index(one) if one else -1 for one in (source.unless, source.unit_in))
                unit = source.unit or column.unit
                keys = keys_of(source.field) if source.is_field else ()
                own = Field(n, n + 1, column.name)
                found.append(_Column(n, own, unit, PRINTED.get(unit, 1.0), source, keys, unless, unit_in))
        return found

    def row(self, shown: _Shown, cells: Cells, columns: Sequence[_Column]) -> None:
        """Compare the columns of a row with the record."""
        for column in columns:
            word = cells.word(column.number)
            number = column.plain_number(shown.fields) if word else None
            if number is not None and self.plain_number(column, word, number, shown):
                continue
            if column.unless < 0 or not is_zero(cells.tokens(column.unless)):
                unit = self.unit(column, shown, cells)
                self.value(column.own, unit, cells.tokens(column.number), column.source, shown)

    def unit(self, column: _Column, shown: _Shown, cells: Cells) -> str:
        """Return the unit of a printed number, which may be that of its row."""
        if column.unit_in >= 0:
            return unit_named(cells.text(column.unit_in))
        is_angle = column.source.angles and re.fullmatch(column.source.angles, shown.row.ids[0])
        return "arc sec" if is_angle else column.unit

    def plain_number(self, column: _Column, word: str, number: float, shown: _Shown) -> bool:
        """Weigh a number of plain digits as `value` would, in a third of the time; tell if it is one."""
        decimals = len(word.partition(".")[2])
        if decimals > LONGEST or not math.isfinite(number):
            return False
        rounded = _FIXED[decimals] % number
        if rounded == word:
            if shown.among:
                self.rule(column.own, _A_NUMBER, _A_NUMBER, shown)
            return True
        if not _PLAIN.fullmatch(word):
            return False
        text = rounded if number.is_integer() else _FIXED[decimals + SHOWN_DIGITS] % number
        token, recorded = Decimal(word), Decimal(rounded)
        if shown.among:
            one = Token._make(("number", word, token, -decimals))
            other = Token._make(("number", text, recorded, -decimals))
            self.weighed(column.own, column.unit, one, other, shown)
        elif token != recorded:
            a, b, texts = (token, recorded, (word, text)) if self.listing == 0 else (recorded, token, (text, word))
            difference = b - a
            verdict = (False, "exact", False, difference, difference.scaleb(decimals), column.unit)
            self.found("number", column.own, texts, Verdict._make(verdict), shown)
        return True

    def pairs(
        self, rows: Sequence[tuple[Row, tuple[str, ...]]], entries: Sequence[Entry]
    ) -> Iterator[tuple[Row | None, Entry | None]]:
        """Yield rows and entries of the same ids, and those of one side only."""
        ids = [key for _, key in rows], [entry.ids for entry in entries]
        texts = [" ".join(key) for key in ids[0]], [" ".join(key) for key in ids[1]]
        found = align(ids, texts, lambda side, n: ids[side][n], strict=True)
        partner = dict(found.pairs)
        for n, (row, _) in enumerate(rows):
            other = partner.get(n)
            yield row, None if other is None else entries[other]
        if not (self.mapped.some or self.cut):
            for n in found.only_b:
                yield None, entries[n]

    def entries(self) -> list[Entry]:
        """Return what the record has, as far as it is printed."""
        paths, unnamed = tuple(self.mapped.ids.values()), self.mapped.unnamed
        return [
            Entry(tuple([id_text(at(fields, path)) or unnamed for path in paths]), fields)
            for outer in self.record_rows()
            for row in nested(outer, self.mapped.nested)
            if self.mapped.prints(row)
            for fields in expanded(self.mapped.worded(row), self.mapped.expand)
        ]

    def record_rows(self) -> list[dict[str, Any]]:
        """Return the rows of the table of the record."""
        found = at(self.content, self.mapped.table)
        if isinstance(found, dict):
            return [found]
        rows = [row for row in found if isinstance(row, dict)] if isinstance(found, list) else []
        return rows or ([{"value": found}] if found else [])  # a vector is the one row of a table

    def lonely(self, row: Row | None, entry: Entry | None) -> None:
        """Take a row of the listing that the record has not, or the other way round."""
        side = self.side if row else self.other
        if row:
            spot, label = spot_of(self.section, None, row, None), name_of(row)
        else:
            ids = entry.ids if entry else ()
            spot, label = Spot((), (" ".join(ids),), ids, lambda column: ids, lambda column: ids), " ".join(ids)
        if self.judge.about_row(self.judge.of_row(self.rules, spot), spot, side):
            return
        place = place_of([row.line]) if row else Place()
        self.result.found(
            Finding(
                kind="only in A" if side == "A" else "only in B",
                section=self.section.title,
                row=label,
                a=label if side == "A" else None,
                b=label if side == "B" else None,
                place_a=place if side == "A" else Place(),
                place_b=place if side == "B" else Place(),
            )
        )

    def across(self) -> None:
        """Compare a table with a column for each entry."""
        entries = self.record_rows()
        by_id = {id_text(at(entry, path)): entry for path in self.mapped.ids.values() for entry in entries}
        for row in self.section.rows:
            source = self.mapped.source_of(row.ids[0])
            cells = self.section.cells(row.line.text, angles=self.section.angles)
            if source is None:
                self.unknown[row.ids[0]] += 1
                continue
            self.result.rows += 1
            shown = self.shown(row, {})
            printed = {n: [one.token for one in inside] for n, inside in cells if n >= 0}
            for n, column in enumerate(self.section.columns):
                entry = by_id.get(column.name) if by_id else (entries[n] if n < len(entries) else None)
                if entry is None:
                    self.unknown[f"column {column.name}"] += 1
                    continue
                one = source
                if source.marks:
                    is_marked = id_text(at(self.content, source.field)) == column.name
                    one, entry = Origin(field="mark"), {"mark": source.marks if is_marked else None}
                own = Field(n, n + 1, column.name)
                self.value(own, column.unit, printed.get(n, []), one, replace(shown, fields=entry))

    def components(self) -> None:
        """Compare a table with rows X, Y, Z for each entry."""
        entries = {id_text(entry.get("point")): entry for entry in self.record_rows()}
        for row in self.section.rows:
            entry = entries.get(row.ids[0])
            letter = row.ids[-1]
            if entry is None or letter not in ("X", "Y", "Z"):
                if any(one.token.kind == "number" for one in tokens_of(row.line.text)):
                    self.lonely(row, None)
                else:
                    self.unknown["notes"] += 1
                continue
            self.result.rows += 1
            shown = self.shown(row, entry)
            printed = dict(self.section.cells(row.line.text, angles=False))
            for n, column in enumerate(self.section.columns):
                source = self.mapped.columns.get(column.name)
                if source:
                    path = Origin(field=f"{source.field}[{'XYZ'.index(letter)}]")
                    tokens = [one.token for one in printed.get(n, [])]
                    self.value(Field(n, n + 1, column.name), "", tokens, path, shown)

    def labels(self) -> None:
        """Compare lines of a label and a value."""
        for row in self.section.rows:
            numbers = [one for one in tokens_of(row.line.text) if one.token.kind in ("number", "overflow")]
            if not numbers:
                self.unknown["words"] += 1
                continue
            source = self.mapped.source_of(row.ids[0])
            if source is None:
                self.unknown[row.ids[0]] += 1
                continue
            sources = [source, *(replace(source, field=one) for one in source.then)]
            if len(numbers) > len(sources):
                self.unknown[f"{row.ids[0]}, all but the first number"] += 1
            self.result.rows += 1
            shown = self.shown(row, self.content)
            for n, (one, of) in enumerate(zip(numbers, sources, strict=False), start=1):
                own = Field(-1, n, "sigma" if n > 1 else "", one.start, one.end)
                self.value(own, of.unit, [one.token], of, shown)

    def texts(self) -> None:
        """Compare sentences, however their lines are broken."""
        recorded = self.recorded_texts()
        cut = False
        waiting = Counter(unbroken(text) for text in recorded)
        for row in sentences(self.section.rows):
            if _MORE.match(row.ids[0]):
                cut = True
            elif waiting[unbroken(row.ids[0])] > 0:
                waiting[unbroken(row.ids[0])] -= 1
                self.result.rows += 1
            else:
                self.lonely(row, None)
        for text in recorded:
            if waiting[unbroken(text)] > 0 and not cut:
                waiting[unbroken(text)] -= 1
                self.lonely(None, Entry((text,), {}))

    def recorded_texts(self) -> list[str]:
        """Return the texts that the record has of the section."""
        texts: list[str] = []
        if self.mapped.ids:
            texts = [" ".join(entry.ids) for entry in self.entries()]
        for path in self.mapped.also if self.mapped.ids else (self.mapped.table, *self.mapped.also):
            found = at(self.content, path)
            entries = found if isinstance(found, list) else []
            texts += [id_text(one.get("text") if isinstance(one, dict) else one) for one in entries]
        return texts

    def shown(self, row: Row, fields: Mapping[str, Any]) -> _Shown:
        """Return a row of the listing with what the record has of it, and the rules that select something in it."""
        spot = spot_of(self.section, None, row, None) if self.rules else NO_SPOT
        return _Shown(row, fields, spot, self.judge.of_row(self.rules, spot))

    def value(self, own: Field, unit: str, printed: Sequence[Token], source: Origin, shown: _Shown) -> None:
        """Weigh one printed value against the record's."""
        token = printed[0] if len(printed) == 1 else Token("word", " ".join([one.text for one in printed]))
        recorded = token_of(value_of(source, shown.fields), token, unit)
        if token.text or not (source.blank or recorded.text == ""):
            self.weighed(own, unit, token, recorded, shown)
        elif shown.among:
            self.rule(own, token, recorded, shown)

    def rule(self, own: Field, token: Token, recorded: Token, shown: _Shown) -> Rule | None:
        """Return the rule that decides about a printed value."""
        return self.judge.about_value(self.judge.of_field(shown.among, shown.spot, own), token, recorded)

    def weighed(self, own: Field, unit: str, token: Token, recorded: Token, shown: _Shown) -> None:
        """Weigh a printed token against the record's."""
        rule = self.rule(own, token, recorded, shown) if shown.among else None
        if token.value is not None and token.value == recorded.value and token.kind == recorded.kind:
            return
        a, b = (token, recorded) if self.listing == 0 else (recorded, token)
        verdict = self.judge.weigh(rule, a, b)
        if verdict.skipped or (verdict.passes and not verdict.difference):
            return
        kind: FindingKind = "overflow" if token.kind == "overflow" else "text"
        if verdict.difference is not None:
            kind = "angle" if token.kind == "angle" else "number"
            verdict = verdict._replace(unit=verdict.unit or unit)
        self.found(kind, own, (a.text, b.text), verdict, shown)

    def found(self, kind: FindingKind, own: Field, texts: tuple[str, str], verdict: Verdict, shown: _Shown) -> None:
        """Take a printed value that differs from the record's; texts are those of A and B."""
        passes, name, _, difference, last_digits, unit = verdict
        row, place = shown.where
        place_a, place_b = (place, _NO_PLACE) if self.listing == 0 else (_NO_PLACE, place)
        self.result.found(
            Finding._make((
                kind, self.section.title, row, own.heading, texts[0] or None, texts[1] or None, difference, unit,
                last_digits, None, name, place_a, place_b,
            )),
            passes=passes,
        )  # fmt: skip
