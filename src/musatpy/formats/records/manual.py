"""The manual of files of records, made from their TOML files (`python -m musatpy.formats.cards.manual`)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from musatpy.formats.markdown import key_table, markdown_table
from musatpy.formats.records.fields import RecordField
from musatpy.formats.records.spec import FileSpec, RecordSpec

_INTRODUCTION = """\
## Files of records

Other agencies' files have no mnemonics: what a line is, is known by what stands before it, or by its first word.
Each TOML file of such a family states one kind of file; the kinds of one family make a set. [How sets are
converted](../docs/formats.md) is said elsewhere.

### Keys of a file of records
"""


def records_manual(families: Iterable[Sequence[FileSpec]]) -> str:
    """Return the manual of families in Markdown: the keys of their files, and the records of each."""
    parts = [
        _INTRODUCTION,
        key_table(FileSpec),
        "Keys of each `[[record]]`:\n",
        key_table(RecordSpec),
        "Keys of each `[[record.field]]`:\n",
        key_table(RecordField),
    ]
    for files in families:
        parts.append(f"## The files of `{files[0].family}`\n")
        parts += [_file_section(file) for file in files]
    return "\n".join(parts)


def _file_section(file: FileSpec) -> str:
    layout = "words with blanks between them" if file.free else "fixed columns"
    parts = [
        f"### `{file.file}`: {file.title}\n",
        f"{file.doc} {layout.capitalize()}; {_conventions(file)}.\n",
        f"Source: {file.source}\n",
        *(_record_section(file, record) for record in file.records),
    ]
    return "\n".join(parts)


def _conventions(file: FileSpec) -> str:
    """Return the keys of a file that say what its numbers mean."""
    said = ["rectangular coordinates" if file.rectangular else "coordinates as in the deck of the job"]
    fields = [field for record in file.records for field in record.fields]
    if any(field.target.startswith("photos.attitude") for field in fields):
        frame = "the local vertical frame" if file.vertical_attitude else "the axes of the file"
        said.append(f"attitudes are {file.attitude} in {frame}")
    if file.longitude_first:
        said.append("geographic ones longitude, latitude, height")
    if file.origin_at_principal_point:
        said.append("image coordinates about the principal point")
    if file.fiducials:
        said.append(f"the first {file.fiducials} measurements of each photo are its fiducial marks")
    return "; ".join(said)


def _record_section(file: FileSpec, record: RecordSpec) -> str:
    follows = ", ".join(f"`{name}`" for name in record.follows)
    joins = f" Makes one row with the `{record.joins}` before it." if record.joins else ""
    says = "".join(f" Says that `{path}` is {letter}." for path, letter in record.constants)
    last = " The file may end after it." if record.last else ""
    text = f"**{record.name}.** {record.doc} Follows {follows}.{joins}{says}{last}\n"
    parts = [text, f"```text\n{record.sample}\n```\n"]
    if record.fields:
        header = ["word" if file.free else "columns", "field", "edit", "unit", "blank", "meaning", "target"]
        parts.append(markdown_table(header, (_field_row(field) for field in record.fields)))
    return "\n".join(parts)


def _field_row(field: RecordField) -> list[str]:
    place = f"{field.first}-{field.last}" if field.last > field.first else f"{field.first}"
    doc = field.doc
    if field.codes:
        doc += f" {', '.join(f'`{text}` is {letter}' for text, letter in field.codes)}."
    if field.none is not None:
        doc += f" {field.none:.1f} stands for no value."
    target = f"`{field.target}`" if field.target else ""
    return [place, field.name, str(field.edit), field.unit, field.blank, doc, target]
