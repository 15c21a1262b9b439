"""Card images -> columns of values: one field of many cards at a time.

`FieldSpec.decode` is the definition of what a field means. What most cards have, a text, or a number of up to 15
digits with or without its point, is read by numpy: such digits are an integer that a float holds exactly, and one
division by a power of ten, exact too up to 10**22, rounds it correctly, as `float()` does. Everything else, and
what stands on few cards, goes through the definition, card by card.
"""

from __future__ import annotations

import numpy as np

from musatpy.arrays import BoolArray, ByteArray, FloatArray, TextArray
from musatpy.formats.cards.spec import DATA_COLUMNS, CardSpec, FieldSpec
from musatpy.fortran import FieldError

Column = FloatArray | TextArray

FEW = 8  # values: operations of numpy on no more than these take longer than one value after the other
_MOST_DIGITS = 15  # 10**15 < 2**53: any such integer is exact in a float
_POWERS = 10.0 ** np.arange(23)


def empty_column(field: FieldSpec, size: int) -> Column:
    """Return the (size,) array that holds the column of `field`, still to be filled."""
    return np.empty(size, dtype=np.float64 if field.edit.is_number else f"U{field.edit.width}")


def decode_column(field: FieldSpec, cards: ByteArray, column: Column) -> list[tuple[int, FieldError]]:
    """Decode one field of the (k, 80) `cards` into `column` (k,); return the rows that do not decode, and why.

    These hold NaN or an empty text.
    """
    plain = np.zeros(len(cards), dtype=bool)
    if len(cards) > FEW:
        letters = cards[:, field.first - 1 : field.last]
        plain = (_decode_numbers if field.edit.is_number else _decode_texts)(field, letters, column)
    bad = []
    for row in np.flatnonzero(~plain).tolist():
        text = cards[row, field.first - 1 : field.last].tobytes().decode("ascii")
        try:
            column[row] = field.decode(text)
        except FieldError as error:
            column[row] = np.nan if field.edit.is_number else ""
            bad.append((row, error))
    return bad


def _decode_numbers(field: FieldSpec, letters: ByteArray, column: Column) -> BoolArray:
    """Decode the plain and the allowed blank numbers among texts (k, w) into `column`, and return where they are.

    Plain are blanks, an optional sign, digits with at most one point among them, and blanks.
    """
    letters = np.ascontiguousarray(letters.T)  # sums over the characters of each number run along its first axis
    digits = letters - np.uint8(ord("0"))
    is_digit, is_point, blank, minus = digits <= 9, *(letters == ord(sign) for sign in ". -")
    starts = ~blank  # the leftmost character of each run of characters
    starts[1:] &= blank[:-1]
    is_sign = starts & (minus | (letters == ord("+")))
    places = np.cumsum(is_digit[::-1], axis=0, dtype=np.int8)[::-1]  # digits from each on
    count, points = places[0], is_point.sum(axis=0, dtype=np.int8)
    plain: BoolArray = (is_digit | is_point | is_sign | blank).all(axis=0) & (
        starts.sum(axis=0, dtype=np.int8) == 1
    )
    plain &= (0 < count) & (count <= _MOST_DIGITS) & (points <= (field.edit.letter != "I"))
    if field.blank == "zero":  # blanks after a number without a point are zeros
        plain &= (points == 1) | ~blank[-1]
    decimals = np.where(points == 1, (places * is_point).sum(axis=0, dtype=np.int8), field.edit.decimals)
    plain &= decimals < len(_POWERS)
    weights = _POWERS[np.clip(places - 1, 0, len(_POWERS) - 1)]
    value = np.einsum("wk,wk->k", digits * is_digit, weights) / _POWERS[np.where(plain, decimals, 0)]
    column[:] = np.where(minus.any(axis=0), -value, value)
    if field.blank != "error":
        nothing = blank.all(axis=0)
        column[nothing] = 0.0 if field.blank == "zero" else np.nan
        plain |= nothing
    return plain


def _decode_texts(field: FieldSpec, letters: ByteArray, column: Column) -> BoolArray:
    """Decode texts (k, w), without outer blanks, into `column`, and return where they are allowed."""
    width = field.edit.width
    stripped = np.char.strip(np.ascontiguousarray(letters).view(f"S{width}")[:, 0], b" ").astype(f"S{width}")
    # A text of numpy is a row of 32-bit characters, ended by zeros.
    column.view(np.uint32).reshape(-1, width)[:] = stripped.view(np.uint8).reshape(-1, width)
    full = column != ""
    plain = full & np.isin(column, field.allowed) if field.allowed else full
    return plain | ~full if field.blank == "missing" else plain


def gaps(spec: CardSpec) -> list[tuple[int, int]]:
    """Return the runs of columns (first, last) from 4 to 72 in which the card has no field."""
    runs = []
    first, end = DATA_COLUMNS
    for field in sorted(spec.fields, key=lambda field: field.first):
        runs.append((first, field.first - 1))
        first = field.last + 1
    return [(first, last) for first, last in [*runs, (first, end)] if first <= last]


def stray_rows(spec: CardSpec, cards: ByteArray) -> BoolArray:
    """Return the rows (k,) of `cards` that have something in columns of no field, 4 to 72."""
    stray = np.zeros(len(cards), dtype=bool)
    for first, last in gaps(spec):
        stray |= (cards[:, first - 1 : last] != ord(" ")).any(axis=1)
    return stray
