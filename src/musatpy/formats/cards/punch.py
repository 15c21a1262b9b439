"""Columns of values -> card images: one field of many cards at a time.

Numbers are written by integer arithmetic where the result is certain, and else, like all columns of few values,
value by value through `FieldSpec.encode`, which is the definition.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from musatpy.arrays import BoolArray, ByteArray, FloatArray, IntArray, TextArray
from musatpy.errors import Problem
from musatpy.formats.cards.codec import FEW, Column
from musatpy.formats.cards.spec import CARD_WIDTH, DATA_COLUMNS, CardSpec, FieldSpec
from musatpy.fortran import FieldError

_CHUNK = 8192  # cards encoded in one go
_BLANK, _MINUS, _POINT, _ZERO = b" -.0"
_LARGEST = 2.0**52  # from here on, ties between two integers are no floats
_SEQUENCE_DIGITS = CARD_WIDTH - DATA_COLUMNS[1]


def encode_cards(
    spec: CardSpec, columns: Mapping[str, Column], count: int, number: int
) -> tuple[bytes, list[Problem]]:
    """Return `count` cards of `spec`, numbered from `number`, with line ends, and a problem of each value left out.

    Raises `ValueError` where the columns are not those of the card, or not of one length.
    """
    names = {field.name for field in spec.fields}
    if set(columns) != names or any(np.shape(column) != (count,) for column in columns.values()):
        raise ValueError(f"{spec.mnemonic}: wants columns {sorted(names)}, each of {count} values")
    cards = np.full((count, CARD_WIDTH + 1), _BLANK, dtype=np.uint8)
    cards[:, -1] = ord("\n")
    cards[:, : len(spec.mnemonic)] = list(spec.mnemonic.encode("ascii"))
    problems = []
    for start in range(0, count, _CHUNK):
        chunk = cards[start : start + _CHUNK]
        numbers = np.arange(number + start, number + start + len(chunk))
        _write_digits(numbers % 10**_SEQUENCE_DIGITS, chunk[:, DATA_COLUMNS[1] : CARD_WIDTH])
        for field in spec.fields:
            values = columns[field.name][start : start + _CHUNK]
            for row, error in _encode_column(field, values, chunk):
                message = f"card {numbers[row]}: '{error.found}' is not {error.expected}"
                problems.append(field.problem(error, message, card=spec.mnemonic))
    return cards.tobytes(), problems


def _encode_column(field: FieldSpec, values: Column, cards: ByteArray) -> Iterator[tuple[int, FieldError]]:
    """Write one field of the cards (k, 81); yield the rows that cannot be written, and why."""
    target = cards[:, field.first - 1 : field.last]
    if field.edit.letter == "A" and len(values) > FEW:
        written = _write_texts(field, values.astype(np.str_, copy=False), target)
    elif field.edit.letter in "IF" and len(values) > FEW:
        numbers = values.astype(np.float64, copy=False)
        written = _write_numbers(field, numbers, target)
        if field.is_sigma:
            written &= ~_shortened(field, numbers)
    else:
        written = np.zeros(len(values), dtype=bool)
    for row in np.flatnonzero(~written).tolist():
        try:
            target[row] = list(field.encode(values[row].item()).encode("ascii"))
        except FieldError as error:
            target[row] = _BLANK
            yield row, error


def _write_digits(numbers: IntArray, target: ByteArray) -> None:
    """Write non-negative `numbers` (k,) into `target` (k, w), with leading zeros."""
    for column in range(target.shape[1] - 1, -1, -1):
        rest = numbers // 10
        target[:, column] = numbers - rest * 10 + _ZERO
        numbers = rest


def _write_texts(field: FieldSpec, values: TextArray, target: ByteArray) -> BoolArray:
    """Write the texts that are plain, and return where they are."""
    width = field.edit.width
    letters = np.ascontiguousarray(values.astype(f"U{width}")).view(np.uint32).reshape(len(values), width)
    inside = np.arange(width) < np.char.str_len(values)[:, None]
    # Of characters above the blank only: outer blanks, and what is not ASCII, are left to the definition.
    plain = ((letters > _BLANK) & (letters < 127)) | ~inside
    written: BoolArray = plain.all(axis=1) & (np.char.str_len(values) <= width)
    if field.allowed:
        written &= np.isin(values, ["", *field.allowed])
    if field.blank == "error":
        written &= values != ""
    target[:] = np.where(inside, letters, _BLANK)
    return written


def _write_numbers(field: FieldSpec, values: FloatArray, target: ByteArray) -> BoolArray:
    """Write the numbers whose rounding is certain and that fit with all decimals, and return where they are."""
    decimals, width = field.edit.decimals, field.edit.width
    # Ties between two integers are floats, and the rounding of the product is monotonic: it may put a value on a
    # tie, never beyond it. Off the ties the product rounds as the exact value does. NaN and infinity compare false.
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = np.abs(values) * 10.0**decimals
        certain = (scaled - np.floor(scaled) != 0.5) & (scaled < _LARGEST)
    ticks = np.rint(np.where(certain, scaled, 0.0)).astype(np.int64)
    if field.edit.letter == "I":
        certain &= scaled == ticks
        negative = np.signbit(values)  # minus zero degrees keep their sign
        whole_width = width
    else:
        certain &= (ticks > 0) | (values == 0.0)  # a number that would print as zero is not lost
        negative = (values < 0) & (ticks > 0)
        whole_width = width - decimals - 1
        whole = ticks // 10**decimals
        _write_digits(ticks - whole * 10**decimals, target[:, whole_width + 1 :])
        target[:, whole_width] = _POINT
        ticks = whole
    written: BoolArray = certain & _write_whole(ticks, negative, target[:, :whole_width])
    if field.blank == "missing":
        missing = np.isnan(values)
        target[missing] = _BLANK
        written |= missing
    return written


def _shortened(field: FieldSpec, values: FloatArray) -> BoolArray:
    """Return the numbers (k,) of which the decimals of a field do not tell twelve digits."""
    with np.errstate(over="ignore", invalid="ignore"):
        told = np.round(values, field.edit.decimals)
        return np.asarray(np.abs(told - values) > 1e-12 * np.abs(values))


def _write_whole(numbers: IntArray, negative: BoolArray, target: ByteArray) -> BoolArray:
    """Write what stands before the point: blanks, sign, digits; return the rows in which it fits."""
    width = target.shape[1]
    digits = np.ones(len(numbers), dtype=np.int64)
    for power in range(1, min(width + 1, 19)):
        digits += numbers >= 10**power
    _write_digits(numbers, target)
    places = np.arange(width, 0, -1)  # of digits, from the right
    target[places > digits[:, None]] = _BLANK
    target[(places == digits[:, None] + 1) & negative[:, None]] = _MINUS
    fits: BoolArray = digits + negative <= width
    return fits
