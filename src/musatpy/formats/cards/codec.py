"""Card images -> columns of values: one field of many cards at a time, eight characters in one machine word.

A card image is a row of bytes; eight neighbouring columns of a row are one little-endian 64-bit word, whose lowest
byte is the leftmost character. Arithmetic on words works on eight characters at once ("SIMD within a register"), and
numpy does it for a chunk of cards in each operation. A field is decoded so when it has the plain form

    blanks, an optional sign, digits, a point exactly where the descriptor implies it, digits

with at most 15 digits: its digits are then an integer that a float holds exactly, and one division by a power of ten
up to 10**22, exact too, rounds it correctly, as `float()` does. Everything else is decoded card by card through
`FieldSpec.decode`, which is the definition of what a field means; here is only its fast equal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from musatpy.formats.cards.spec import DATA_COLUMNS, CardSpec, FieldSpec
from musatpy.fortran import FieldError

ByteMatrix = NDArray[np.uint8]
Words = NDArray[np.uint64]
Mask = NDArray[np.bool_]
Column = NDArray[np.float64] | NDArray[np.str_]

MOST_DIGITS = 15  # 10**15 < 2**53: any such integer is exact in a float


def _each_byte(byte: int) -> int:
    return int.from_bytes(bytes([byte]) * 8, "little")


_BLANKS = _each_byte(ord(" "))
_ZEROS = _each_byte(ord("0"))
_MINUSES = _each_byte(ord("-") ^ ord(" "))  # a minus sign as it differs from a blank
_TOP_BITS = _each_byte(0x80)
_LOW_BITS = _each_byte(0x7F)


@dataclass(frozen=True, kw_only=True)
class BadField:
    """A field that does not decode: its row in the chunk of cards, and why."""

    row: int
    field: FieldSpec
    error: FieldError


def card_words(cards: ByteMatrix, column: int) -> Words:
    """Return the (k,) words of eight characters from `column` (1-based) on; `cards` is (k, 80), rows of any stride."""
    words: Words = cards[:, column - 1 : column + 7].view("<u8")[:, 0].astype(np.uint64)
    return words


def empty_column(field: FieldSpec, size: int) -> Column:
    """Return the (size,) array that holds the column of `field`, still to be filled."""
    return np.empty(size, dtype=np.float64 if field.edit.is_number else f"U{field.edit.width}")


def decode_column(field: FieldSpec, cards: ByteMatrix, column: Column) -> list[BadField]:
    """Decode one field of the (k, 80) `cards` into `column` (k,); return the fields that do not decode.

    These hold NaN or an empty text.
    """
    plain = _decode_plain(field, cards, column)
    bad = []
    for row in np.flatnonzero(~plain):
        text = cards[row, field.first - 1 : field.last].tobytes().decode("ascii")
        try:
            column[row] = field.decode(text)
        except FieldError as error:
            column[row] = np.nan if field.edit.is_number else ""
            bad.append(BadField(row=int(row), field=field, error=error))
    return bad


def _decode_plain(field: FieldSpec, cards: ByteMatrix, column: Column) -> Mask:
    """Decode the plain rows into `column` and return where they are."""
    edit = field.edit
    if edit.letter == "A":
        return _short_texts(field, cards, column) if edit.width <= 8 else _long_texts(field, cards, column)
    if edit.letter == "I" and edit.width <= MOST_DIGITS:
        plain = _plain_integers(field, cards, column)
    elif edit.letter == "F" and edit.width - 1 <= MOST_DIGITS and edit.decimals <= 8:
        plain = _plain_reals(field, cards, column)
    else:
        plain = np.zeros(len(cards), dtype=bool)
    if field.blank != "error" and not plain.all():
        plain |= _blank_numbers(field, cards, column, ~plain)
    return plain


# --- numbers ---------------------------------------------------------------------------------------------------------


def _plain_integers(field: FieldSpec, cards: ByteMatrix, column: Column) -> Mask:
    whole = _leading_part(cards, field.first, field.edit.width)
    column[:] = np.where(whole.negative, -whole.value, whole.value)
    return whole.plain & whole.ends_in_digit


def _plain_reals(field: FieldSpec, cards: ByteMatrix, column: Column) -> Mask:
    decimals = field.edit.decimals
    point = field.last - decimals
    plain: Mask = cards[:, point - 1] == ord(".")
    whole = _leading_part(cards, field.first, point - field.first)
    plain &= whole.plain
    value = whole.value
    if decimals:
        words = _right_aligned(card_words(cards, point + 1), decimals, _ZEROS)
        fraction = words ^ _ZEROS
        plain &= _nondigits(fraction) == 0
        value = (value * 10.0**decimals + _accumulate(fraction)) / 10.0**decimals
    else:
        plain &= whole.ends_in_digit
    column[:] = np.where(whole.negative, -value, value)
    return plain


@dataclass(frozen=True, kw_only=True)
class _Leading:
    """What stands before the point, row by row: blanks, a sign, digits. Any of them may be absent."""

    value: NDArray[np.float64]  # magnitude, integral
    negative: Mask
    plain: Mask  # False: something else stands there
    ends_in_digit: Mask


def _leading_part(cards: ByteMatrix, first: int, width: int) -> _Leading:
    """Return the part of a number that starts at column `first` and may start with blanks and a sign."""
    if width == 0:
        none = np.zeros(len(cards), dtype=bool)
        return _Leading(value=np.zeros(len(cards)), negative=none, plain=~none, ends_in_digit=none)
    if width <= 8:
        return _leading_word(_right_aligned(card_words(cards, first), width, _BLANKS))
    # Two words: either the high one is all blank, or the low one is all digits.
    high_words = _right_aligned(card_words(cards, first), width - 8, _BLANKS)
    high, low = _leading_word(high_words), _leading_word(card_words(cards, first + width - 8))
    all_digits = _nondigits(card_words(cards, first + width - 8) ^ _ZEROS) == 0
    return _Leading(
        value=high.value * 1e8 + low.value,
        negative=high.negative | low.negative,
        plain=high.plain & low.plain & (all_digits | (high_words == _BLANKS)),
        ends_in_digit=low.ends_in_digit,
    )


def _leading_word(words: Words) -> _Leading:
    digits = words ^ _ZEROS
    # 0xFF in each byte that is no digit. They are the leftmost characters, that is the lowest bytes, exactly when
    # this is 2**(8 k) - 1, so that adding one carries out of all of them.
    outside = (_nondigits(digits) >> 7) * 0xFF
    prefix = (outside & (outside + 1)) == 0
    last_outside = outside ^ (outside >> 8)  # 0xFF in the last byte of the prefix, the place of a sign
    unlike_blank = (words ^ _BLANKS) & outside
    negative = unlike_blank != 0
    plain = prefix & (~negative | (unlike_blank == (last_outside & _MINUSES)))
    return _Leading(
        value=_accumulate(digits & ~outside),
        negative=negative,
        plain=plain,
        ends_in_digit=(outside >> 56) == 0,
    )


def _right_aligned(words: Words, width: int, fill: int) -> Words:
    """Return the first `width` characters of words moved to the right end, `fill` before them."""
    if width == 8:
        return words
    return (words << (64 - 8 * width)) | (fill >> (8 * width))


def _nondigits(digits: Words) -> Words:
    """Return 0x80 in each byte above 9, of words already relative to the character zero."""
    # 9 + 0x76 is the largest sum that leaves the top bit free; the sum is of seven bits, so that none carries over.
    return (((digits & _LOW_BITS) + 0x7676767676767676) | digits) & _TOP_BITS


def _accumulate(digits: Words) -> NDArray[np.float64]:
    """Return the numbers that eight decimal digits, one in each byte, make: pairs, then fours, then all eight."""
    pairs = (digits * 10 + (digits >> 8)) & 0x00FF00FF00FF00FF
    fours = (pairs * 100 + (pairs >> 16)) & 0x0000FFFF0000FFFF
    eights = (fours * 10000 + (fours >> 32)) & 0xFFFFFFFF
    return eights.view(np.int64).astype(np.float64)


def _blank_numbers(field: FieldSpec, cards: ByteMatrix, column: Column, rows: Mask) -> Mask:
    """Fill in the fields among `rows` that are all blank, and return where they are."""
    blank: Mask = rows.copy()
    blank[rows] = (cards[rows, field.first - 1 : field.last] == ord(" ")).all(axis=1)
    column[blank] = 0.0 if field.blank == "zero" else np.nan
    return blank


# --- texts -----------------------------------------------------------------------------------------------------------


def _short_texts(field: FieldSpec, cards: ByteMatrix, column: Column) -> Mask:
    """Decode texts of up to eight characters, stripped at both ends."""
    width = field.edit.width
    words = card_words(cards, field.first)
    if width < 8:
        words = (words & ((1 << 8 * width) - 1)) | ((_BLANKS << 8 * width) & (2**64 - 1))
    words = _without_leading_blanks(words)
    unlike_blank = words ^ _BLANKS
    # Smear each character that is no blank over those to its left: what stays zero are the trailing blanks.
    kept = unlike_blank | (unlike_blank >> 8)
    kept |= kept >> 16
    kept |= kept >> 32
    words &= ((((kept & _LOW_BITS) + _LOW_BITS) | kept) & _TOP_BITS) // 0x80 * 0xFF
    letters = words.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :width]
    column[:] = letters.astype(np.uint32).view(f"U{width}")[:, 0]
    plain: Mask = words != 0
    if field.allowed:
        plain = np.isin(words, [_packed(text) for text in field.allowed])
    return plain | (words == 0) if field.blank == "missing" else plain


def _without_leading_blanks(words: Words) -> Words:
    """Return words moved to the left until their first character is no blank; all-blank words stay."""
    if not ((words & 0xFF) == ord(" ")).any():
        return words
    for count in (4, 2, 1):
        low = (1 << 8 * count) - 1
        moved = (words >> (8 * count)) | ((_BLANKS << 8 * (8 - count)) & (2**64 - 1))
        words = np.where((words & low) == (_BLANKS & low), moved, words)
    return words


def _packed(text: str) -> int:
    return int.from_bytes(text.encode("ascii"), "little")


def _long_texts(field: FieldSpec, cards: ByteMatrix, column: Column) -> Mask:
    letters = np.ascontiguousarray(cards[:, field.first - 1 : field.last])
    column[:] = np.char.strip(letters.view(f"S{field.edit.width}")[:, 0], b" ")
    plain: Mask = column != ""
    if field.allowed:
        plain = np.isin(column, field.allowed)
    return plain | (column == "") if field.blank == "missing" else plain


# --- columns of no field ---------------------------------------------------------------------------------------------


def stray_rows(spec: CardSpec, cards: ByteMatrix) -> Mask:
    """Return the rows (k,) of `cards` that have something in columns of no field, 4 to 72."""
    stray = np.zeros(len(cards), dtype=bool)
    for column, mask in _gap_words(spec):
        stray |= ((card_words(cards, column) ^ _BLANKS) & mask) != 0
    return stray


def gaps(spec: CardSpec) -> list[int]:
    """Return the columns from 4 to 72 in which the card has no field."""
    covered = {column for field in spec.fields for column in range(field.first, field.last + 1)}
    return [column for column in range(DATA_COLUMNS[0], DATA_COLUMNS[1] + 1) if column not in covered]


def _gap_words(spec: CardSpec) -> Iterator[tuple[int, int]]:
    """Yield (column, mask) of the words that cover the gaps of a card, 0xFF in the bytes of the gaps."""
    columns = gaps(spec)
    while columns:
        first = columns[0]
        inside = [column for column in columns if column < first + 8]
        yield first, sum(0xFF << 8 * (column - first) for column in inside)
        columns = columns[len(inside) :]
