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
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.fortran import Edit, parse_edit, write_number
from musatpy.model import CoordinateSystem
from musatpy.units import ARC_SECOND, DEGREE, GON, HECTOPASCAL, MICROMETRE, dms_from_radians

# What headings call a unit -> that unit in units of the record, which has mm on the plate and rad.
PRINTED = {"um": MICROMETRE, "arc sec": ARC_SECOND, "degrees": DEGREE, "gon": GON, "hPa": HECTOPASCAL}
SEXAGESIMAL = "D  M  S"  # how headings of degrees, minutes and seconds begin
_RECORDED = {"um": "mm", "arc sec": "rad", "degrees": "rad", "gon": "rad", "hPa": "Pa"}
_UNITS = frozenset({*_RECORDED.values(), "m", "s", "m/s", "unit", "mm/unit", "deg", "sigmas"})
_METRIC = (CoordinateSystem.LOCAL, CoordinateSystem.GEOCENTRIC, "MODEL")


def printed_unit(heading: str) -> float:
    """Return what one of the unit that a heading ends with is in units of the record."""
    last = heading.split("\n")[-1]
    return PRINTED.get(last) or PRINTED.get(last.rpartition(" ")[2], 1.0)


def named(heading: str) -> tuple[str, str]:
    """Return a heading in one line, and the unit that its numbers are printed in: `East`, `m`; empty: none."""
    *words, last = heading.split("\n")
    name, _, inside = last.rpartition(" ")
    if words and last.startswith(SEXAGESIMAL):
        return " ".join(words).strip(), SEXAGESIMAL
    if words and _RECORDED.get(last, last) in _UNITS:
        return " ".join(words).strip(), last
    if inside in _RECORDED:  # `RMS x um`
        return " ".join([*words, name]).strip(), inside
    return " ".join((*words, last)).strip(), ""


def with_unit(heading: str) -> str:
    """Return a heading in one line, with the unit of the record in brackets: `East (m)`."""
    words, unit = named(heading)
    unit = "rad" if unit == SEXAGESIMAL else _RECORDED.get(unit, unit)
    return f"{words} ({unit})" if unit else words


@dataclass(frozen=True)
class Headings:
    """Headings and edit descriptors of the components of a vector, and those in some coordinate systems."""

    usual: Sequence[str]
    edits: Sequence[str]
    other: Sequence[str]
    other_edits: Sequence[str]
    systems: tuple[str, ...]  # in which the others stand

    def of(self, system: str) -> tuple[Sequence[str], Sequence[str]]:
        """Return headings and edit descriptors in a job of a system."""
        return (self.other, self.other_edits) if system in self.systems else (self.usual, self.edits)


def position(decimals: int) -> Headings:
    """Return the headings of positions (n, 3) in the system of the job, metres with `decimals`."""
    return Headings(
        ("Latitude\nD  M  S    ", "Longitude\nD  M  S    ", "Elevation\nm"),
        ("S16.5", "S16.5", f"F11.{decimals}"),
        ("X\nm", "Y\nm", "Z\nm"),
        (f"F15.{decimals}",) * 3,
        _METRIC,
    )


def along_axes(label: str = "", edit: str = "F9.3", unit: str = "\nm") -> Headings:
    """Return the headings, behind a label, of what is along east, north, up; X, Y, Z in local jobs."""
    enu, xyz = ([f"{label}{name}{unit}" for name in names] for names in (("East", "North", "Up"), "XYZ"))
    return Headings(enu, (edit,) * 3, xyz, (edit,) * 3, (CoordinateSystem.LOCAL,))


ATTITUDES_AS_ANGLES = [f"{name}\nD  M  S   " for name in ("X-Tilt", "Y-Tilt", "Heading")]
ATTITUDE_SIGMAS = [f"Sigma {name}\narc sec" for name in ("X-T", "Y-T", "Hdg")]


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


