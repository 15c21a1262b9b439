"""A listing against a record: each line of the listing is printed again with the values of the record.

In place of a printed value stands the record's, in the unit of its column and to as many digits; then print is
compared with print. Which value is where, the reports state.
"""

from __future__ import annotations

import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from decimal import Decimal
from functools import cache
from typing import Any

import numpy as np

from musatpy.errors import Problem
from musatpy.image_observations import are_apart, with_images
from musatpy.listings.findings import Difference, RuleUse
from musatpy.listings.lines import CUT, CannotCompareError, Line, paper_of
from musatpy.listings.listing import compare_sections, overflows
from musatpy.listings.records import read_json
from musatpy.listings.rules import Rules
from musatpy.listings.sections import Row, Section, columns_of, numbered, sections_of, squeezed
from musatpy.listings.tokens import Placed, tokens_of
from musatpy.reports.editing import edited
from musatpy.reports.encoding import plain
from musatpy.reports.fields import Field
from musatpy.reports.labels import Labels, Texts
from musatpy.reports.table import Report, Table
from musatpy.reports.values import Values, at

_MORE = re.compile(r"and \d+ more\b")  # texts that are not printed
_SPOILT = (LookupError, TypeError, ValueError, ArithmeticError, AttributeError)  # of what no record of ours has
_LARGEST_STEP = 30  # digits before or behind the point
Record = Mapping[str, Any]
Cells = Mapping[int, Sequence[Placed]]
Shown = Mapping[int, tuple[Any, bool]]  # by column: value in its printed unit, may be blank


def compare_with_record(a: str, b: str, rules: Rules, names: tuple[str, str], *, listing: int) -> Difference:
    """Return what differs between a listing and a record; `listing` says which of the two is the listing."""
    uses, texts, name = [RuleUse(rule) for rule in rules.rules], (a, b), names[1 - listing]
    content = read_json(texts[1 - listing], name)
    if not isinstance(content, dict):
        message = "is no record of a run, and cannot be held against a listing"
        raise CannotCompareError([Problem(file=name, message=message)])
    _refuse_other_schema(content, name)
    content = _with_images(content)
    tallies, notes = [], []
    for section in sections_of(paper_of(texts[listing], rules.layout), rules.layout):
        mapped = next((one for one in stated_sections() if re.fullmatch(_title(one), section.title)), None)
        place = getattr(mapped, "place", "") or getattr(mapped, "table", "")
        if mapped is None or _is_left_out(content, place):
            notes.append(section.title or "lines before the first title")
            continue
        printed = _Printed(section, mapped, content)
        both = printed.sections()
        tallies.append(compare_sections(uses, *(both if listing == 0 else both[::-1])))
        if printed.unknown:
            kinds = [f"{what} ({count} rows)" if count > 1 else what for what, count in printed.unknown.items()]
            notes.append(f"{section.title}: {', '.join(kinds)}")
    if not tallies:
        raise CannotCompareError([Problem(file=names[listing], message="has no section with numbers of a record")])
    return Difference.of(names, tallies, uses, [*notes, *overflows(tallies)])


def _refuse_other_schema(content: Record, name: str) -> None:
    """Raise `CannotCompareError` for the record of a run that another version wrote."""
    from musatpy.reports.record import SCHEMA_VERSION  # two listings need it not

    schema = str(content.get("schema_version", SCHEMA_VERSION))
    if schema.partition(".")[0] != SCHEMA_VERSION.partition(".")[0]:
        message = f"is a record of schema {schema}, and this program knows {SCHEMA_VERSION}; run the deck again"
        raise CannotCompareError([Problem(file=name, message=message)])


@cache
def stated_sections() -> tuple[Any, ...]:
    """Return what the reports state of all sections with numbers of the record."""
    from musatpy.reports.statements import statements  # two listings need them not

    return tuple(one for one in statements() if not isinstance(one, Report) or one.place)


def _with_images(content: Record) -> Record:
    """Return a record with all observations in one table; one that is not as its schema says stays as it is."""
    try:
        return with_images(content) if are_apart(content) else content
    except (LookupError, TypeError, ValueError, ZeroDivisionError):
        return content


def _is_left_out(content: Record, table: str) -> bool:
    """Tell whether a record was written without a table."""
    return content.get("content") == "tables" and at(content, table) is None


