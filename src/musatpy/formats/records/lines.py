"""One line of a file <-> the values of its record."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from musatpy.errors import DeckError, Problem
from musatpy.formats.records.fields import RecordField
from musatpy.formats.records.layout import RecordSpec
from musatpy.fortran import FieldError

Value = float | str
_WORD = re.compile(r"\S+")


def record_values(record: RecordSpec, line: str) -> dict[str, Value]:
    """Return the values of a line by field; raises `DeckError` with every field that does not decode."""
    free = bool(record.mark) or any(field.free for field in record.fields)
    pieces, bad = _free_pieces(record, line) if free else _fixed_pieces(record, line)
    values: dict[str, Value] = {}
    for field in record.fields:
        text, columns = pieces[field.name]
        try:
            values[field.name] = field.decode(text)
        except FieldError as error:
            bad.append(field.problem(error, columns=columns))
    if bad:
        raise DeckError(sorted(bad, key=lambda problem: problem.columns or (0, 0)))
    return values


Pieces = dict[str, tuple[str, tuple[int, int]]]  # field -> its text and its columns


def _free_pieces(record: RecordSpec, line: str) -> tuple[Pieces, list[Problem]]:
    words = [(word.group(), (word.start() + 1, word.end())) for word in _WORD.finditer(line)]
    nothing = ("", (len(line) + 1, len(line) + 1))
    pieces = {one.name: words[one.first - 1] if one.first <= len(words) else nothing for one in record.fields}
    most = len(record.fields) + bool(record.mark)
    bad = [Problem(columns=at, found=word, message=f"'{word}' is a word too many") for word, at in words[most:]]
    return pieces, bad


def _fixed_pieces(record: RecordSpec, line: str) -> tuple[Pieces, list[Problem]]:
    pieces = {one.name: (line[one.first - 1 : one.last], (one.first, one.last)) for one in record.fields}
    rest = list(line)
    for one in record.fields:
        end = min(one.last, len(line))
        rest[one.first - 1 : end] = " " * max(end - one.first + 1, 0)
    bad = [
        Problem(
            columns=(word.start() + 1, word.end()),
            found=word.group(),
            message=f"'{word.group()}' stands in columns of no field",
        )
        for word in _WORD.finditer("".join(rest))
    ]
    return pieces, bad


def record_line(record: RecordSpec, values: Mapping[str, Value], free: bool) -> str:
    """Return the line of values; raises `DeckError` with every value that does not fit its field."""
    texts: list[tuple[RecordField, str]] = []
    bad = []
    for field in record.fields:
        try:
            texts.append((field, field.encode(values[field.name])))
        except FieldError as error:
            bad.append(field.problem(error, f"'{error.found}' is not {error.expected}"))
    if bad:
        raise DeckError(bad)
    if not free:
        line = ""
        for field, text in texts:
            line = line.ljust(field.first - 1) + text
        return line.rstrip(" ")
    _check_gaps(texts, values)
    return " ".join([*([record.mark] if record.mark else []), *(text for _, text in texts)]).rstrip(" ")


def _check_gaps(texts: Sequence[tuple[RecordField, str]], values: Mapping[str, Value]) -> None:
    """Raise `DeckError` where a word is missing and not all after it are: it would shift the others."""
    missing = [not text.strip() for _, text in texts]
    for place, (field, _) in enumerate(texts):
        if missing[place] and not all(missing[place:]):
            value = values[field.name]
            shown = "nan" if isinstance(value, float) and math.isnan(value) else str(value)
            error = FieldError(shown, "given where a later word is")
            raise DeckError([field.problem(error, str(error))])
