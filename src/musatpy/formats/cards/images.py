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
    stride: int  # bytes from line to line; 0 where lines differ or are shorter than a card
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
        stops: IntArray = ends - ((before == _CR) & (ends > self._starts[lines]))
        return stops

    def cards(self, lines: IntArray) -> ByteArray:
        """Return the (k, 80) card images of `lines` (k,), 0-based and ascending."""
        if self.stride:
            matrix = self._bytes.reshape(self.count, self.stride)[:, :CARD_WIDTH]
            if lines.size and lines[-1] - lines[0] == lines.size - 1:
                return matrix[lines[0] : lines[-1] + 1]
            return matrix[lines]
        starts = self._starts[lines]
        images = self._from(starts)
        lengths = self._ends(lines) - starts
        for column in range(int(lengths.min(initial=CARD_WIDTH)), CARD_WIDTH):
            images[lengths <= column, column] = ord(" ")
        return images

    def _from(self, starts: IntArray) -> ByteArray:
        """Return the (k, 80) bytes of the file from `starts` (k,) on; beyond its end, whatever."""
        columns = np.arange(CARD_WIDTH)
        inside = int(np.searchsorted(starts, len(self.data) - CARD_WIDTH, side="right"))
        images = np.empty((len(starts), CARD_WIDTH), dtype=np.uint8)
        words = images.view("<u8")
        every_word = np.ndarray(max(len(self.data) - 7, 0), dtype="<u8", buffer=self.data, strides=(1,))
        for word in range(CARD_WIDTH // 8):
            words[:inside, word] = every_word[starts[:inside] + 8 * word]
        images[inside:] = self._bytes.take(starts[inside:, None] + columns, mode="clip")
        return images

    def overlong(self) -> Iterator[tuple[int, int]]:
        """Yield (line, last column), 1-based, of the lines that go on beyond column 80 with more than blanks."""
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
    every = np.frombuffer(data, dtype=np.uint8)
    stride, line_end = _stride(data)
    unprintable = sum(
        int(np.count_nonzero(_is_unprintable(every[start : start + _BLOCK])))
        for start in range(0, len(data), _BLOCK)
    )
    if stride and unprintable == len(data) // stride * line_end:
        return CardImages(data=data, count=len(data) // stride, stride=stride, bad_characters=())
    return _uneven_images(data, unprintable)


def _uneven_images(data: bytes, unprintable: int) -> CardImages:
    """Return the images of a file of which all that is known is how many bytes are not printable."""
    characters: tuple[BadCharacter, ...] = ()
    count, returns = data.count(b"\n"), data.count(b"\r")
    if unprintable != count + returns or (returns and data.count(b"\r\n") != returns):
        bad = _bad_bytes(np.frombuffer(data, dtype=np.uint8))
        characters = tuple(_locate(data, bad))
        mended = np.frombuffer(data, dtype=np.uint8).copy()
        mended[bad] = _SUBSTITUTE
        data = mended.tobytes()
    return CardImages(data=data, count=count, stride=0, bad_characters=characters)


def _stride(data: bytes) -> tuple[int, int]:
    """Return the length of the lines and that of their ends where all are alike and a card wide; else zeros."""
    stride = data.find(b"\n") + 1
    line_end = 2 if data[:stride].endswith(b"\r\n") else 1
    if stride < CARD_WIDTH + line_end or len(data) % stride:
        return 0, 0
    lines = np.frombuffer(data, dtype=np.uint8).reshape(-1, stride)
    alike = (lines[:, -1] == _LF).all() and (line_end == 1 or (lines[:, -2] == _CR).all())
    return (stride, line_end) if alike else (0, 0)


def _is_unprintable(every: ByteArray) -> NDArray[np.bool_]:
    # Unsigned differences wrap: one comparison finds what is below the blank and what is above the tilde.
    unprintable: NDArray[np.bool_] = every - np.uint8(ord(" ")) > ord("~") - ord(" ")
    return unprintable


def _bad_bytes(every: ByteArray) -> IntArray:
    """Return the places of the bytes that are neither printable ASCII nor part of a line end."""
    places = np.flatnonzero(_is_unprintable(every))
    found, after = every[places], every[np.minimum(places + 1, len(every) - 1)]
    line_end = (found == _LF) | ((found == _CR) & (after == _LF))
    bad: IntArray = places[~line_end]
    return bad


def _locate(data: bytes, places: IntArray) -> Iterator[BadCharacter]:
    ends = np.flatnonzero(np.frombuffer(data, dtype=np.uint8) == _LF)
    for place, line in zip(places.tolist(), np.searchsorted(ends, places).tolist(), strict=True):
        start = int(ends[line - 1]) + 1 if line else 0
        yield BadCharacter(line=line + 1, column=place - start + 1, byte=data[place])
