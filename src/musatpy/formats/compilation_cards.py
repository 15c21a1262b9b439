"""The cards of compilation decks, and their fields as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.errors import Problem
from musatpy.formats import mapping
from musatpy.formats.cards.deck import CardDeck, CardTable
from musatpy.formats.cards.spec import Family, card_formats_folder, load_family
from musatpy.formats.musat import card_family

OF_RUN = ("ELL", "WTR")  # cards that say again what the run says, and must agree
_SHARED = ("TTL", "END", *OF_RUN)  # cards of triangulation decks that these have too
COORDINATES = ("x_left", "y_left", "x_right", "y_right")
PLACE = ("x", "y", "z")
READINGS = ("STG", "MPT")
CORNERS = ("first_1", "first_2", "second_1", "second_2")
LEVELS = tuple(f"level_{number}" for number in range(1, 9))
TIMES = tuple(f"time_{number}" for number in range(1, 6))


@lru_cache(maxsize=8)
def compilation_family(folder: Path | None = None) -> Family:
    """Return the cards of compilation decks, or those of another folder of their formats.

    Raises `CardFormatError` for formats that are wrong, or whose targets and units are not those of the model.
    """
    family = load_family(folder or card_formats_folder() / "as11")
    mapping.check_targets(family)
    cards = {**family.cards, **{name: card for name, card in card_family().cards.items() if name in _SHARED}}
    ordered = sorted(cards.values(), key=lambda card: (card.order, card.mnemonic))
    return replace(family, cards=MappingProxyType({card.mnemonic: card for card in ordered}))


def cards_of(deck: CardDeck, mnemonic: str) -> CardTable:
    """Return the cards of a kind, none where the deck has none."""
    return deck.table(compilation_family().cards[mnemonic])


def text(table: CardTable, name: str) -> TextArray:
    """Return a field as texts (k,)."""
    return np.asarray(table.columns[name], dtype=np.str_)


def number(table: CardTable, name: str) -> FloatArray:
    """Return a field as numbers (k,)."""
    return np.asarray(table.columns[name], dtype=float)


def numbers(table: CardTable, names: Sequence[str]) -> FloatArray:
    """Return several fields as columns (k, n), NaN of those that the cards do not have."""
    nothing = np.full(len(table), np.nan)
    return np.stack([number(table, name) if name in table.columns else nothing for name in names], axis=1)


def reading_lines(deck: CardDeck) -> IntArray:
    """Return the lines (k,) of the readings, in the order of the deck."""
    return np.sort(np.concatenate([cards_of(deck, name).lines for name in READINGS]))


def problem(deck: CardDeck, table: CardTable, row: int, field: str, message: str) -> Problem:
    """Return what is wrong with a field of a card."""
    line, spec = int(table.lines[row]), table.spec.field(field)
    image = deck.text(line)
    return Problem(
        file=deck.file, line=line, columns=spec.columns, card=table.spec.mnemonic, field=field,
        found=image[spec.first - 1 : spec.last].strip(), message=message, text=image,
    )  # fmt: skip


def place_of_model(file: str, line: int) -> dict[str, Any]:
    """Return where the photos of a model stand, as a `Problem` has it."""
    spec = compilation_family().cards["MDL"]
    return {
        "file": file,
        "line": line,
        "card": "MDL",
        "columns": (spec.field("left").first, spec.field("right").last),
    }


def with_columns(problem: Problem, file: str) -> Problem:
    """Return a problem of a deck with its file, and where it names a card's field and line with its columns."""
    spec = compilation_family().cards.get(problem.card or "")
    if spec is None or problem.field is None or problem.line is None:
        return Problem(file=file, message=problem.message)
    return replace(problem, file=file, columns=spec.field(problem.field).columns)


def place_of_reading(file: str, line: int, *, on_stages: bool) -> dict[str, Any]:
    """Return where the coordinates of a reading stand, as a `Problem` has it."""
    mnemonic, names = ("STG", COORDINATES) if on_stages else ("MPT", PLACE)
    spec = compilation_family().cards[mnemonic]
    columns = (spec.field(names[0]).first, spec.field(names[-1]).last)
    return {"file": file, "line": line, "card": mnemonic, "columns": columns}
