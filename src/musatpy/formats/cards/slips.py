"""Slips that all of a card has in common: columns moved, commas for points, letters for digits, decimal degrees."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import product

import numpy as np

from musatpy.arrays import BoolArray, ByteArray
from musatpy.formats.cards.spec import CARD_WIDTH, DATA_COLUMNS, CardSpec, FieldSpec

_BLANK = ord(" ")
_MOVES = [sign * by for by in range(1, 9) for sign in (1, -1)]  # columns to the left, the nearest first
_LETTERS = (  # for digits and points, in the fields of numbers
    (b",", b".", "the card reads with points in place of its commas"),
    (b"OolI", b"0011", "the card reads with the digits 0 and 1 in place of the letters O and l"),
)
_DECIMAL_DEGREES = (
    "decimal degrees stand in the columns of degrees, minutes and seconds: cards STD, CTD and ATD have those"
)
_DECIMAL = re.compile(rb" {0,6}([-+]?)(\d{1,3}\.\d+) *")


def readings(spec: CardSpec, cards: ByteArray) -> Iterator[tuple[str, ByteArray, BoolArray]]:
    """Yield what may be wrong with all of cards (k, 80): a message, the cards without it, and (k,) which have it.

    Whether what is there then reads is for the caller to say.
    """
    numbers = np.zeros(CARD_WIDTH, dtype=bool)
    for field in (field for field in spec.fields if field.edit.is_number):
        numbers[field.first - 1 : field.last] = True
    for letters, digits, message in _LETTERS:
        table = np.arange(256, dtype=np.uint8)
        table[list(letters)] = list(digits)
        mended = np.where(numbers, table[cards], cards)
        yield message, mended, (mended != cards).any(axis=1)
    angles = _angles(spec)
    if angles:
        mended, known = _in_degrees(angles, cards)
        yield _DECIMAL_DEGREES, mended, known
    body = DATA_COLUMNS[0] - 1
    for move, end in product(_MOVES, (CARD_WIDTH, DATA_COLUMNS[1])):  # with the number of the sequence, or without
        text = cards[:, body:end]
        lost = text[:, :move] if move > 0 else text[:, move:]
        moved = np.full_like(cards, _BLANK)
        moved[:, :body] = cards[:, :body]
        kept = text[:, max(move, 0) : text.shape[1] + min(move, 0)]
        moved[:, max(body, body - move) : end - max(move, 0)] = kept
        by = f"{abs(move)} column{'s' * (abs(move) > 1)} to the {'left' if move > 0 else 'right'}"
        yield f"the card reads if it is moved {by}", moved, (lost == _BLANK).all(axis=1)


def _angles(spec: CardSpec) -> list[list[FieldSpec]]:
    """Return the fields of degrees, minutes and seconds of each angle of a card, side by side."""
    fields = {field.name: field for field in spec.fields}
    names = [name.removesuffix("_deg") for name in fields if name.endswith("_deg")]
    return [
        [fields[f"{name}_{part}"] for part in ("deg", "min", "sec")] for name in names if f"{name}_sec" in fields
    ]


def _in_degrees(angles: list[list[FieldSpec]], cards: ByteArray) -> tuple[ByteArray, BoolArray]:
    """Return cards with degrees, minutes and seconds in place of decimal degrees, and (k,) which had these."""
    mended, known = cards.copy(), np.zeros(len(cards), dtype=bool)
    for degrees, minutes, seconds in angles:
        for row in range(len(cards)):
            match = _DECIMAL.fullmatch(cards[row, degrees.first - 1 : seconds.last].tobytes())
            if match:
                whole, part = divmod(round(float(match[2]) * 3600.0, seconds.edit.decimals), 3600.0)
                sign = match[1].decode().strip("+")
                text = f"{sign}{whole:.0f}".rjust(degrees.edit.width) + f"{part // 60.0:{minutes.edit.width}.0f}"
                text += f"{math.fmod(part, 60.0):{seconds.edit.width}.{seconds.edit.decimals}f}"
                mended[row, degrees.first - 1 : seconds.last] = list(text.encode())
                known[row] = True
    return mended, known
