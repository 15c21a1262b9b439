"""A file as card images: lines found and padded, and every character that is no card character reported."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from musatpy.formats.cards.spec import CARD_WIDTH

ByteArray = NDArray[np.uint8]
IntArray = NDArray[np.int64]

_LF, _CR, _TAB = b"\n\r\t"
_BLOCK = 1 << 18  # bytes looked at in one go: temporaries stay in the cache
_SUBSTITUTE = ord("?")  # in place of characters that no card has


@dataclass(frozen=True, kw_only=True)
class BadCharacter:
    """A byte that no card may hold: a tab, another control character, or one outside ASCII."""

    line: int  # 1-based
    column: int  # 1-based
    byte: int

    def describe(self) -> str:
        """Return what the byte is, in words."""
        if self.byte == _TAB:
            return "tab character"
        return f"{'control' if self.byte < 128 else 'non-ASCII'} character (byte {self.byte:#04x})"


@dataclass(frozen=True, kw_only=True)
class CardImages:
    """The lines of a file, each readable as a card of 80 columns.

    Lines end with LF or CR LF. Where all are equally long and have 80 columns, card images are views of the file;
    else they are copies, cut or filled with blanks.
    """

    data: bytes  # the file, its last line ended, characters that no card has replaced
    count: int  # lines
    stride: int  # bytes from line to line; 0 where they differ or are shorter than a card
    bad_characters: tuple[BadCharacter, ...]

    @cached_property
    def _bytes(self) -> ByteArray:
        return np.frombuffer(self.data, dtype=np.uint8)

    @cached_property
    def _starts(self) -> IntArray:
        """(count + 1,) first byte of each line, and of the line after the last."""
        if self.stride:
            return np.arange(self.count + 1) * self.stride
        starts = np.zeros(self.count + 1, dtype=np.int64)
        starts[1:] = np.flatnonzero(self._bytes == _LF) + 1
        return starts

    def _ends(self, lines: IntArray) -> IntArray:
        """Return the byte after the last character of lines (0-based), its line end left out."""
        ends = self._starts[lines + 1] - 1
        before = self._bytes[np.maximum(ends - 1, 0)]
        return ends - ((before == _CR) & (ends > self._starts[lines]))

    def cards(self, lines: IntArray) -> ByteArray:
        """Return the (k, 80) card images of `lines` (k,), 0-based and ascending."""
        if self.stride:
            matrix = self._bytes.reshape(self.count, self.stride)[:, :CARD_WIDTH]
            if lines.size and lines[-1] - lines[0] == lines.size - 1:
                return matrix[lines[0] : lines[-1] + 1]
            return matrix[lines]
        columns = np.arange(CARD_WIDTH)
        starts = self._starts[lines]
        images = self._bytes.take(starts[:, None] + columns, mode="clip")
        images[columns >= (self._ends(lines) - starts)[:, None]] = ord(" ")
        return images

    def overlong(self) -> Iterator[tuple[int, int]]:
        """Yield (line, last column) of the lines, 1-based, that have characters other than blanks beyond column 80."""
        if self.stride and self.stride <= CARD_WIDTH + 2:
            return
        lines = np.arange(self.count)
        for line in np.flatnonzero(self._ends(lines) - self._starts[:-1] > CARD_WIDTH):
            length = len(self.text(int(line) + 1))
            if length > CARD_WIDTH:
                yield int(line) + 1, length

    def text(self, line: int) -> str:
        """Return line `line` (1-based) as text, without trailing blanks."""
        if not 1 <= line <= self.count:
            raise IndexError(f"line {line} of {self.count}")
        start, stop = (line - 1) * self.stride, line * self.stride
        if not self.stride:
            start, stop = (int(edge) for edge in self._starts[line - 1 : line + 1])
        return self.data[start:stop].decode("ascii").rstrip("\r\n ")


def card_images(data: bytes) -> CardImages:
    """Return the card images of the bytes of a file."""
    if data and not data.endswith(b"\n"):
        data += b"\r\n" if b"\r\n" in data else b"\n"
    bad = _bad_bytes(data)
    characters: tuple[BadCharacter, ...] = ()
    if bad.size:
        characters = tuple(_locate(data, bad))
        mended = np.frombuffer(data, dtype=np.uint8).copy()
        mended[bad] = _SUBSTITUTE
        data = mended.tobytes()
    count = data.count(b"\n")
    return CardImages(data=data, count=count, stride=_stride(data, count), bad_characters=characters)


def _stride(data: bytes, count: int) -> int:
    """Return the length of the lines with their ends where all are equal and a card wide or wider, else 0."""
    stride = data.find(b"\n") + 1
    returns = data.count(b"\r")  # each is part of a line end: others have been replaced
    equal = len(data) == stride * count and returns in (0, count) and stride > CARD_WIDTH + bool(returns)
    if equal and bool((np.frombuffer(data, dtype=np.uint8)[stride - 1 :: stride] == _LF).all()):
        return stride
    return 0


def _bad_bytes(data: bytes) -> IntArray:
    """Return the places of the bytes that are neither printable ASCII nor part of a line end."""
    every = np.frombuffer(data, dtype=np.uint8)
    blocks = [every[start : start + _BLOCK] for start in range(0, len(data), _BLOCK)]
    # Unsigned differences wrap: one comparison finds what is below the blank and what is above the tilde.
    unprintable = sum(int(np.count_nonzero(block - np.uint8(32) > 94)) for block in blocks)
    ends = data.count(b"\n")
    returns = data.count(b"\r")
    if unprintable == ends + returns and (not returns or data.count(b"\r\n") == returns):
        return np.zeros(0, dtype=np.int64)
    places = np.flatnonzero(every - np.uint8(32) > 94)
    found, after = every[places], every[np.minimum(places + 1, len(data) - 1)]
    line_end = (found == _LF) | ((found == _CR) & (after == _LF))
    return places[~line_end]


def _locate(data: bytes, places: IntArray) -> Iterator[BadCharacter]:
    ends = np.flatnonzero(np.frombuffer(data, dtype=np.uint8) == _LF)
    for place, line in zip(places.tolist(), np.searchsorted(ends, places).tolist(), strict=True):
        start = int(ends[line - 1]) + 1 if line else 0
        yield BadCharacter(line=line + 1, column=place - start + 1, byte=data[place])
