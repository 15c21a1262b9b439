"""A listing against a record: every printed number must be the record's number at its printed precision."""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from musatpy.errors import Problem
from musatpy.listings.align import Alignment, align
from musatpy.listings.findings import Difference, Place, Tally
from musatpy.listings.json_tables import at, in_one_table
from musatpy.listings.json_text import read_json
from musatpy.listings.judge import Field, Judge, Spot
from musatpy.listings.lines import CUT, CannotCompareError, paper_of
from musatpy.listings.recorded import (
    entries_of,
    id_text,
    mapped_section,
    rows_of,
    token_of,
    unit_named,
    value_of,
)
from musatpy.listings.rules import Rules
from musatpy.listings.sections import Row, Section, name_of, numbered, place_of, sections_of, spot_of, squeezed
from musatpy.listings.tokens import Placed, Token, tokens_of
from musatpy.listings.weighing import Comparison, RowPair, Where
from musatpy.reports.origin import Mapped, Origin

_MORE = re.compile(r"and \d+ more\b")  # texts that are not printed


def compare_with_record(a: str, b: str, rules: Rules, names: tuple[str, str], *, listing: int) -> Difference:
    """Return what differs between a listing and a record; `listing` says which of the two is the listing."""
    judge = Judge(rules)
    texts = (a, b)
    content = read_json(texts[1 - listing], names[1 - listing])
    if not isinstance(content, dict):
        message = "is no record of a run, and cannot be held against a listing"
        raise CannotCompareError([Problem(file=names[1 - listing], message=message)])
    content = in_one_table(content)
    tallies, notes = [], []
    for section in sections_of(paper_of(texts[listing], rules.layout), rules.layout):
        mapped = mapped_section(section.title)
        if mapped is None or _is_left_out(content, mapped.table):
            notes.append(section.title or "lines before the first title")
            continue
        comparison = _Shown(judge, section, mapped, content, listing)
        tallies.append(comparison.tally())
        notes += comparison.notes()
    if not tallies:
        raise CannotCompareError([Problem(file=names[listing], message="has no section with numbers of a record")])
    return Difference.of(names, tallies, judge.rules, notes)


@dataclasses.dataclass(frozen=True, eq=False)
class _RowPair(RowPair):
    """A row of the listing, and what the record has of it."""

    fields: Mapping[str, Any] = dataclasses.field(default_factory=dict)


class _Column(NamedTuple):
    """A column of a table, and where the record has its numbers."""

    field: Field
    unit: str
    source: Origin
    unless: int  # the column that leaves this one blank with a zero, -1 for none
    unit_in: int  # the column that says the unit, -1 for none


class _Cells:
    """The tokens of a row of a table by columns."""

    def __init__(self, section: Section, row: Row) -> None:
        self.line = row.line.text
        self.placed: dict[int, list[Placed]] = dict(section.cells(self.line, angles=section.angles))

    def text(self, column: int) -> str:
        """Return what stands in a column, with one blank between words."""
        placed = self.placed.get(column)
        return squeezed(self.line[placed[0].start : placed[-1].end]) if placed else ""

    def tokens(self, column: int) -> list[Token]:
        """Return the tokens in a column."""
        return [placed.token for placed in self.placed.get(column, [])]

    def is_zero(self, column: int) -> bool:
        """Tell whether the number in a column is zero as printed."""
        tokens = self.tokens(column)
        return bool(tokens) and tokens[0].value == 0


