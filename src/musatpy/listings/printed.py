"""A listing against a record: the tables of the record are printed, and print is compared with print.

What pages print in their own way (photos across the page, a label and numbers) is printed as the listing has it,
with the numbers of the record in place of its own. Which value is where, the reports state.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.errors import RecordError
from musatpy.listings.findings import Difference
from musatpy.listings.lines import CUT, CannotCompareError, PrintedLine, paper_of
from musatpy.listings.records import is_number, read_json
from musatpy.listings.rules import Rules, RuleUse
from musatpy.listings.sections import ListingRow, ListingSection, numbered, sections_of, squeezed
from musatpy.listings.tokens import PlacedToken, tokens_of
from musatpy.listings.weighing import compare_rows, overflows
from musatpy.records.json_files import known_of
from musatpy.reports.editing import edited
from musatpy.reports.fields import Field
from musatpy.reports.table import Labels, Report, Table, Texts
from musatpy.reports.values import Values, at, plain

_MORE = re.compile(r"and \d+ more\b")  # texts that are not printed
Record = Mapping[str, Any]


def compare_with_record(a: str, b: str, rules: Rules, names: tuple[str, str], *, listing: int) -> Difference:
    """Return what differs between a listing and a record; `listing` says which of the two is the listing."""
    from musatpy.reports.listing import statements  # two listings need them not

    uses, texts, name = [RuleUse(rule) for rule in rules.rules], (a, b), names[1 - listing]
    content = _record_of(texts[1 - listing], name)
    stated = [one for one in statements() if not isinstance(one, Report) or one.place]
    found, notes = [], []
    for section in sections_of(paper_of(texts[listing], rules.layout), rules.layout):
        titles = [getattr(one, "pattern", "") or re.escape(one.title) for one in stated]
        known = [one for one, title in zip(stated, titles, strict=True) if re.fullmatch(title, section.title)]
        if not known or _is_left_out(known[0], content):
            notes.append(section.title or "lines before the first title")
            continue
        printed = _Printed(section, known[0], content)
        sides = [(section, printed.listed), (printed.section_of_record(), printed.recorded)]
        found.append(compare_rows(uses, *(sides if listing == 0 else sides[::-1])))
        if printed.unknown:
            kinds = [f"{what} ({count} rows)" if count > 1 else what for what, count in printed.unknown.items()]
            notes.append(f"{section.title}: {', '.join(kinds)}")
    if not found:
        raise CannotCompareError.of("has no section with numbers of a record", file=names[listing])
    return Difference(*names, tuple(found), tuple(uses), (*notes, *overflows(found)))


def _record_of(text: str, name: str) -> Record:
    """Return a record, all observations in one table; raises `CannotCompareError` unless it obeys its schema."""
    from musatpy.reports.listing import documents

    content = read_json(text, name)
    of_others = (one for one in documents() if isinstance(content, dict) and one.name in content)
    schema = next((one.schema() for one in of_others), None)
    try:
        return known_of(content, Path(name), schema=schema)
    except RecordError as error:
        raise CannotCompareError(error.problems) from error


def _is_left_out(stated: Any, content: Record) -> bool:
    """Tell whether a record was written without the table of a section."""
    table = str(getattr(stated, "place", "") or getattr(stated, "table", ""))
    return content.get("content") == "tables" and at(content, table) is None


class _Printed:
    """A section of the listing, and the same section as the record prints it."""

    def __init__(self, section: ListingSection, stated: Any, content: Record) -> None:
        self.section = section
        self.stated = stated
        self.content = content
        self.unknown: Counter[str] = Counter()  # what of the listing the record has not
        self.listed: list[ListingRow] = []  # rows of the listing that are compared
        self.recorded: list[ListingRow] = []  # those of the record

    def section_of_record(self) -> ListingSection:
        """Return the section as the record prints it, after its rows and those of the listing have been paired."""
        if isinstance(self.stated, Labels):
            self.labels()
        elif isinstance(self.stated, Texts) or self.stated.layout == "texts":
            self.texts()
        elif self.stated.layout == "rows":
            return self.table()
        else:
            self.grid()
        return self.section

    @cached_property
    def values(self) -> Values:
        """The rows of the table of a section."""
        system = at(self.content, "options.system") or at(self.content, "job.system")
        values: Values = self.stated.read(self.content, str(system or ""))
        return values

    def printed(self, column: Field[Any]) -> list[Any]:
        """Return what a column prints."""
        values = column.printed(self.values) if self.values.count else ()
        return plain(values) if isinstance(values, np.ndarray) else list(values)

    def table(self) -> ListingSection:
        """Print a table with a row for each entry."""
        values = self.values
        columns = list(self.stated.side_by_side(values)) if values.count else []
        headings = {column.heading for column in columns}
        all_columns = (part for column in self.stated.stated() for part in column.columns(values.system))
        columns += [column for column in all_columns if column.heading not in headings]
        table = Table[Any](tuple(columns))
        recorded = ListingSection(self.section.title, head=[PrintedLine(text, 0, 0) for text in table.head()])
        recorded.lines = [(PrintedLine(text, 0, 0), 0) for text in (table.lines(values) if values.count else ())]
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
        is_cut = self.stated.some or any(CUT.match(row.line.text) for row in self.section.rows)
        in_note, there = False, {row.ids for row in recorded.rows}
        for row in self.section.rows:
            begins_note = CUT.match(row.line.text) or self.section.is_note(row.line.text)
            in_note = bool(begins_note) or (in_note and row.ids not in there)
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
        of_points = self.stated.layout == "xyz"
        printed = {str(column.heading): self.printed(column) for column in self.stated.stated()}
        heads = [head.name for head in self.section.columns]
        of_names = (column for column in self.stated.stated() if column.is_id and column.name in ("photo", "point"))
        entries = [str(name) for column in of_names for name in self.printed(column)] or heads
        # ids of a row -> value by heading
        shown: dict[tuple[str, ...], dict[str, Any]] = {} if of_points else {(heading,): {} for heading in printed}
        for heading, values in printed.items():
            for entry, value in zip(entries, values, strict=False):
                if of_points:
                    for axis, part in zip("XYZ", value if isinstance(value, list) else [None] * 3, strict=True):
                        shown.setdefault((entry, axis), {})[heading] = part
                else:
                    shown[heading,][entry] = value
        for row in self.section.rows:
            known = shown.get((row.ids[0], row.ids[-1]) if of_points else row.ids[:1])
            if known is not None:
                cells = dict(self.section.cells(row.line.text, angles=self.section.angles))
                places = [(n, known[head]) for n, head in enumerate(heads) if head in known]
                self.take(row, [(cells.get(n, []), self.section.columns[n].end, value) for n, value in places])
                self.unknown.update(f"column {head}" for head in heads if not of_points and head not in known)
            elif any(placed.token.kind == "number" for placed in tokens_of(row.line.text)):
                self.listed.append(row)
            else:
                self.unknown["notes"] += 1

    def labels(self) -> None:
        """Print lines of a label and a value, or more."""
        known = self.stated.numbers(self.content)
        for row in self.section.rows:
            label = row.ids[0]
            numbers = [placed for placed in tokens_of(row.line.text) if placed.token.kind in ("number", "overflow")]
            if not numbers or label not in known:
                self.unknown[label if numbers else "words"] += 1
                continue
            if len(numbers) > (most := len(known[label])):
                self.unknown[f"{label}, all but the first {most} number{'s' * (most > 1)}"] += 1
            self.take(row, [([at], at.end, value) for at, value in zip(numbers, known[label], strict=False)])

    def take(self, row: ListingRow, values: Sequence[tuple[Sequence[PlacedToken], int, Any]]) -> None:
        """Take a row of the listing, and what the record prints: its values in place of what stands in the row.

        A value has the tokens of its field, none of an empty one, and the column of print where this ends.
        """
        text = row.line.text
        for placed, end, value in reversed(values):
            piece = _reprinted(placed, value)
            start, end = (placed[0].start, placed[-1].end) if placed else (end, end)
            before, longer = text[:start].ljust(start), len(piece) - (end - start)
            if longer > 0 and before.endswith(" " * (longer + 1)):
                before = before[:-longer]
            text = f"{before}{piece:>{end - start}}{text[end:]}" if placed or piece else text
        self.listed.append(row)
        self.recorded.append(row._replace(line=PrintedLine(text.rstrip(), 0, 0)))

    def texts(self) -> None:
        """Print sentences, however their lines are broken: those that are not indented begin one."""
        sentences: list[PrintedLine] = []
        for row in self.section.rows:
            text = squeezed(row.line.text)
            if sentences and row.line.text[0] == " ":
                sentences[-1] = sentences[-1]._replace(text=f"{sentences[-1].text} {text}")
            else:
                sentences.append(row.line._replace(text=text.removeprefix("- ").removeprefix("Note: ")))
        self.listed += [ListingRow(line, (line.text,), 0) for line in sentences if not _MORE.match(line.text)]
        listed = {"".join(row.line.text.split()): row.line for row in self.listed}
        for text in self.recorded_texts():
            line = listed.get("".join(text.split()))
            if line or len(self.listed) == len(sentences):  # else the listing is cut
                text = line.text if line else text
                self.recorded.append(ListingRow(PrintedLine(text, 0, 0), (text,), 0))

    def recorded_texts(self) -> Sequence[str]:
        """Return the texts that the record has of the section."""
        if isinstance(self.stated, Texts):
            return list(self.stated.texts(self.content))
        cells = [self.printed(column) for column in self.stated.stated()]
        return [" ".join(str(text) for text in row if text) for row in zip(*cells, strict=True)]


def _reprinted(placed: Sequence[PlacedToken], value: Any) -> str:
    """Return a value of the record as a listing prints it that has `placed`: with as many digits."""
    token = placed[0].token if len(placed) == 1 else None
    if not is_number(value) or not math.isfinite(value):
        return "" if value is None else str(value).replace("_", " ")
    if token and token.kind == "angle":
        return edited(f"S40.{max(-token.step, 0)}", [value])[0].strip()
    step = token.step if token and token.kind == "number" else -4
    rounded = Decimal(value).quantize(Decimal(1).scaleb(step)) + 0
    return token.text if token and rounded == token.value else f"{rounded:f}"
