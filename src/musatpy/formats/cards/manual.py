"""The manual of a family of cards, made from its TOML files: `python -m musatpy.formats.cards.manual` prints it."""

from __future__ import annotations

import sys

from musatpy.formats.cards.spec import (
    CARD_WIDTH,
    CardSpec,
    Family,
    FieldSpec,
    card_formats_folder,
    load_family,
)
from musatpy.formats.markdown import key_table, markdown_table

RULER = "".join(f"----+----{tens}" for tens in range(1, CARD_WIDTH // 10 + 1))

_INTRODUCTION = """\
# Card formats

<!-- Generated from the TOML files: python -m musatpy.formats.cards.manual > card_formats/README.md -->

A deck is a file of cards, lines of up to 80 columns of printable ASCII. Columns 1-3 hold the mnemonic of the card;
columns 73-80 its sequence number, which is not read and is written as eight digits. Columns of no field are blank.
Lines end with LF or CR LF; blank lines are skipped with a warning; nothing follows the END card.

A folder here is a family of cards. Each of its TOML files states one card, and is the only place where its columns
stand: reader, writer and this page are made from it, and it is checked whenever it is loaded. The folders of other
agencies hold [files of records](#files-of-records).
"""

_NUMBERS = """\
## How fields are read and written

FORTRAN 66/77 rules hold. An explicit point beats the one that `Fw.d` implies (`1500` under F8.3 is 1.5); exponents
are `1.5E+3`, `1.5D3` or `1.5+3`; blanks within a number are errors. Blanks after a number mean nothing, except
where blank fields are zero: there they are zeros, as in FORTRAN 66. The sign of zero is kept: `-0` degrees belong
to a negative angle. Texts lose outer blanks, and keep inner ones.

Numbers are written right-justified, with the decimals of the descriptor; one that does not fit loses decimals as
far as needed, one too small for its decimals gets more of them or an exponent, and one that fits in no way is an
error. Texts are written left-justified.
"""


def card_manual(family: Family) -> str:
    """Return the manual of `family` in Markdown: the keys of its files; ruler, sample and fields of each card."""
    cards = family.cards.values()
    parts = [
        _INTRODUCTION,
        "## Keys of a file\n",
        key_table(CardSpec),
        "Keys of each `[[field]]`:\n",
        key_table(FieldSpec),
        _NUMBERS,
        f"## The cards of `{family.name}`\n",
        markdown_table(
            ["card", "", "in a deck"],
            ([_link(card), card.title, _occurrence(card)] for card in cards),
        ),
        *(_card_section(card) for card in cards),
    ]
    return "\n".join(parts)


def _card_section(card: CardSpec) -> str:
    sample = f"{card.doc}\n\n```text\n{RULER}\n{card.sample}\n```\n"
    parts = [f"### {card.mnemonic}: {card.title}\n", sample]
    if card.fields:
        header = ["columns", "field", "edit", "unit", "blank", "meaning", "target"]
        parts.append(markdown_table(header, (_field_row(field) for field in card.fields)))
    return "\n".join(parts)


def _field_row(field: FieldSpec) -> list[str]:
    columns = f"{field.first}-{field.last}" if field.last > field.first else f"{field.first}"
    blank = f"{field.blank}, or asterisks" if field.asterisks else field.blank
    allowed = f" One of {', '.join(f'`{text}`' for text in field.allowed)}." if field.allowed else ""
    return [columns, field.name, str(field.edit), field.unit, blank, field.doc + allowed, f"`{field.target}`"]


def _link(card: CardSpec) -> str:
    anchor = f"{card.mnemonic}-{card.title}".lower().replace(",", "").replace(" ", "-")
    return f"[{card.mnemonic}](#{anchor})"


def _occurrence(card: CardSpec) -> str:
    if card.repeat == "one":
        return "one" if card.required else "one or none"
    return "one or more" if card.required else "any number"


def manual() -> str:
    """Return the manual of all formats of the program."""
    from musatpy.formats.families import agencies
    from musatpy.formats.records.manual import records_manual

    cards = card_manual(load_family(card_formats_folder() / "musat"))
    return f"{cards}\n{records_manual([family.files for family in agencies().values()])}"


if __name__ == "__main__":
    sys.stdout.write(manual())
