"""The formats explained, from their TOML files: cards for a terminal, and the manual of all of them.

`python -m musatpy.formats.cards.manual` prints the manual.
"""

from __future__ import annotations

import json
import sys
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from musatpy import model
from musatpy.errors import Problem
from musatpy.formats import assembly, mapping
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.cards.settings import Setting, blank_card, card_with
from musatpy.formats.cards.spec import (
    CARD_WIDTH,
    END_MNEMONIC,
    CardSpec,
    Family,
    FieldSpec,
    card_formats_folder,
    load_family,
)
from musatpy.formats.checks import check_card
from musatpy.formats.checks.values import bounds
from musatpy.formats.compilation_deck import compilation_draft, compilation_family
from musatpy.formats.draft import draft_of
from musatpy.formats.families import agencies
from musatpy.formats.records.fields import RecordField
from musatpy.formats.records.layout import FileSpec, RecordSpec
from musatpy.model.compilation import CARD_TABLES
from musatpy.specs import is_required, keys, read_toml

RULER = "".join(f"----+----{tens}" for tens in range(1, CARD_WIDTH // 10 + 1))

_WIDTH = 80
_INDENT = " " * 10
# Parts of a block that a single card fills and that have values where it is blank.
_DEFAULTS = {
    "options": model.Options(),
    "reduction": model.ReductionOptions(),
    "comparator": model.ComparatorSpec(),
    "orientation": model.OrientationSpec(),
}

_EXPLAINED = ("title", "doc", "source", "file", "order", "record")  # keys of a file that its section has in words

_INTRODUCTION = """\
# Card formats

<!-- Generated from the TOML files: python -m musatpy.formats.cards.manual > card_formats/README.md -->

A folder here is a family of cards. Each of its TOML files states one card, and is the only place where its columns
stand: reader, writer and this page are made from it, and it is checked whenever it is loaded. [How fields are read
and written](../docs/cards.md#how-cards-are-read) is told elsewhere. The folders of other agencies hold [files of
records](#files-of-records).
"""
_RECORDS = """\
## Files of records

Other agencies' files have no mnemonics: what a line is, is known by what stands before it, or by its first word.
Each TOML file of such a family states one kind of file; the kinds of one family make a set. [How sets are
converted](../docs/formats.md).

### Keys of a file of records
"""


# --- for a terminal ---


def list_of_cards(families: Iterable[Family]) -> str:
    """Return the cards of families, one on a line: mnemonic, title and how many of them a deck has."""
    lines: list[str] = []
    for family in families:
        cards = family.cards.values()
        width = max(len(card.title) for card in cards)
        lines += ["", f"Cards of {family.name}", ""]
        lines += [f"{card.mnemonic}  {card.title:<{width}}  {occurrence(card)}" for card in cards]
    return "\n".join(lines[1:]) + "\n"


def card_text(spec: CardSpec) -> str:
    """Return what a card is for, its sample below a ruler, and its fields: columns, descriptor, unit, default."""
    lines = [f"{spec.mnemonic}: {spec.title} ({occurrence(spec)} in a deck)", *textwrap.wrap(spec.doc, _WIDTH), ""]
    lines += [RULER, spec.sample]
    row = "{:>7}   {:<20} {:<7} {:<7} {}".format
    if spec.fields:
        lines += ["", row("columns", "field", "edit", "unit", "blank is")]
    defaults = _defaults(spec)
    for field in sorted(spec.fields, key=lambda field: field.first):
        blank = {"error": "an error", "zero": "zero"}.get(field.blank, defaults.get(field.name) or "no value")
        lines.append(row(_place(field), field.name, str(field.edit), field.unit, blank))
        doc = f"{field.doc} One of {', '.join(field.allowed)}." if field.allowed else field.doc
        lines += textwrap.wrap(doc, _WIDTH, initial_indent=_INDENT, subsequent_indent=_INDENT)
    return "\n".join(lines) + "\n"


def _place(field: FieldSpec) -> str:
    return f"{field.first}-{field.last}" if field.last > field.first else f"{field.first}"


def _defaults(spec: CardSpec) -> dict[str, str]:
    """Return what blank fields stand for, as they would be punched, where the model has a default for them."""
    tables = {slot.path.partition(".")[0] for slot in mapping.slots(spec)}
    if len(tables) != 1 or (table := tables.pop()) not in _DEFAULTS:
        return {}
    values = mapping.scatter(spec, assembly.single_values(_DEFAULTS[table], table))
    fields = {field.name: field for field in spec.fields if field.blank == "missing"}
    return {name: field.encode(values[name][0].item()).strip() for name, field in fields.items()}


def card_of(spec: CardSpec, settings: Sequence[Setting], family: Family) -> tuple[str, tuple[Problem, ...]]:
    """Return the card with these fields, without a sequence number, and every problem of what it says itself.

    What only shows beside other cards (a camera that is nowhere, say) is none of them.
    """
    card = card_with(blank_card(spec), settings)
    tables = {slot.path.partition(".")[0] for slot in mapping.slots(spec)}
    if compiled := bool(tables) and tables <= CARD_TABLES.keys():
        family = compilation_family()
    deck = read_cards(f"{card}\n{END_MNEMONIC}\n".encode(), family, name=spec.mnemonic)
    problems = [problem for problem in deck.problems if problem.line == 1]
    if compiled:
        problems += bounds(compilation_draft(deck))
    elif tables:
        problems += check_card(draft_of(deck, family))
    return card.rstrip(), tuple(problems)


# --- in Markdown ---


def card_manual(family: Family) -> str:
    """Return the manual of `family` in Markdown: the keys of its files; ruler, sample and fields of each card."""
    parts = [
        _INTRODUCTION,
        "## Keys of a file\n",
        _key_table(CardSpec),
        "Keys of each `[[field]]`:\n",
        _key_table(FieldSpec),
        *card_sections(family),
    ]
    return "\n".join(parts)


def card_sections(family: Family) -> list[str]:
    """Return the cards of a family in Markdown: which there are, and ruler, sample and fields of each."""
    rows, sections = [], []
    for card in family.cards.values():
        anchor = f"{card.mnemonic}-{card.title}".lower().replace(",", "").replace(" ", "-")
        rows.append([f"[{card.mnemonic}](#{anchor})", card.title, occurrence(card)])
        sample = f"{card.doc}\n\n```text\n{RULER}\n{card.sample}\n```\n"
        fields = _field_table(card.fields, "columns")
        sections.append("\n".join([f"### {card.mnemonic}: {card.title}\n", sample, *fields]))
    return [f"## The cards of `{family.name}`\n", _table(["card", "", "in a deck"], rows), *sections]


def occurrence(card: CardSpec) -> str:
    """Return how many cards of a kind a deck has, in words."""
    if card.repeat == "one":
        return "one" if card.required else "one or none"
    return "one or more" if card.required else "any number"


def _file_section(file: FileSpec) -> str:
    stated = read_toml(Path(file.stated_in))
    others = {"layout": "free" if file.free else "fixed"} | stated  # fixed is the default, and stands there too
    shown = [
        f"`{name} = {json.dumps(others[name])}`" for name in keys(FileSpec) if name in {*others} - {*_EXPLAINED}
    ]
    parts = [
        f"### `{file.file}`: {file.title}\n",
        f"{file.doc} Keys: {', '.join(shown)}.\n",
        f"Source: {file.source}\n",
        *(_record_section(file, record) for record in file.records),
    ]
    return "\n".join(parts)


def _record_section(file: FileSpec, record: RecordSpec) -> str:
    follows = ", ".join(f"`{name}`" for name in record.follows)
    joins = f" Makes one row with the `{record.joins}` before it." if record.joins else ""
    says = "".join(f" Says that `{path}` is {letter}." for path, letter in record.constants)
    last = " The file may end after it." if record.last else ""
    text = f"**{record.name}.** {record.doc} Follows {follows}.{joins}{says}{last}\n"
    fields = _field_table(record.fields, "word" if file.free else "columns")
    return "\n".join([text, f"```text\n{record.sample}\n```\n", *fields])


def _field_table(fields: Sequence[FieldSpec], place: str) -> list[str]:
    """Return the table of the fields of a card or record, none without fields."""
    header = [place, "field", "edit", "unit", "blank", "meaning", "target"]
    return [_table(header, (_field_row(field) for field in fields))] if fields else []


def _field_row(field: FieldSpec) -> list[str]:
    blank = f"{field.blank}, or asterisks" if field.asterisks else field.blank
    doc = field.doc
    if field.allowed:
        doc += f" One of {', '.join(f'`{text}`' for text in field.allowed)}."
    if isinstance(field, RecordField) and field.codes:
        doc += f" {', '.join(f'`{text}` is {letter}' for text, letter in field.codes)}."
    if isinstance(field, RecordField) and field.none is not None:
        doc += f" {field.none:.1f} stands for no value."
    target = f"`{field.target}`" if field.target else ""
    return [_place(field), field.name, str(field.edit), field.unit, blank, doc, target]


def _key_table(kind: Any) -> str:
    """Return the table that explains the keys of a format file."""
    rows = (
        [f"`{name}`", "yes" if is_required(field) else "no", field.metadata["doc"]]
        for name, field in keys(kind).items()
    )
    return _table(["key", "required", "meaning"], rows)


def _table(header: list[str], rows: Iterable[list[str]]) -> str:
    """Return a table in Markdown."""
    lines = [header, ["---"] * len(header), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def manual() -> str:
    """Return the manual of all formats of the program."""
    parts = [
        card_manual(load_family(card_formats_folder() / "musat")),
        *card_sections(load_family(card_formats_folder() / "as11")),
        _RECORDS,
        _key_table(FileSpec),
        "Keys of each `[[record]]`:\n",
        _key_table(RecordSpec),
        "Keys of each `[[record.field]]`:\n",
        _key_table(RecordField),
    ]
    for family in agencies().values():
        parts += [f"## The files of `{family.name}`\n", *(_file_section(file) for file in family.files)]
    return "\n".join(parts)


if __name__ == "__main__":
    sys.stdout.write(manual())
