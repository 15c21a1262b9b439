"""A file as card images: lines found and padded, and every character that is no card character reported."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, ByteArray, IntArray, WordArray
from musatpy.formats.cards.spec import CARD_WIDTH

_LF, _CR, _TAB = b"\n\r\t"
_BLOCK = 1 << 18  # bytes looked at in one go: temporaries stay in the cache
_SUBSTITUTE = ord("?")  # in place of characters that no card has
_BLANKS = np.uint64(int.from_bytes(b" " * 8, "little"))
_FIRST_BYTES = np.array([256**count - 1 for count in range(9)], dtype=np.uint64)  # 0xFF in so many bytes


@dataclass(frozen=True, kw_only=True, eq=False)
class CardImages:
    """The lines of a file, each readable as a card of 80 columns.

    Lines end with LF or CR LF. Where all are equally long and have 80 columns, card images are views of the file;
    else they are copies, cut or filled with blanks.
    """

    data: bytes  # the file, characters that no card has replaced
    count: int  # lines
    stride: int  # bytes from line to line; 0 where lines differ or are shorter than a card
    bad_characters: tuple[tuple[int, int, str], ...]  # line and column, 1-based, and what no card may hold there

    @cached_property
    def _bytes(self) -> ByteArray:
        return np.frombuffer(self.data, dtype=np.uint8)

    @cached_property
    def _starts(self) -> IntArray:
        """(count + 1,) first byte of each line, and of the line after the last, as if that were ended."""
        if self.stride:
            return np.arange(self.count + 1) * self.stride
        after = [np.flatnonzero(block == _LF) + (offset + 1) for offset, block in _blocks(self.data)]
        starts = np.concatenate([np.zeros(1, dtype=np.int64), *after])
        return starts if len(starts) > self.count else np.append(starts, len(self.data) + 1)

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
        words = self._words_from(starts)
        lengths = self._ends(lines) - starts
        for word in range(int(lengths.min(initial=CARD_WIDTH)) // 8, CARD_WIDTH // 8):
            inside = _FIRST_BYTES[np.clip(lengths - 8 * word, 0, 8)]
            words[:, word] = (words[:, word] & inside) | (_BLANKS & ~inside)
        return words.astype("<u8", copy=False).view(np.uint8)

    def _words_from(self, starts: IntArray) -> WordArray:
        """Return the (k, 10) words of 80 bytes of the file from `starts` (k,) on; beyond its end, whatever."""
        every = np.frombuffer(self.data, dtype="<u8", count=len(self.data) // 8)
        words = np.empty((len(starts), CARD_WIDTH // 8), dtype=np.uint64)
        inside = int(np.searchsorted(starts, 8 * (len(every) - words.shape[1]), side="left"))
        # A card starts anywhere in a word: the high end of each word goes before the low end of the next one.
        first, down = starts[:inside] >> 3, (8 * (starts[:inside] & 7)).astype(np.uint64)
        up = np.uint64(64) - down  # numpy shifts by 64 to zero
        word = every.take(first)
        for place in range(words.shape[1]):
            following = every.take(first + place + 1)
            words[:inside, place] = (word >> down) | (following << up)
            word = following
        last = self._bytes.take(starts[inside:, None] + np.arange(CARD_WIDTH), mode="clip")
        words[inside:] = last.view("<u8")
        return words

    def overlong(self) -> Iterator[tuple[int, int]]:
        """Yield (line, last column), 1-based, of the lines that go on beyond column 80 with more than blanks."""
        if self.stride and self.data[CARD_WIDTH : self.stride] in (b"\n", b"\r\n"):
            return  # all of them end there
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
    stride = data.find(b"\n") + 1
    line_end = b"\r\n" if data[:stride].endswith(b"\r\n") else b"\n"
    card_wide = stride >= CARD_WIDTH + len(line_end)
    if card_wide and not data.endswith(b"\n") and (len(data) + len(line_end)) % stride == 0:
        data += line_end
    unprintable = sum(int(np.count_nonzero(_is_unprintable(block))) for _, block in _blocks(data))
    if card_wide and unprintable * stride == len(data) * len(line_end) and _is_even(data, stride, line_end):
        return CardImages(data=data, count=len(data) // stride, stride=stride, bad_characters=())
    return _uneven_images(data, unprintable)


def _is_even(data: bytes, stride: int, line_end: bytes) -> bool:
    """Return whether every `stride` bytes are a line with its end."""
    if len(data) % stride:
        return False
    ends = np.frombuffer(data, dtype=np.uint8).reshape(-1, stride)[:, -len(line_end) :]
    return bool((ends == np.frombuffer(line_end, dtype=np.uint8)).all())


def _uneven_images(data: bytes, unprintable: int) -> CardImages:
    """Return the images of a file of which all that is known is how many bytes are not printable."""
    characters: tuple[tuple[int, int, str], ...] = ()
    feeds, returns = data.count(b"\n"), data.count(b"\r")
    if unprintable != feeds + returns or (returns and data.count(b"\r\n") != returns):
        bad = _bad_bytes(data)
        characters = tuple(_locate(data, bad))
        mended = np.frombuffer(data, dtype=np.uint8).copy()
        mended[bad] = _SUBSTITUTE
        data = mended.tobytes()
    last_open = bool(data) and not data.endswith(b"\n")
    return CardImages(data=data, count=feeds + last_open, stride=0, bad_characters=characters)


def _bad_bytes(data: bytes) -> IntArray:
    """Return the places of the bytes that are neither printable ASCII nor part of a line end."""
    every = np.frombuffer(data, dtype=np.uint8)
    places = np.flatnonzero(_is_unprintable(every))
    byte, after = every[places], every[np.minimum(places + 1, len(every) - 1)]
    line_end = (byte == _LF) | ((byte == _CR) & (after == _LF))
    bad: IntArray = places[~line_end]
    return bad


def _locate(data: bytes, places: IntArray) -> Iterator[tuple[int, int, str]]:
    """Yield line, column, and in words what is there: a tab, a control character, or a byte outside ASCII."""
    ends = np.flatnonzero(np.frombuffer(data, dtype=np.uint8) == _LF)
    for place, line in zip(places.tolist(), np.searchsorted(ends, places).tolist(), strict=True):
        start, byte = int(ends[line - 1]) + 1 if line else 0, data[place]
        kind = f"{'control' if byte < 128 else 'non-ASCII'} character (byte {byte:#04x})"
        yield line + 1, place - start + 1, "tab character" if byte == _TAB else kind


def _blocks(data: bytes) -> Iterator[tuple[int, ByteArray]]:
    """Yield the bytes in blocks, each with its offset."""
    every = np.frombuffer(data, dtype=np.uint8)
    for offset in range(0, len(every), _BLOCK):
        yield offset, every[offset : offset + _BLOCK]


def _is_unprintable(every: ByteArray) -> BoolArray:
    # Unsigned differences wrap: one comparison finds what is below the blank and what is above the tilde.
    unprintable: BoolArray = every - np.uint8(ord(" ")) > ord("~") - ord(" ")
    return unprintable
