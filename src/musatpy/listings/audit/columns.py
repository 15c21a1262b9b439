"""The cells of a column of a table: as texts, and as numbers.

Long tables are read by column: their rows are one array of characters, of which a column is a slice. Texts are made
of it where they are asked for; numbers, which our listings print flush right, digit by digit of all rows at one go.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, overload

import numpy as np

from musatpy.arrays import BoolArray, ByteArray, FloatArray
from musatpy.listings.audit.cells import printed
from musatpy.listings.audit.structures import Printed

Spans = tuple[tuple[int, int], ...]  # columns of print
_BLANK, _MINUS, _POINT, _ZERO = b" -.0"
# In what order the characters of a number stand before its point; others stand in none.
_ORDER = np.full(256, 3, dtype=np.uint8)
_ORDER[_BLANK], _ORDER[_MINUS], _ORDER[list(b"0123456789")] = 0, 1, 2
_LONGEST = 16  # characters of a number: 15 digits and the power of ten that they are over are exact
_NUMBER = re.compile(r"(?:-?\d{1,9} +\d{1,9} +)?-?(?:\d+\.?\d*|\.\d+)")


class Cells(Sequence[str]):
    """The cells of a column, stripped; blank where they are not legible."""

    def __init__(self, texts: Sequence[str] = (), characters: ByteArray | None = None) -> None:
        """Take texts, or characters (width, n) of ASCII in their place: one of all rows after another."""
        self._texts, self._characters = texts, characters

    @overload
    def __getitem__(self, index: int) -> str: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[str]: ...

    def __getitem__(self, index: int | slice) -> str | Sequence[str]:
        return self.texts[index]

    def __len__(self) -> int:
        return len(self._texts) if self._characters is None else self._characters.shape[1]

    def __iter__(self) -> Iterator[str]:
        return iter(self.texts)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Cells) and list(self) == list(other)

    @cached_property
    def texts(self) -> Sequence[str]:
        """The cells as texts."""
        if self._characters is None:
            return self._texts
        width, n = self._characters.shape
        if np.all(self._characters == _BLANK):
            return [""] * n
        text = self._characters.T.tobytes().decode("ascii")
        return [text[start : start + width].strip() for start in range(0, n * width, width)]

    @cached_property
    def decimals(self) -> int | None:
        """How many decimals the numbers have, where all cells are blank or numbers that end in one place."""
        return self._fixed.decimals if self._fixed else None

    @cached_property
    def is_blank(self) -> BoolArray:
        """Which cells (n,) are blank."""
        if self._fixed:
            return ~self._fixed.is_number
        return np.array([not text for text in self.texts], dtype=bool)

    @cached_property
    def numbers(self) -> tuple[FloatArray, FloatArray]:
        """The values (n,) and half their last digits (n,), NaN where a cell is no number; angles in arc seconds."""
        if self._fixed:
            return self._fixed.numbers()
        cells = (number(text, 0) for text in self.texts)
        pairs = [(math.nan, math.nan) if cell is None else cell[:2] for cell in cells]
        values, halves = np.array(pairs, dtype=float).reshape(-1, 2).T
        return values, halves

    @cached_property
    def _fixed(self) -> _Fixed | None:
        return None if self._characters is None else _fixed(self._characters)


class _Fixed(NamedTuple):
    """Blanks and numbers that have their points and ends in one place."""

    characters: ByteArray  # (width, n), from the first to the last that is no blank
    point: int

    @property
    def decimals(self) -> int:
        """How many decimals the numbers have."""
        return len(self.characters) - self.point - 1

    @property
    def is_number(self) -> BoolArray:
        """Which of the cells (n,) are no blanks."""
        return self.characters[self.point] == _POINT

    def numbers(self) -> tuple[FloatArray, FloatArray]:
        """Return what `Cells.numbers` is, to the last bit as `float` reads them."""
        units = np.zeros(self.characters.shape[1], dtype=np.int64)  # of the last decimal
        for digits in self.characters - _ZERO:
            units = np.where(digits <= 9, 10 * units + digits, units)
        is_negative = np.any(self.characters[: self.point] == _MINUS, axis=0)
        sizes = np.where(self.is_number, units / 10.0**self.decimals, math.nan)
        halves = np.where(self.is_number, 0.5 * 10.0**-self.decimals, math.nan)
        return np.where(is_negative, -sizes, sizes), halves


def _fixed(characters: ByteArray) -> _Fixed | None:
    """Return characters (width, n) of a column as numbers; None where a cell is neither blank nor such a one."""
    written = np.flatnonzero(np.any(characters != _BLANK, axis=1))
    points = np.flatnonzero(np.any(characters == _POINT, axis=1))
    if len(points) != 1 or points[0] == written[-1] or written[-1] - written[0] >= _LONGEST:
        return None
    fixed = _Fixed(characters[written[0] : written[-1] + 1], int(points[0] - written[0]))
    order = _ORDER[fixed.characters]
    before, behind = order[: fixed.point], order[fixed.point + 1 :]
    last = np.where(fixed.is_number, _ORDER[_ZERO], _ORDER[_BLANK])  # beside the point
    if np.any(behind != last) or np.any(before[-1:] > last):
        return None
    is_broken = (before[1:] < before[:-1]) | ((before[1:] == _ORDER[_MINUS]) & (before[:-1] == _ORDER[_MINUS]))
    return None if np.any(is_broken) else fixed


def number(text: str, line: int) -> Printed | None:
    """Return the number of a cell, None where it is blank, overflown or no number."""
    return printed(text, line) if _NUMBER.fullmatch(text) else None


def sliced(rows: Sequence[str], spans: Spans) -> list[Cells] | None:
    """Return the columns of rows of ASCII that have blanks alone between them; None where these are other rows."""
    width, text = spans[-1][1], "".join(rows)
    if not text.isascii() or any(len(row) != width for row in rows):
        return None
    characters = np.frombuffer(text.encode("ascii"), dtype=np.uint8).reshape(-1, width)
    characters = np.ascontiguousarray(characters.T)
    if any(np.any(characters[end:start] != _BLANK) for (_, end), (start, _) in pairwise(spans)):
        return None
    return [Cells(characters=characters[start:end]) for start, end in spans]
