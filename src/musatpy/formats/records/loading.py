"""The files of a family as its TOML files state them, checked on loading."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from musatpy.errors import CardFormatError, DeckError
from musatpy.formats.cards.spec import format_of, named
from musatpy.formats.records.layout import START, FileSpec, RecordSpec
from musatpy.formats.records.lines import record_line, record_values
from musatpy.specs import require


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
    try:
        records = []
        for number, record in enumerate(spec.records, 1):
            with named(f"record {number} ({record.name})"):
                records.append(record.laid_out(spec.free))
        spec = replace(spec, records=tuple(records))
        _check_order(spec)
    except ValueError as error:
        raise CardFormatError(f"{path}: {error}") from error
    return spec


def _check_order(spec: FileSpec) -> None:
    """Raise `ValueError` for records that do not fit together, or with bad samples."""
    names = [record.name for record in spec.records]
    require(len(set(names)) == len(names), "record: two have the same name")
    require(any(record.last for record in spec.records), "last: the file may end after no record")
    for number, record in enumerate(spec.records):
        with named(f"record {record.name}"):
            unknown = set(record.follows) - {START, *names}
            require(not unknown, f"follows: no record {', '.join(sorted(unknown))}")
            require(not record.joins or record.joins in names[:number], "joins: no record before it")
            _check_sample(spec, record)
    for leaf in spec.leaves():
        fields = spec.row_fields(leaf)
        require(len({one.name for one in fields}) == len(fields), f"{leaf.name}: fields of one name")


def _check_sample(spec: FileSpec, record: RecordSpec) -> None:
    with named("sample"):
        try:
            line = record_line(record, record_values(record, record.sample), spec.free)
        except DeckError as error:
            faults = (replace(problem, columns=None).headline() for problem in error.problems)
            raise ValueError("; ".join(faults)) from error
        require(line == record.sample, f"does not encode to itself:\n    {record.sample}\n    {line}")
