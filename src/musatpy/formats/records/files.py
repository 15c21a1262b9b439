"""A file of records <-> tables of rows, with every problem of its lines.

On writing come the records between rows that the order of a file asks for.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import IntArray
from musatpy.errors import DeckError, Problem, in_order
from musatpy.formats.cards.slips import of_survey
from musatpy.formats.records.fields import LONGEST
from musatpy.formats.records.layout import START, FileSpec, RecordSpec, Value, record_line, record_values

_END_OF_FILE = "\x1a"
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([EeDd][-+]?\d+)?", re.ASCII)
_DECIMAL, _NAME = r"([-+]?\d+\.\d+)", rf"([!-~]{{1,{LONGEST}}})"
Columns = Mapping[str, NDArray[Any]]  # field -> (k,) numbers, NaN for no value, or texts


@dataclass(frozen=True, kw_only=True)
class RecordFile:
    """A file as read: its rows by the name of the record that ends them, in the order of the file."""

    file: str  # name for messages
    spec: FileSpec
    tables: Mapping[str, Columns]
    lines: Mapping[str, IntArray]  # (k,) 1-based, of the last record of each row
    problems: tuple[Problem, ...]  # by line
    texts: tuple[str, ...]  # the lines

    def problem(self, line: int, message: str) -> Problem:
        """Return a problem of a line that only shows between records."""
        return Problem(file=self.file, line=line, message=message, text=self.texts[line - 1].rstrip())


def read_records(data: bytes, spec: FileSpec, file: str) -> RecordFile:
    """Return the rows in the bytes of a file. Problems are listed, never raised.

    Lines may end with LF or CR LF; blank lines, and comments where the file has any, are skipped.
    """
    return _RecordReader(data, spec, file).read()


class _RecordReader:
    def __init__(self, data: bytes, spec: FileSpec, file: str) -> None:
        text = data.decode("ascii", errors="replace").replace("\r\n", "\n").removesuffix(_END_OF_FILE)
        self.texts = tuple(text.split("\n"))
        self.spec = spec
        self.file = file
        self.leaves = {leaf.name for leaf in spec.leaves()}
        self.joined = {record.joins for record in spec.records if record.joins}
        self.marks = {record.mark for record in spec.records}
        self.patterns = {leaf.name: self._pattern(leaf) for leaf in spec.leaves()}
        self.rows: dict[str, dict[str, list[Value]]] = {  # by field
            leaf.name: {field.name: [] for field in spec.row_fields(leaf)} for leaf in spec.leaves()
        }
        self.lines: dict[str, list[int]] = {name: [] for name in self.rows}
        self.before = START  # name of the record before
        self.open: dict[str, dict[str, Value]] = {}  # the last of each record that others join
        self.waiting: dict[str, int] = {}  # those that no other has joined yet, and their lines
        self.end = 1  # the last line that is not blank
        self.problems: list[Problem] = []
        self.skipped: Counter[str] = Counter()
        self.further: list[tuple[int, int]] = []  # lines with words behind the last field, and where these begin
        self.missing: list[tuple[int, str]] = []  # lines before which a record is missing, and its mark

    def read(self) -> RecordFile:
        for number, line in enumerate(self.texts, 1):
            if self._repeats(number, line):
                self.end = number
            elif line.strip() and not (self.spec.comments and self.spec.is_comment(line.split()[0])):
                self.end = number
                self._line(number, line.rstrip())
        self._finish()
        return RecordFile(
            file=self.file,
            spec=self.spec,
            tables={leaf.name: self._columns(leaf) for leaf in self.spec.leaves()},
            lines={name: np.array(lines, dtype=int) for name, lines in self.lines.items()},
            problems=in_order(self.problems),
            texts=self.texts,
        )

    def _pattern(self, record: RecordSpec) -> re.Pattern[str] | None:
        """Return how plain words read that can only be one more such record; None where that is not so simple."""
        plain = [one for one in self._allowed(record.name) if not one.mark]
        if plain[:1] != [record] or not record.joins or not all(field.is_plain for field in record.fields):
            return None
        words = (_DECIMAL if field.edit.is_number else _NAME for field in record.fields)
        return re.compile(f" *{' +'.join(words)} *", re.ASCII)

    def _repeats(self, number: int, line: str) -> bool:
        """Take a line of plain words like the one before, as most of a large file are; return whether it is one."""
        pattern = self.patterns.get(self.before)
        words = pattern.fullmatch(line) if pattern else None
        if words is None or words[1] in self.marks or self.spec.is_comment(words[1]):
            return False
        record = self.spec.record(self.before)
        row = zip(record.fields, words.groups(), strict=True)
        self._keep(record, number, {of.name: float(word) if of.edit.is_number else word for of, word in row})
        return True

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
        if self.spec.skip_words:
            words = [word.start() for word in re.finditer(r"\S+", line)]
            most = len(record.fields) + bool(record.mark)
            if len(words) > most:
                self.further.append((number, words[most]))
                line = line[: words[most]].rstrip()
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
            head = self.open.get(record.joins, {})
            values = {**head, **values}
            complete = complete and bool(head) and self._agrees(record, number, values)
        if record.name in self.joined:
            self.open[record.name] = values if complete else {}
            self.waiting[record.name] = number
        if record.name in self.leaves and complete:
            self.lines[record.name].append(number)
            for name, column in self.rows[record.name].items():
                column.append(values[name])

    def _agrees(self, record: RecordSpec, number: int, values: dict[str, Value]) -> bool:
        """Return whether the fields that repeat others say the same; complain of those that do not."""
        wrong = [field for field in record.fields if field.same_as and values[field.name] != values[field.same_as]]
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
        allowed = self._allowed(self.before)
        marked = [record for record in allowed if record.mark and record.mark == word]
        is_mark = word in self.marks
        plain = [record for record in allowed if not record.mark and not is_mark]
        if not marked and self._is_heading(line):
            for record in (record for record in allowed if record.may_be_missing):
                after = [one for one in self._allowed(record.name) if not one.mark]
                if after and len(after[0].fields) == len(line.split()):
                    plain = after
                    self.missing.append((number, record.mark))
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
            message=f"'{word}' is no record that may stand here; expected {names or 'the end of the file'}"
            + of_survey(word),
            found=word,
            expected=names,
        )
        return None

    def _allowed(self, before: str) -> list[RecordSpec]:
        return [record for record in self.spec.records if before in record.follows]

    def _is_heading(self, line: str) -> bool:
        """Return whether a line has several words, of which none behind the first is a number."""
        words = line.split()[1:]
        return bool(words) and not any(_NUMBER.fullmatch(word) for word in words)

    def _warn_waiting(self, name: str) -> None:
        line = self.waiting.pop(name)
        message = "nothing belongs to this record: it is left out"
        self._problem(line, card=name, message=message, severity="warning")

    def _finish(self) -> None:
        for name in tuple(self.waiting):
            self._warn_waiting(name)
        at_end = [record.mark for record in self._allowed(self.before) if record.may_be_missing and record.last]
        if self.before == START:
            self.problems.append(Problem(file=self.file, message="the file has no records"))
        elif at_end and not self.spec.record(self.before).last:
            self.missing.append((self.end + 1, at_end[0]))
        elif not self.spec.record(self.before).last:
            expected = [record.mark or record.name for record in self._allowed(self.before)]
            message = f"the file ends after {self.before}; expected {' or '.join(expected)}"
            self._problem(self.end, message=message)
        if self.further:
            line, column = self.further[0]
            words = self.texts[line - 1][column:].strip()
            message = f"'{words}' stands behind the last field: left out ({len(self.further)} lines in all)"
            place = (column + 1, column + len(words))
            self._problem(line, columns=place, message=message, found=words, severity="warning")
        if self.missing:
            line, mark = self.missing[0]
            where = "at the end of the file" if line > self.end else "before this line"
            message = f"{mark} is missing {where}: read as if it stood there ({len(self.missing)} in all)"
            self._problem(min(line, self.end), message=message, severity="warning")
        for word, count in self.skipped.items():
            message = f"{count} record{'s' * (count > 1)} '{word}' left out: no format says what it holds"
            message += of_survey(word)
            self.problems.append(Problem(file=self.file, message=message, severity="warning"))

    def _problem(self, line: int, **details: object) -> None:
        self.problems.append(Problem(file=self.file, line=line, text=self.texts[line - 1].rstrip(), **details))  # type: ignore[arg-type]

    def _columns(self, leaf: RecordSpec) -> Columns:
        kinds = {field.name: float if field.edit.is_number else str for field in self.spec.row_fields(leaf)}
        return {name: np.array(self.rows[leaf.name][name], dtype=kind) for name, kind in kinds.items()}


# --- writing ---


def write_records(spec: FileSpec, tables: Mapping[str, Columns], file: str) -> bytes:
    """Return the file of rows, given by the name of the record that ends them; every line ends with LF.

    Rows that share a record which many may join stand together, in the order in which the first of each comes.
    Raises `DeckError` with every value that does not fit its field.
    """
    writer = _Writer(spec, file)
    for leaf in spec.leaves():
        columns = tables.get(leaf.name)
        if columns is not None and len(next(iter(columns.values()))):
            writer.rows(leaf, columns)
    writer.finish()
    if writer.problems:
        raise DeckError(writer.problems)
    return "".join(f"{line}\n" for line in writer.lines).encode("ascii")


class _Writer:
    def __init__(self, spec: FileSpec, file: str) -> None:
        self.spec = spec
        self.file = file
        self.lines: list[str] = []
        self.problems: list[Problem] = []
        self.before = START
        self.marks = {record.mark for record in spec.records if record.mark}

    def rows(self, leaf: RecordSpec, columns: Columns) -> None:
        """Add the rows that end with `leaf`."""
        chain = self.spec.chain(leaf)
        count = len(next(iter(columns.values())))
        texts: dict[str, list[Value]] = {}
        for field in (field for one in chain for field in one.fields):
            blank: Value = math.nan if field.edit.is_number else ""  # what the model does not have, or says again
            column = columns.get(field.same_as or field.name)
            texts[field.name] = [blank] * count if column is None else column.tolist()
        heads = list(zip(*(texts[field.name] for record in chain[:-1] for field in record.fields), strict=True))
        places: dict[tuple[Value, ...], int] = {}
        ranks = [places.setdefault(head, len(places)) for head in heads]
        order = np.argsort(ranks, kind="stable").tolist() if heads else range(count)
        shared: dict[str, tuple[Value, ...]] = {}  # the values under which a record was last written
        for row in order:  # equal heads together
            values = {name: column[row] for name, column in texts.items()}
            again = False
            for record in chain:
                content = tuple(values[field.name] for field in record.fields)
                again = (
                    again or record is leaf or shared.get(record.name) != content or not self._many(record, leaf)
                )
                if again:
                    self._add(record, values)
                    shared[record.name] = content

    def _many(self, head: RecordSpec, leaf: RecordSpec) -> bool:
        """Return whether several rows may follow one `head`: its members may follow one another."""
        chain = self.spec.chain(leaf)
        member = chain[chain.index(head) + 1]
        return any(one.name in member.follows for one in chain[chain.index(member) :])

    def _add(self, record: RecordSpec, values: Mapping[str, Value]) -> None:
        self._bridge([record.name])
        try:
            line = record_line(record, values, self.spec.free)
            self.lines.append(line)
            word = line.split()[0] if self.spec.free and not record.mark else ""
            if word in self.marks or self.spec.is_comment(word):  # a reader would take it for one
                message = f"'{word}' begins another kind of line in this file"
                self.problems.append(Problem(file=self.file, card=record.name, message=message, found=word))
        except DeckError as error:
            named = " ".join(str(value) for value in values.values() if isinstance(value, str) and value)
            for problem in error.problems:
                message = f"{named}: '{problem.found}' is not {problem.expected}"
                columns = None if self.spec.free else problem.columns
                problem = replace(problem, message=message, columns=columns)
                self.problems.append(replace(problem, file=self.file, card=record.name))
        self.before = record.name

    def finish(self) -> None:
        """Add the records that must stand at the end."""
        if self.before == START or not self.spec.record(self.before).last:
            self._bridge([record.name for record in self.spec.records if record.last], to=True)

    def _bridge(self, targets: Sequence[str], to: bool = False) -> None:
        """Add the fewest records without fields that lead from the one before to a target (`to`: and itself)."""
        paths: list[tuple[str, ...]] = [()]
        bare = [record for record in self.spec.records if not record.fields]
        while paths:
            longer: list[tuple[str, ...]] = []
            for path in paths:
                here = path[-1] if path else self.before
                if here in targets if to else any(here in self.spec.record(name).follows for name in targets):
                    self.lines += [self.spec.record(name).mark for name in path]
                    self.before = here
                    return
                longer += [(*path, one.name) for one in bare if here in one.follows and one.name not in path]
            paths = longer
        name = targets[0] if targets else "end"
        self.problems.append(Problem(file=self.file, message=f"no record leads from {self.before} to {name}"))
