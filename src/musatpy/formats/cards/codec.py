"""Card images <-> columns of values: one field of many cards at a time; bytes of decks <-> text.

`FieldSpec.decode` is the definition of what a field means. What most cards have, a text, or a number of up to 15
digits with or without its point, is read by numpy: such digits are an integer that a float holds exactly, and one
division by a power of ten, exact too up to 10**22, rounds it correctly, as `float()` does. Everything else, and
what stands on few cards, goes through the definition, card by card. So it is with `FieldSpec.encode`: numbers that
fit with all decimals are written in one go, and each of the different texts once.
"""

from __future__ import annotations

import codecs
from collections.abc import Iterator, Mapping

import numpy as np

from musatpy.arrays import BoolArray, ByteArray, FloatArray, IntArray, TextArray
from musatpy.errors import Problem
from musatpy.formats.cards.spec import CARD_WIDTH, DATA_COLUMNS, CardSpec, FieldSpec
from musatpy.fortran import FieldError

Column = FloatArray | TextArray

FEW = 8  # values: operations of numpy on no more than these take longer than one value after the other
_UTF_8, _MARKED, LATIN_1 = "utf-8", "utf-8-sig", "latin-1"
_CHUNK = 8192  # cards encoded in one go
_BLANK = ord(" ")
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


def strays(spec: CardSpec, cards: ByteArray) -> Iterator[tuple[int, int, str]]:
    """Yield row, first column and text of what stands on `cards` (k, 80) in columns of no field, 4 to 72."""
    fields = sorted(spec.fields, key=lambda field: field.first)
    starts = [DATA_COLUMNS[0], *(field.last + 1 for field in fields)]
    ends = [*(field.first - 1 for field in fields), DATA_COLUMNS[1]]
    for first, last in ((first, last) for first, last in zip(starts, ends, strict=True) if first <= last):
        letters = cards[:, first - 1 : last]
        for row in np.flatnonzero((letters != _BLANK).any(axis=1)).tolist():
            text = letters[row].tobytes().decode("ascii")
            yield row, last + 1 - len(text.lstrip()), text.strip()


# --- writing ---


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
    digits = CARD_WIDTH - DATA_COLUMNS[1]
    for start in range(0, count, _CHUNK):
        chunk = cards[start : start + _CHUNK]
        numbers = np.arange(number + start, number + start + len(chunk))
        chunk[:, DATA_COLUMNS[1] : CARD_WIDTH] = _printed(f"%0{digits}d", digits, numbers % 10**digits)
        for field in spec.fields:
            values = columns[field.name][start : start + _CHUNK]
            for row, error in _encode_column(field, values, chunk[:, field.first - 1 : field.last]):
                message = f"card {numbers[row]}: '{error.found}' is not {error.expected}"
                problems.append(field.problem(error, message, card=spec.mnemonic))
    data = cards.tobytes()
    for field in (field for field in spec.fields if field.letters):
        for row, value in enumerate(columns[field.name].tolist()):
            if not value.isascii() and len(value) <= field.edit.width:
                lines = data.decode().split("\n")
                lines[row] = f"{lines[row][: field.first - 1]}{value:<{field.edit.width}}{lines[row][field.last :]}"
                data = "\n".join(lines).encode()
    return data, problems


def _encode_column(field: FieldSpec, values: Column, target: ByteArray) -> Iterator[tuple[int, FieldError]]:
    """Write values (k,) into their columns (k, w); yield the rows that cannot be written, and why."""
    written = np.zeros(len(values), dtype=bool)
    if len(values) > FEW and field.edit.letter in "IF":
        written = _encode_numbers(field, values.astype(np.float64, copy=False), target)
    rest = np.flatnonzero(~written)
    different, which = values[rest], np.arange(len(rest))  # minus zero is another number than zero
    if not field.edit.is_number:
        different, which = np.unique(different.astype(np.str_), return_inverse=True)
    texts: list[str] = []
    errors: dict[int, FieldError] = {}
    for place, value in enumerate(different.tolist()):
        try:
            texts.append(field.encode(value))
        except FieldError as error:
            texts.append(" " * field.edit.width)
            errors[place] = error
    target[rest] = _characters("".join(texts), field.edit.width)[which]
    for row in np.flatnonzero(np.isin(which, list(errors))).tolist():
        yield int(rest[row]), errors[int(which[row])]


def _encode_numbers(field: FieldSpec, values: FloatArray, target: ByteArray) -> BoolArray:
    """Write the numbers (k,) that fit with all decimals of their field, and return where they are."""
    edit = field.edit
    negative = np.signbit(values) & ((values != 0.0) | (edit.letter == "I"))  # minus zero degrees keep their sign
    whole = edit.width - negative - (edit.decimals + 1 if edit.letter == "F" else 0)
    size = np.abs(values)
    plain: BoolArray = size < 10.0**whole - 1.0  # not NaN, nor what rounding makes longer
    if edit.letter == "I":
        plain &= size == np.rint(size)
    else:
        plain &= (size == 0.0) | (size > 10.0**-edit.decimals)  # a number that would print as zero is not lost
    if field.is_sigma:
        with np.errstate(over="ignore", invalid="ignore"):  # those that the decimals do not tell in full
            plain &= np.abs(np.round(values, edit.decimals) - values) <= 1e-12 * size
    form = f"%{'#' * (edit.letter == 'F')}{edit.width}.{edit.decimals}f"
    target[plain] = _printed(form, edit.width, np.where(negative, values, size)[plain])
    if field.blank == "missing":
        plain |= np.isnan(values)
    return plain


def _printed(form: str, width: int, values: FloatArray | IntArray) -> ByteArray:
    """Return the characters (k, width) of numbers, each as wide as the format."""
    return _characters((form * len(values)) % tuple(values.tolist()), width)


def _characters(text: str, width: int) -> ByteArray:
    return np.frombuffer(text.encode("ascii", "replace"), dtype=np.uint8).reshape(-1, width)


def text_of(data: bytes) -> tuple[str, str]:
    """Return the text of the bytes of a deck without byte order mark, and its encoding: UTF-8, else Latin-1."""
    encoding = _MARKED if data.startswith(codecs.BOM_UTF8) else _UTF_8
    try:
        return data.decode(encoding), encoding
    except UnicodeDecodeError:
        return data.decode(LATIN_1), LATIN_1


def bytes_of(text: str, encoding: str) -> bytes:
    """Return the bytes of a text in an encoding; in UTF-8 where that lacks one of the letters."""
    try:
        return text.encode(encoding)
    except UnicodeEncodeError:
        return text.encode(_UTF_8)