class _Printed:
    """A section of the listing, and the same section as the record prints it."""

    def __init__(self, section: Section, mapped: Any, content: Record) -> None:
        self.section = section
        self.mapped = mapped
        self.content = content
        self.unknown: Counter[str] = Counter()  # what of the listing the record has not
        self.ids: tuple[int, ...] = ()  # columns of a table that name its rows
        self.listed: list[Row] = []  # rows of the listing that are compared
        self.recorded: list[Row] = []  # those of the record

    def sections(self) -> tuple[Section, Section]:
        """Return the section of the listing without what the record has not, and that of the record."""
        layouts = {"rows": self.table, "across": self.across, "xyz": self.components, "texts": self.texts}
        if isinstance(self.mapped, Labels):
            self.labels()
        else:
            layouts["texts" if isinstance(self.mapped, Texts) else self.mapped.layout]()
        listed, recorded = (replace(self.section, titles=[]) for _ in range(2))
        listed.rows, recorded.rows = self.listed, self.recorded
        listed.id_columns = recorded.id_columns = self.ids or self.section.id_columns
        return listed, recorded

    def take(self, row: Row, values: Sequence[tuple[int, int, str]]) -> None:
        """Take a row of the listing; the record prints it with these texts between these columns of print."""
        self.listed.append(row)
        text = row.line.text
        for start, end, value in sorted(values, reverse=True):
            before, longer = text[:start].ljust(start), len(value) - (end - start)
            if longer > 0 and before.endswith(" " * (longer + 1)):
                before = before[:-longer]
            text = f"{before}{value:>{end - start}}{text[end:]}"
        self.recorded.append(row._replace(line=Line(text.rstrip(), 0, 0)))

    def cells(self, row: Row) -> Cells:
        """Return the numbers and words of a row by columns."""
        return dict(self.section.cells(row.line.text, angles=self.section.angles))

    def columns(self, values: Values) -> dict[str, Field[Any]]:
        """Return the columns of the report by their headings, as the listing has these."""
        layout = tuple(part for column in self.mapped.stated() for part in column.columns(values.system))
        names = numbered([column.name for column in columns_of(Table(layout).head())])
        return dict(zip(names, layout, strict=True))

    def table(self) -> None:
        """Print a table with a row for each entry."""
        names = numbered([head.name for head in self.section.columns])
        if not names:
            self.unknown["rows without headings"] += len(self.section.lines)
            return
        entries, ids, known = self.entries(names)
        self.ids = tuple(n for n, name in enumerate(names) if name in ids)
        for n, head in enumerate(self.section.columns):
            if n not in known and n not in self.ids:
                self.unknown[f"column {head.name}" if head.name else "a column without a heading"] += 1
        waiting: dict[tuple[str, ...], list[Shown]] = defaultdict(list)
        for key, shown in reversed(entries):
            waiting[key].append(shown)
        is_cut, after_note = self.mapped.some, -1
        for row in self.section.rows:
            cells = self.cells(row)
            key = tuple([_text_of(row, cells.get(n, [])) for n in self.ids])
            is_last = CUT.match(row.line.text)
            if is_last or -1 in cells or (row.line.number == after_note and key not in waiting):
                self.unknown["notes"] += 1
                after_note = row.line.number + 1
                is_cut = is_cut or bool(is_last)
                continue
            row = row._replace(ids=key or row.ids)
            if waiting.get(key):
                self.reprint(row, cells, waiting[key].pop())
            else:
                self.listed.append(row)
        if not is_cut:
            rest = [key for key, left in waiting.items() for _ in left]
            self.recorded += [Row(Line(" ".join(key), 0, 0), key, 0) for key in rest]

    def entries(self, names: Sequence[str]) -> tuple[list[tuple[tuple[str, ...], Shown]], set[str], set[int]]:
        """Return the rows of the record by their names, which headings these have, and which columns are known."""
        values = self.values()
        columns = self.columns(values)
        printed = {n: _printed(columns[name], values) for n, name in enumerate(names) if name in columns}
        ids = {name for name, column in columns.items() if column.is_id}
        named = [n for n in printed if names[n] in ids]
        keys = [tuple([squeezed(id_text(printed[n][entry])) for n in named]) for entry in range(values.count)]
        shown: list[Shown] = [
            {n: (texts[entry], columns[names[n]].blank) for n, texts in printed.items() if n not in named}
            for entry in range(values.count)
        ]
        return list(zip(keys, shown, strict=True)), ids, set(printed)

    def values(self) -> Values:
        """Return the rows of the table of a section."""
        system = at(self.content, "options.system") or at(self.content, "job.system")
        try:
            values: Values = self.mapped.read(self.content, str(system or ""))
            return values if values.count else Values([], list)
        except _SPOILT:
            return Values([], list)

    def reprint(self, row: Row, cells: Cells, shown: Shown) -> None:
        """Take a row, with what the record has of some of its columns."""
        values = []
        for n, (value, blank) in shown.items():
            placed, head = cells.get(n, []), self.section.columns[n]
            text = _reprinted(placed, value)
            if placed:
                values.append((placed[0].start, placed[-1].end, text))
            elif text and not blank:
                values.append((head.end, head.end, text))
        self.take(row, values)

    def across(self) -> None:
        """Print a table with a column for each entry."""
        values = self.values()
        rows = {str(column.heading): column for column in self.mapped.stated()}
        ids = [_printed(column, values) for column in rows.values() if column.is_id and column.name == "photo"]
        places = {id_text(name): entry for entry, name in enumerate(ids[0])} if ids else {}
        for row in self.section.rows:
            column = rows.get(row.ids[0])
            if column is None:
                self.unknown[row.ids[0]] += 1
                continue
            printed, shown = _printed(column, values), {}
            for n, head in enumerate(self.section.columns):
                entry = places.get(head.name) if ids else n
                if entry is None or entry >= len(printed):
                    self.unknown[f"column {head.name}"] += 1
                else:
                    shown[n] = printed[entry], column.blank
            self.reprint(row, self.cells(row), shown)

    def components(self) -> None:
        """Print a table with rows X, Y, Z for each entry."""
        values = self.values()
        columns = self.columns(values)
        rows = {id_text(name): row for row, name in enumerate(_printed(next(iter(columns.values())), values))}
        heads = [(n, columns.get(head.name)) for n, head in enumerate(self.section.columns)]
        printed = {n: _printed(column, values) for n, column in heads if column and not column.is_id}
        for row in self.section.rows:
            entry, axis = rows.get(row.ids[0]), "XYZ".find(row.ids[-1] or "-")
            if entry is not None and axis >= 0:
                shown = {n: (_entry(texts[entry], axis), False) for n, texts in printed.items()}
                self.reprint(row, self.cells(row), shown)
            elif any(placed.token.kind == "number" for placed in tokens_of(row.line.text)):
                self.listed.append(row)
            else:
                self.unknown["notes"] += 1

    def labels(self) -> None:
        """Print lines of a label and a value, or more."""
        try:
            found = self.mapped.numbers(self.content)
        except _SPOILT:
            found = {row.ids[0]: [None] for row in self.section.rows}
        for row in self.section.rows:
            label = row.ids[0]
            numbers = [placed for placed in tokens_of(row.line.text) if placed.token.kind in ("number", "overflow")]
            if not numbers or label not in found:
                self.unknown[label if numbers else "words"] += 1
                continue
            if len(numbers) > len(found[label]):
                most = len(found[label])
                self.unknown[f"{label}, all but the first {most} number{'s' * (most > 1)}"] += 1
            pairs = zip(numbers, found[label], strict=False)
            self.take(row, [(at.start, at.end, _reprinted([at], value)) for at, value in pairs])

    def texts(self) -> None:
        """Print sentences, however their lines are broken."""
        is_cut, listed = False, {}
        for line in _sentences(self.section.rows):
            if _MORE.match(line.text):
                is_cut = True
            else:
                listed["".join(line.text.split())] = line.text
                self.listed.append(Row(line, (line.text,), 0))
        for text in self.recorded_texts():
            unbroken = "".join(text.split())
            if unbroken in listed or not is_cut:
                known = listed.get(unbroken, text)
                self.recorded.append(Row(Line(known, 0, 0), (known,), 0))

    def recorded_texts(self) -> Iterator[str]:
        """Yield the texts that the record has of the section."""
        if isinstance(self.mapped, Texts):
            with suppress(*_SPOILT):
                yield from self.mapped.texts(self.content)
            return
        if isinstance(self.mapped, Report):
            values = self.values()
            cells = [_printed(column, values) for column in self.mapped.stated()]
            yield from (" ".join(filter(None, map(id_text, row))) for row in zip(*cells, strict=True))
            return