Characters = NDArray[np.uint32]  # (n, width)
# Columns of print as characters, whole columns at once. `fortran.write_number` edits what does not fit, and what is
# so near a tie that the product with a power of ten does not tell which way it is rounded.
_BLANK, _MINUS, _POINT, _ZERO = map(ord, " -.0")
_EXACT = 1e15  # whole numbers below it are exact, and so are their halves
_SPACING = 2.0**-52


def blank(rows: int, width: int) -> Characters:
    """Return a column of blanks."""
    return np.full((width, rows), _BLANK, dtype=np.uint32).T  # filled character by character


def of_texts(texts: Sequence[str] | TextArray, width: int) -> Characters:
    """Return texts (n,), each cut or filled with blanks behind it."""
    table: Any = np.array(texts, dtype=f"U{width}").reshape(-1, 1).view(np.uint32)
    return np.where(table == 0, np.uint32(_BLANK), table)


def strings(table: Characters) -> list[str]:
    """Return the rows of characters as texts."""
    whole: Any = np.ascontiguousarray(table).view(f"U{table.shape[1]}")
    return list(whole.ravel().tolist())


def fixed(values: FloatArray, width: int, decimals: int) -> tuple[Characters, BoolArray]:
    """Return numbers (n,) with decimals, none of them wider than leaves a blank, and which (n,) are done.

    There is no zero before the point, no sign of what rounds to zero, and nothing but blanks of NaN.
    """
    room = width - decimals
    limit = 10.0 ** (room - 2) - 1.0 if decimals and room > 3 else 0.0
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.abs(values)
        scaled = size * 10.0**decimals
        nearest = np.rint(scaled)
        done = (size < limit) & (scaled < _EXACT) & (np.abs(np.abs(scaled - nearest) - 0.5) > _SPACING * scaled)
    table, number = blank(len(values), width), _whole(nearest, done)
    left = _digits(table, number, width, decimals)
    point = width - decimals - 1
    table[:, point] = _POINT
    _signed(table, left, (values < 0.0) & (number > 0), point, least=0)
    nothing = np.isnan(values)
    table[nothing] = _BLANK
    return table, done | nothing


def whole_numbers(values: NDArray[Any], negative: BoolArray, width: int) -> tuple[Characters, BoolArray]:
    """Return whole numbers (n,), none wider than leaves a blank, with signs where told, and which (n,) are done."""
    with np.errstate(invalid="ignore"):
        size = np.abs(values)
        done = size < min(10.0 ** (width - 1), _EXACT) if width > 1 else np.zeros(len(values), dtype=bool)
    table = blank(len(values), width)
    _signed(table, _whole(size, done), negative & done, width, least=1)
    return table, done


def _whole(size: NDArray[Any], done: BoolArray) -> NDArray[Any]:
    """Return whole numbers, zero where they are not done; short ones are divided in half the time."""
    number = np.where(done, size, 0).astype(np.int64)
    return number.astype(np.uint32) if number.max(initial=0) < 2**32 else number


def _digits(table: Characters, number: NDArray[Any], end: int, count: int) -> NDArray[Any]:
    """Write the last `count` digits of numbers before the column `end`; return what is left of the numbers."""
    for column in range(end - 1, end - 1 - count, -1):
        left = number // 10
        table[:, column] = number - 10 * left + _ZERO
        number = left
    return number


def _signed(table: Characters, number: NDArray[Any], negative: BoolArray, end: int, *, least: int) -> None:
    """Write whole numbers before the column `end`, of `least` digits, and the signs before them."""
    first = np.full(len(number), end)
    for column in range(end - 1, -1, -1):
        shown = number > 0 if column < end - least else np.ones(len(number), dtype=bool)
        if not shown.any():
            break
        left = number // 10
        table[:, column] = np.where(shown, number - 10 * left + _ZERO, _BLANK)
        first -= shown
        number = left
    rows = np.flatnonzero(negative)
    table[rows, first[rows] - 1] = _MINUS
