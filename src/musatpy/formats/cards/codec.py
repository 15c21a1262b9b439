"""Card images -> columns of values: one field of many cards at a time, eight characters in one machine word.

A card image is a row of bytes of printable ASCII; eight neighbouring columns of a row are one little-endian 64-bit
word, whose lowest byte is the leftmost character. Arithmetic on words works on eight characters at once ("SIMD
within a register"), and numpy does it for a chunk of cards in each operation. A number is decoded so when it has
the plain form

    blanks, an optional minus sign, digits, a point exactly where the descriptor implies it, digits

with at most 15 digits: its digits are then an integer that a float holds exactly, and one division by a power of
ten, exact too up to 10**22, rounds it correctly, as `float()` does. Numbers with their point elsewhere go through
`float()` itself, a column at a time, and everything else card by card through `FieldSpec.decode`, which is the
definition of what a field means; here are only its fast equals. Of few cards, the definition is the faster.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.formats.cards.spec import DATA_COLUMNS, CardSpec, FieldSpec
from musatpy.fortran import FieldError

ByteMatrix = NDArray[np.uint8]
Words = NDArray[np.uint64]
Floats = FloatArray
Mask = BoolArray
Column = FloatArray | TextArray

MOST_DIGITS = 15  # 10**15 < 2**53: any such integer is exact in a float
FEW = 8  # values: operations of numpy on no more than these take longer than one value after the other


def _each_byte(byte: int | str) -> np.uint64:
    value = ord(byte) if isinstance(byte, str) else byte
    return np.uint64(int.from_bytes(bytes([value]) * 8, "little"))


_BLANKS = _each_byte(" ")
_ZEROS = _each_byte("0")
_MINUSES = _each_byte(ord("-") ^ ord(" "))  # a minus sign as it differs from a blank
_TOP_BITS = _each_byte(0x80)
_LOW_BITS = _each_byte(0x7F)
_ABOVE_NINE = _each_byte(0x80 - 10)  # added to a byte, sets its top bit when it is more than 9


def card_words(cards: ByteMatrix, column: int) -> Words:
    """Return the (k,) words of eight characters from `column` (1-based) on.

    `cards` is (k, 80), of rows at any distance from each other.
    """
    words: Words = cards[:, column - 1 : column + 7].view("<u8")[:, 0].astype(np.uint64)
    return words


def empty_column(field: FieldSpec, size: int) -> Column:
    """Return the (size,) array that holds the column of `field`, still to be filled."""
    return np.empty(size, dtype=np.float64 if field.edit.is_number else f"U{field.edit.width}")


def decode_column(field: FieldSpec, cards: ByteMatrix, column: Column) -> list[tuple[int, FieldError]]:
    """Decode one field of the (k, 80) `cards` into `column` (k,); return the rows that do not decode, and why.

    These hold NaN or an empty text.
    """
    if len(cards) <= FEW:
        plain = np.zeros(len(cards), dtype=bool)
    elif field.edit.letter == "A":
        plain = _decode_texts(field, cards, column)
    else:
        plain = _decode_numbers(field, cards, column)
    if plain.all():
        return []
    bad = []
    for row in np.flatnonzero(~plain).tolist():
        text = cards[row, field.first - 1 : field.last].tobytes().decode("ascii")
        try:
            column[row] = field.decode(text)
        except FieldError as error:
            column[row] = np.nan if field.edit.is_number else ""
            bad.append((row, error))
    return bad


# --- numbers ---


def _decode_numbers(field: FieldSpec, cards: ByteMatrix, column: Column) -> Mask:
    """Decode the plain and the allowed blank numbers into `column`, and return where they are."""
    edit = field.edit
    digits = edit.width - (edit.letter != "I")
    if edit.letter not in "IF" or digits > MOST_DIGITS or edit.decimals > 8:
        plain = np.zeros(len(cards), dtype=bool)
    elif digits <= 8:
        plain = _one_word(field, cards, column)
    else:
        plain = _several_words(field, cards, column)
    if not plain.all() and field.blank != "error":
        plain |= _blank_numbers(field, cards, column, ~plain)
    if not plain.all() and edit.letter != "I":
        plain |= _pointed_numbers(field, cards, column, ~plain)
    return plain


def _one_word(field: FieldSpec, cards: ByteMatrix, column: Column) -> Mask:
    """Decode numbers of up to eight digits, their point taken out: the digits of both sides stand in one word."""
    decimals, point = field.edit.decimals, _point_column(field)
    whole = point - field.first
    words = np.full(len(cards), _BLANKS >> _bits(whole + decimals) if whole + decimals < 8 else 0, dtype=np.uint64)
    if whole:
        words |= card_words(cards, field.first) << _bits(8 - whole) >> _bits(decimals)
    if decimals:
        words |= card_words(cards, point + 1) << _bits(8 - decimals)
    number = _leading_word(words)
    plain: Mask = number.plain & (number.outside >> _bits(8 - max(decimals, 1)) == 0)
    if field.edit.letter == "F":
        plain &= cards[:, point - 1] == ord(".")
    _store(number.value / 10.0**decimals if decimals else number.value, number.negative, column)
    return plain


def _several_words(field: FieldSpec, cards: ByteMatrix, column: Column) -> Mask:
    """Decode numbers of nine to fifteen digits: what stands before the point, then what stands after it."""
    decimals, point = field.edit.decimals, _point_column(field)
    whole = _leading_part(cards, field.first, point - field.first)
    plain, value = whole.plain, whole.value
    if decimals:
        digits = _right_aligned(card_words(cards, point + 1), decimals, _ZEROS) ^ _ZEROS
        plain &= _nondigits(digits) == 0
        value *= 10.0**decimals
        value += _accumulate(digits)
        value /= 10.0**decimals
    else:
        plain &= whole.outside >> _bits(7) == 0
    if field.edit.letter == "F":
        plain &= cards[:, point - 1] == ord(".")
    _store(value, whole.negative, column)
    return plain


def _point_column(field: FieldSpec) -> int:
    """Return the column (1-based) of the point of `Fw.d`; of `Iw`, the column after the field."""
    return field.last + (field.edit.letter == "I") - field.edit.decimals


def _store(magnitude: Floats, negative: Mask, column: Column) -> None:
    column[:] = np.where(negative, -magnitude, magnitude)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Leading:
    """A number that may start with blanks and a minus sign, row by row; even without any digit."""

    value: Floats  # magnitude, integral
    negative: Mask
    plain: Mask  # False: something else stands there
    outside: Words  # of its last eight characters, 0xFF in the bytes that are no digits


def _leading_part(cards: ByteMatrix, first: int, width: int) -> _Leading:
    """Return the number in `width` columns from `first` on."""
    if width <= 8:
        return _leading_word(_right_aligned(card_words(cards, first), width, _BLANKS))
    # Two words: either the high one is all blank, or the low one is all digits.
    high_words = _right_aligned(card_words(cards, first), width - 8, _BLANKS)
    high, low = _leading_word(high_words), _leading_word(card_words(cards, first + width - 8))
    return _Leading(
        value=high.value * 1e8 + low.value,
        negative=high.negative | low.negative,
        plain=high.plain & low.plain & ((low.outside == 0) | (high_words == _BLANKS)),
        outside=low.outside,
    )


def _leading_word(words: Words) -> _Leading:
    digits = words ^ _ZEROS
    # 0xFF in each byte that is no digit. They are the leftmost characters, that is the lowest bytes, exactly when
    # this is 2**(8 k) - 1, so that adding one carries out of all of them.
    outside = (_nondigits(digits) >> np.uint64(7)) * np.uint64(0xFF)
    prefix = (outside & (outside + np.uint64(1))) == 0
    last_outside = outside ^ (outside >> np.uint64(8))  # 0xFF in the last byte of the prefix, the place of a sign
    unlike_blank = (words ^ _BLANKS) & outside
    negative = unlike_blank != 0
    plain = prefix & (~negative | (unlike_blank == (last_outside & _MINUSES)))
    return _Leading(value=_accumulate(digits & ~outside), negative=negative, plain=plain, outside=outside)


def _bits(characters: int) -> np.uint64:
    return np.uint64(8 * characters)


def _right_aligned(words: Words, width: int, fill: np.uint64) -> Words:
    """Return the first `width` characters of words moved to the right end, `fill` before them."""
    if width == 8:
        return words
    aligned: Words = (words << _bits(8 - width)) | (fill >> _bits(width))
    return aligned


def _nondigits(digits: Words) -> Words:
    """Return 0x80 in each byte above 9, of ASCII words already relative to the character zero."""
    above: Words = (digits + _ABOVE_NINE) & _TOP_BITS
    return above


def _accumulate(digits: Words) -> Floats:
    """Return the numbers that eight decimal digits, one in each byte, make: pairs, then fours, then all eight.

    Each product adds every second part, times its weight, to the part on its right, and the shift brings it down.
    """
    pairs = (digits * np.uint64(10 << 8 | 1)) >> np.uint64(8) & np.uint64(0x00FF00FF00FF00FF)
    fours = (pairs * np.uint64(100 << 16 | 1)) >> np.uint64(16) & np.uint64(0x0000FFFF0000FFFF)
    eights = (fours * np.uint64(10000 << 32 | 1)) >> np.uint64(32)
    return eights.view(np.int64).astype(np.float64)


def _blank_numbers(field: FieldSpec, cards: ByteMatrix, column: Column, rows: Mask) -> Mask:
    """Fill in the fields among `rows` that are all blank, and return where they are."""
    blank = rows.copy()
    blank[rows] = (cards[rows, field.first - 1 : field.last] == ord(" ")).all(axis=1)
    column[blank] = 0.0 if field.blank == "zero" else np.nan
    return blank


def _pointed_numbers(field: FieldSpec, cards: ByteMatrix, column: Column, rows: Mask) -> Mask:
    """Decode the fields among `rows` with a point anywhere, and return where they are.

    These are blanks, an optional sign, digits with one point, and blanks: Python and FORTRAN read them alike.
    """
    letters = cards[rows, field.first - 1 : field.last]
    digits = letters - np.uint8(ord("0")) <= 9
    points = letters == ord(".")
    full = letters != ord(" ")
    starts = full.copy()  # the leftmost character of each run of characters
    starts[:, 1:] &= ~full[:, :-1]
    signs = ((letters == ord("-")) | (letters == ord("+"))) & starts
    pointed: Mask = (digits | points | signs | ~full).all(axis=1) & digits.any(axis=1)
    pointed &= (points.sum(axis=1) == 1) & (starts.sum(axis=1) == 1)
    places = np.flatnonzero(rows)[pointed]
    column[places] = np.ascontiguousarray(letters[pointed]).view(f"S{field.edit.width}")[:, 0].astype(np.float64)
    pointed_rows = np.zeros_like(rows)
    pointed_rows[places] = True
    return pointed_rows


# --- texts ---


def _decode_texts(field: FieldSpec, cards: ByteMatrix, column: Column) -> Mask:
    """Decode texts, without outer blanks, into `column`, and return where they are allowed."""
    width = field.edit.width
    letters = _short_texts(field, cards) if width <= 8 else _long_texts(field, cards)
    # A text of numpy is a row of 32-bit characters, ended by zeros.
    column.view(np.uint32).reshape(-1, width)[:] = letters
    full = letters[:, 0] != 0
    plain: Mask = full
    if field.allowed:
        plain = np.zeros_like(full)
        for text in field.allowed:
            plain |= column == text
    return plain | ~full if field.blank == "missing" else plain


def _short_texts(field: FieldSpec, cards: ByteMatrix) -> ByteMatrix:
    """Return the texts of up to eight characters, moved to the left, zeros in place of trailing blanks."""
    width = field.edit.width
    if width == 1:
        letters = cards[:, field.first - 1 : field.last].copy()
        letters[letters == ord(" ")] = 0
        return letters
    words = card_words(cards, field.first)
    if width < 8:
        words = (words << _bits(8 - width) >> _bits(8 - width)) | (_BLANKS >> _bits(width) << _bits(width))
    words = _without_leading_blanks(words)
    # Smear each character that is no blank over those to its left: what stays zero are the trailing blanks.
    kept = words ^ _BLANKS
    for characters in (1, 2, 4):
        kept |= kept >> _bits(characters)
    words &= ((kept + _LOW_BITS & _TOP_BITS) >> np.uint64(7)) * np.uint64(0xFF)
    return words.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :width]


def _without_leading_blanks(words: Words) -> Words:
    """Return words moved to the left until their first character is no blank; all-blank words stay."""
    if not (((words & np.uint64(0xFF)) == ord(" ")) & (words != _BLANKS)).any():
        return words
    for count in (4, 2, 1):
        low = _BLANKS >> _bits(8 - count)
        moved = (words >> _bits(count)) | (_BLANKS ^ (_BLANKS >> _bits(count)))
        words = np.where((words << _bits(8 - count) >> _bits(8 - count)) == low, moved, words)
    return words


def _long_texts(field: FieldSpec, cards: ByteMatrix) -> ByteMatrix:
    """Return the texts of any length, moved to the left, zeros in place of trailing blanks."""
    width = field.edit.width
    texts = np.ascontiguousarray(cards[:, field.first - 1 : field.last]).view(f"S{width}")[:, 0]
    stripped = np.char.strip(texts, b" ").astype(f"S{width}")
    return stripped.view(np.uint8).reshape(-1, width)


# --- columns of no field ---


def stray_rows(spec: CardSpec, cards: ByteMatrix) -> Mask:
    """Return the rows (k,) of `cards` that have something in columns of no field, 4 to 72."""
    stray = np.zeros(len(cards), dtype=np.uint64)
    for column, mask in _gap_words(spec):
        stray |= (card_words(cards, column) ^ _BLANKS) & mask
    rows: Mask = stray != 0
    return rows


def gaps(spec: CardSpec) -> list[tuple[int, int]]:
    """Return the runs of columns (first, last) from 4 to 72 in which the card has no field."""
    runs = []
    first, end = DATA_COLUMNS
    for field in sorted(spec.fields, key=lambda field: field.first):
        runs.append((first, field.first - 1))
        first = field.last + 1
    return [(first, last) for first, last in [*runs, (first, end)] if first <= last]


def _gap_words(spec: CardSpec) -> Iterator[tuple[int, np.uint64]]:
    """Yield (column, mask) of the words that cover the gaps of a card, 0xFF in the bytes of the gaps."""
    columns = [column for first, last in gaps(spec) for column in range(first, last + 1)]
    while columns:
        first = columns[0]
        inside = [column for column in columns if column < first + 8]
        yield first, np.uint64(sum(0xFF << 8 * (column - first) for column in inside))
        columns = columns[len(inside) :]
