"""A file of records -> tables of rows, and every problem of its lines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import IntArray
from musatpy.errors import DeckError, Problem
from musatpy.formats.cards.codec import Column
from musatpy.formats.records.layout import START, FileSpec, RecordSpec
from musatpy.formats.records.lines import Value, record_values

_END_OF_FILE = "\x1a"


@dataclass(frozen=True, kw_only=True)
class RowTable:
    """The k rows that end with one kind of record, in the order of the file."""

    record: RecordSpec
    columns: dict[str, Column]  # field -> (k,) numbers, NaN for no value, or texts
    lines: IntArray  # (k,) 1-based, of the last record of each row

    def __len__(self) -> int:
        return len(self.lines)


@dataclass(frozen=True, kw_only=True)
class RecordFile:
    """A file as read."""

    file: str  # name for messages
    spec: FileSpec
    tables: tuple[RowTable, ...]  # one for each kind of row
    problems: tuple[Problem, ...]  # by line
    texts: tuple[str, ...]  # the lines


def read_records(data: bytes, spec: FileSpec, file: str) -> RecordFile:
    """Return the rows in the bytes of a file. Problems are listed, never raised.

    Lines may end with LF or CR LF; blank lines, and comments where the file has any, are skipped.
    """
    return _Reader(data, spec, file).read()


class _Reader:
    def __init__(self, data: bytes, spec: FileSpec, file: str) -> None:
        text = data.decode("ascii", errors="replace").replace("\r\n", "\n").removesuffix(_END_OF_FILE)
        self.texts = tuple(text.split("\n"))
        self.spec = spec
        self.file = file
        self.leaves = {leaf.name for leaf in spec.leaves()}
        self.joined = {record.joins for record in spec.records if record.joins}
        self.rows: dict[str, list[tuple[int, dict[str, Value]]]] = {leaf.name: [] for leaf in spec.leaves()}
        self.before = START  # name of the record before
        self.open: dict[str, tuple[int, dict[str, Value]]] = {}  # the last of each record that others join
        self.waiting: dict[str, int] = {}  # those that no other has joined yet, and their lines
        self.end = 1  # the last line that is not blank
        self.problems: list[Problem] = []
        self.skipped: Counter[str] = Counter()

    def read(self) -> RecordFile:
        for number, line in enumerate(self.texts, 1):
            if line.strip() and not (self.spec.comments and self.spec.is_comment(line.split()[0])):
                self.end = number
                self._line(number, line.rstrip())
        self._finish()
        tables = tuple(self._table(leaf) for leaf in self.spec.leaves())
        problems = tuple(sorted(self.problems, key=lambda one: (one.line or 0, one.columns or (0, 0))))
        return RecordFile(file=self.file, spec=self.spec, tables=tables, problems=problems, texts=self.texts)

    def _line(self, number: int, line: str) -> None:
        if not (line.isascii() and line.isprintable()):
            bad = next(place for place, one in enumerate(line, 1) if not (one.isascii() and one.isprintable()))
            message = "a character that is not printable ASCII"
            self._problem(number, columns=(bad, bad), message=message, expected="printable ASCII characters")
            return
        record = self._record(number, line)
        if record is None:
            return
        self.before = record.name
        try:
            values = record_values(record, line)
        except DeckError as error:
            self.problems += [
                replace(problem, file=self.file, line=number, card=record.name, text=line)
                for problem in error.problems
            ]
            values = {}
        self._keep(record, number, values)

    def _keep(self, record: RecordSpec, number: int, values: dict[str, Value]) -> None:
        """Complete a row, or keep the record for those that join it. Values of a bad line are empty."""
        complete = bool(values) or not record.fields
        if record.joins:
            self.waiting.pop(record.joins, None)
            head = self.open.get(record.joins, (0, {}))[1]
            complete = complete and bool(head)
            values = {**head, **values}
            complete = complete and self._agrees(record, number, values)
        if record.name in self.joined:
            self.open[record.name] = (number, values if complete else {})
            self.waiting[record.name] = number
        if record.name in self.leaves and complete:
            self.rows[record.name].append((number, values))

    def _agrees(self, record: RecordSpec, number: int, values: dict[str, Value]) -> bool:
        """Return whether the fields that repeat others say the same; complain of those that do not."""
        wrong = [one for one in record.fields if one.same_as and values[one.name] != values[one.same_as]]
        for field in wrong:
            self._problem(
                number,
                columns=None if field.free else (field.first, field.last),
                card=record.name,
                field=field.name,
                found=str(values[field.name]),
                expected=f"'{values[field.same_as]}', the {field.same_as} of the record before",
            )
        return not wrong

    def _record(self, number: int, line: str) -> RecordSpec | None:
        """Return the record that a line is: by its mark, else the one that may stand here."""
        word = line.split()[0]
        allowed = [record for record in self.spec.records if self.before in record.follows]
        marked = [record for record in allowed if record.mark and record.mark == word]
        is_mark = word in {record.mark for record in self.spec.records}
        plain = [record for record in allowed if not record.mark and not is_mark]
        if marked or plain:
            record = (marked or plain)[0]
            if record.name in self.waiting:  # others should have joined it before one like it comes
                self._warn_waiting(record.name)
            return record
        if self.spec.skip_others and not is_mark:
            self.skipped[word] += 1
            return None
        names = " or ".join(f"{one.name} ({one.mark})" if one.mark else one.name for one in allowed)
        column = line.index(word) + 1
        self._problem(
            number,
            columns=(column, column + len(word) - 1),
            message=f"'{word}' is no record that may stand here; expected {names or 'the end of the file'}",
            found=word,
            expected=names,
        )
        return None

    def _warn_waiting(self, name: str) -> None:
        line = self.waiting.pop(name)
        message = "nothing belongs to this record: it is left out"
        self._problem(line, card=name, message=message, severity="warning")

    def _finish(self) -> None:
        for name in tuple(self.waiting):
            self._warn_waiting(name)
        for word, count in self.skipped.items():
            message = f"{count} record{'s' * (count > 1)} '{word}' left out: no format says what it holds"
            self.problems.append(Problem(file=self.file, message=message, severity="warning"))
        if self.before == START:
            self.problems.append(Problem(file=self.file, message="the file has no records"))
        elif not self.spec.record(self.before).last:
            expected = [record.mark or record.name for record in self.spec.records if self.before in record.follows]
            message = f"the file ends after {self.before}; expected {' or '.join(expected)}"
            self._problem(self.end, message=message)

    def _problem(self, line: int, **details: object) -> None:
        self.problems.append(Problem(file=self.file, line=line, text=self.texts[line - 1].rstrip(), **details))  # type: ignore[arg-type]

    def _table(self, leaf: RecordSpec) -> RowTable:
        rows = self.rows[leaf.name]
        columns = {
            field.name: np.array(
                [values[field.name] for _, values in rows], dtype=float if field.edit.is_number else str
            )
            for field in self.spec.row_fields(leaf)
        }
        return RowTable(record=leaf, columns=columns, lines=np.array([line for line, _ in rows], dtype=int))


def problem_of(file: RecordFile, line: int, message: str, fields: Sequence[str] = ()) -> Problem:
    """Return a problem of a line that only shows between records."""
    return Problem(
        file=file.file,
        line=line,
        field=fields[0] if len(fields) == 1 else None,
        message=message,
        text=file.texts[line - 1].rstrip(),
    )
