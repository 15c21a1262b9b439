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


def _recorded(heading: str) -> tuple[str, str]:
    """Return a heading in one line, and the unit that the record has."""
    words, unit = named(heading)
    return words, "rad" if unit == SEXAGESIMAL else _RECORDED.get(unit, unit)


def with_unit(heading: str) -> str:
    """Return a heading in one line, with the unit of the record in brackets: `East (m)`."""
    words, unit = _recorded(heading)
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


def recorded_unit(heading: str | Sequence[str] | Headings) -> str:
    """Return the unit in the record of what is printed below a heading, empty where components have several."""
    texts = heading.usual if isinstance(heading, Headings) else [heading] if isinstance(heading, str) else heading
    units = {_recorded(text)[1] for text in texts}
    return "".join(units - {"sigmas"}) if len(units) == 1 else ""


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
    if sexagesimal := _SEXAGESIMAL.fullmatch(descriptor):
        return _angles(np.asarray(column, dtype=float), *map(int, sexagesimal.groups()))
    one, numbers = _editing_of(descriptor), np.asarray(column) if len(column) >= MANY else np.zeros(0)
    if descriptor[0] == "F" and numbers.dtype.kind in "fiu" and len(numbers):
        return _at_once(parse_edit(descriptor), numbers, one)
    return [one(value) for value in (column.tolist() if isinstance(column, np.ndarray) else column)]


def _at_once(edit: Edit, values: NDArray[Any], one: Callable[[Any], str]) -> list[str]:
    """Return the texts of numbers (n,) under F by one formatting; `one` edits what is not finite or too wide."""
    if not edit.decimals:
        return [one(value) for value in values.tolist()]
    zeros = "0" * edit.decimals
    text = f"\n%{edit.width}.{edit.decimals}f" * len(values) % tuple(values.tolist()) + "\n"
    text = text.replace(f"-0.{zeros}\n", f" 0.{zeros}\n")
    text = text.replace(" 0.", "  .").replace("\n0.", "\n .").replace("-0.", " -.")
    texts, blank = text[1:-1].split("\n"), " " * edit.width
    for row in np.flatnonzero(~np.isfinite(values) | (np.fromiter(map(len, texts), int) != edit.width)).tolist():
        texts[row] = blank if values[row] != values[row] else one(values[row].item())
    return texts


@lru_cache
def _editing_of(descriptor: str) -> Callable[[Any], str]:
    """Return the function that edits one value; raises `FieldError` where `descriptor` is none."""
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
    text = write_number(value, edit)
    return _LEADING_ZERO.sub("", text).rjust(len(text))  # `  0.281` becomes `   .281`


def _angles(angles: NDArray[Any], width: int, decimals: int) -> list[str]:
    """Edit rad as degrees, minutes, seconds in fields of their own; the sign sits on the degrees, zero included."""
    texts, seconds = [], Edit(letter="F", width=decimals + 4, decimals=decimals)
    parts = dms_from_radians(np.where(np.isfinite(angles), angles, 0.0), decimals)
    for angle, d, m, s in zip(angles.tolist(), *(part.tolist() for part in parts), strict=True):
        sign = "-" if math.copysign(1.0, d) < 0.0 and (d or m or s) else ""
        text = f"{sign}{abs(d):.0f}{m:3.0f}{_number(s, seconds)}".rjust(width)
        if not math.isfinite(angle):
            text = (" " if math.isnan(angle) else "*") * width
        texts.append(text if len(text) <= width else "*" * width)
    return texts
