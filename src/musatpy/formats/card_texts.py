"""Cards explained for a terminal: ruler, fields, values and defaults, from the TOML files that state them."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence

from musatpy import model
from musatpy.errors import CardFormatError, Problem
from musatpy.formats import assembly, mapping
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.cards.manual import RULER, occurrence
from musatpy.formats.cards.settings import Setting, blank_card, card_with
from musatpy.formats.cards.spec import END_MNEMONIC, CardSpec, Family, FieldSpec
from musatpy.formats.checks import check_card
from musatpy.formats.draft import draft_of

_WIDTH = 80
_INDENT = " " * 10
# Parts of a block that a single card fills and that have values where it is blank.
_DEFAULTS = {
    "options": model.Options(),
    "reduction": model.ReductionOptions(),
    "comparator": model.ComparatorSpec(),
    "orientation": model.OrientationSpec(),
}


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
    if spec.fields:
        lines += ["", *_row("columns", "field", "edit", "unit", "blank is")]
        defaults = _defaults(spec)
        for field in sorted(spec.fields, key=lambda field: field.first):
            lines += _field(field, defaults.get(field.name, ""))
    return "\n".join(lines) + "\n"


def _row(*cells: str) -> list[str]:
    columns, name, edit, unit, blank = cells
    return [f"{columns:>7}   {name:<20} {edit:<7} {unit:<7} {blank}".rstrip()]


def _field(field: FieldSpec, default: str) -> Iterator[str]:
    place = f"{field.first}-{field.last}" if field.last > field.first else f"{field.first}"
    blank = {"error": "an error", "zero": "zero"}.get(field.blank, default or "no value")
    yield from _row(place, field.name, str(field.edit), field.unit, blank)
    doc = field.doc
    if field.allowed:
        doc += f" One of {', '.join(field.allowed)}."
    yield from textwrap.wrap(doc, _WIDTH, initial_indent=_INDENT, subsequent_indent=_INDENT)


def _defaults(spec: CardSpec) -> dict[str, str]:
    """Return what blank fields stand for, as they would be punched, where the model has a default for them."""
    tables = {slot.path.partition(".")[0] for slot in _slots(spec)}
    if len(tables) != 1 or (table := tables.pop()) not in _DEFAULTS:
        return {}
    values = mapping.scatter(spec, assembly.single_values(_DEFAULTS[table], table))
    fields = {field.name: field for field in spec.fields if field.blank == "missing"}
    return {name: field.encode(values[name][0].item()).strip() for name, field in fields.items()}


def _slots(spec: CardSpec) -> tuple[mapping.Slot, ...]:
    """Return the slots of a card; none of one that fills no block, as those of compilation decks."""
    try:
        return mapping.slots(spec)
    except CardFormatError:
        return ()


def card_of(spec: CardSpec, settings: Sequence[Setting], family: Family) -> tuple[str, tuple[Problem, ...]]:
    """Return the card with these fields, without a sequence number, and every problem of what it says itself.

    What only shows beside other cards (a camera that is nowhere, say) is none of them.
    """
    card = card_with(blank_card(spec), settings)
    deck = read_cards(f"{card}\n{END_MNEMONIC}\n".encode("ascii", "replace"), family, name=spec.mnemonic)
    problems = [problem for problem in deck.problems if problem.line == 1]
    if _slots(spec):
        problems += check_card(draft_of(deck, family))
    return card.rstrip(), tuple(problems)