def _sentences(rows: Sequence[Row]) -> list[Line]:
    """Return the lines that are not indented, each with those that continue it."""
    sentences: list[Line] = []
    for row in rows:
        text = squeezed(row.line.text)
        if sentences and row.line.text[0] == " ":
            sentences[-1] = sentences[-1]._replace(text=f"{sentences[-1].text} {text}")
        else:
            sentences.append(row.line._replace(text=text.removeprefix("- ").removeprefix("Note: ")))
    return sentences


def _entry(values: Any, number: int) -> Any:
    return values[number] if isinstance(values, list) and number < len(values) else None


def id_text(value: Any) -> str:
    """Return what names a row as it is printed: of several names one behind the other."""
    return "" if value is None else " ".join(map(str, value)) if isinstance(value, list) else str(value)


def _title(stated: Any) -> str:
    return getattr(stated, "pattern", "") or re.escape(stated.title)


def _printed(column: Field[Any], values: Values) -> list[Any]:
    """Return what a column prints; nothing of a record that is not as its schema says."""
    try:
        found = column.printed(values)
        texts = plain(found) if isinstance(found, np.ndarray) else list(found)
    except _SPOILT:
        texts = []
    return [*texts, *[None] * (values.count - len(texts))]


def _text_of(row: Row, placed: Sequence[Placed]) -> str:
    """Return what stands in a cell, with one blank between words."""
    return squeezed(row.line.text[placed[0].start : placed[-1].end]) if placed else ""


def _reprinted(placed: Sequence[Placed], value: Any) -> str:
    """Return a value of the record as a listing prints it that has `placed`: with as many digits."""
    token = placed[0].token if len(placed) == 1 else None
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        return "" if value is None else str(value).replace("_", " ")
    if token and token.kind == "angle":
        return edited(f"S40.{max(-token.step, 0)}", [value])[0].strip()
    step = token.step if token and token.kind == "number" else -4
    number = Decimal(float(value))
    if abs(step) > _LARGEST_STEP:  # no field that a listing of ours has
        return str(number)
    rounded = number.quantize(Decimal(1).scaleb(step)) + 0
    return token.text if token and rounded == token.value else f"{rounded:f}"
