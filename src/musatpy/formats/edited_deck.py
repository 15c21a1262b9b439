"""A deck of which some cards say something else: the lines of all others stay as they are, byte by byte."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterator

from musatpy import model
from musatpy.formats import assembly
from musatpy.formats.cards.codec import bytes_of, text_of
from musatpy.formats.cards.deck import CardDeck, Columns, read_cards
from musatpy.formats.cards.settings import Setting, card_with
from musatpy.formats.cards.spec import CardSpec, Family
from musatpy.formats.musat import check_deck, deck_bytes

_Card = dict[str, float | str | None]  # field -> value, None for no number
_Key = tuple[float | str | None, ...]  # the names on a card, by which it is known among those of its kind


def edited_deck(data: bytes, after: model.Block, family: Family) -> bytes | None:
    """Return the deck `data` with those cards changed that must be to make it the deck of `after`.

    On a card that changes only the columns of the fields do so; a card that says nothing any more is left out. None
    where no such deck has the block `after`, as where it has cards that are new.
    """
    before, _ = check_deck(data, family, for_run=False)
    if before is None:
        return None
    deck = read_cards(data, family)
    text, encoding = text_of(data)
    lines = re.findall(r"[^\n]*\n|[^\n]+", text)
    old, new = (
        {spec: _rows(spec, columns) for spec, columns in assembly.cards_of(block, family)}
        for block in (before, after)
    )
    for spec in family.cards.values():
        for line, card, changed in _changes(deck, spec, old.get(spec, []), new.get(spec, [])):
            ending = lines[line - 1][len(lines[line - 1].rstrip("\r\n")) :]
            lines[line - 1] = _changed(spec, lines[line - 1], card, changed) + ending if changed else ""
    edited = bytes_of("".join(lines), encoding)
    block, _ = check_deck(edited, family, for_run=False)
    same = block is not None and _contents(block, family) == _contents(after, family)
    return edited if same else None


def _contents(block: model.Block, family: Family) -> list[bytes]:
    """Return the cards of a block without the numbers of the sequence, in an order of their own."""
    return sorted(line[:72] for line in deck_bytes(block, family).splitlines())


def _rows(spec: CardSpec, columns: Columns) -> list[_Card]:
    names = [field.name for field in spec.fields]
    rows = zip(*(columns[name].tolist() for name in names), strict=True)
    return [dict(zip(names, [None if value != value else value for value in row], strict=True)) for row in rows]


def _key(spec: CardSpec, card: _Card) -> _Key:
    named = [field for field in spec.fields if not (field.edit.is_number or field.allowed or field.letters)]
    return tuple(card[field.name] for field in named)


def _changes(
    deck: CardDeck, spec: CardSpec, before: list[_Card], after: list[_Card]
) -> Iterator[tuple[int, _Card, _Card | None]]:
    """Yield the lines of a deck that change, with what the card says before and after, None where it goes.

    Cards of the deck are known by their names, several of the same names by their order. What becomes of one that
    changes is the new card that has most fields in common with it, and of these one with its names.
    """
    if before == after:
        return
    places, left = defaultdict[_Key, list[int]](list), list[tuple[int, _Card]]()
    for line, card in zip(deck.lines[spec.mnemonic].tolist(), _rows(spec, deck.tables[spec.mnemonic]), strict=True):
        places[_key(spec, card)].append(line)
    wanted = defaultdict[_Key, list[_Card]](list)
    for card in after:
        wanted[_key(spec, card)].append(card)
    for card in before:
        key = _key(spec, card)
        if not places[key]:
            continue  # no card of the deck: what is made of it would differ
        line = places[key].pop(0)
        if card in wanted[key]:
            wanted[key].remove(card)
        else:
            left.append((line, card))
    for line, card in left:
        nearest = max(
            (other for cards in wanted.values() for other in cards),
            key=lambda other: (
                sum(card[name] == other[name] for name in card),
                _key(spec, card) == _key(spec, other),
            ),
            default=None,
        )
        if nearest is not None:
            wanted[_key(spec, nearest)].remove(nearest)
        yield line, card, nearest


def _changed(spec: CardSpec, line: str, before: _Card, after: _Card) -> str:
    """Return a line with the columns of what differs."""
    columns = []
    for field in (field for field in spec.fields if before[field.name] != after[field.name]):
        value = after[field.name]
        columns.append((field.first, field.encode(math.nan if value is None else value)))
    setting = Setting(card=spec.mnemonic, name="", value="", columns=tuple(columns))
    return card_with(line.rstrip("\r\n"), [setting])
