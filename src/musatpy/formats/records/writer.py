"""Tables of rows -> a file of records, with the records between them that its order asks for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.errors import DeckError, Problem
from musatpy.formats.records.fields import RecordField
from musatpy.formats.records.layout import START, FileSpec, RecordSpec
from musatpy.formats.records.lines import Value, record_line

Columns = Mapping[str, NDArray[Any]]


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
        texts = {field.name: self._column(field, columns, count) for one in chain for field in one.fields}
        heads = [one.name for record in chain[:-1] for one in record.fields]
        shared: dict[str, tuple[Value, ...]] = {}  # the values under which a record was last written
        for row in self._order([texts[name] for name in heads], count):
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

    @staticmethod
    def _column(field: RecordField, columns: Columns, count: int) -> list[Value]:
        """Return the values of a field; one that the model does not have is blank, or says another again."""
        name = field.same_as or field.name
        if name in columns:
            values: list[Value] = columns[name].tolist()
            return values
        return [math.nan if field.edit.is_number else ""] * count

    def _many(self, head: RecordSpec, leaf: RecordSpec) -> bool:
        """Return whether several rows may follow one `head`: its members may follow one another."""
        chain = self.spec.chain(leaf)
        member = chain[chain.index(head) + 1]
        return any(one.name in member.follows for one in chain[chain.index(member) :])

    @staticmethod
    def _order(heads: Sequence[Sequence[Value]], count: int) -> list[int]:
        """Return the rows with equal heads together, in order of first appearance."""
        ranks: dict[tuple[Value, ...], int] = {}
        keys = [tuple(column[row] for column in heads) for row in range(count)]
        order = [ranks.setdefault(key, len(ranks)) for key in keys]
        rows: list[int] = np.argsort(order, kind="stable").tolist() if heads else list(range(count))
        return rows

    def _add(self, record: RecordSpec, values: Mapping[str, Value]) -> None:
        self._bridge([record.name])
        try:
            line = record_line(record, values, self.spec.free)
            self._check_first_word(record, line)
            self.lines.append(line)
        except DeckError as error:
            named = " ".join(str(value) for value in values.values() if isinstance(value, str) and value)
            for problem in error.problems:
                message = f"{named}: '{problem.found}' is not {problem.expected}"
                columns = None if self.spec.free else problem.columns
                self.problems.append(
                    replace(problem, message=message, file=self.file, card=record.name, columns=columns)
                )
        self.before = record.name

    def _check_first_word(self, record: RecordSpec, line: str) -> None:
        """Complain of a line without mark whose first word a reader would take for a mark or a comment."""
        if record.mark or not self.spec.free:
            return
        word = line.split()[0]
        if word in self.marks or self.spec.is_comment(word):
            message = f"'{word}' begins another kind of line in this file"
            self.problems.append(Problem(file=self.file, card=record.name, message=message, found=word))

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
