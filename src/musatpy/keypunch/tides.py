"""The cards that say how high the water is at each exposure, by the readings of a gauge."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from musatpy.errors import DeckError, Problem
from musatpy.formats.cards.codec import bytes_of, text_of
from musatpy.formats.cards.deck import CardDeck, read_cards
from musatpy.formats.cards.settings import blank_card, card_with, setting_of
from musatpy.formats.cards.spec import END_MNEMONIC, CardSpec, Family
from musatpy.pointfiles.gauges import Tide


def deck_with_tides(
    data: bytes, family: Family, tide: Tide, exposures: Mapping[str, float] | None, *, clock: float = 0.0
) -> tuple[bytes, dict[str, tuple[float, float]]]:
    """Return a deck with the tides of its photos on their cards, and these by photo: height and sigma (m).

    `exposures`: times by photo; None: those on the cards of tides, which count from `clock` (s). All other columns
    and cards stay as they are; a photo without a card gets one before the END. Raises `DeckError` with every photo
    that has no tide.
    """
    deck = read_cards(data, family)
    spec, fields = _card_of_tides(family)
    photos = _photos(deck, family)
    on_cards = {photo: row for row, photo in enumerate(deck.tables[spec.mnemonic][fields["photos.ids"]].tolist())}
    if exposures is None:
        times = deck.tables[spec.mnemonic][fields["photos.time"]]
        exposures = {photo: float(times[row]) + clock for photo, row in on_cards.items()}
    time = np.array([exposures.get(photo, np.nan) for photo in photos])
    height, sigma = tide.at(time)
    lost = np.flatnonzero(np.isnan(height)).tolist()
    if lost:
        raise DeckError([Problem(message=f"photo {photos[row]}, {tide.lacking(time[row])}") for row in lost])
    text, encoding = text_of(data)
    lines = re.findall(r"[^\n]*\n|[^\n]+", text)
    new = list[str]()
    for photo, *values in zip(photos, height.tolist(), sigma.tolist(), strict=True):
        named = zip(("photos.tide", "photos.tide_sigma"), values, strict=True)
        settings = [setting_of(spec, fields[target], f"{value:.4f}") for target, value in named]
        if photo in on_cards:
            line = int(deck.lines[spec.mnemonic][on_cards[photo]]) - 1
            card = lines[line].rstrip("\r\n")
            lines[line] = card_with(card, settings) + lines[line][len(card) :]
        else:
            name = setting_of(spec, fields["photos.ids"], photo)
            new.append(card_with(blank_card(spec), [name, *settings]).rstrip() + "\n")
    end = next((row for row, line in enumerate(lines) if line.startswith(END_MNEMONIC)), len(lines))
    data = bytes_of("".join([*lines[:end], *new, *lines[end:]]), encoding)
    return data, dict(zip(photos, zip(height.tolist(), sigma.tolist(), strict=True), strict=True))


def _card_of_tides(family: Family) -> tuple[CardSpec, dict[str, str]]:
    """Return the card of a family that has the tides, and its fields by what they are of a block."""
    for spec in family.cards.values():
        fields = {field.target: field.name for field in spec.fields}
        if "photos.tide" in fields:
            return spec, fields
    raise DeckError.of("no card of these formats has a tide")


def _photos(deck: CardDeck, family: Family) -> list[str]:
    """Return the photos of a deck, in the order of its cards."""
    named = [
        (spec.mnemonic, field.name)
        for spec in family.cards.values()
        for field in spec.fields
        if field.target == "photos.ids"
    ]
    return list(dict.fromkeys(photo for card, name in named for photo in deck.tables[card][name].tolist() if photo))
