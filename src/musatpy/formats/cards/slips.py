"""What is wrong with many lines alike, told once: a file that is no deck, and slips that all of a card has.

These are columns moved, commas for points, letters for digits, and decimal degrees.
"""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Iterator
from itertools import product

import numpy as np

from musatpy.arrays import BoolArray, ByteArray
from musatpy.formats.cards.spec import CARD_WIDTH, DATA_COLUMNS, CardSpec, Family, FieldSpec

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
_LOOKED_AT = 100  # lines
_FEWEST = 10  # lines without a card that make a file no deck; of fewer each is told
_BINARY = (  # how files begin, and what they are
    (codecs.BOM_UTF16_LE, "text in UTF-16: save it as plain text (ASCII, or UTF-8)"),
    (codecs.BOM_UTF16_BE, "text in UTF-16: save it as plain text (ASCII, or UTF-8)"),
    (b"LASF", "a cloud of points (LAS): musat correct takes it"),
    (b"PK\x03\x04", "an archive or an office document: save the cards as plain text"),
    (b"%PDF", "a document (PDF)"),
    (b"\x89PNG", "a picture (PNG)"),
    (b"\xff\xd8\xff", "a picture (JPEG)"),
    (b"II*\x00", "a picture or a raster (TIFF)"),
    (b"MM\x00*", "a picture or a raster (TIFF)"),
    (b"SQLite format 3", "a database, such as a GeoPackage"),
)
_SURVEY = ("ANG", "DIR", "HDIR", "HOR", "VDIR", "ZEN", "AZI", "AZM", "BRG", "BEAR", "TACH", "THEO", "TRAV")


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


def of_survey(line: str) -> str:
    """Return what to do with a line of terrestrial survey, by how it begins; nothing for any other."""
    if not line.upper().startswith(_SURVEY):
        return ""
    return (
        "; angles, directions and coordinates of terrestrial survey are not adjusted here: adjust them first, and "
        "give the points with their covariances (CTG or CTX, and CTC)"
    )


def foreign(data: bytes, family: Family) -> str:
    """Return what the bytes of a file are that is no deck of a family; nothing for a deck, and for a few lines."""
    start = data.lstrip()[:4096]
    for magic, name in _BINARY:
        if data.startswith(magic):
            return name
    if start.count(b"\x00") > len(start) // 10:
        return "no text: many of its characters are zero"
    if b"\r" in data and b"\n" not in data:
        return "text whose lines end with CR alone: save it with line ends LF or CR LF"
    if start.startswith(b"{"):
        return "a record (JSON), not the deck of its run: musat report prints it" if b"musat" in start else "JSON"
    if start.removeprefix(b"1").startswith(b"MUSATPY "):
        return "a listing, not the deck of its run"
    lines = [line.decode("latin-1") for line in data.split(b"\n", _LOOKED_AT)[:_LOOKED_AT] if line.strip()]
    mnemonics = {line[:3] for line in lines}
    if len(lines) < _FEWEST or mnemonics & family.cards.keys():
        return ""
    if {mnemonic.upper() for mnemonic in mnemonics} & family.cards.keys():
        return "a deck in small letters: cards are in capitals"
    survey = next((what for line in lines if (what := of_survey(line))), "")
    return (
        f"no deck: none of its first {len(lines)} lines begins with a card; files of other agencies go through "
        f"musat convert; the first line is '{lines[0][:40].strip()}'{survey}"
    )
