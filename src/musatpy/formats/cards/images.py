"""A file as card images: lines cut or filled to 80 columns, and every character that is no card character."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import ByteArray
from musatpy.formats.cards.spec import CARD_WIDTH

_LF, _TAB = b"\n\t"
_SUBSTITUTE = ord("?")  # in place of characters that no card has


@dataclass(frozen=True, kw_only=True, eq=False)
class CardImages:
    """The lines of a file, which end with LF or CR LF, as cards of 80 columns."""

    cards: ByteArray  # (count, 80), `?` in place of characters that no card has
    overlong: Mapping[int, str]  # lines (1-based) that go on beyond column 80 with more than blanks
    bad_characters: tuple[tuple[int, int, str], ...]  # line and column, 1-based, and what no card may hold there

    @property
    def count(self) -> int:
        """The number of lines."""
        return len(self.cards)

    def text(self, line: int) -> str:
        """Return line `line` (1-based) as text, without trailing blanks."""
        if not 1 <= line <= self.count:
            raise IndexError(f"line {line} of {self.count}")
        return self.overlong.get(line) or self.cards[line - 1].tobytes().decode("ascii").rstrip(" ")


def card_images(data: bytes) -> CardImages:
    """Return the card images of the bytes of a file."""
    data = data.replace(b"\r\n", b"\n")
    # Unsigned differences wrap: one comparison finds what is below the blank and what is above the tilde.
    every = np.frombuffer(data, dtype=np.uint8)
    bad = np.flatnonzero(every - np.uint8(ord(" ")) > ord("~") - ord(" "))
    bad = bad[every[bad] != _LF]
    characters = tuple(_located(data, bad.tolist()))
    if characters:
        mended = every.copy()
        mended[bad] = _SUBSTITUTE
        data = mended.tobytes()
    lines = data.split(b"\n")
    if not lines[-1]:  # the file ends with a line end
        lines.pop()
    cards = np.array(lines, dtype=f"S{CARD_WIDTH}").view(np.uint8).reshape(len(lines), CARD_WIDTH)
    np.maximum(cards, ord(" "), out=cards)  # short lines end in zeros
    long = {number: line.rstrip(b" ") for number, line in enumerate(lines, 1) if len(line) > CARD_WIDTH}
    overlong = {number: line.decode("ascii") for number, line in long.items() if len(line) > CARD_WIDTH}
    return CardImages(cards=cards, overlong=overlong, bad_characters=characters)


def _located(data: bytes, places: list[int]) -> Iterator[tuple[int, int, str]]:
    """Yield line, column, and in words what is there: a tab, a control character, or a byte outside ASCII."""
    line, start = 1, 0
    for place in places:
        line += data.count(b"\n", start, place)
        start = max(start, data.rfind(b"\n", start, place) + 1)
        byte = data[place]
        kind = f"{'control' if byte < 128 else 'non-ASCII'} character (byte {byte:#04x})"
        yield line, place - start + 1, "tab character" if byte == _TAB else kind
