"""What a file of records looks like: stated once in TOML and checked on loading.

A card says by its mnemonic what it is; a record of other agencies is known by what stands before it. So a record
says which records it may follow, and a file is read by that rule alone.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from musatpy.errors import CardFormatError
from musatpy.files import name_fault
from musatpy.formats import mapping
from musatpy.formats.cards.spec import FIELD_KEYS, UNITS, Key, check_keys, require
from musatpy.formats.records.fields import PACKED, RecordField
from musatpy.fortran import FieldError, parse_edit
from musatpy.specs import read_toml

START = "start"  # what the first record of a file follows
JOB_UNIT = "job"  # packed angles in a geographic job, metres in a rectangular one
RECORD_UNITS = (*UNITS, "rad", "gon", PACKED, JOB_UNIT)
ATTITUDES = ("omega-phi-kappa", "phi-omega-kappa", "matrix ground to photo", "matrix photo to ground")
_CONSTANT = re.compile(r"\w+\.\w+", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class RecordSpec:
    """One kind of record. `fields` are its own, in their order; those of the record it joins come first."""

    name: str
    doc: str
    sample: str
    mark: str = ""  # first word of a free record
    follows: tuple[str, ...]
    joins: str = ""
    last: bool = False
    constants: tuple[tuple[str, str], ...] = ()  # model attribute -> letter of a deck
    fields: tuple[RecordField, ...]


@dataclass(frozen=True, kw_only=True)
class FileSpec:
    """One kind of file of a family."""

    family: str
    title: str
    doc: str
    source: str
    file: str  # name, or a pattern `*.ext`
    order: int
    free: bool
    records: tuple[RecordSpec, ...]
    comments: tuple[str, ...] = ()
    skip_others: bool = False
    attitude: str = ATTITUDES[0]
    origin_at_principal_point: bool = False  # of image coordinates; else that of the plate, as in a deck
    vertical_attitude: bool = True  # attitudes in the local vertical frame, else in the axes of the file
    rectangular: bool = False  # coordinates are rectangular whatever the job's system
    longitude_first: bool = False
    fiducials: int = 0  # the first plate measurements of each photo that are fiducial marks

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
        return tuple(one for one in self.records if self.row_fields(one) and one.name not in joined)

    def row_fields(self, record: RecordSpec) -> tuple[RecordField, ...]:
        """Return the fields of a row."""
        return tuple(field for one in self.chain(record) for field in one.fields)


FILE_KEYS = {
    "title": Key(str, True, "what the file is called"),
    "doc": Key(str, True, "what it holds"),
    "source": Key(str, True, "where the layout is published, and what no public source settles"),
    "file": Key(str, True, "its plain name, or `*.ext` for any stem; the files of one stem belong together"),
    "order": Key(int, True, "its place among the files of the family"),
    "layout": Key(str, True, "`fixed` columns, or `free`: words with blanks between them"),
    "comments": Key(list, False, "first words (signs: first characters) of lines that are comments"),
    "others": Key(str, False, "lines of no record: an `error` (so without the key), or `skip` with a warning"),
    "attitude": Key(str, False, f"what attitudes are: {', '.join(f'`{text}`' for text in ATTITUDES)}"),
    "attitude_frame": Key(str, False, "`vertical` (east, north, up; so without the key) or `file` (its own axes)"),
    "coordinates": Key(str, False, "`job` as in the deck (so without the key), or `rectangular`, then geocentric"),
    "image_origin": Key(
        str, False, "of image coordinates: `plate`, as in a deck (so without), or `principal point`"
    ),
    "longitude_first": Key(bool, False, "whether geographic coordinates are longitude, latitude, height"),
    "fiducials": Key(int, False, "how many measurements, the first of each photo, are its fiducial marks"),
    "record": Key(list, True, "the records, one `[[record]]` table each"),
}
RECORD_KEYS = {
    "name": Key(str, True, "lower case identifier"),
    "doc": Key(str, True, "what it says"),
    "sample": Key(str, True, "a line; it must decode and encode to itself"),
    "mark": Key(str, False, "first word of the line, by which the record is known (free layout)"),
    "follows": Key(list, True, "records that may stand before it; `start` is the start of the file"),
    "joins": Key(str, False, "the record before it with which it makes one row; many may join one"),
    "last": Key(bool, False, "whether the file may end after it"),
    "constants": Key(dict, False, "model attributes that the kind of record says, as letters of the deck"),
    "field": Key(list, False, "the fields, one `[[record.field]]` table each; in a free layout in their order"),
}
RECORD_FIELD_KEYS = {
    **FIELD_KEYS,
    "columns": Key(list, False, "`[first, last]`, counted from 1 (fixed layout only)"),
    "unit": Key(str, False, f"one of {', '.join(f'`{unit}`' for unit in RECORD_UNITS if unit)}, or empty; `dms` is "
                            "DDDMMSS.s in one number, `job` is `dms` in a geographic job and `m` in others"),
    "codes": Key(dict, False, "texts of the file and the letters that a deck has for the same"),
    "justify": Key(str, False, "texts stand `left` (so without the key) or `right` in their columns"),
    "none": Key(float, False, "a number that stands for no value"),
    "same_as": Key(str, False, "the field of the same row that it says again; its target is empty"),
    "part": Key(int, False, "place of the field in a target of several fields, which hyphens join"),
}  # fmt: skip


def is_record_folder(folder: Path) -> bool:
    """Return whether the TOML files of a folder state files of records, and not cards."""
    paths = sorted(folder.glob("*.toml"))
    return bool(paths) and "record" in _toml(paths[0])


def load_files(folder: Path | str) -> tuple[FileSpec, ...]:
    """Return the files of the family that the TOML files of `folder` state, in their order.

    Raises `CardFormatError`, naming file and key, for whatever is wrong with them.
    """
    folder = Path(folder)
    paths = sorted(folder.glob("*.toml"))
    require(bool(paths), str(folder), "no formats (*.toml)")
    return tuple(sorted((_load_file(path, folder.resolve().name) for path in paths), key=lambda spec: spec.order))


def _toml(path: Path) -> dict[str, Any]:
    try:
        return read_toml(path)
    except ValueError as error:
        raise CardFormatError(f"{path}: {error}") from error


def _load_file(path: Path, family: str) -> FileSpec:
    where = str(path)
    table = check_keys(_toml(path), FILE_KEYS, where)
    fault = name_fault(table["file"])
    require(not fault, f"{where}: file", f"{table['file']!r} {fault}")
    free = _choice(table, "layout", ("fixed", "free"), where) == "free"
    records = tuple(_load_record(one, free, f"{where}: record {i}") for i, one in enumerate(table["record"], 1))
    spec = FileSpec(
        family=family,
        title=table["title"],
        doc=table["doc"],
        source=table["source"],
        file=table["file"],
        order=table["order"],
        free=free,
        records=records,
        comments=_texts(table.get("comments", []), f"{where}: comments"),
        skip_others=_choice(table, "others", ("error", "skip"), where) == "skip",
        attitude=_choice(table, "attitude", ATTITUDES, where),
        origin_at_principal_point=_choice(table, "image_origin", ("plate", "principal point"), where) != "plate",
        vertical_attitude=_choice(table, "attitude_frame", ("vertical", "file"), where) == "vertical",
        rectangular=_choice(table, "coordinates", ("job", "rectangular"), where) == "rectangular",
        longitude_first=table.get("longitude_first", False),
        fiducials=table.get("fiducials", 0),
    )
    _check_order(spec, where)
    return spec


def _choice(table: dict[str, Any], key: str, allowed: Sequence[str], where: str) -> str:
    """Return the value of a key, the first that is allowed where it is not given."""
    value: str = table.get(key, allowed[0])
    require(value in allowed, f"{where}: {key}", f"{value!r} is not one of {', '.join(allowed)}")
    return value


def _texts(values: list[object], where: str) -> tuple[str, ...]:
    texts = tuple(value for value in values if isinstance(value, str))
    require(len(texts) == len(values), where, "not a list of texts")
    return texts


def _load_record(raw: object, free: bool, where: str) -> RecordSpec:
    table = check_keys(raw, RECORD_KEYS, where)
    where = f"{where} ({table['name']})"
    require(free or "mark" not in table, f"{where}: mark", "only in a free layout")
    first = 2 if table.get("mark") else 1  # word of the first field
    found = [
        _load_field(field, number if free else 0, f"{where}: field {number}")
        for number, field in enumerate(table.get("field", []), first)
    ]
    fields = tuple(sorted(found, key=lambda field: field.first))
    for field, after in pairwise(fields):
        require(field.last < after.first, f"{where}: field {after.name}: columns", f"overlap those of {field.name}")
    require(len({field.name for field in fields}) == len(fields), f"{where}: field", "two have the same name")
    constants = tuple(sorted(table.get("constants", {}).items()))
    for path, letter in constants:
        known = _CONSTANT.fullmatch(path) and letter in mapping.CODES.get(path, {})
        require(bool(known), f"{where}: constants", f"{path} = {letter!r} is no letter of a deck")
    record = RecordSpec(
        name=table["name"],
        doc=table["doc"],
        sample=table["sample"],
        mark=table.get("mark", ""),
        follows=_texts(table["follows"], f"{where}: follows"),
        joins=table.get("joins", ""),
        last=table.get("last", False),
        constants=constants,
        fields=fields,
    )
    return record


def _load_field(raw: object, word: int, where: str) -> RecordField:
    """Return a field, of a free layout where `word` is not zero."""
    table = dict(check_keys(raw, RECORD_FIELD_KEYS, where))
    where = f"{where} ({table['name']})"
    try:
        edit = parse_edit(table.pop("edit"))
    except FieldError as error:
        raise CardFormatError(f"{where}: edit: {error}") from error
    require(edit.letter != "X", f"{where}: edit", "columns to skip need no field")
    first, last = (word, word) if word else _columns(table.get("columns"), edit.width, f"{where}: columns")
    require(not word or "columns" not in table, f"{where}: columns", "words of a free layout have none")
    table.pop("columns", None)
    require(table.get("unit", "") in RECORD_UNITS, f"{where}: unit", f"not one of {RECORD_UNITS}")
    require(table.get("blank", "error") in ("error", "missing"), f"{where}: blank", "not error or missing")
    require(not edit.is_number or not {"codes", "justify", "part"} & set(table), where, "a number has no such key")
    require(edit.is_number or not {"none", "unit"} & set(table), where, "a text has no such key")
    table["justify"] = _choice(table, "justify", ("left", "right"), where)
    table["allowed"] = _texts(table.get("allowed", []), f"{where}: allowed")
    table["codes"] = tuple((str(text), str(letter)) for text, letter in table.get("codes", {}).items())
    return RecordField(**table, first=first, last=last, edit=edit, free=bool(word))


def _columns(columns: object, width: int, where: str) -> tuple[int, int]:
    match columns:
        case [int(first), int(last)]:
            require(1 <= first <= last, where, f"{first}-{last} are no columns")
            require(last - first + 1 == width, where, f"{first}-{last} is not {width} wide")
            return first, last
    raise CardFormatError(f"{where}: not [first, last]")


def _check_order(spec: FileSpec, where: str) -> None:
    """Raise `CardFormatError` for records that do not fit together, or with bad samples."""
    names = [record.name for record in spec.records]
    require(len(set(names)) == len(names), f"{where}: record", "two have the same name")
    require(any(record.last for record in spec.records), f"{where}: last", "the file may end after no record")
    for number, record in enumerate(spec.records):
        inside = f"{where}: record {record.name}"
        unknown = set(record.follows) - {START, *names}
        require(not unknown, f"{inside}: follows", f"no record {', '.join(sorted(unknown))}")
        require(not record.joins or record.joins in names[:number], f"{inside}: joins", "no record before it")
        _check_sample(spec, record, inside)
    for leaf in spec.leaves():
        fields = spec.row_fields(leaf)
        require(len({one.name for one in fields}) == len(fields), f"{where}: {leaf.name}", "fields of one name")


def _check_sample(spec: FileSpec, record: RecordSpec, where: str) -> None:
    from musatpy.formats.records.lines import RecordError, record_line, record_values

    try:
        line = record_line(record, record_values(record, record.sample), spec.free)
    except RecordError as error:
        raise CardFormatError(f"{where}: sample: {error}") from error
    require(
        line == record.sample, f"{where}: sample", f"does not encode to itself:\n    {record.sample}\n    {line}"
    )
