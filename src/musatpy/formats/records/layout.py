"""What a file of records looks like, stated once in TOML and checked on loading; and one of its lines <-> values.

A card says by its mnemonic what it is; a record of other agencies is known by what stands before it. So a record
says which records it may follow, and a file is read by that rule alone.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from musatpy.errors import CardFormatError, DeckError, Problem, in_order
from musatpy.files import name_fault
from musatpy.formats import mapping
from musatpy.formats.cards.spec import check_fields, format_of, named
from musatpy.formats.records.fields import RecordField, pairs_of
from musatpy.fortran import FieldError
from musatpy.specs import key, read_toml, require

# Where a conversion takes from what files of other agencies do not say.
OPTION_OF_SYSTEM = "--set OPT.system=GEOG, GEOC or LOCL, or a --deck with its options"
OPTION_OF_ELLIPSOID = "--set ELL.name=WGS84 or another one, or a --deck with its ELL card"
OPTION_OF_CAMERAS = "--camera NAME=FOCAL_LENGTH (mm) or a table, or a --deck with the camera cards"

START = "start"  # what the first record of a file follows
ATTITUDES = ("omega-phi-kappa", "phi-omega-kappa", "matrix ground to photo", "matrix photo to ground")
_CONSTANT = re.compile(r"\w+\.\w+", re.ASCII)
_WORD = re.compile(r"\S+")
Value = float | str


def _second_of(first: str, second: str) -> Callable[[Any], bool]:
    """Return the reading of a key with two texts: whether it is the second."""

    def convert(value: Any) -> bool:
        require(value in (first, second), f"{value!r} is not one of {', '.join(sorted((first, second)))}")
        return bool(value == second)

    return convert


def _constants(table: Any) -> tuple[tuple[str, str], ...]:
    for path, letter in (constants := pairs_of(table)):
        known = _CONSTANT.fullmatch(path) and letter in mapping.CODES.get(path, {})
        require(bool(known), f"{path} = {letter!r} is no letter of a deck")
    return tuple(sorted(constants))


def _file_name(name: Any) -> str:
    require(isinstance(name, str), f"{name!r} is not a str")
    fault = name_fault(name)
    require(not fault, f"{name!r} {fault}")
    return str(name)


@dataclass(frozen=True, kw_only=True)
class RecordSpec:
    """One kind of record. `fields` are its own, in their order; those of the record it joins come first."""

    name: str = key(doc="lower case identifier")
    doc: str = key(doc="what it says")
    sample: str = key(doc="a line; it must decode and encode to itself")
    mark: str = key("", "first word of the line, by which the record is known (free layout)")
    follows: tuple[str, ...] = key(doc="records that may stand before it; `start` is the start of the file")
    joins: str = key("", "the record before it with which it makes one row; many may join one")
    last: bool = key(False, "whether the file may end after it")
    may_be_missing: bool = key(
        False, "whether it may be missing before a record of several words, none of them a number, and at the end"
    )
    constants: tuple[tuple[str, str], ...] = key(
        (), "model attributes that the kind of record says, as letters of the deck", convert=_constants
    )
    fields: tuple[RecordField, ...] = key(
        (), "the fields, one `[[record.field]]` table each; in a free layout in their order", name="field"
    )

    @property
    def mnemonic(self) -> str:
        """What messages of targets call it, as a card."""
        return self.name

    def laid_out(self, free: bool) -> RecordSpec:
        """Return the record with its fields in order. Raises `ValueError` for fields that do not fit together."""
        require(free or not self.mark, "mark: only in a free layout")
        fields = []
        for number, field in enumerate(self.fields, 2 if self.mark else 1):
            with named(f"field {number} ({field.name})"):
                replace(field, free=free).check()
            fields.append(replace(field, columns=(number, number), free=True) if free else field)
        fields.sort(key=lambda field: field.first)
        require(len({field.name for field in fields}) == len(fields), "field: two have the same name")
        check_fields(fields)
        return replace(self, fields=tuple(fields))


@dataclass(frozen=True, kw_only=True)
class FileSpec:
    """One kind of file of a family."""

    family: str = ""
    title: str = key(doc="what the file is called")
    doc: str = key(doc="what it holds")
    source: str = key(doc="where the layout is published, and what no public source settles")
    file: str = key(
        doc="its plain name, or `*.ext` for any stem; the files of one stem belong together", convert=_file_name
    )
    order: int = key(doc="its place among the files of the family")
    free: bool = key(
        False,
        "`fixed` columns (so without the key), or `free`: words with blanks between them",
        name="layout",
        convert=_second_of("fixed", "free"),
    )
    comments: tuple[str, ...] = key((), "first words (signs: first characters) of lines that are comments")
    skip_others: bool = key(
        False,
        "lines of no record: an `error` (so without the key), or `skip` with a warning",
        name="others",
        convert=_second_of("error", "skip"),
    )
    skip_words: bool = key(
        False,
        "words behind the last field (free layout): an `error` (so without the key), or `skip` with a warning",
        name="further_words",
        convert=_second_of("error", "skip"),
    )
    attitude: str = key(
        ATTITUDES[0], f"what attitudes are: {', '.join(f'`{text}`' for text in ATTITUDES)}", choices=ATTITUDES
    )
    vertical_attitude: bool = key(
        True,
        "`vertical` (east, north, up; so without the key) or `file` (its own axes)",
        name="attitude_frame",
        convert=_second_of("file", "vertical"),
    )
    rectangular: bool = key(
        False,
        "`job` as in the deck (so without the key), or `rectangular`, then geocentric",
        name="coordinates",
        convert=_second_of("job", "rectangular"),
    )
    origin_at_principal_point: bool = key(
        False,
        "of image coordinates: `plate`, as in a deck (so without), or `principal point`",
        name="image_origin",
        convert=_second_of("plate", "principal point"),
    )
    longitude_first: bool = key(False, "whether geographic coordinates are longitude, latitude, height")
    fiducials: int = key(0, "how many measurements, the first of each photo, are its fiducial marks")
    stated_in: str = ""  # the file where all this stands
    records: tuple[RecordSpec, ...] = key(doc="the records, one `[[record]]` table each", name="record")

    def is_comment(self, word: str) -> bool:
        """Return whether a line with this first word is a comment."""
        return any(word == mark or (not mark.isalnum() and word.startswith(mark)) for mark in self.comments)

    def record(self, name: str) -> RecordSpec:
        """Return the record called `name`."""
        return next(record for record in self.records if record.name == name)

    def chain(self, record: RecordSpec) -> tuple[RecordSpec, ...]:
        """Return the records that make one row with `record`, the one they all join first."""
        before = self.chain(self.record(record.joins)) if record.joins else ()
        return (*before, record)

    def leaves(self) -> tuple[RecordSpec, ...]:
        """Return the records that end a row: those with something to say that no other joins."""
        joined = {record.joins for record in self.records}
        return tuple(record for record in self.records if self.row_fields(record) and record.name not in joined)

    def row_fields(self, record: RecordSpec) -> tuple[RecordField, ...]:
        """Return the fields of a row."""
        return tuple(field for one in self.chain(record) for field in one.fields)


# --- a line ---


def record_values(record: RecordSpec, line: str) -> dict[str, Value]:
    """Return the values of a line by field; raises `DeckError` with every field that does not decode."""
    words = [(word.group(), (word.start() + 1, word.end())) for word in _WORD.finditer(line)]
    free = bool(record.mark) or any(field.free for field in record.fields)
    if free:
        pieces = dict(enumerate(words, 1))
        most = len(record.fields) + bool(record.mark)
        bad = []
        if len(words) > most:
            (first, _), last = words[most][1], words[-1][1][1]
            further = line[first - 1 : last]
            plural = len(words) > most + 1
            message = f"'{further}' {'are words' if plural else 'is a word'} too many"
            bad = [Problem(columns=(first, last), found=further, message=message)]
    else:
        pieces = {field.first: (line[field.first - 1 : field.last], field.columns) for field in record.fields}
        rest = list(line)
        for field in record.fields:
            end = min(field.last, len(line))
            rest[field.first - 1 : end] = " " * max(end - field.first + 1, 0)
        outside = ((one.group(), (one.start() + 1, one.end())) for one in _WORD.finditer("".join(rest)))
        message = "stands in columns of no field"
        bad = [Problem(columns=at, found=word, message=f"'{word}' {message}") for word, at in outside]
    nothing = ("", (len(line) + 1, len(line) + 1))
    values: dict[str, Value] = {}
    for field in record.fields:
        text, columns = pieces.get(field.first, nothing)
        try:
            values[field.name] = field.decode(text)
        except FieldError as error:
            bad.append(field.problem(error, columns=columns))
    if bad:
        raise DeckError(in_order(bad))
    return values


def record_line(record: RecordSpec, values: Mapping[str, Value], free: bool) -> str:
    """Return the line of values; raises `DeckError` with every value that does not fit its field.

    Of a free layout no word may be missing where a later one is given: it would shift the others.
    """
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
    given = [bool(text.strip()) for _, text in texts]
    for place, (field, _) in enumerate(texts):
        if not given[place] and any(given[place:]):
            value = values[field.name]
            shown = "nan" if isinstance(value, float) and math.isnan(value) else str(value)
            missing = FieldError(shown, "given where a later word is")
            raise DeckError([field.problem(missing, str(missing))])
    return " ".join([*([record.mark] if record.mark else []), *(text for _, text in texts)]).rstrip(" ")


# --- loading ---


def load_files(folder: Path | str) -> tuple[FileSpec, ...]:
    """Return the files of the family that the TOML files of `folder` state, in their order.

    Raises `CardFormatError`, naming file and key, for whatever is wrong with them.
    """
    folder = Path(folder)
    paths = sorted(folder.glob("*.toml"))
    if not paths:
        raise CardFormatError(f"{folder}: no formats (*.toml)")
    return tuple(sorted((_load_file(path, folder.resolve().name) for path in paths), key=lambda spec: spec.order))


def _load_file(path: Path, family: str) -> FileSpec:
    spec: FileSpec = replace(format_of(FileSpec, path), family=family, stated_in=str(path))
    names = [record.name for record in spec.records]
    try:
        require(len(set(names)) == len(names), "record: two have the same name")
        records = []
        for number, record in enumerate(spec.records, 1):
            with named(f"record {number} ({record.name})"):
                records.append(record.laid_out(spec.free))
        spec = replace(spec, records=tuple(records))
        require(any(record.last for record in spec.records), "last: the file may end after no record")
        for number, record in enumerate(spec.records):
            with named(f"record {record.name}"):
                unknown = set(record.follows) - {START, *names}
                require(not unknown, f"follows: no record {', '.join(sorted(unknown))}")
                require(not record.joins or record.joins in names[:number], "joins: no record before it")
                with named("sample"):
                    _check_sample(spec, record)
        for leaf in spec.leaves():
            fields = spec.row_fields(leaf)
            require(len({one.name for one in fields}) == len(fields), f"{leaf.name}: fields of one name")
    except ValueError as error:
        raise CardFormatError(f"{path}: {error}") from error
    return spec


def _check_sample(spec: FileSpec, record: RecordSpec) -> None:
    try:
        line = record_line(record, record_values(record, record.sample), spec.free)
    except DeckError as error:
        faults = (replace(problem, columns=None).headline() for problem in error.problems)
        raise ValueError("; ".join(faults)) from error
    require(line == record.sample, f"does not encode to itself:\n    {record.sample}\n    {line}")


def is_record_folder(folder: Path) -> bool:
    """Return whether the TOML files of a folder state files of records, and not cards."""
    paths = sorted(folder.glob("*.toml"))
    try:
        return bool(paths) and "record" in read_toml(paths[0])
    except ValueError as error:
        raise CardFormatError(f"{paths[0]}: {error}") from error
