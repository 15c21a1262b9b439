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
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import numpy as np

from musatpy.fortran import Edit, parse_edit, write_number
from musatpy.units import dms_from_radians

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
    plain = values.tolist() if isinstance(values, np.ndarray) else list(values)
    sexagesimal = _SEXAGESIMAL.fullmatch(descriptor)
    if sexagesimal:
        return _angles(plain, int(sexagesimal[1]), int(sexagesimal[2]))
    edit = parse_edit(descriptor)
    if edit.letter == "A":
        return _at_once(f"%-{edit.width}.{edit.width}s", plain)
    if edit.letter == "F":
        return _fixed(plain, edit)
    return [_number(value, edit) for value in plain]


def number_text(descriptor: str, value: float) -> str:
    """Return the text of one number without the blanks around it."""
    return edited(descriptor, [value])[0].strip()


def prints_as_zero(descriptor: str, value: float) -> bool:
    """Tell whether a field shows no digit but zeros: what is left is rounding error, different on each machine."""
    return not re.search("[1-9*]", edited(descriptor, [value])[0])


def _fixed(values: list[float], edit: Edit) -> list[str]:
    """Edit by Fw.d: all at once, then one by one again what has no value or no room for a blank before it."""
    zeros = "0" * edit.decimals
    joined = _joined(f"%#{edit.width}.{edit.decimals}f", values)
    joined = joined.replace(f"-0.{zeros}\0", f" 0.{zeros}\0")  # no sign of what rounds to zero
    texts = joined.replace(" 0.", "  .").replace(" -0.", "  -.").split("\0")[:-1]
    size, room = np.abs(np.array(values, dtype=float)), edit.width - edit.decimals
    plain = size < (10.0 ** (room - 2) - 1.0 if edit.decimals and room > 3 else 0.0)
    for row in np.flatnonzero(~plain).tolist():
        texts[row] = _number(values[row], edit)
    return texts


def _at_once(template: str, values: list[Any]) -> list[str]:
    """Return `template % value` of each value."""
    return _joined(template, values).split("\0")[:-1]


def _joined(template: str, values: list[Any]) -> str:
    """Return `template % value` of each value and a null, in one operation: a large block has millions of them."""
    return (template + "\0") * len(values) % tuple(values)


@lru_cache(maxsize=4096)
def _number(value: float, edit: Edit) -> str:
    return _without_zero(write_number(value, edit))


def _without_zero(text: str) -> str:
    """Return a number without the zero before its point, as wide as it was: `  0.281` becomes `   .281`."""
    return _LEADING_ZERO.sub("", text).rjust(len(text))


def _angles(angles: list[float], width: int, decimals: int) -> list[str]:
    """Edit rad as degrees, minutes, seconds in fields of their own; the sign sits on the degrees, zero included."""
    edit = Edit(letter="F", width=decimals + 4, decimals=decimals)
    numbers = np.array(angles, dtype=float)
    parts = dms_from_radians(np.where(np.isfinite(numbers), numbers, 0.0), decimals)
    texts = []
    for angle, d, m, s in zip(angles, *(part.tolist() for part in parts), strict=True):
        if not math.isfinite(angle):
            texts.append((" " if math.isnan(angle) else "*") * width)
            continue
        sign = "-" if math.copysign(1.0, d) < 0.0 and (d or m or s) else ""
        text = f"{sign}{abs(d):.0f}{m:3.0f}{_number(s, edit)}"
        texts.append(text.rjust(width) if len(text) <= width else "*" * width)
    return texts
