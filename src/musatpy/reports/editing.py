"""Numbers as MUSAT printed them: the output editing of whole columns.

An edit descriptor is FORTRAN's (`A8`, `I5`, `F10.3`, `E11.3`), or `S14.3` for a sexagesimal angle: degrees, minutes
and seconds with three decimals in 14 columns. The tables of ETL-0306 print no zero before the decimal point, and
so do we. A value that rounds to zero prints without sign (ANSI X3.9-1978, 13.5.9, forbids a negative zero in a
record; that holds for a sexagesimal angle as a whole), a missing one (NaN) prints blanks, and one that does not fit
its field prints asterisks. Text is a FORTRAN 77 character variable of the width of its field: left-justified, cut
where longer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import BoolArray, FloatArray
from musatpy.fortran import Edit, parse_edit, write_number
from musatpy.reports.characters import Characters, blank, fixed, of_texts, strings, whole_numbers
from musatpy.units import ARC_SECOND, dms_from_radians

MANY = 40  # values of a column, from which on they are edited at once
_LEADING_ZERO = re.compile(r"(?<!\d)0(?=\.\d)")
_SEXAGESIMAL = re.compile(r"S(\d+)\.(\d+)")


@lru_cache
def field_width(descriptor: str) -> int:
    """Return the width of an edit descriptor, `S` included; raises `FieldError` where it is none."""
    sexagesimal = _SEXAGESIMAL.fullmatch(descriptor)
    return int(sexagesimal[1]) if sexagesimal else parse_edit(descriptor).width


def edited(descriptor: str, values: Iterable[Any]) -> list[str]:
    """Return one text per value, each exactly as wide as the descriptor says; angles of `S` are radians.

    Raises `FieldError` where `descriptor` is none.
    """
    column = values if isinstance(values, np.ndarray) else list(values)
    if len(column) >= MANY:
        return strings(characters(descriptor, column))
    one = _editing_of(descriptor)
    return [one(value) for value in (column.tolist() if isinstance(column, np.ndarray) else column)]


def characters(descriptor: str, values: Sequence[Any] | NDArray[Any]) -> Characters:
    """Return the texts of `edited` as an array of characters (n, width), a whole column at once."""
    width, one = field_width(descriptor), _editing_of(descriptor)
    if descriptor.startswith("A"):
        is_text = isinstance(values, np.ndarray) and values.dtype.kind == "U"
        return of_texts(values if is_text else [one(value) for value in values], width)
    table, done = _at_once(descriptor, np.asarray(values), width)
    rows = np.flatnonzero(~done)
    table[rows] = of_texts([one(value) for value in np.asarray(values)[rows].tolist()], width)
    return table


def _at_once(descriptor: str, values: NDArray[Any], width: int) -> tuple[Characters, BoolArray]:
    """Return the characters of numbers (n,), and which of them (n,) are those that are wanted."""
    sexagesimal = _SEXAGESIMAL.fullmatch(descriptor)
    if sexagesimal:
        return _angles(values.astype(float), width, int(sexagesimal[2]))
    edit = parse_edit(descriptor)
    if edit.letter == "F":
        return fixed(values.astype(float), width, edit.decimals)
    if edit.letter == "I" and values.dtype.kind in "iu":
        return whole_numbers(values, values < 0, width)
    return blank(len(values), width), np.zeros(len(values), dtype=bool)


@lru_cache
def _editing_of(descriptor: str) -> Callable[[Any], str]:
    """Return the function that edits one value; raises `FieldError` where `descriptor` is none."""
    sexagesimal = _SEXAGESIMAL.fullmatch(descriptor)
    if sexagesimal:
        return partial(_angle, width=int(sexagesimal[1]), decimals=int(sexagesimal[2]))
    edit = parse_edit(descriptor)
    if edit.letter == "A":
        return f"%-{edit.width}.{edit.width}s".__mod__
    return partial(_number, edit=edit)


def number_text(descriptor: str, value: float) -> str:
    """Return the text of one number without the blanks around it."""
    return edited(descriptor, [value])[0].strip()


def with_decimals(descriptor: str, values: Any, card_width: int, spare: int) -> str:
    """Return the descriptor with as many more decimals, and columns, as numbers (n,) need, `spare` at most.

    Of each count the decimals that a field of a card has room for, `card_width` columns; what is computed has more.
    """
    letter, least = descriptor[0], int(descriptor.partition(".")[2] or 0)
    numbers = np.asarray(values, dtype=float)
    numbers = numbers[np.isfinite(numbers) & (numbers != 0.0)]
    if letter == "I" or not len(numbers):
        return descriptor
    size, signs = np.abs(numbers), (numbers < 0.0).astype(int)
    if letter == "S":
        size, signs = size / ARC_SECOND % 60.0, 0
    elif letter == "E":
        size, signs = size / 10.0 ** np.floor(np.log10(size) + 1.0), signs + len("E-00")
    digits = np.where(size < 1.0, 0, np.floor(np.log10(np.maximum(size, 1.0))) + 1.0)
    room = card_width - 1 - signs - digits
    most = min(least + spare, int(room.max()))
    more = 0
    while least + more < most and (np.abs(size - np.round(size, least + more)) >= 0.5 * 10.0**-room).any():
        more += 1
    return f"{letter}{field_width(descriptor) + more}.{least + more}" if more else descriptor


def prints_as_zero(descriptor: str, value: float) -> bool:
    """Tell whether a field shows no digit but zeros: what is left is rounding error, different on each machine."""
    return not re.search("[1-9*]", edited(descriptor, [value])[0])


@lru_cache(maxsize=4096)
def _number(value: float, edit: Edit) -> str:
    return _without_zero(write_number(value, edit))


def _without_zero(text: str) -> str:
    """Return a number without the zero before its point, as wide as it was: `  0.281` becomes `   .281`."""
    return _LEADING_ZERO.sub("", text).rjust(len(text))


def _angle(angle: float, width: int, decimals: int) -> str:
    """Edit rad as degrees, minutes, seconds in fields of their own; the sign sits on the degrees, zero included."""
    if not math.isfinite(angle):
        return (" " if math.isnan(angle) else "*") * width
    d, m, s = (float(part) for part in dms_from_radians(angle, decimals))
    sign = "-" if math.copysign(1.0, d) < 0.0 and (d or m or s) else ""
    text = f"{sign}{abs(d):.0f}{m:3.0f}{_number(s, Edit(letter='F', width=decimals + 4, decimals=decimals))}"
    return text.rjust(width) if len(text) <= width else "*" * width


def _angles(angles: FloatArray, width: int, decimals: int) -> tuple[Characters, BoolArray]:
    """Return what `_angle` does of angles (n,) as characters, and which (n,) are done."""
    finite = np.isfinite(angles)
    degrees, minutes, seconds = dms_from_radians(np.where(finite, angles, 0.0), decimals)
    negative = np.signbit(degrees) & ((degrees != 0.0) | (minutes != 0.0) | (seconds != 0.0))
    last, done = fixed(seconds, decimals + 4, decimals)
    if width < decimals + 8:  # no column for the degrees
        return blank(len(angles), width), np.zeros(len(angles), dtype=bool)
    first, fits = whole_numbers(degrees, negative, width - decimals - 7)
    middle, _ = whole_numbers(minutes, np.zeros(len(angles), dtype=bool), 3)
    return np.concatenate([first, middle, last], axis=1), finite & done & fits