class _Shown(Comparison):
    """A section of the listing and what the record has of it."""

    def __init__(
        self, judge: Judge, section: Section, mapped: Mapped, content: Mapping[str, Any], listing: int
    ) -> None:
        super().__init__(judge, section.title, [section.title])
        self.section = section
        self.mapped = mapped
        self.content = content
        self.listing = listing
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
        entries = entries_of(self.mapped, self.content)
        rows = list(self.rows_of(ids, {entry.ids for entry in entries}))
        columns = self.columns(names)
        self.leave_out(
            {*ids, *(column.field.column for column in columns), *(column.unit_in for column in columns)}
        )
        alignment = self.alignment([key for *_, key in rows], [entry.ids for entry in entries])
        partner = dict(alignment.pairs)
        for n, (row, cells, _) in enumerate(rows):
            if n not in partner:
                self.only_listed(row)
                continue
            both = self.row_pair(row, entries[partner[n]].fields)
            for column in columns:
                if column.unless < 0 or not cells.is_zero(column.unless):
                    unit = self.unit(column, row, cells)
                    self.value(both, column.field, unit, cells.tokens(column.field.column), column.source)
        for n in alignment.only_b if not (self.mapped.some or self.cut) else ():
            self.only_recorded(entries[n].ids)

    def rows_of(
        self, ids: Sequence[int], known: Collection[tuple[str, ...]]
    ) -> Iterator[tuple[Row, _Cells, tuple[str, ...]]]:
        """Yield the rows of the table with their ids; not the sentences below it, nor the ends of these."""
        after_note = -1
        for row in self.section.rows:
            cells = _Cells(self.section, row)
            key = tuple([cells.text(n) for n in ids])
            is_cut = bool(CUT.match(row.line.text) or _MORE.match(row.line.text))
            self.cut = self.cut or is_cut
            if is_cut or -1 in cells.placed or (row.line.number == after_note and key not in known):
                self.unknown["notes"] += 1
                after_note = row.line.number + 1
            else:
                yield row, cells, key

    def leave_out(self, taken: Collection[int]) -> None:
        """Name the columns that the record has nothing of."""
        for n, column in enumerate(self.section.columns):
            if n not in taken:
                self.unknown[f"column {column.name}" if column.name else "a column without a heading"] += 1

    def columns(self, names: Sequence[str]) -> list[_Column]:
        """Return the columns that the record has something of."""
        places = {name: n for n, name in enumerate(names) if name}
        return [
            _Column(
                Field(n, n + 1, column.name),
                source.unit or column.unit,
                source,
                places.get(source.unless, -1),
                places.get(source.unit_in, -1),
            )
            for n, (name, column) in enumerate(zip(names, self.section.columns, strict=True))
            if (source := self.mapped.columns.get(name))
        ]

    def unit(self, column: _Column, row: Row, cells: _Cells) -> str:
        """Return the unit of a printed number, which may be that of its row."""
        if column.unit_in >= 0:
            return unit_named(cells.text(column.unit_in))
        is_angle = column.source.angles and re.fullmatch(column.source.angles, row.ids[0])
        return "arc sec" if is_angle else column.unit

    def alignment(self, keys: Sequence[tuple[str, ...]], ids: Sequence[tuple[str, ...]]) -> Alignment:
        """Return which row of the listing belongs to which entry of the record."""
        texts = [" ".join(key) for key in keys], [" ".join(key) for key in ids]
        return align((keys, ids), texts, lambda side, n: (keys, ids)[side][n], strict=True)

    def only_listed(self, row: Row) -> None:
        """Take a row of the listing that the record has not."""
        where = Where(name_of(row), place_of([row.line]))
        self.only_row(spot_of(self.section, row), "AB"[self.listing], where.row, where)

    def only_recorded(self, ids: tuple[str, ...]) -> None:
        """Take a row of the record that the listing has not."""
        label = " ".join(ids)
        spot = Spot((), (label,), ids, lambda column: ids, lambda column: ids)
        self.only_row(spot, "AB"[1 - self.listing], label, Where(label))

    def across(self) -> None:
        """Compare a table with a column for each entry."""
        entries = rows_of(self.mapped, self.content)
        by_id = {id_text(at(entry, path)): entry for path in self.mapped.ids.values() for entry in entries}
        for row in self.section.rows:
            source = self.mapped.source_of(row.ids[0])
            if source is None:
                self.unknown[row.ids[0]] += 1
                continue
            both, cells = self.row_pair(row, {}), _Cells(self.section, row)
            for n, column in enumerate(self.section.columns):
                entry = by_id.get(column.name) if by_id else (entries[n] if n < len(entries) else None)
                if entry is None:
                    self.unknown[f"column {column.name}"] += 1
                    continue
                shown = source
                if source.marks:
                    is_marked = id_text(at(self.content, source.field)) == column.name
                    shown, entry = Origin(field="mark"), {"mark": source.marks if is_marked else None}
                field = Field(n, n + 1, column.name)
                self.value(dataclasses.replace(both, fields=entry), field, column.unit, cells.tokens(n), shown)

    def components(self) -> None:
        """Compare a table with rows X, Y, Z for each entry."""
        entries = {id_text(entry.get("point")): entry for entry in rows_of(self.mapped, self.content)}
        for row in self.section.rows:
            entry, letter = entries.get(row.ids[0]), row.ids[-1]
            if entry is None or letter not in ("X", "Y", "Z"):
                if any(placed.token.kind == "number" for placed in tokens_of(row.line.text)):
                    self.only_listed(row)
                else:
                    self.unknown["notes"] += 1
                continue
            both, cells = self.row_pair(row, entry), _Cells(self.section, row)
            for n, column in enumerate(self.section.columns):
                if source := self.mapped.columns.get(column.name):
                    path = Origin(field=f"{source.field}[{'XYZ'.index(letter)}]")
                    self.value(both, Field(n, n + 1, column.name), "", cells.tokens(n), path)

    def labels(self) -> None:
        """Compare lines of a label and a value."""
        for row in self.section.rows:
            numbers = [placed for placed in tokens_of(row.line.text) if placed.token.kind in ("number", "overflow")]
            source = self.mapped.source_of(row.ids[0])
            if not numbers or source is None:
                self.unknown[row.ids[0] if numbers else "words"] += 1
                continue
            sources = [source, *(dataclasses.replace(source, field=path) for path in source.then)]
            if len(numbers) > len(sources):
                self.unknown[f"{row.ids[0]}, all but the first number"] += 1
            both = self.row_pair(row, self.content)
            for n, (number, of) in enumerate(zip(numbers, sources, strict=False), start=1):
                if of.count and _is_left_out(self.content, of.field):
                    self.unknown[f"{row.ids[0]}, number {n}"] += 1
                    continue
                field = Field(-1, n, "sigma" if n > 1 else "", number.start, number.end)
                self.value(both, field, of.unit, [number.token], of)

    def texts(self) -> None:
        """Compare sentences, however their lines are broken."""
        recorded = self.recorded_texts()
        waiting = Counter(_unbroken(text) for text in recorded)
        for row in _sentences(self.section.rows):
            if _MORE.match(row.ids[0]):
                self.cut = True
            elif waiting[_unbroken(row.ids[0])] > 0:
                waiting[_unbroken(row.ids[0])] -= 1
                self.result.rows += 1
            else:
                self.only_listed(row)
        for text in recorded:
            if waiting[_unbroken(text)] > 0 and not self.cut:
                waiting[_unbroken(text)] -= 1
                self.only_recorded((text,))

    def recorded_texts(self) -> list[str]:
        """Return the texts that the record has of the section."""
        texts: list[str] = []
        if self.mapped.ids:
            texts = [" ".join(entry.ids) for entry in entries_of(self.mapped, self.content)]
        for path in self.mapped.also if self.mapped.ids else (self.mapped.table, *self.mapped.also):
            entries = at(self.content, path)
            for entry in entries if isinstance(entries, list) else []:
                texts.append(id_text(entry.get("text") if isinstance(entry, dict) else entry))
        return texts

    def row_pair(self, row: Row, fields: Mapping[str, Any]) -> _RowPair:
        """Return a row of the listing with what the record has of it, and the rules that select something in it."""
        self.result.rows += 1
        places = [Place(), Place()]
        places[self.listing] = place_of([row.line])
        spot = spot_of(self.section, row)
        return _RowPair(Where(name_of(row), *places), spot, self.judge.of_row(self.rules, spot), fields)

    def value(self, both: _RowPair, field: Field, unit: str, printed: Sequence[Token], source: Origin) -> None:
        """Weigh one printed value against the record's."""
        token = printed[0] if len(printed) == 1 else Token("word", " ".join([token.text for token in printed]))
        recorded = token_of(value_of(source, both.fields), token, unit)
        may_be_blank = source.blank or recorded.text == ""
        if (not token.text and may_be_blank) or (
            token.value is not None and token.value == recorded.value and token.kind == recorded.kind
        ):
            self.rule(both, field, token, recorded)
        else:
            a, b = (token, recorded) if self.listing == 0 else (recorded, token)
            self.weigh(both, field, unit, a, b)


def _is_left_out(content: Mapping[str, Any], path: str) -> bool:
    """Tell whether a record was written without a table."""
    return content.get("content") == "tables" and at(content, path) is None


def _sentences(rows: Sequence[Row]) -> list[Row]:
    """Return the rows that are not indented, each with the lines that continue it as its id."""
    sentences: list[Row] = []
    for row in rows:
        text = squeezed(row.line.text)
        if sentences and row.line.text[0] == " ":
            sentences[-1] = sentences[-1]._replace(ids=(f"{sentences[-1].ids[0]} {text}",))
        else:
            sentences.append(row._replace(ids=(text.removeprefix("- ").removeprefix("Note: "),)))
    return sentences


def _unbroken(text: object) -> str:
    """Return a text without blanks: lines may be broken behind hyphens too."""
    return "".join(str(text).split())
