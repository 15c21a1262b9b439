"""A listing against a record: the tables of the record are printed, and print is compared with print.

What pages print in their own way (photos across the page, a label and numbers) is printed as the listing has it,
with the numbers of the record in place of its own. Which value is where, the reports state.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.errors import Problem, RecordError
from musatpy.json_files import known_of
from musatpy.listings.findings import Difference, RuleUse
from musatpy.listings.lines import CUT, CannotCompareError, Line, paper_of
from musatpy.listings.records import read_json
from musatpy.listings.rules import Rules
from musatpy.listings.sections import Row, Section, numbered, sections_of, squeezed
from musatpy.listings.tokens import Placed, tokens_of
from musatpy.listings.weighing import compare_rows, overflows
from musatpy.reports.editing import edited
from musatpy.reports.fields import Field
from musatpy.reports.table import Labels, Report, Table, Texts
from musatpy.reports.values import Values, at, plain

_MORE = re.compile(r"and \d+ more\b")  # texts that are not printed
Record = Mapping[str, Any]


def compare_with_record(a: str, b: str, rules: Rules, names: tuple[str, str], *, listing: int) -> Difference:
    """Return what differs between a listing and a record; `listing` says which of the two is the listing."""
    uses, texts, name = [RuleUse(rule) for rule in rules.rules], (a, b), names[1 - listing]
    content = _record_of(texts[1 - listing], name)
    found, notes = [], []
    for section in sections_of(paper_of(texts[listing], rules.layout), rules.layout):
        stated = next((one for one in stated_sections() if re.fullmatch(_title(one), section.title)), None)
        table = str(getattr(stated, "place", "") or getattr(stated, "table", ""))
        if stated is None or (content.get("content") == "tables" and at(content, table) is None):
            notes.append(section.title or "lines before the first title")
            continue
        printed = _Printed(section, stated, content)
        both = printed.sections()
        found.append(compare_rows(uses, *(both if listing == 0 else both[::-1])))
        if printed.unknown:
            kinds = [f"{what} ({count} rows)" if count > 1 else what for what, count in printed.unknown.items()]
            notes.append(f"{section.title}: {', '.join(kinds)}")
    if not found:
        raise CannotCompareError([Problem(file=names[listing], message="has no section with numbers of a record")])
    return Difference(*names, tuple(found), tuple(uses), (*notes, *overflows(found)))


def _record_of(text: str, name: str) -> Record:
    """Return a record, all observations in one table; raises `CannotCompareError` unless it obeys its schema."""
    from musatpy.reports.listing import documents  # two listings need them not

    content = read_json(text, name)
    of_others = (one for one in documents() if isinstance(content, dict) and one.name in content)
    schema = next((one.schema() for one in of_others), None)
    try:
        return known_of(content, Path(name), schema=schema)
    except RecordError as error:
        raise CannotCompareError(error.problems) from error


@cache
def stated_sections() -> tuple[Any, ...]:
    """Return what the reports state of all sections with numbers of the record."""
    from musatpy.reports.listing import statements  # two listings need them not

    return tuple(one for one in statements() if not isinstance(one, Report) or one.place)


class _Printed:
    """A section of the listing, and the same section as the record prints it."""

    def __init__(self, section: Section, stated: Any, content: Record) -> None:
        self.section = section
        self.stated = stated
        self.content = content
        self.unknown: Counter[str] = Counter()  # what of the listing the record has not
        self.listed: list[Row] = []  # rows of the listing that are compared
        self.recorded: list[Row] = []  # those of the record

    def sections(self) -> tuple[Section, Section]:
        """Return the section of the listing without what the record has not, and that of the record."""
        recorded = replace(self.section)
        if isinstance(self.stated, Labels):
            self.labels()
        elif isinstance(self.stated, Texts) or self.stated.layout == "texts":
            self.texts()
        elif self.stated.layout == "rows":
            recorded = self.table()
        else:
            self.grid()
        listed = replace(self.section)
        listed.rows, recorded.rows = self.listed, self.recorded
        listed.id_columns, listed.blank = self.section.id_columns, self.section.blank
        return listed, recorded

    def values(self) -> Values:
        """Return the rows of the table of a section."""
        system = at(self.content, "options.system") or at(self.content, "job.system")
        values: Values = self.stated.read(self.content, str(system or ""))
        return values

    def table(self) -> Section:
        """Print a table with a row for each entry."""
        values = self.values()
        columns = list(self.stated.side_by_side(values)) if values.count else []
        headings = {column.heading for column in columns}
        all_columns = (part for column in self.stated.stated() for part in column.columns(values.system))
        columns += [column for column in all_columns if column.heading not in headings]
        table = Table[Any](tuple(columns))
        recorded = Section(self.section.title, head=_lines(table.head()))
        recorded.lines = [(line, 0) for line in _lines(table.lines(values) if values.count else [])]
        names, known = (numbered([head.name for head in one.columns]) for one in (self.section, recorded))
        if not names:
            self.unknown["rows without headings"] += len(self.section.lines)
            return recorded
        others = [name for name in names if name not in known]
        self.unknown.update(f"column {name}" if name else "a column without a heading" for name in others)
        self.section.blank = {name for name, column in zip(known, columns, strict=True) if column.blank}
        if ids := {name for name, column in zip(known, columns, strict=True) if column.is_id and name in names}:
            for section, heads in ((self.section, names), (recorded, known)):
                section.id_columns = tuple([n for n, name in enumerate(heads) if name in ids])
        is_cut, in_note, there = self.stated.some, False, {row.ids for row in recorded.rows}
        for row in self.section.rows:
            is_last = CUT.match(row.line.text) is not None
            in_note = is_last or self.section.is_note(row.line.text) or (in_note and row.ids not in there)
            is_cut = is_cut or is_last
            if in_note:
                self.unknown["notes"] += 1
            else:
                self.listed.append(row)
        here = {row.ids for row in self.listed}
        rows = recorded.rows
        if not ids:  # they go by their places
            rows = [row._replace(ids=one.ids) for row, one in zip(rows, self.listed, strict=False)]
            rows += [] if is_cut else recorded.rows[len(rows) :]
        self.recorded = [row for row in rows if row.ids in here or not is_cut]
        return recorded

    def grid(self) -> None:
        """Print a table with a column for each entry, or with rows X, Y, Z for each."""
        values, of_points = self.values(), self.stated.layout == "xyz"
        columns = {str(column.heading): column for column in self.stated.stated()}
        printed = {heading: _printed(column, values) for heading, column in columns.items()}
        heads = [head.name for head in self.section.columns]
        names = [heading for heading, one in columns.items() if one.name in ("photo", "point") and one.is_id]
        entries = {str(name): entry for entry, name in enumerate(printed[names[0]] if names else range(len(heads)))}
        for row in self.section.rows:
            name, axis = row.ids[0], "XYZ".find(row.ids[-1] or "-")
            if of_points and name in entries and axis >= 0:
                texts = {n: printed[head][entries[name]] for n, head in enumerate(heads) if head in printed}
                self.reprint(row, {n: _entry(text, axis) for n, text in texts.items()})
            elif not of_points and name in printed:
                places = {n: entries.get(head if names else str(n), -1) for n, head in enumerate(heads)}
                known = {n: printed[name][at] for n, at in places.items() if 0 <= at < values.count}
                self.reprint(row, known)
                self.unknown.update(f"column {head}" for n, head in enumerate(heads) if n not in known)
            elif any(placed.token.kind == "number" for placed in tokens_of(row.line.text)):
                self.listed.append(row)
            else:
                self.unknown["notes"] += 1

    def reprint(self, row: Row, shown: Mapping[int, Any]) -> None:
        """Take a row, with what the record has of some of its columns."""
        cells = dict(self.section.cells(row.line.text, angles=self.section.angles))
        pieces = []
        for n, value in shown.items():
            placed, end = cells.get(n, []), self.section.columns[n].end
            text = _reprinted(placed, value)
            if placed or text:
                pieces.append((placed[0].start if placed else end, placed[-1].end if placed else end, text))
        self.take(row, pieces)

    def take(self, row: Row, pieces: Sequence[tuple[int, int, str]]) -> None:
        """Take a row of the listing; the record prints it with these texts between these columns of print."""
        text = row.line.text
        for start, end, piece in sorted(pieces, reverse=True):
            before, longer = text[:start].ljust(start), len(piece) - (end - start)
            if longer > 0 and before.endswith(" " * (longer + 1)):
                before = before[:-longer]
            text = f"{before}{piece:>{end - start}}{text[end:]}"
        self.listed.append(row)
        self.recorded.append(row._replace(line=Line(text.rstrip(), 0, 0)))

    def labels(self) -> None:
        """Print lines of a label and a value, or more."""
        found = self.stated.numbers(self.content)
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
                self.recorded.append(Row(_lines([known])[0], (known,), 0))

    def recorded_texts(self) -> Sequence[str]:
        """Return the texts that the record has of the section."""
        if isinstance(self.stated, Texts):
            return list(self.stated.texts(self.content))
        values = self.values()
        cells = [_printed(column, values) for column in self.stated.stated()]
        return [" ".join(str(text) for text in row if text) for row in zip(*cells, strict=True)]


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


def _lines(texts: Sequence[str]) -> list[Line]:
    """Return lines that stand in no file."""
    return [Line(text, 0, 0) for text in texts]


def _entry(values: Any, number: int) -> Any:
    return values[number] if isinstance(values, list) and number < len(values) else None


def _title(stated: Any) -> str:
    return getattr(stated, "pattern", "") or re.escape(stated.title)


def _printed(column: Field[Any], values: Values) -> list[Any]:
    """Return what a column prints."""
    found = column.printed(values) if values.count else ()
    return plain(found) if isinstance(found, np.ndarray) else list(found)


def _reprinted(placed: Sequence[Placed], value: Any) -> str:
    """Return a value of the record as a listing prints it that has `placed`: with as many digits."""
    token = placed[0].token if len(placed) == 1 else None
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        return "" if value is None else str(value).replace("_", " ")
    if token and token.kind == "angle":
        return edited(f"S40.{max(-token.step, 0)}", [value])[0].strip()
    step = token.step if token and token.kind == "number" else -4
    rounded = Decimal(value).quantize(Decimal(1).scaleb(step)) + 0
    return token.text if token and rounded == token.value else f"{rounded:f}"
