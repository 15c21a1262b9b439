"""Decks of 80-column cards, whose layout stands in TOML files and nowhere else."""

from musatpy.formats.cards.deck import CardDeck, CardTable, read_cards, write_cards
from musatpy.formats.cards.spec import CardSpec, Family, FieldSpec, card_formats_folder, load_family

__all__ = [
    "CardDeck",
    "CardSpec",
    "CardTable",
    "Family",
    "FieldSpec",
    "card_formats_folder",
    "load_family",
    "read_cards",
    "write_cards",
]
