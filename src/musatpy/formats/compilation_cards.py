"""The cards of compilation decks, as rows of a draft, and where what they say stands."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from musatpy.arrays import IntArray
from musatpy.errors import Problem
from musatpy.formats import mapping
from musatpy.formats.cards.deck import CardDeck
from musatpy.formats.cards.spec import Family, card_formats_folder, load_family
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import Rows
from musatpy.formats.musat import card_family
from musatpy.model import Options

_SHARED = ("TTL", "END", "ELL", "WTR")  # cards of triangulation decks that these have too
READINGS = ("STG", "MPT")


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


def compilation_draft(deck: CardDeck) -> Draft:
    """Return what the cards of a compilation deck say, whatever is wrong with them; their roles are mnemonics."""
    rows = {}
    for name, spec in compilation_family().cards.items():
        table, fills = deck.table(spec), {slot.path.partition(".")[0] for slot in mapping.slots(spec)}
        values = mapping.gather(spec, table.columns)
        rows[name] = Rows.of(fills.pop() if fills else name, (spec,), values, table.lines)
    nobody, links = np.zeros(0, dtype=np.str_), dict[str, IntArray]()
    return Draft(
        deck=deck, rows=rows, options=Options(), reduction=None,
        camera_ids=nobody, photo_ids=nobody, point_ids=nobody, camera=links, photo=links, point=links,
    )  # fmt: skip


def reading_lines(draft: Draft) -> IntArray:
    """Return the lines (k,) of the readings, in the order of the deck."""
    return np.sort(np.concatenate([draft.rows[name].lines for name in READINGS]))


def place_of(file: str, line: int, mnemonic: str) -> dict[str, Any]:
    """Return where the photos of a model (MDL), or the coordinates of a reading, stand, as a `Problem` has it."""
    ends = {"MDL": ("left", "right"), "STG": ("x_left", "y_right"), "MPT": ("x", "z")}[mnemonic]
    first, last = (compilation_family().cards[mnemonic].field(name) for name in ends)
    return {"file": file, "line": line, "card": mnemonic, "columns": (first.first, last.last)}


def with_columns(problem: Problem, file: str) -> Problem:
    """Return a problem of a deck with its file, and where it names a card's field and line with its columns."""
    spec = compilation_family().cards.get(problem.card or "")
    if spec is None or problem.field is None or problem.line is None:
        return Problem(file=file, message=problem.message)
    return replace(problem, file=file, columns=spec.field(problem.field).columns)
